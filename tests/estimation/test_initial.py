"""Initial estimates of a record that breaks off often: a filter that hardly settles between holes decides nothing."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accelcal.data import Channel, Recording, Rig
from accelcal.estimation import run_state
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.estimation.run import natural_origins
from accelcal.io import load
from accelcal.model import Model
from tests.regimes.regimes import TABLE
from tests.regimes.trials import Trial


def test_two_hundred_holes_leave_the_parameters_identifiable(tmp_path: Path, monkeypatch: pytest.MonkeyPatch):
    record = TABLE["k-accel10-blocks-cxl02"].build(Trial("k-accel10-blocks-cxl02", 3, 502).record_seed)
    path = record.write(tmp_path)
    recording = load(path)
    end = recording.position.t[0] + 42.0
    result = solve_runs(Model.linear(), [recording], end=end)
    values = result.states[0].values
    assert values.bias == pytest.approx(record.truth["bias"], abs=2e-4)  # 5 deviations and more
    monkeypatch.setattr(run_state, "LEAST_SETTLED", 0.0)
    with pytest.raises(NotIdentifiable):  # loaded anew, since a recording keeps its rough estimate
        solve_runs(Model.linear(), [load(path)], end=end)


@pytest.mark.parametrize(("at", "origin"), [(0.0, 0.0), (0.25, 0.0), (7.0, 7.0), (-7.0, -7.0)])
def test_the_zero_of_an_encoder_is_its_own_unless_it_is_far_from_the_travel(at: float, origin: float):
    t = np.arange(0.0, 4.0, 0.01)
    position = Channel("position", 5.0 + t, at + 0.1 * np.sin(2.0 * np.pi * t), "m")
    temperature = Channel("temperature", 5.0 + t, 20.0 + t, "degC")
    accel = Channel("accel", 5.0 + t, np.zeros(len(t)), "m/s^2")
    origins = natural_origins(Recording(accel, position, Rig(), {"temperature": temperature}))
    assert origins.p == pytest.approx(origin, abs=1e-12)
    assert origins.t == 5.0
    assert origins.temperature == pytest.approx(float(np.mean(temperature.y)))
