"""A planned motion stays within its limits and separates what it was asked to."""

from __future__ import annotations

import csv
import json
from itertools import product

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.experiment import Limits, plan, set_points_of
from accelcal.diagnosis.experiment.design import PATTERNS, Recipe, build
from accelcal.diagnosis.search.confounding import TIED_CORRELATION
from accelcal.simulation import ADXL105_RIG, CXL02_RIG
from tests.commands import accelcal
from tests.schemas import require_published

LIMITS = (Limits(0.2, 0.1, 20.0), Limits(0.02, 1.0, 5.0), Limits(1.0, 0.5, 2.0))


def extremes(motion) -> tuple[float, float, float]:
    """Travel, top speed and top acceleration at 20 kHz, far above the rate of the search for peaks."""
    t = np.arange(0.0, motion.seconds, 5e-5)
    p, v, a, _ = motion.derivatives(t)
    return float(np.ptp(p)), float(np.max(np.abs(v))), float(np.max(np.abs(a)))


@pytest.fixture(scope="module")
def odd():
    return plan(["cubic", "odd_quadratic"], stroke=0.2, v_max=0.1, a_max=20.0, seconds=30.0, rig=CXL02_RIG)


@pytest.mark.parametrize("limits", LIMITS, ids=["paper", "short", "slow"])
@pytest.mark.parametrize("aligned", [False, True])
def test_no_recipe_exceeds_a_limit(limits, aligned):
    for seed, (pattern, share) in enumerate(product(PATTERNS, (0.2, 0.5))):
        travel, speed, acceleration = extremes(build(Recipe(pattern, share, aligned, seed), limits, 12.0))
        assert travel <= limits.stroke
        assert speed <= limits.speed
        assert acceleration <= limits.acceleration
        assert speed > 0.5 * limits.speed or acceleration > 0.5 * limits.acceleration or travel > 0.5 * limits.stroke


def test_the_whole_stroke_is_used_when_there_is_time_and_the_stage_ends_where_it_began():
    motion = build(Recipe(PATTERNS[0], 0.5, False), LIMITS[0], 60.0)
    assert extremes(motion)[0] > 0.998 * LIMITS[0].stroke
    p, v, a, _ = motion.derivatives(np.array([0.0, 60.0]))
    np.testing.assert_allclose([*p, *v, *a], 0.0, atol=1e-12)  # sums of a few doubles


def test_a_plan_separates_what_one_tone_confounds(odd):
    (pair,) = odd.correlations
    assert pair[:2] == ("cubic", "odd_quadratic")
    assert pair[2] < TIED_CORRELATION
    assert odd.separated
    assert "odd_quadratic" not in odd.power["cubic"].members
    assert 24 <= odd.tried <= 60


def test_a_plan_beats_the_motion_of_the_paper(odd):
    from accelcal.diagnosis.experiment import power_of_motion
    from accelcal.simulation.motion import motion

    usual = power_of_motion(motion("interleaved", 30.0, np.random.default_rng(1)), CXL02_RIG)
    for name in odd.effects:
        assert odd.power[name].smallest[0] < usual[name].smallest[0]


def test_a_plan_for_position_moves_and_a_plan_for_acceleration_shakes():
    asked = {"stroke": 0.2, "v_max": 0.1, "a_max": 20.0, "seconds": 12.0, "rig": ADXL105_RIG}
    place, shake = plan(["rail_curve"], **asked), plan(["quadratic"], **asked)
    assert place.power["rail_curve"].smallest[0] < shake.power["rail_curve"].smallest[0]
    assert shake.power["quadratic"].smallest[0] < place.power["quadratic"].smallest[0]


