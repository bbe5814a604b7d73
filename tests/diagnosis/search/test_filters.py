"""First-order filters that nobody declared are found by name: of the position sensor, and AC coupling of the output."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.verdict import Diagnosis
from tests.regimes.hidden import EFFECTS, FINE
from tests.regimes.motion import Motion, Piecewise
from tests.regimes.regimes import ADXL105, CXL02, TABLE
from tests.regimes.rig import NOTHING, Planted, Reference, Rig

SECONDS = 15.0
LATE = 318e-6
"""s; an LVDT behind 500 Hz."""
LVDT = Reference(2e-6, None, 1666.71)


def diagnosed(tmp_path: Path, rig: Rig, profile: str, planted: Planted = NOTHING) -> tuple[Diagnosis, ac.Recording]:
    """The base model on one record of a rig, and the record."""
    regime = replace(TABLE["a-mixed-adxl105"], rig=rig, profile=profile, seconds=SECONDS)
    recording = ac.load(regime.build(6, planted).write(tmp_path))
    return ac.diagnose(ac.fit(recording), recording), recording


def classes(found: Diagnosis) -> dict[str, tuple[str, ...]]:
    return {group.effect: group.members for group in found.classes}


@pytest.mark.parametrize("tau", [2.0])
def test_ac_coupling_is_found_with_its_time_constant(tmp_path: Path, tau: float) -> None:
    def output(motion: Motion) -> Piecewise:
        return EFFECTS["ac_coupling"][0](motion.refined(FINE), 1.0 / tau, 0.0)

    found, recording = diagnosed(tmp_path, Rig(CXL02), "mixed", Planted(output=output))
    assert found.effects == ("ac_coupling",)
    fit = ac.add(found.fit, recording, "ac_coupling")
    (estimate,) = fit.shapes
    assert estimate.name == "ac_coupling.tau"
    assert abs(estimate.value - tau) < 4.0 * estimate.std < tau


def test_a_lag_of_the_encoder_is_in_the_class_that_is_named(tmp_path: Path) -> None:
    found, recording = diagnosed(tmp_path, Rig(ADXL105, replace(LVDT, lag=LATE)), "shaker")
    assert found.effects
    assert all("encoder_lag" in members for members in classes(found).values())
    fit = ac.add(found.fit, recording, "encoder_lag")
    (estimate,) = fit.shapes
    assert abs(estimate.value - LATE) < 4.0 * estimate.std < LATE
    assert abs(fit["time_offset"].value) < 20e-6 + 4.0 * fit["time_offset"].std  # the rest is the clocks'


def test_neither_is_named_without_a_filter_nor_for_a_lag_of_the_sensor(tmp_path: Path) -> None:
    # The twins: the same rig without a filter, and a lag in the other channel.
    assert diagnosed(tmp_path, Rig(ADXL105, LVDT), "shaker")[0].effects == ()
    late, _ = diagnosed(tmp_path, Rig(ADXL105, LVDT), "shaker", Planted(poles=(complex(-1.0 / LATE),)))
    assert not {"encoder_lag", "ac_coupling"} & set(late.effects)
    assert {"time_offset", "sensor_lag"} & set(late.effects)
    assert np.sign(late.fit["time_offset"].value) == 1.0
