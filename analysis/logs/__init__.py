"""The way in: files become logs. Formats, columns and units, time stamps, the catalogue."""

from analysis.logs.static import Channel, Log, catalogue, read

__all__ = ["Channel", "Log", "catalogue", "read"]
