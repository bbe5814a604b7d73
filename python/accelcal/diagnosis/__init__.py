"""Diagnosis: which physical effect a model lacks."""

from accelcal._support.values import listing

__dir__ = listing(globals())
