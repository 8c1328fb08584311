"""How a command writes its files: all of them or none, and a disk error becomes a sentence."""

import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

from analysis import CannotAnswer


@contextmanager
def writing(out):
    """Turn an error of the disk into `CannotAnswer`."""
    try:
        yield
    except OSError as error:
        raise CannotAnswer(f"--out {out}: cannot write there ({error.strerror})") from error


@contextmanager
def replacing(out, earlier=()):
    """Give a draft folder whose files are moved into `out` once all of them are written.

    Parameters
    ----------
    out : path-like
        Folder; made if need be. Other files there stay.
    earlier : iterable of path-like, optional
        Files of an earlier run, relative to `out`, to remove if they are not written again.

    Yields
    ------
    pathlib.Path

    Raises
    ------
    CannotAnswer
        If the folder cannot be written.
    """
    out = Path(out)
    with writing(out):
        where = out if out.is_dir() else out.parent
        where.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=where, prefix=".draft-"))
        try:
            yield draft
            written = [p.relative_to(draft) for p in sorted(draft.rglob("*")) if p.is_file()]
            for path in written:
                (out / path).parent.mkdir(parents=True, exist_ok=True)
                os.replace(draft / path, out / path)
            for path in {Path(p) for p in earlier} - set(written):
                (out / path).unlink(missing_ok=True)
        finally:
            shutil.rmtree(draft, ignore_errors=True)