def test_set_points_are_the_motion(odd):
    t, p = set_points_of(odd.motion, 500.0)
    assert (t[0], t[-1], len(t)) == (0.0, 30.0, 15001)
    np.testing.assert_array_equal(p, odd.motion.position(t))


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"effects": ["tilt"]}, "cannot be shown by any motion"),
        ({"effects": ["bias"]}, "in every model"),
        ({"effects": ["temperature_bias"]}, "temperature"),
        ({"effects": ["vibration"]}, "noise"),
        ({"effects": []}, "at least one"),
        ({"effects": ["no_such"]}, "no effect called"),
        ({"stroke": 0.0}, "stroke must be positive"),
        ({"seconds": 1.0}, "too short"),
    ],
)
def test_what_no_motion_can_do_is_refused(changed, message):
    asked = {
        "effects": ["cubic"],
        "stroke": 0.2,
        "v_max": 0.1,
        "a_max": 20.0,
        "seconds": 20.0,
        "rig": CXL02_RIG,
    }
    with pytest.raises(ValueError, match=message):
        plan(**{**asked, **changed})


LIMITS_GIVEN = ("--stroke", "20 cm", "--vmax", "0.1 m/s", "--amax", "20 m/s^2", "--seconds", 10)


def test_a_plan_is_written_to_a_file_that_power_reads(tmp_path):
    plan = accelcal("plan", "--effects", "quadratic,cubic", *LIMITS_GIVEN, "-o", "m.csv", "--json", cwd=tmp_path)
    assert plan.returncode == 0, plan.stderr
    content = json.loads(plan.stdout)
    assert content["schema"] == "accelcal/plan/5"
    require_published(content)
    assert content["limits"]["stroke"] == 0.2
    with (tmp_path / "m.csv").open() as file:
        rows = list(csv.reader(file))
    assert rows[0] == ["t_s", "position_m"]
    position = np.array([float(row[1]) for row in rows[1:]])
    assert np.ptp(position) <= 0.2
    answer = accelcal("power", "m.csv", "--json", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    limits = {item["effect"]: item for item in json.loads(answer.stdout)["detectabilities"]}
    for item in (limit for limit in content["power"]["detectabilities"] if limit["effect"] in content["effects"]):
        # The file is read at 1000 Hz, the plan was judged at 833.5 Hz: R counts for 20 % less.
        assert limits[item["effect"]]["smallest"] == pytest.approx(item["smallest"], rel=0.1)


def test_power_of_a_recording_and_its_refusals(tmp_path):
    from accelcal.cli import write_recording

    simulation = ac.simulate("bursts", seconds=10.0, rig=ADXL105_RIG, parameters={}, rng=np.random.default_rng(1))
    write_recording(simulation.recording, tmp_path / "run.csv")
    answer = accelcal("power", "run.csv", "--json", cwd=tmp_path)
    assert answer.returncode == 0, answer.stderr
    content = json.loads(answer.stdout)
    assert content["schema"] == "accelcal/power/5"
    require_published(content)
    (tmp_path / "bare.csv").write_text("t_s,position_m\n" + "".join(f"{k / 100},{k % 7}e-3\n" for k in range(100)))
    bare = accelcal("power", "bare.csv", cwd=tmp_path)
    assert bare.returncode == 3
    assert "noise density" in bare.stderr
    assert accelcal("plan", "--effects", "cubic", *LIMITS_GIVEN, "--sensor", "X", cwd=tmp_path).returncode == 2


def test_a_limit_without_unit_is_refused_and_power_prints_whole_names_and_units(tmp_path):
    limits = (*LIMITS_GIVEN[:-1], 5)
    given = ["--stroke", "20", *limits[2:]]
    refused = accelcal("plan", "--effects", "cubic", *given, cwd=tmp_path)
    assert refused.returncode == 2
    assert "no unit" in refused.stderr
    assert "0.2 m" in refused.stderr
    plan = accelcal("plan", "--effects", "cubic", *limits, "-o", "m.csv", cwd=tmp_path)
    assert "within 0.2 m, 0.1 m/s, 20 m/s²" in " ".join(plan.stdout.split())
    printed = accelcal("power", "m.csv", cwd=tmp_path).stdout
    for phrase in ("vibration_rectification", "encoder_nonlinearity", "(m/s²)⁻²", "Confounded:"):
        assert phrase in printed
