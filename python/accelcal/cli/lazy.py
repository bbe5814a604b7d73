"""Modules that the commands call, each imported when a command first uses something of it: help appears at once."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

from accelcal._support.values import face

if TYPE_CHECKING:
    from accelcal import data, effects as catalogue, io, live as measuring, plots, report as pages, verbs
    from accelcal.calibration import export as exports
    from accelcal.diagnosis import experiment
    from accelcal.estimation import allan as noises, triad as triads
    from accelcal.fleet import campaign, summary
    from accelcal.io import dwells as resting, files, loading
    from accelcal.live import session as sessions
    from accelcal.plots import matplotlib as drawing
    from accelcal.response import export as response_files
    from accelcal.results import json as results_json, json_text, model_file, words
    from accelcal.simulation import sensor as sensors

HOMES = {
    "campaign": "fleet.campaign",
    "catalogue": "effects",
    "drawing": "plots.matplotlib",
    "experiment": "diagnosis.experiment",
    "exports": "calibration.export",
    "files": "io.files",
    "json_text": "results.json_text",
    "loading": "io.loading",
    "measuring": "live",
    "model_file": "results.model_file",
    "noises": "estimation.allan",
    "pages": "report",
    "response_files": "response.export",
    "resting": "io.dwells",
    "results_json": "results.json",
    "sensors": "simulation.sensor",
    "sessions": "live.session",
    "summary": "fleet.summary",
    "triads": "estimation.triad",
    "words": "results.words",
}
"""Modules of the package by their names here, where the two differ."""
__all__ = [
    "campaign",
    "catalogue",
    "data",
    "drawing",
    "experiment",
    "exports",
    "files",
    "io",
    "json_text",
    "loading",
    "measuring",
    "model_file",
    "noises",
    "pages",
    "plots",
    "response_files",
    "resting",
    "results_json",
    "sensors",
    "sessions",
    "summary",
    "triads",
    "verbs",
    "words",
]


class Later:
    """A module that is imported with the first name that is looked up in it."""

    def __init__(self, name: str) -> None:
        self.name = name

    def __getattr__(self, name: str) -> Any:
        return getattr(face(self.name), name)


def __getattr__(name: str) -> Later:
    if name not in __all__:
        raise AttributeError(f"module 'accelcal.cli.lazy' has no attribute {name!r}")
    return Later(HOMES.get(name, name))
