"""What only a set of runs tells is not held out, and is never "nothing is missing"."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.recording import Recording
from accelcal.estimation.run_fit import run_to_hold_out
from accelcal.simulation import CXL02_RIG

THREE = ("level", "up", "down")


def runs(
    seed: int, axes: tuple[str, ...], encoder_scale: float = 0.0, biases: tuple[float, ...] = ()
) -> list[Recording]:
    """Runs of one sensor whose encoder reads too much by a share of the travel."""
    recordings = []
    for number, (axis, bias) in enumerate(zip(axes, biases or len(axes) * (0.05,), strict=True)):
        rng = np.random.default_rng([seed, number])
        rig, truth = replace(CXL02_RIG, axis=axis), {"bias": bias, "scale_factor": 0.01}
        recording = ac.simulate("tones", seconds=15.0, rig=rig, parameters=truth, rng=rng).recording
        read = replace(recording.position, y=recording.position.y * (1.0 + encoder_scale))
        recordings.append(replace(recording, position=read, digest=f"{seed} {number}", name=f"{axis} {number}"))
    return recordings


def test_an_encoder_scale_that_three_runs_show_is_not_held_out() -> None:
    improvement = ac.improve(runs(3401, THREE, 5e-4))
    assert improvement.same_run
    assert improvement.verdict == "tied"
    assert improvement.sentence.startswith("The runs differ as encoder_scale of 0.0005")
    assert improvement.diagnosis.classes[0].members == ("encoder_scale", "bias")


def test_three_runs_without_one_lack_nothing() -> None:
    """False-alarm rate: 1 % of sets by any of all candidates."""
    improvement = ac.improve(runs(3402, THREE))
    assert improvement.verdict == "adequate"
    assert improvement.sentence.startswith("Nothing is missing")


def test_the_verdict_is_on_the_run_that_is_held_out_too() -> None:
    improvement = ac.improve(runs(3403, ("level",) * 3, biases=(0.05, 0.05, 0.052)))
    assert not improvement.same_run
    assert [run.name for run in improvement.best.runs] == ["level 0", "level 1"]
    assert "bias differs from run to run" in improvement.sentence
    assert "Nothing is missing" not in improvement.sentence


def test_two_runs_that_differ_may_show_an_encoder_scale() -> None:
    pair = runs(3404, ("level", "up"), 5e-4)
    judged = ac.diagnose(ac.fit(pair), pair)
    assert judged.verdict == "tied"
    assert {"encoder_scale", "bias"} <= set(judged.classes[0].members)


@pytest.mark.parametrize(
    ("axes", "apart"),
    [
        (("level", "level"), None),
        (("level", "level", "level"), 2),
        (THREE, None),
        (("level", "level", "up"), None),
        (("level", "up", "down", "level"), 3),
        (("level", "up", "up", "down"), 2),
        (("level", "level", "up", "down"), 1),
    ],
)
def test_a_run_is_held_out_where_another_has_its_pose(axes: tuple[str, ...], apart: int | None) -> None:
    assert run_to_hold_out(runs(3405, axes)) == apart
