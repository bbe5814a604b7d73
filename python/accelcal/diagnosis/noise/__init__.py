"""Noise: effects that act on it, each tested with a stated null, and their sizes estimated by likelihood."""

from accelcal._support.values import listing

__dir__ = listing(globals())
