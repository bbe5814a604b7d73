"""Experiment design: what a record or a planned motion can detect, and how to plan a motion (derivations D3.5)."""

from accelcal._support.values import listing
from accelcal.diagnosis.experiment.design import Limits, Plan, plan, set_points_of
from accelcal.diagnosis.experiment.detectability import Detectability, Group, Power
from accelcal.diagnosis.experiment.drift_bandwidth import DriftBandwidth, TumbleLimit, drift_bandwidth
from accelcal.diagnosis.experiment.next_runs import Cause, Experiment, NextExperiments, next_experiments
from accelcal.diagnosis.experiment.power_analysis import power, power_of_motion, power_of_set_points, through

__all__ = [
    "Cause",
    "Detectability",
    "DriftBandwidth",
    "Experiment",
    "Group",
    "Limits",
    "NextExperiments",
    "Plan",
    "Power",
    "TumbleLimit",
    "drift_bandwidth",
    "next_experiments",
    "plan",
    "power",
    "power_of_motion",
    "power_of_set_points",
    "set_points_of",
    "through",
]


__dir__ = listing(globals())
