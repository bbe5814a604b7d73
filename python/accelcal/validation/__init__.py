"""Validation: a fitted model against a recording."""

from accelcal._support.values import listing

__dir__ = listing(globals())
