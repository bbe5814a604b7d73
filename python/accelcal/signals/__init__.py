"""Signals: smoothed motion and side channels, and the processing that makes them."""

from accelcal._support.values import listing

__dir__ = listing(globals())
