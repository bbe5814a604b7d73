"""The workbench: the loop in a browser on this machine. Every number comes from the public functions of the library."""

from accelcal.app.roles import Refused
from accelcal.app.server import serve
from accelcal.app.state import State, Step
from accelcal.app.workbench import Workbench

__all__ = ["Refused", "State", "Step", "Workbench", "serve"]
