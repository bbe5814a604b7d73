"""A running measurement followed by a live filter: parameters, innovations, and whether the model holds."""

from accelcal.filters.live_model import watchable
from accelcal.live.session import LiveHistory, LiveSession, LiveState
from accelcal.live.tracker import Alarm, InnovationMonitor, LiveSettings, Naming, Tracker, settings_of

__all__ = [
    "Alarm",
    "InnovationMonitor",
    "LiveHistory",
    "LiveSession",
    "LiveSettings",
    "LiveState",
    "Naming",
    "Tracker",
    "settings_of",
    "watchable",
]
