"""Selection: from the base model to one that is adequate, effect by effect."""

from accelcal._support.values import listing

__dir__ = listing(globals())
