"""Where a command writes: refused before any work, and in a sentence, if it cannot be."""

from contextlib import contextmanager
from pathlib import Path

from analysis import CannotAnswer, WrongUsage


def check_folder(out):
    """Refuse an output folder that cannot be, before any work is done."""
    out = Path(out)
    if out.exists() and not out.is_dir():
        raise WrongUsage(f"--out {out.name}: there is a file of that name; name a folder")


def check_file(out):
    """Refuse an output file that cannot be, before any work is done."""
    out = Path(out)
    if out.is_dir():
        raise WrongUsage(f"--out {out.name}: there is a folder of that name; name a file")


@contextmanager
def writing(out):
    """Turn an error of the disk into a sentence."""
    try:
        yield
    except OSError as error:
        raise CannotAnswer(f"--out {out}: cannot write there ({error.strerror})") from error
