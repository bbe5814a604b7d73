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

from __future__ import annotations

from _thread import get_ident

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from accelcal._core import __version__
    from accelcal.data.dwells import Dwells
    from accelcal.data.recording import Channel, Recording, RecordingError
    from accelcal.data.rig import LowPass, Rig, Sensor
    from accelcal.diagnosis.dwells import diagnose_dwells
    from accelcal.diagnosis.verdict import Diagnosis
    from accelcal.effects import effect, load_effects
    from accelcal.estimation.estimate import Fit
    from accelcal.estimation.gauss_newton import NotIdentifiable
    from accelcal.estimation.recursive import fit_recursive
    from accelcal.experiment import plan, power
    from accelcal.filters.choice import FilterChoice
    from accelcal.filters.live_model import LiveModel
    from accelcal.filters.record import FilterRun
    from accelcal.filters.stream import LiveFilter
    from accelcal.io import load, load_dwells
    from accelcal.model import Estimate, Model, Prior
    from accelcal.results.model_file import load as load_model
    from accelcal.results.model_file import save as save_model
    from accelcal.selection.improvement import History, Improvement
    from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, simulate
    from accelcal.validation.comparison import Coast, Comparison
    from accelcal.validation.differences import PairedComparison
    from accelcal.workflow import add, coast, compare, compare_paired, diagnose, drop, fit, formulas, history, improve

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
    "PairedComparison",
    "Prior",
    "Recording",
    "RecordingError",
    "Rig",
    "Sensor",
    "__version__",
    "add",
    "coast",
    "compare",
    "compare_paired",
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
PACKAGES = (
    "campaign",
    "data",
    "effects",
    "experiment",
    "filters",
    "fleet",
    "io",
    "plots",
    "report",
    "response",
    "simulation",
)
"""Packages that are reached as attributes, imported on first use."""
_binding: set[int] = set()
"""Threads that are importing the public names."""


def __getattr__(name: str) -> Any:
    """Import what a name needs on its first use: all but the workflow at once, and that when one of its verbs is used.

    Nothing is imported before, so that a Ctrl-C finds the command line ready for it.
    """
    if name == "__version__" or not name.startswith("_"):
        _bind()
    if name in globals():
        return globals()[name]
    if name in PACKAGES:
        from accelcal._support.faces import face

        return face(name)
    if name not in __all__:
        raise AttributeError(f"module 'accelcal' has no attribute {name!r}")
    from accelcal import experiment, workflow
    from accelcal.diagnosis import dwells

    home = {"plan": experiment, "power": experiment, "diagnose_dwells": dwells}.get(name, workflow)
    return globals().setdefault(name, getattr(home, name))


def _bind() -> None:
    """Bind the public names, and with them the submodules; but for the workflow: SciPy's statistics load slowly."""
    thread = get_ident()
    if thread in _binding:
        return  # a module asks for a submodule: Python imports it
    _binding.add(thread)
    try:
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
        from accelcal.results.model_file import load as load_model
        from accelcal.results.model_file import save as save_model
        from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, simulate
        from accelcal.validation.comparison import Coast, Comparison

        globals().update({name: value for name, value in locals().items() if name != "thread"})
    finally:
        _binding.discard(thread)


def __dir__() -> list[str]:
    return sorted({*__all__, *PACKAGES})
