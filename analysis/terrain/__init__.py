"""Terrain-based localisation: road maps, simulated gyros, the filter, and the price of precision.

A vehicle measures its pitch or roll and compares it with a map of the road. The face of this room
is the names below.
"""

from analysis.terrain.assumptions import Sensor, Setup, attitude_variance, unit_paths
from analysis.terrain.monte_carlo import interval, share, simulate_laps
from analysis.terrain.point_mass import compare_filters
from analysis.terrain.real_laps import track_real_laps
from analysis.terrain.relocate import watch_real_laps
from analysis.terrain.roughness import IsoRoad
from analysis.terrain.terrain_map import AttitudeMap, held_out
from analysis.terrain.trends import PowerLaw, cheapest, draw_prices, fit_trend
