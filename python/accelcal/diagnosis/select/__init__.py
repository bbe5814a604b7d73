"""Selection: from the base model to an adequate model, effect by effect."""

from accelcal._support.values import listing

__dir__ = listing(globals())
