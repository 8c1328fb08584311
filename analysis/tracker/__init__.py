"""The six blocks of the tracker paper, and what joins, simulates and judges them.

Blocks 1 to 6 are in `last_position`, `attitude`, `at_rest` (3 and 4), `mounting` and `fusion`.

``replay(timeline, Options(...))`` runs a whole log through the device that the blocks make.
"""

from analysis.tracker.device import Options
from analysis.tracker.evaluate import (
    courtyard_errors,
    gated,
    mounting_rides,
    ratio_interval,
    stationary_period,
    stationary_periods,
)
from analysis.tracker.last_position import GATE_ALONE, Stored
from analysis.tracker.log_replay import replay
from analysis.tracker.mounting import printed_angle
from analysis.tracker.operations import block_costs, filter_costs
from analysis.tracker.scenarios import GnssErrors, ImuErrors, assumed_errors, scenario
