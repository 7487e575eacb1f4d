"""Calibration: numbers of a machine file found from measured frequencies and pressures."""
