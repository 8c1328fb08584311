"""Where a command writes: refused before any work, and in a sentence, if it cannot be."""

import csv
import json
import math
import os
import shutil
import tempfile
from contextlib import contextmanager
from pathlib import Path

from analysis import CannotAnswer, WrongUsage

DECIMALS = {  # as good as each column can be; a millimetre of position
    "t_s": 3, "lat_deg": 8, "lon_deg": 8, "pdop": 2, "out_lat_deg": 8, "out_lon_deg": 8,
    "roll_deg": 3, "pitch_deg": 3, "yaw_deg": 3, "mount_deg": 3,
}  # fmt: skip


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


def write(track, out):
    """Write track.csv and summary.json, both or neither.

    Parameters
    ----------
    track : analysis.tracker.log_replay.Track
    out : path-like
        Folder; made if need be. Files of an earlier replay there are replaced, others stay.

    Raises
    ------
    WrongUsage, CannotAnswer
        If the folder cannot be.
    """
    check_folder(out)
    out = Path(out)
    with writing(out):
        out.mkdir(parents=True, exist_ok=True)
        draft = Path(tempfile.mkdtemp(dir=out, prefix=".replay-"))
    try:
        with (draft / "track.csv").open("w", newline="", encoding="utf-8") as handle:
            writer = csv.writer(handle, lineterminator="\n")
            writer.writerow(track.columns)
            cells = [_cells(name, column) for name, column in track.columns.items()]
            writer.writerows(zip(*cells, strict=True))
        text = json.dumps(_rounded(track.summary), indent=1, ensure_ascii=False)
        (draft / "summary.json").write_text(text + "\n", encoding="utf-8")
        for path in sorted(draft.iterdir()):
            os.replace(path, out / path.name)
    finally:
        shutil.rmtree(draft, ignore_errors=True)


def told(summary):
    """Yield what a replay found, one sentence a line."""
    for note in summary["notes"]:
        yield f"note: {note}"
    fixes, static, mount = summary["fixes"], summary["static"], summary["mounting"]
    yield (
        f"fixes: {fixes['with_fix']:,} in {summary['source']['epochs']:,} epochs, "
        f"{fixes['accepted']:,} accepted, {fixes['refused']:,} refused"
    )
    if fixes["first_output_s"] is not None:
        yield f"first position put out after {fixes['first_output_s']:.1f} s"
    layers = ", ".join(f"{s:.0f}" for s in static["seconds_in_layer"])
    yield f"standing still for {static['seconds']:.0f} s, of which in layers 1, 2, 3: {layers} s"
    if mount["deg"] is not None:
        yield (
            f"mounting angle {mount['deg']:.1f}° ± {1.96 * mount['sigma_deg']:.1f}° (95 %) from "
            f"{mount['straights']} straights; by eq (3) as printed {mount['printed_rule_deg']:.1f}°"
        )
    elif mount["straights"]:
        yield f"no mounting angle: {mount['straights']} straights, too little acceleration on them"


def _cells(name, column):
    """Write a column: whole numbers as such, others rounded, nothing where there is no value."""
    if column.dtype.kind in "iub":
        return [str(int(v)) for v in column]
    return ["" if v != v else f"{v:.{DECIMALS[name]}f}" for v in column.tolist()]


def _rounded(value):
    """Round every number to six digits, and write NaN and infinities as null."""
    if isinstance(value, dict):
        return {k: _rounded(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_rounded(v) for v in value]
    if isinstance(value, float):
        return float(f"{value:.6g}") if math.isfinite(value) else None
    return value
