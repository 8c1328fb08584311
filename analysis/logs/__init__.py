"""Reads logs: static logs on a uniform grid, logs of a moving device as one timeline of events.

This room imports no other room. `read` and `read_moving` take a file or a name of the catalogue
(``data/logs.toml``, ``data/own/logs.toml``); `dataset` looks up a registered raw file.
"""

from analysis.logs.datasets import entry as dataset
from analysis.logs.moving import read_moving
from analysis.logs.nmea import imu_csv_lines, nmea_lines
from analysis.logs.static import read
