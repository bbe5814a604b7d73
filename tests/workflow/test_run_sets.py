"""Sets of runs: what they show, which further run would show the rest, whole runs held out."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.data.dwells import Dwells
from accelcal.diagnosis.runs import further_runs
from accelcal.estimation.estimate import solve_runs
from accelcal.simulation import CXL02_RIG
from tests.worlds import World

G = 9.80665


def run(number, axis="level", mount="normal", eps=0.0, **truth):
    rig = replace(CXL02_RIG, axis=axis, mount=mount)
    parameters = {"bias": 0.05, "scale_factor": 0.01, **truth}
    simulation = ac.simulate("tones", seconds=12.0, rig=rig, parameters=parameters, rng=np.random.default_rng(number))
    recording = simulation.recording
    read = replace(recording.position, y=recording.position.y * (1.0 + eps))
    return replace(recording, position=read, digest=f"{number}", name=f"{axis} {mount} {number}")


def test_the_deviation_that_a_further_run_promises_is_the_one_it_gives():
    first = run(1)
    solution = solve_runs(ac.Model.linear(), [first])
    promised = {further_run.effect: further_run for further_run in further_runs(solution.states, solution.model)}
    assert set(promised) == {"encoder_scale", "tilt", "misalignment", "cross_axis_gravity"}
    assert "axis" in promised["encoder_scale"].run
    assert "turned" in promised["tilt"].run
    for effect in ("misalignment", "cross_axis_gravity"):
        assert "rolled" in promised[effect].run
    axis = "up" if "up" in promised["encoder_scale"].run else "down"
    up = ac.fit([first, run(2, axis)], ac.Model.linear().add("encoder_scale"))
    assert up["encoder_scale"].std == pytest.approx(promised["encoder_scale"].std, rel=0.15)
    turned = ac.fit([first, run(3, mount="reversed")])
    assert turned["tilt"].std == pytest.approx(promised["tilt"].std, rel=0.15)
    rolled = ac.fit([first, run(4, mount="rolled")])
    assert rolled["misalignment"].std == pytest.approx(promised["misalignment"].std, rel=0.15)
    assert rolled["cross_axis_gravity"].std == pytest.approx(promised["cross_axis_gravity"].std, rel=0.15)


def test_a_verdict_says_which_run_would_tell_and_that_run_tells():
    blind = ac.diagnose(ac.fit(run(5, eps=3e-4)), run(5, eps=3e-4))
    assert blind.verdict == "adequate"
    tie = next(tie for tie in blind.inseparable if "encoder_scale" in tie.members)
    assert "one further run with the axis" in tie.experiment
    assert "gives encoder_scale to" in tie.experiment
    several = [run(k, axis, eps=3e-4) for k, axis in enumerate(("level", "up", "down"), 5)]
    diagnosis = ac.diagnose(ac.fit(several), several)
    assert diagnosis.classes[0].members == ("encoder_scale", "bias")
    assert "dwells" in diagnosis.classes[0].experiment  # what tells it from a bias that differs


def test_the_last_of_three_runs_is_held_out_as_a_whole():
    several = [run(k) for k in range(3)]
    improvement = ac.improve(several)
    assert not improvement.same_run
    assert [item.name for item in improvement.diagnosis.fit.runs] == [item.name for item in several[:2]]
    assert improvement.steps[-1].heldout.recording == several[2].name
    few = ac.improve(several[:2])
    assert few.same_run


def test_dwells_alone_are_diagnosed_and_have_no_motion_to_improve_on():
    item = (np.full(4, 1e-3), np.full(4, 60.0), np.full(4, 6000.0))
    angle = np.arange(4) * np.pi / 2.0
    dwells = Dwells(angle, 0.05 + 1.01 * G * np.sin(angle), *item, ("0",) * 4, CXL02_RIG, name="tumble.csv")
    with pytest.raises(ac.RecordingError, match="dwells alone show no motion; only fit, diagnose, add"):
        ac.improve(dwells)
    assert ac.diagnose(ac.fit(dwells), dwells).fit.name == "tumble.csv"
    outcome = run(9)
    together = [outcome, dwells]
    assert ac.diagnose(ac.fit(together), together).fit.dwells is not None


def test_each_run_is_judged_on_its_own_clock_and_as_a_whole(tmp_path):
    """The second run begins where the first ends and is longer: nothing of it is cut to the span of the first."""
    world = World("interleaved", "ADXL105", (), seed=5).settled()
    run = ac.load(world.record().write(tmp_path, "whole"))
    runs = [run.part(0.0, 22.0), run.part(22.0, 58.0)]
    fitted = ac.fit(runs)
    diagnosis = ac.diagnose(fitted, runs)
    assert diagnosis.verdict == "adequate"
    assert [end - start > 35.0 for start, end in diagnosis.used] == [False, True]
    assert diagnosis.fit["bias"].std == pytest.approx(fitted["bias"].std, rel=0.05)
    assert ac.improve(runs).diagnosis.used[1] == diagnosis.used[1]
