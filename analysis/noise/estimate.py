"""A number with its 95 % interval, or a refusal that still says what the data do support."""

from dataclasses import dataclass


@dataclass(frozen=True)
class Estimate:
    """One parameter of one channel.

    Attributes
    ----------
    value : float or None
        None where the data do not resolve the parameter.
    low, high : float or None
        95 % interval; None on a side that the data leave open.
    unit : str
    resolved : bool
    note : str
        How it was found, or why it was not.
    """

    value: float | None
    low: float | None
    high: float | None
    unit: str
    resolved: bool = True
    note: str = ""

    @classmethod
    def refused(cls, unit, note, *, low=None, high=None):
        """Make a refusal, with the bound that stands all the same."""
        return cls(None, low, high, unit, False, note)


def random_walk_unit(unit):
    """Unit of U sqrt(s) as the field writes it: deg/s gives deg/sqrt(s), g gives g*sqrt(s)."""
    return f"{unit[:-2]}/sqrt(s)" if unit.endswith("/s") else f"{unit}*sqrt(s)"
