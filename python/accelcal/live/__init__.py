"""A running measurement followed by a live filter: parameters, innovations, and whether the model holds."""

from accelcal.live.moments import LiveHistory
from accelcal.live.monitor import Alarm, InnovationMonitor
from accelcal.live.session import LiveSession, LiveState
from accelcal.live.settings import LiveSettings, settings_of
from accelcal.live.tracker import Tracker

__all__ = [
    "Alarm",
    "InnovationMonitor",
    "LiveHistory",
    "LiveSession",
    "LiveSettings",
    "LiveState",
    "Tracker",
    "settings_of",
]
