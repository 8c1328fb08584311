"""Static logs: the part that lies still, characterised; stored as model.json and read back.

``read("adis16405")`` gives a committed result, ``characterise(log)`` makes one of a log that
`sensorlogs.read` has read.
"""

from analysis.static_logs.characterised import StaticResult, characterise
from analysis.static_logs.stored import read
