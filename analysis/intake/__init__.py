"""The way in, behind `analysis.logs`: formats, columns and units, time stamps, the catalogue."""
