"""What a fleet keeps of one recording: estimates of the sensor's parameters, and how well they hold."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np

from accelcal.io import load
from accelcal.model import Model
from accelcal.workflow import fit

MODELS = {"linear": Model.linear, "cubic": Model.cubic}
STD = ".std"
"""Ending of the name under which a standard deviation is kept."""


def fit_of(path: Path, *, model: str = "linear") -> dict[str, float]:
    """Fit one recording.

    Parameters
    ----------
    path : with its sidecar beside it.
    model : a key of `MODELS`.

    Returns
    -------
    Value and standard deviation of each parameter; ratio of the noise to the declared one, normalised innovation
    squared, length (s), date (days), mean temperature (degC), NaN where not known; number of remarks.
    """
    recording = load(path)
    found = fit(recording, MODELS[model]())
    run = found.runs[0]
    warm = recording.side.get("temperature")
    kept = {
        "nis": math.nan if run.nis is None else run.nis,
        "noise_ratio": math.nan if run.noise.ratio is None else run.noise.ratio,
        "seconds": run.end - run.start,
        "date": math.nan if recording.labels.date is None else recording.labels.date,
        "temperature": math.nan if warm is None else float(np.mean(warm.y)),
        "remarks": float(len(found.remarks)),
    }
    for e in found.free:
        kept |= {e.name: e.value, e.name + STD: e.std}
    return kept
