"""A log as the paper's firmware dumped it: NMEA among time stamps, and the IMU as CSV lines.

The tracker paper's Section III-B, backwards: what `analysis.logs.moving` reads. For the simulated
scenarios, so that they can go through the same door as a real log.
"""

import datetime

import numpy as np
from pynmeagps import GET, NMEAMessage


def nmea(gnss, start):
    """Write GNSS epochs as RMC, GGA and GSA sentences, each epoch after a line with its stamp.

    Parameters
    ----------
    gnss : Gnss
    start : datetime.datetime
        UTC of ``t_s = 0``.

    Yields
    ------
    str
        A line, without its end.
    """
    for k, t in enumerate(gnss.t_s.tolist()):
        at = start + datetime.timedelta(seconds=t)
        yield f"{t:.3f}"
        has = bool(gnss.has_fix[k])
        clock = {"time": at.time().replace(tzinfo=None), "lat": "", "NS": "", "lon": "", "EW": ""}
        if has:
            lat, lon = float(gnss.lat_deg[k]), float(gnss.lon_deg[k])
            clock |= {"lat": lat, "NS": "NS"[lat < 0], "lon": lon, "EW": "EW"[lon < 0]}
        rmc = {"status": "AV"[not has], "date": at.date(), "posMode": "AN"[not has]}
        if has:
            knots = float(gnss.speed_m_s[k]) / 0.514444
            rmc |= {"spd": round(knots, 3), "cog": round(float(gnss.course_deg[k]), 2)}
        dop = round(float(gnss.pdop[k]), 2)
        part = round(dop / 2**0.5, 2)  # the PDOP's square is the sum of theirs
        gga = {"quality": int(has), "numSV": 8 * has, "HDOP": part, "altUnit": "M", "sepUnit": "M"}
        gga |= {"diffAge": "", "diffStation": ""}
        gga |= {"alt": round(float(gnss.height_m[k]), 1), "sep": 0.0} if has else {}
        gsa = {"opMode": "A", "navMode": 3 if has else 1, "PDOP": dop, "HDOP": part, "VDOP": part}
        gsa |= {f"svid_{i:02}": i if has and i <= 8 else "" for i in range(1, 13)}
        for kind, fields in (("RMC", clock | rmc), ("GGA", clock | gga), ("GSA", gsa)):
            message = NMEAMessage("GP", kind, GET, **fields)
            yield message.serialize().decode().strip()


def imu_csv(imu):
    """Write IMU samples as lines of a CSV: time, gyro (rad/s), acceleration (m/s^2).

    Parameters
    ----------
    imu : Imu

    Yields
    ------
    str
        A line, without its end.
    """
    axes = "xyz"
    names = [f"gyro_{a}_rad_s" for a in axes] + [f"accel_{a}_m_s2" for a in axes]
    yield ",".join(["t_s", *names])
    for t, row in zip(imu.t_s, np.hstack([imu.gyro_b, imu.accel_b]), strict=True):
        yield ",".join([f"{t:.4f}", *(f"{v:.6f}" for v in row)])
