"""Estimation: one recording through the replay, and Gauss-Newton over all of them."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
