"""Something local on the rail is a function of position, not a step in time."""

from __future__ import annotations

from pathlib import Path

import pytest

import accelcal as ac
from accelcal.diagnosis.search.scan import scan
from accelcal.estimation.estimate import solve_runs
from accelcal.model import Model
from tests.worlds import Hidden, World, at_d


@pytest.mark.parametrize("name", ["narrow_bump", "notch"])
def test_a_bump_is_a_curve_of_position_at_its_place(name: str, tmp_path: Path) -> None:
    world = at_d(World("interleaved", "ADXL105", (Hidden(name, 3e-2),), seed=4, seconds=30.0), 30.0).settled()
    state = solve_runs(Model.linear(), [ac.load(world.record().write(tmp_path))]).states[0]
    result = scan([state], Model.linear())
    assert result.detected[0].effect == "shape_of_position"
    shape, truth = result.detected[0].shape, world.hidden[0].shape
    assert abs(shape["centre"] + state.run.origins.p - truth["centre"]) < 3.0 * truth["width"]
    assert "bias_step" not in [f.effect for f in result.detected]
