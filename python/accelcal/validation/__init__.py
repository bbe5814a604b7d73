"""Validation: a fitted model against a recording."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
