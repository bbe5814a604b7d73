"""Where a model fails: the residual names the variable of the effect that is missing, and nothing when none is."""

from __future__ import annotations

import numpy as np
import pytest

from accelcal.estimation.estimate import estimate
from accelcal.model import Model
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Simulated, simulate
from accelcal.validation.comparison import Evaluation
from accelcal.verbs import compare

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}


def run(seed: int, rig: object = CXL02_RIG, **hidden: float) -> Simulated:
    return simulate(
        "interleaved",
        seconds=30.0,
        rig=rig,  # type: ignore[arg-type]
        parameters={**TRUTH, **hidden},
        rng=np.random.default_rng([699, seed]),
        a_rms=1.0,
    )


def across(seed: int, rig: object = CXL02_RIG, **hidden: float) -> Evaluation:
    """A model fitted on one run against another run of the same sensor."""
    fit = estimate(Model.linear(), run(seed, rig, **hidden).recording)
    return compare(fit, run(seed + 100, rig, **hidden).recording)[0]


@pytest.mark.parametrize("seed", range(3))
def test_worst_region_is_acceleration_when_a_cubic_is_hidden(seed: int) -> None:
    result = across(seed, cubic=1e-3)
    print(result.worst)
    assert result.worst.startswith("acceleration between")


@pytest.mark.parametrize("rig", [ADXL105_RIG, CXL02_RIG], ids=["225 ug", "20 ug"])
@pytest.mark.parametrize("seed", range(3))
def test_no_region_stands_out_when_nothing_is_missing(seed: int, rig: object) -> None:
    # 72 bins at 4 sigma: 0.5 % for each run
    result = across(seed, rig)
    print(result.worst, result.accel_rms)
    assert result.worst.startswith("no region stands out")


@pytest.mark.parametrize("rig", [ADXL105_RIG, CXL02_RIG], ids=["225 ug", "20 ug"])
def test_accelerometer_residual_of_a_true_model_is_the_sensors_own_noise(rig: object) -> None:
    result = across(7, rig)
    density = rig.sensor.noise  # type: ignore[attr-defined]
    # Sensor noise up to the band, and encoder noise below it: equal at the band, a fifth of it in all (1 + 1/5).
    assert result.accel_rms == pytest.approx(density * np.sqrt(result.band * 1.2), rel=0.1)


def test_a_band_that_is_asked_for_is_used() -> None:
    first, second = run(8), run(9)
    result = compare(estimate(Model.linear(), first.recording), second.recording, band=6.0)[0]
    assert result.band == 6.0
    assert next(b for b in result.bins if b.variable == "frequency").edges[-1] <= 6.0
