"""Files and JSON of models and diagnoses."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
