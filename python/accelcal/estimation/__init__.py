"""Estimation: one recording through the replay, and Gauss-Newton over all of them."""

from accelcal._support.values import listing

__dir__ = listing(globals())
