"""accelcal: estimate an accelerometer from position, see where the model fails, learn which effect is missing.

Examples
--------
>>> import numpy as np
>>> import accelcal as ac
>>> truth = {"bias": 0.05, "scale_factor": 0.01}
>>> rng = np.random.default_rng(1)
>>> made = ac.simulate("tones", seconds=20.0, rig=ac.ADXL105_RIG, parameters=truth, rng=rng)
>>> found = ac.fit(ac.Model.linear(), made.recording)
>>> abs(found["scale_factor"].value - 0.01) < 4 * found["scale_factor"].std
True
"""

from typing import TYPE_CHECKING, Any

from accelcal._core import __version__
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.data.rig import LowPass, Rig, Sensor
from accelcal.effects import effect, load_effects
from accelcal.estimation.estimate import Fit
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.estimation.recursive import fit_recursive
from accelcal.filters.choice import FilterChoice
from accelcal.filters.live_model import LiveModel
from accelcal.filters.record import FilterRun
from accelcal.filters.stream import LiveFilter
from accelcal.io import load, load_dwells
from accelcal.model import Estimate, Model, Prior
from accelcal.serialization.model_file import load as load_model
from accelcal.serialization.model_file import save as save_model
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, simulate
from accelcal.validation.comparison import Coast, Comparison

if TYPE_CHECKING:
    from accelcal.diagnosis.dwells import diagnose_dwells
    from accelcal.diagnosis.verdict import Diagnosis
    from accelcal.experiment import plan, power
    from accelcal.selection.improvement import History, Improvement
    from accelcal.workflow import add, coast, compare, diagnose, drop, fit, formulas, history, improve

__all__ = [
    "ADXL105_RIG",
    "CXL02_RIG",
    "Channel",
    "Coast",
    "Comparison",
    "Diagnosis",
    "Dwells",
    "Estimate",
    "FilterChoice",
    "FilterRun",
    "Fit",
    "History",
    "Improvement",
    "LiveFilter",
    "LiveModel",
    "LowPass",
    "Model",
    "NotIdentifiable",
    "Prior",
    "Recording",
    "RecordingError",
    "Rig",
    "Sensor",
    "__version__",
    "add",
    "coast",
    "compare",
    "diagnose",
    "diagnose_dwells",
    "drop",
    "effect",
    "fit",
    "fit_recursive",
    "formulas",
    "history",
    "improve",
    "load",
    "load_dwells",
    "load_effects",
    "load_model",
    "plan",
    "power",
    "save_model",
    "simulate",
]


def __getattr__(name: str) -> Any:
    """Import the verbs of the workflow and of experiment design on first use, since SciPy's statistics load slowly."""
    if name not in __all__:
        raise AttributeError(f"module 'accelcal' has no attribute {name!r}")
    from accelcal import experiment, workflow
    from accelcal.diagnosis import dwells

    home = {"plan": experiment, "power": experiment, "diagnose_dwells": dwells}.get(name, workflow)
    return globals().setdefault(name, getattr(home, name))


def __dir__() -> list[str]:
    return sorted({*globals(), *__all__})
