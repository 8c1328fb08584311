"""Units side by side: one clock, one frame, their differences and events; without a truth too.

Pure: a unit is a `Timeline` that somebody has read. To read in order: frame, clock, metrics,
events, variances, side_by_side.
"""

from analysis.resampling import ratio_of_spreads, spread
from analysis.units.clock import clock_offset
from analysis.units.events import find_events
from analysis.units.frame import tracks
from analysis.units.metrics import differences, trajectory_metrics
from analysis.units.side_by_side import noise_of_each
from analysis.units.variances import unit_variances
