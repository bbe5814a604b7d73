"""Experiment design: what a record or a planned motion can detect, and how to plan a motion (derivations D3.5)."""

from accelcal.diagnosis.search.thresholds import predicted_detection
from accelcal.experiment.design import Limits, Plan, plan
from accelcal.experiment.detectability import Detectability, Group, Power, power
from accelcal.experiment.planned_motion import power_of_motion, power_of_set_points, through

__all__ = [
    "Detectability",
    "Group",
    "Limits",
    "Plan",
    "Power",
    "plan",
    "power",
    "power_of_motion",
    "power_of_set_points",
    "predicted_detection",
    "through",
]
