"""Reports of one short simulated rig: two models of the same hidden cubic, and text that would be markup."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal import report
from accelcal.data.recording import Channel
from accelcal.data.rig import Uncertainty
from accelcal.estimation.estimate import estimate
from accelcal.simulation import CXL02_RIG

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 2e-3}
HOSTILE = "<script>alert(1)</script>"
FILE = '<img src=x onerror=alert(2)> & "run".csv'


def record(seed, uncertainty=None):
    recording = ac.simulate(
        "interleaved", seconds=20.0, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng(seed)
    ).recording
    t = np.arange(0.0, 20.0, 0.5)
    channel = Channel(HOSTILE, t, np.random.default_rng(seed).standard_normal(len(t)), "V")
    sensor = replace(recording.rig.sensor, scale=0.1, scale_unit="V", zero=2.5)
    rig = replace(recording.rig, sensor=sensor, uncertainty=uncertainty or Uncertainty())
    return replace(recording, rig=rig, side={HOSTILE: channel}, name=FILE, digest=f"{seed:064x}")


@pytest.fixture(scope="session")
def lacking():
    """Return the report of a linear model: an effect is missing, nothing is declared."""
    run = record(1)
    return report.gather(estimate(ac.Model.linear(), run), run, holdout=record(2), command="accelcal report <m>.json")


@pytest.fixture(scope="session")
def complete():
    """Return the report of a cubic model with declared uncertainties, judged on its own end."""
    run = record(1, Uncertainty(encoder_scale=1e-5, level=1e-3, misalignment=2e-3))
    model = ac.Model.linear().add("cubic")
    return report.gather(estimate(model, run), run)


@pytest.fixture(scope="session")
def pages(lacking, complete):
    return {"lacking": report.html(lacking), "complete": report.html(complete), "light": report.light(lacking)}
