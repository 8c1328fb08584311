"""What came of a replay, for a program: summary.json."""

import math
from dataclasses import asdict

import numpy as np

BLOCKS = ("last_position", "attitude", "static", "low_pass", "mounting", "fusion")


def summarise(timeline, options, columns, device, said):
    """Put summary.json together."""
    t, layer = columns["t_s"], columns["layer"]
    step = np.diff(t, append=t[-1:]) if len(t) else t
    accepted = columns["accepted"].astype(bool)
    has_fix = columns["has_fix"].astype(bool)
    put_out = np.isfinite(columns["out_lat_deg"])
    mount = device.mounting
    imu = timeline.imu

    def first(mask):
        return float(t[np.argmax(mask)]) if mask.any() else None

    def degrees(angle):
        return None if angle is None else math.degrees(angle)

    return {
        "source": {
            "files": timeline.sources,
            "start_utc": timeline.start_utc,
            "duration_s": timeline.duration_s,
            "epochs": 0 if timeline.gnss is None else len(t),
            "imu_samples": 0 if imu is None else len(imu.t_s),
            "imu_rate_hz": None if imu is None else float(1 / np.median(np.diff(imu.t_s))),
        },
        "blocks": _blocks(timeline, options),
        "fixes": {
            "with_fix": int(has_fix.sum()),
            "accepted": int(accepted.sum()),
            "refused": int((has_fix & ~accepted).sum()),
            "first_fix_s": first(has_fix),
            "first_accepted_s": first(accepted),
            "first_output_s": first(put_out),
        },
        "moved_while_off_m": device.last.moved_while_off,
        "static": {
            "seconds": float(step[columns["moving"] == 0].sum()),
            "seconds_in_layer": [float(step[layer == k].sum()) for k in (1, 2, 3)],
            "wake_ups": int((np.diff(columns["moving"]) > 0).sum()),
        },
        "mounting": {
            "deg": degrees(mount.mount),
            "sigma_deg": degrees(mount.sigma),
            "printed_rule_deg": degrees(mount.printed),
            "straights": len(mount.straights),
        },
        "seconds_without_fix_but_position": float(step[put_out & ~accepted].sum()),
        "options": {k: v for k, v in asdict(options).items() if k not in (*BLOCKS, "dtype")},
        "number_type": np.dtype(options.dtype).name,
        "notes": list(said),
    }


def _blocks(timeline, options):
    """Tell for each block whether it ran: on, off, or what it lacked."""
    imu, gnss = timeline.imu is not None, timeline.gnss is not None
    lacks = {
        "last_position": "" if gnss else "needs GNSS",
        "attitude": "" if imu else "needs an IMU",
        "static": "",
        "low_pass": "" if gnss else "needs GNSS",
        "mounting": "" if imu and gnss and options.attitude else "needs GNSS, an IMU and block 2",
        "fusion": "" if imu and gnss and options.attitude else "needs GNSS, an IMU and block 2",
    }
    return {name: lack or "on" if getattr(options, name) else "off" for name, lack in lacks.items()}
