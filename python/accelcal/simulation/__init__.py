"""Simulation: motion of a stage, the paper's sensors, and records drawn from the model of a filter."""

from accelcal._support.values import listing
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Simulated, simulate

__all__ = ["ADXL105_RIG", "CXL02_RIG", "Simulated", "simulate"]

__dir__ = listing(globals())
