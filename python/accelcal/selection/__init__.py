"""Selection: from the base model to one that is adequate, effect by effect."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
