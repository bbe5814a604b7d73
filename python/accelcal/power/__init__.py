"""What a record, or a motion that is only planned, can see; and a motion that sees what it should (discovery 3.5)."""

from accelcal.detectable import predicted_detection
from accelcal.power.design import Limits, Plan, plan
from accelcal.power.planned import power_of_motion, power_of_set_points, through
from accelcal.power.sight import Group, Power, Sight, power

__all__ = [
    "Group",
    "Limits",
    "Plan",
    "Power",
    "Sight",
    "plan",
    "power",
    "power_of_motion",
    "power_of_set_points",
    "predicted_detection",
    "through",
]
