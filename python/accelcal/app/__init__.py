"""The workbench: the loop in a browser on this machine. Every number comes from the public functions of the library."""

from accelcal.app.server import serve
from accelcal.app.state import Refused, State, Step
from accelcal.app.workbench import Workbench

__all__ = ["Refused", "State", "Step", "Workbench", "serve"]
