"""Data: a recording, the rig it was made on, units, and the quality of both."""

from accelcal._support.values import listing

__dir__ = listing(globals())
