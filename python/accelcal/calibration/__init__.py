"""Calibration: the static characteristic of a sensor, its uncertainty budget, and code that inverts it."""
