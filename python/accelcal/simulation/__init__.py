"""Simulation: motion of a stage, the paper's sensors, and records drawn from the model of a filter."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
