"""What the columns of a moving log mean, and in which unit: by name, or by physics."""

import re

import numpy as np

from analysis import WrongUsage
from analysis.logs import clock, columns
from analysis.logs.columns import IN_M_S2

_NAMES = (  # what a name says, once its unit is off
    ("lat", r"(gps_?|location_?)?lat(itude)?"),
    ("lon", r"(gps_?|location_?)?(lon|lng|long)(itude)?"),
    ("height", r"(gps_?|location_?)?(height|alt|altitude)"),
    ("pdop", r"(gps_?)?pdop"),
    ("speed", r"(gps_?|location_?)?(speed|sog|ground_?speed|speed_over_ground)"),
    ("course", r"(gps_?|location_?)?(course|cog|bearing|track|heading)"),
    ("fix", r"has_?fix|fix|fix_?type|quality"),
    ("accel_{}", r"(a|acc|accel|accelerometer|acceleration|g_?force)[ _.]?{}"),
    ("gyro_{}", r"(w|gyr|gyro|gyroscope|omega|rate|angular_?rate)[ _.]?{}"),
)
_BODY_RATES = {"rollrate": "gyro_x", "pitchrate": "gyro_y", "yawrate": "gyro_z"}
SPEED = {"m_s": 1.0, "km_h": 1 / 3.6, "knots": 1852 / 3600, "mph": 0.44704}
_SPEED_SPELLINGS = {
    "m_s": r"m_s|m/s|mps|ms", "km_h": r"km_h|km/h|kmh|kph", "knots": r"knots?|kn|kt", "mph": r"mph",
}  # fmt: skip
_RATE = {"deg/s": np.pi / 180, "rad/s": 1.0, "deg/h": np.pi / 180 / 3600}


def renamed(frame, wanted, file):
    """Give columns the names that the reader says they mean; others of that meaning go."""
    names = list(frame.columns)
    turned = {ours for ours, theirs in wanted.items() if theirs.startswith("-")}
    picked = {
        ours: columns.resolve(theirs.removeprefix("-"), names, file)
        for ours, theirs in wanted.items()
    }
    for ours, theirs in picked.items():
        if not (clock.is_time(ours) or _meaning(ours)[0]):
            raise WrongUsage(
                f"--columns {ours}={theirs}: '{ours}' is none of t_s, lat_deg, lon_deg, height_m, "
                "pdop, speed_m_s, course_deg, has_fix, accel_x_m_s2 ..., gyro_x_deg_s ..."
            )
    meant = {_meaning(ours)[0] for ours in picked} - {None}
    timed = any(clock.is_time(ours) for ours in picked)
    drop = [
        n for n in names
        if n not in picked.values() and (_meaning(n)[0] in meant or (timed and clock.is_time(n)))
    ]  # fmt: skip
    frame = frame.drop(columns=drop).rename(columns={v: k for k, v in picked.items()})
    return frame.assign(**{ours: -frame[ours] for ours in turned})


def _meaning(name):
    """Return what a column's name means and in which unit (None, None if nothing known)."""
    lower = name.strip().lower()
    if lower in _BODY_RATES:
        return _BODY_RATES[lower], None
    base, unit = columns.split(name)
    base = base.strip().lower()
    for speed_unit, spelled in _SPEED_SPELLINGS.items():
        match = re.fullmatch(rf"(.*?)[ _]*[\[(]?(?:{spelled})[\])]?", lower)
        if match and re.fullmatch(_NAMES[4][1], match[1].strip(" _")):
            return "speed", speed_unit
    for meaning, pattern in _NAMES:
        for axis in "xyz" if "{}" in meaning else [""]:
            if re.fullmatch(pattern.replace("{}", axis), base):
                return meaning.format(axis), unit
    return None, None


def meanings(frame):
    """Return meaning -> (column, unit) of the columns of numbers; the first of a kind counts."""
    found = {}
    for name in frame.select_dtypes("number"):
        meaning, unit = _meaning(name)
        if meaning and meaning not in found:
            found[meaning] = (name, unit)
    return found


def speed_unit(t, lat, lon, speed, name, file):
    """Find the unit of a speed from the distance between positions."""
    metres = 111_195 * np.hypot(np.diff(lat), np.diff(lon) * np.cos(np.radians(lat[1:])))
    gone, said = metres[speed[1:] > 0], (speed[1:] * np.diff(t))[speed[1:] > 0]
    ratio = np.nansum(gone) / max(np.nansum(said), 1e-9)
    unit = min(SPEED, key=lambda u: abs(np.log(max(ratio, 1e-9) / SPEED[u])))
    if len(gone) < 20 or abs(ratio / SPEED[unit] - 1) > 0.06 or np.nansum(gone) < 200:
        raise WrongUsage(
            f"{file}: column '{name}' has no unit, and its positions do not tell it; say "
            f"--columns speed_m_s={name}, or speed_km_h, speed_knots, speed_mph"
        )
    return unit


def gyro_scale(found, file):
    """Return rad/s per unit of the gyro; a column without a unit is refused."""
    scales = set()
    for axis in "xyz":
        name, unit = found[f"gyro_{axis}"]
        if unit not in _RATE:
            raise WrongUsage(
                f"{file}: column '{name}' has no unit of a rate: say --columns "
                f"gyro_{axis}_deg_s={name}, or gyro_{axis}_rad_s={name}, for each axis"
            )
        scales.add(_RATE[unit])
    if len(scales) > 1:
        raise WrongUsage(f"{file}: the three gyros are in different units")
    return scales.pop()


def accel_scale(found, accel, file, notes):
    """Return m/s^2 per unit of the accelerometer; without a unit, gravity tells it."""
    units = {found[f"accel_{axis}"][1] for axis in "xyz"}
    if len(units) > 1:
        raise WrongUsage(f"{file}: the three accelerometers are in different units")
    unit, norm = units.pop(), float(np.median(np.linalg.norm(accel, axis=1)))
    likely = [u for u, one in IN_M_S2.items() if 0.8 < norm * one / 9.80665 < 1.25]
    if unit is None and likely:
        notes.append(f"{file}: accelerometer read as {likely[0]}: its length is {norm:.3g}")
        unit = likely[0]
    if unit not in IN_M_S2 or unit not in likely:
        raise WrongUsage(
            f"{file}, columns {', '.join(found[f'accel_{a}'][0] for a in 'xyz')}: the median "
            f"length is {norm:.3g}{' ' + unit if unit else ''}, which is no gravity; give specific "
            "force (gravity included) as accel_x_m_s2 or accel_x_g"
        )
    return IN_M_S2[unit]
