"""A CSV log of something that moves -> GNSS epochs and IMU samples, found by the columns' names."""

import numpy as np

from analysis import CannotAnswer, WrongUsage
from analysis.logs import clock, columns, delimited, moments, quantities
from analysis.logs.grid import BadStamps
from analysis.logs.layout import CLOCK
from analysis.logs.timeline import Gnss, Imu

SENSOR_GAPS = 0.01  # share of IMU rows that may lack a value, or step back
NEEDED = {
    "positions": ("lat_deg", "lon_deg"),
    "the readings of an IMU": (
        *(f"gyro_{axis}_deg_s" for axis in "xyz"),
        *(f"accel_{axis}_m_s2" for axis in "xyz"),
    ),
}
HELD = 0.6  # share of rows with the position of the row before: a held output beside an IMU
HELD_S = 1.0  # s after which a receiver that says the same again is believed to have said it anew


def read(path, wanted=None):
    """Read a CSV log.

    Parameters
    ----------
    path : Path
    wanted : dict, optional
        Our names (``speed_km_h``, ``gyro_x_deg_s``, ``t_s``) -> the file's columns, for those whose
        name does not say it; a minus before the column turns its sign.

    Returns
    -------
    Gnss or None, Moments or None
    Imu or None, Moments or None
    list of str
        What was assumed or repaired.

    Raises
    ------
    CannotAnswer, WrongUsage
        Naming file, line and column.
    """
    table = delimited.read(path)
    frame = quantities.renamed(table.frame, wanted or {}, path.name)
    notes = [f"{path.name}: {repair}" for repair in table.repairs]
    name = next((n for n in frame if clock.is_time(n)), None)
    if name is None:
        clocks = [n for n in frame if frame[n].dtype.kind != "f"]
        clocks = [n for n in clocks if CLOCK.match(str(frame[n].iloc[0]).strip())]
        name = clocks[0] if len(clocks) == 1 else None
    if name is None:
        raise WrongUsage(
            f"{path.name}, line 1: no column is named as time; say --columns t_s=COLUMN; there "
            f"are: {', '.join(frame)}"
        )
    try:
        stamps = moments.read(name, frame[name].to_numpy())
    except BadStamps as error:
        where = f"{path.name}, {table.where(error.row)}, column '{name}'"
        raise CannotAnswer(f"{where}: {error.message}") from error
    except WrongUsage as error:
        raise WrongUsage(f"{path.name}: {error}") from error
    notes += [f"{path.name}: {note}" for note in stamps.notes]
    found = quantities.meanings(frame.drop(columns=name))
    t = stamps.t_s

    def place(row):
        return f"{path.name}, {table.where(int(row))}, column '{name}'"

    gnss = _gnss(frame, found, t, place, path.name, notes)
    imu = _imu(frame, found, t, place, path.name, notes)
    lacks = list(_lacks(found))
    if gnss is None and imu is None:
        neither = (
            "neither positions (lat_deg, lon_deg) nor an IMU (accel_x_m_s2 ..., gyro_x_deg_s ...)"
        )
        raise WrongUsage(
            f"{path.name}, line 1: {'; '.join(lacks) or neither}; say --columns OURS=THEIRS; there "
            f"are: {', '.join(frame)}"
        )
    notes += [f"{path.name}: {lack}: not used" for lack in lacks]

    def stamped(part):
        return None if part is None else moments.Moments(part.t_s, stamps.clock)

    return gnss, stamped(gnss), imu, stamped(imu), notes


def _lacks(found):
    """Say what is missing where a part of the columns is there."""
    for what, needed in NEEDED.items():
        missing = [name for name in needed if columns.split(name)[0] not in found]
        if 0 < len(missing) < len(needed):
            yield f"{what} lack {', '.join(missing)}"


