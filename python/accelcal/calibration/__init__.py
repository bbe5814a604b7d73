"""Calibration: the static characteristic of a sensor, its uncertainty budget, and code that inverts it."""

from accelcal._support.values import listing

__dir__ = listing(globals())
