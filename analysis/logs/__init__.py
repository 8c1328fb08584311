"""Reads logs: static logs on a uniform grid, logs of a moving device as one timeline of events.

This room imports no other room. `read` and `read_moving` take a file or a name of the catalogue
(``data/logs.toml``, ``data/own/logs.toml``); `dataset_path` finds a registered raw file.
"""

from analysis.logs.catalogue import load_catalogue
from analysis.logs.datasets import entry as dataset_entry
from analysis.logs.datasets import path as dataset_path
from analysis.logs.moving import read_moving
from analysis.logs.nmea import imu_csv_lines, nmea_lines
from analysis.logs.static import Channel, Log, read
from analysis.logs.timeline import Gnss, Imu, Timeline, inject_outages