def _gnss(frame, found, t, place, file, notes):
    """Make the epochs: the rows at which the receiver said something."""
    if not {"lat", "lon"} <= set(found):
        return None
    said = {m: frame[found[m][0]].to_numpy() for m in found if not m.startswith(("accel", "gyro"))}
    rows = np.flatnonzero(np.isfinite(t) & np.any([np.isfinite(v) for v in said.values()], axis=0))
    place_of = np.column_stack([said["lat"][rows], said["lon"][rows]])
    changed = np.r_[True, (np.diff(place_of, axis=0) != 0).any(axis=1)]
    if any(m.startswith("accel") for m in found) and np.mean(~changed) > HELD:
        keep, last = [], -np.inf
        for k, row in enumerate(rows):
            if changed[k] or t[row] - last >= HELD_S:
                keep.append(k)
                last = t[row]
        notes.append(f"{file}: a position is held over rows: {len(keep):,} epochs where it changes")
        rows = rows[keep]
    keep, twice = [], 0
    for row in rows:
        if not keep or t[row] > t[keep[-1]]:
            keep.append(row)
        elif t[row] == t[keep[-1]]:
            twice += 1
        else:
            back = t[keep[-1]] - t[row]
            raise CannotAnswer(f"{place(row)}: time goes backward by {back:.6g} s; cut it there")
    if twice:
        notes.append(f"{file}: {twice:,} epochs at a time already there, left out")
    at = np.array(keep, dtype=int)

    def column(meaning):
        return said[meaning][at] if meaning in said else np.full(len(at), np.nan)

    lat, lon = column("lat"), column("lon")
    fix = np.isfinite(lat) & np.isfinite(lon) & ~((lat == 0) & (lon == 0))
    if "fix" in said:
        fix &= column("fix") > 0
    beyond = fix & ~((np.abs(lat) <= 90) & (np.abs(lon) <= 360))
    if beyond.any():
        row = at[int(np.argmax(beyond))]
        where = place(row).rsplit(",", 1)[0] + f", column '{found['lat'][0]}'"
        raise CannotAnswer(f"{where}: {lat[beyond][0]:g}, {lon[beyond][0]:g} is nowhere on Earth")
    speed = column("speed")
    if "speed" in said:
        name, unit = found["speed"]
        if unit is None:
            unit = quantities.speed_unit(t[at], lat, lon, speed, name, file)
            notes.append(f"{file}: column '{name}' read as {unit.replace('_', '/')}")
        if (speed < 0).any():
            notes.append(f"{file}: column '{name}': {(speed < 0).sum():,} below zero, left out")
        speed = np.where(speed >= 0, speed, np.nan) * quantities.SPEED[unit]
    if found.get("course", ("", None))[1] == "rad":
        said["course"] = np.degrees(said["course"])
    blank = {"lat_deg": lat, "lon_deg": lon, "height_m": column("height")}
    blank |= {"speed_m_s": speed, "course_deg": column("course")}
    blank = {name: np.where(fix, array, np.nan) for name, array in blank.items()}
    return Gnss(t_s=t[at], pdop=column("pdop"), has_fix=fix, **blank)


def _imu(frame, found, t, place, file, notes):
    """Make the samples: rows with all six readings, in SI units."""
    names = [f"{kind}_{axis}" for kind in ("gyro", "accel") for axis in "xyz"]
    if not set(names) <= set(found):
        return None
    readings = frame[[found[n][0] for n in names]].to_numpy(dtype=float)
    whole = np.isfinite(readings).all(axis=1) & np.isfinite(t)
    if not whole.any():
        raise CannotAnswer(f"{file}: no row has all six IMU readings and a time")
    rows = np.flatnonzero(whole)
    ahead = np.maximum.accumulate(t[rows])
    forward = np.r_[True, t[rows][1:] > ahead[:-1]]
    sparse = 1 - len(rows) / len(readings) if "lat" not in found else 0.0
    late = np.flatnonzero(~forward)
    if len(late) > SENSOR_GAPS * len(rows):
        back = float(ahead[late[0] - 1] - t[rows][late[0]])
        raise CannotAnswer(
            f"{place(rows[late[0]])}: time stands still or goes backward (by {back:.6g} s) here "
            f"and in {len(late):,} of {len(rows):,} rows; sort or cut the file"
        )
    if len(late):
        notes.append(f"{place(rows[late[0]])}: {len(late):,} rows not later than the row before")
    if sparse > 0:
        notes.append(f"{file}: {sparse:.1%} of the IMU rows lack a reading, left out")
    rows = rows[forward]
    if len(rows) < 2:
        raise CannotAnswer(f"{file}: a single IMU sample")
    readings = readings[rows]
    gyro = readings[:, :3] * quantities.gyro_scale(found, file)
    accel = readings[:, 3:] * quantities.accel_scale(found, readings[:, 3:], file, notes)
    return Imu(t[rows], gyro, accel)
