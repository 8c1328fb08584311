"""What breaks the noise models in a static log, and which parameters it affects.

Each test returns `Disturbance` objects. A parameter whose averaging times hold a disturbance of
practical size is refused, unless the disturbance is modelled as a term of its own.
"""

from dataclasses import dataclass


@dataclass(frozen=True)
class Disturbance:
    """One departure of a log from stationary noise.

    Attributes
    ----------
    kind : str
        warm_up, step, sinusoid, temperature, noise_level, heavy_tails, spikes, oscillation,
        missing, motion or misfit.
    start_s, end_s : float
        Where in the log, s from its first sample.
    affects : tuple of str
        Parameters, by their names in model.json.
    note : str
        One sentence for the page.
    decides : bool
        False where it is shown only: its size does not change the parameters noticeably.
    """

    kind: str
    start_s: float
    end_s: float
    affects: tuple[str, ...]
    note: str
    decides: bool = True
