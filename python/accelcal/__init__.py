"""accelcal: estimate an accelerometer from position, see where the model fails, learn which effect is missing.

Examples
--------
>>> import numpy as np
>>> import accelcal as ac
>>> truth = {"bias": 0.05, "scale_factor": 0.01}
>>> rng = np.random.default_rng(1)
>>> simulated = ac.simulate("tones", seconds=20.0, rig=ac.simulation.ADXL105_RIG, parameters=truth, rng=rng)
>>> fit = ac.fit(simulated.recording)
>>> abs(fit["scale_factor"].value - 0.01) < 4 * fit["scale_factor"].std
True
"""

from __future__ import annotations

from _thread import get_ident

TYPE_CHECKING = False
if TYPE_CHECKING:
    from typing import Any

    from accelcal import (
        data as data,
        effects as effects,
        filters as filters,
        fleet as fleet,
        io as io,
        plots as plots,
        report as report,
        response,
        simulation as simulation,
        verbs as verbs,
    )
    from accelcal._core import __version__
    from accelcal._support.errors import AccelcalError
    from accelcal.data import Channel, Dwells, LowPass, Recording, RecordingError, Rig, Sensor
    from accelcal.diagnosis.experiment import next_experiments, plan, power
    from accelcal.diagnosis.select.improvement import Improvement
    from accelcal.diagnosis.verdict import Diagnosis
    from accelcal.effects import effect, load_effects
    from accelcal.estimation.allan import rest
    from accelcal.estimation.estimate import Fit
    from accelcal.estimation.gauss_newton import NotIdentifiable
    from accelcal.filters.choice import FilterChoice
    from accelcal.filters.live_model import LiveModel
    from accelcal.io import load, load_axes, load_dwells
    from accelcal.model import Model, Prior
    from accelcal.results.model_file import load as load_model
    from accelcal.simulation.sensor import simulate
    from accelcal.validation.differences import Comparison
    from accelcal.verbs import add, compare, diagnose, drop, fit, formulas, improve, nested

__all__ = [
    "AccelcalError",
    "Channel",
    "Comparison",
    "Diagnosis",
    "Dwells",
    "FilterChoice",
    "Fit",
    "Improvement",
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
    "compare",
    "diagnose",
    "drop",
    "effect",
    "fit",
    "formulas",
    "improve",
    "load",
    "load_axes",
    "load_dwells",
    "load_effects",
    "load_model",
    "nested",
    "next_experiments",
    "plan",
    "power",
    "response",
    "rest",
    "simulate",
]
PACKAGES = (
    "data",
    "effects",
    "filters",
    "fleet",
    "io",
    "plots",
    "report",
    "response",
    "simulation",
    "verbs",
)
"""Modules below the public names that are reached as attributes, imported on first use; `response` is public."""
HOMES = {
    "_core": "__version__",
    "_support.errors": "AccelcalError",
    "data.dwells": "Dwells",
    "data.recording": "Channel Recording RecordingError",
    "data.rig": "LowPass Rig Sensor",
    "effects": "effect load_effects",
    "estimation.allan": "rest",
    "estimation.estimate": "Fit",
    "estimation.gauss_newton": "NotIdentifiable",
    "filters.choice": "FilterChoice",
    "filters.live_model": "LiveModel",
    "io": "load load_axes load_dwells",
    "model": "Model Prior",
    "simulation.sensor": "simulate",
    "validation.differences": "Comparison",
}
"""Modules of the public names that are bound together; `verbs` loads SciPy's statistics, which takes longer."""
_binding: set[int] = set()
"""Threads that are importing the public names."""


def __getattr__(name: str) -> Any:
    """Import what a name needs on its first use: all but `verbs` at once, and that when one of its verbs is used.

    Nothing is imported before, so that a Ctrl-C finds the command line ready for it.
    """
    if name == "__version__" or not name.startswith("_"):
        _bind()
    if name in globals():
        return globals()[name]
    if name in PACKAGES:
        from accelcal._support.values import face

        return face(name)
    if name not in __all__:
        raise AttributeError(f"module 'accelcal' has no attribute {name!r}")
    from accelcal import verbs
    from accelcal.diagnosis import experiment

    home = experiment if name in ("next_experiments", "plan", "power") else verbs
    return globals().setdefault(name, getattr(home, name))


def _bind() -> None:
    """Bind the public names, and with them the submodules; but for `verbs`: SciPy's statistics load slowly."""
    thread = get_ident()
    if thread in _binding:
        return  # a module asks for a submodule: Python imports it
    _binding.add(thread)
    try:
        from accelcal._support.values import face

        globals()["load_model"] = face("results.model_file").load
        for home, names in HOMES.items():
            globals().update({name: getattr(face(home), name) for name in names.split()})
    finally:
        _binding.discard(thread)


def __dir__() -> list[str]:
    return sorted({*__all__, *PACKAGES})
