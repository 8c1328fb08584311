"""Look back over a drive: the constrained filter, smoothed.

A filter knows at each moment what came before; the fixes after an outage also tell where the car
was in it. With e the error of the filter's state that the whole drive shows, from the last step
backward (Rauch, Tung and Striebel, AIAA Journal 3, 1965) ::

    e = A (e' + c'),    S = P + A (S' - P'-) A',    A = P F' (P'-)^-1

where ' is the next step, c the correction that the filter made there, P- and P its covariance
before and after it, and F how errors are carried there.
"""

import numpy as np

from analysis.tracker.constrained import STATES
from analysis.tracker.doubt import Doubted


class Recorded(Doubted):
    """A constrained filter that keeps every step, a few times a second: 6 kB each.

    Epochs between two samples share the step of the first: it is for an IMU as fast as the fixes.
    """

    def __init__(self, *given):
        super().__init__(*given)
        self._steps = []

    @property
    def step(self):
        """Number of the step that the state stands at."""
        return len(self._steps) - 1

    def start(self, *state):
        """Start in motion, with nothing to look back at."""
        self._end()
        super().start(*state)
        self._keep(None)

    def _end(self):
        """Keep the covariance that the corrections of a step leave."""
        if self._steps:
            self._steps[-1][3] = np.array(self.P)

    def _keep(self, transition):
        self._steps.append([transition, np.array(self.P), np.zeros(STATES), None])

    def _carry(self):
        if self._seconds > 0:
            self._end()
            super()._carry()
            self._keep(self.carried)

    def _apply(self):
        self._steps[-1][2] += self._error
        super()._apply()

    def smoothed(self):
        """Look back from the last step.

        Returns
        -------
        errors : ndarray, shape (steps, 16)
            To be added to the state of each step, in the order of `constrained`.
        before, after : ndarray, shape (steps, 16, 16)
            Covariance by the filter, and smoothed.
        """
        self._end()
        n, filtered = len(self._steps), np.array([last for *_, last in self._steps])
        errors = np.zeros((n, STATES))
        smooth = filtered.copy()
        for k in range(n - 1, 0, -1):
            transition, before, applied, _ = self._steps[k]
            if transition is None:  # started anew
                continue
            gain = np.linalg.solve(before, transition @ filtered[k - 1]).T
            errors[k - 1] = gain @ (errors[k] + applied)
            smooth[k - 1] += gain @ (smooth[k] - before) @ gain.T
        return errors, filtered, smooth
