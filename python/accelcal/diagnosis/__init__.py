"""Diagnosis: which physical effect a model lacks."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
