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

from accelcal._core import __version__
from accelcal.compare import Coast, Comparison, coast, compare
from accelcal.filters import FilterChoice, FilterRun, LiveFilter
from accelcal.fit import Fit, fit
from accelcal.gauss_newton import Estimate, NotIdentifiable
from accelcal.io import load
from accelcal.live import LiveModel
from accelcal.model import Model, Prior
from accelcal.recording import Channel, Recording, RecordingError
from accelcal.recursive import fit_recursive
from accelcal.rig import LowPass, Rig, Sensor
from accelcal.simulate import ADXL105_RIG, CXL02_RIG, simulate
from accelcal.store import load as load_model
from accelcal.store import save as save_model

__all__ = [
    "ADXL105_RIG",
    "CXL02_RIG",
    "Channel",
    "Coast",
    "Comparison",
    "Estimate",
    "FilterChoice",
    "FilterRun",
    "Fit",
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
    "coast",
    "compare",
    "fit",
    "fit_recursive",
    "load",
    "load_model",
    "save_model",
    "simulate",
]
