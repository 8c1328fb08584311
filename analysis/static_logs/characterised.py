"""A static log characterised: every channel with its own random numbers."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from functools import partial

import numpy as np

from analysis.noise import channel as noise
from analysis.noise import notes, spectrum
from analysis.noise.channel import ChannelNoise, joined, remarks
from analysis.static_logs.processes import in_processes
from analysis.static_logs.standstill import static_part
from analysis.store import rounded_number
from sensorlogs import grouped
from sensorlogs.static import Log

SEED = 20080505
SOURCE = (  # of a static log, in the order of model.json
    *("title", "file", "sha256", "rate_hz", "duration_s", "samples", "gaps", "repairs"),
    *("licence", "source"),
)


@dataclass(frozen=True)
class StaticResult:
    """A characterised static log.

    Attributes
    ----------
    source : dict
        ``file``, ``sha256``, ``rate_hz``, ``duration_s``, ``samples``, ``gaps``, ``repairs``,
        ``licence``, ``source``, ``title``, ``seed``; ``used`` {from_s, to_s} where a part is.
    channels : tuple of ChannelNoise
    """

    source: dict
    channels: tuple[ChannelNoise, ...]

    def __getitem__(self, name: str) -> ChannelNoise:
        """Return the channel of that name."""
        return next(c for c in self.channels if c.name == name)


def characterise(log: Log, *, seed: int = SEED, progress: bool = True) -> StaticResult:
    """Characterise every channel of a log, channel k with the k-th stream spawned from `seed`.

    Parameters
    ----------
    log : Log
        Of which the static stretch is used; see `static_part`.
    seed : int
    progress : bool
        Show a progress bar on a terminal.

    Raises
    ------
    CannotAnswer
        If the sensor moves, or a channel is too short, or none varies; of several, those that do
        not are left out.
    """
    log = static_part(log)
    dead = [c.name for c in log.channels if np.nanmin(c.values) == np.nanmax(c.values)]
    if 0 < len(dead) < len(log.channels):
        kept = tuple(c for c in log.channels if c.name not in dead)
        repairs = (*log.repairs, notes.said("dead", names=", ".join(dead)))
        log = replace(log, channels=kept, repairs=repairs)
    streams = np.random.SeedSequence(seed).spawn(len(log.channels))

    spectrum.prepare(len(log.channels[0].values))
    channels = in_processes(
        partial(_characterised, log),
        list(enumerate(streams)),
        desc=f"characterising {log.name}",
        unit="channel",
        disable=None if progress else True,
    )
    said = grouped((s, c.name) for c in log.channels for s in remarks(c.values, log.dt, c.kind))
    noticed = [f"{', '.join(names)}: {sentence}" for sentence, names in said.items()]
    channels = joined(channels, len(log.channels[0].values) * log.dt)
    return StaticResult(log_source(log, noticed) | {"seed": seed}, channels)


def _characterised(log, job):
    """Characterise channel k with its own random numbers, so that the order does not matter."""
    k, stream = job
    channel, rng = log.channels[k], np.random.default_rng(stream)
    named = {"name": channel.name, "unit": channel.unit, "kind": channel.kind}
    return noise.characterise(channel.values, log.dt, **named, rng=rng, temperature=log.temperature)


def log_source(log: Log, noticed: Iterable[str] = ()) -> dict:
    """State where a static log comes from and what was repaired in it."""
    used = dict(zip(("from_s", "to_s"), log.used, strict=True)) if log.used else None
    about = {key: getattr(log, key) for key in SOURCE} | ({"used": used} if used else {})
    about |= {key: rounded_number(about[key]) for key in ("rate_hz", "duration_s")}
    return about | {"repairs": [*log.repairs, *noticed]}
