"""What belongs to one record is not carried to another: steps, walks and warm-up stay behind, creep begins at rest."""

import dataclasses

import numpy as np
import pytest

import accelcal as ac
from accelcal.demo import with_effect
from accelcal.effects import BUILT_IN, find, of_one_record
from accelcal.estimation.run import prepare
from accelcal.simulation import CXL02_RIG
from accelcal.validation.prediction import left_out, values_on

STEP, INSTANT = 0.02, 21.0


def record(seed, effect="", size=0.0, shape=None):
    rng = np.random.default_rng(seed)
    simulation = ac.simulate("interleaved", seconds=40.0, rig=CXL02_RIG, parameters={"bias": 0.05}, rng=rng)
    digest = f"{effect} {seed}"
    if not effect:
        return dataclasses.replace(simulation.recording, digest=digest)
    hidden = with_effect(simulation, find(effect), size, shape, prepare(simulation.recording).origins)
    return dataclasses.replace(hidden, digest=digest)


@pytest.fixture(scope="module")
def stepped():
    recording = record(3, "bias_step", STEP, {"instant": INSTANT})
    base = ac.fit(recording)
    return base, ac.add(base, recording, "bias_step"), recording


def test_a_step_of_one_record_is_no_step_of_another(stepped):
    base, result, recording = stepped
    assert result["bias_step"].value == pytest.approx(STEP, rel=0.05)
    other = record(4)
    plain, evaluation = ac.compare(base, other)[0], ac.compare(result, other)[0]
    # windows across the instant would drift by STEP h^2/2 = 1 m; the filters differ, for the base calls the step noise
    assert evaluation.coast_rms[10.0] < 0.5 * plain.coast_floor[10.0]
    assert evaluation.coast_rms[10.0] == pytest.approx(evaluation.coast_floor[10.0], rel=1.0)
    assert evaluation.not_carried == ("bias_step: follows the clock of the fitted recording; left out on this one",)
    # the twin: taken for the fitted recording, it drifts by the step that it never had
    twin = ac.compare(result, dataclasses.replace(other, digest=recording.digest))[0]
    assert twin.coast_rms[10.0] > 5.0 * evaluation.coast_rms[10.0]
    assert twin.not_carried == ()


def test_on_its_own_record_the_step_stays(stepped):
    _, result, recording = stepped
    evaluation = ac.compare(result, recording)[0]
    assert evaluation.not_carried == ()
    assert values_on(result, recording) == result.values()
    assert values_on(result, recording.part(25.0, 39.0)) == result.values()  # a part has the clock of the whole
    assert evaluation.coast_rms[10.0] == pytest.approx(evaluation.coast_floor[10.0], rel=1.0)


def test_clocks_that_agree_within_a_tolerance_are_set_anew_on_another_record():
    """Loggers started by hand: 2 ms between the clocks of two records is no error of the model where it is declared."""
    fit, other = ac.fit(record(7)), record(8)
    late = dataclasses.replace(other.accel, t=other.accel.t + 2e-3)
    rig = dataclasses.replace(other.rig, offset_tolerance=3e-3)
    declared = ac.compare(fit, dataclasses.replace(other, accel=late, rig=rig, digest="declared"))[0]
    assert declared.one_step_rms == pytest.approx(ac.compare(fit, other)[0].one_step_rms, rel=0.01)
    assert declared.not_carried == ("time_offset: estimated on this one, whose clocks agree within 3 ms only",)
    # the twins: without a tolerance, and with one that is too small
    for tolerance in (0.0, 0.5e-3):
        rig = dataclasses.replace(other.rig, offset_tolerance=tolerance)
        misaligned = ac.compare(fit, dataclasses.replace(other, accel=late, rig=rig, digest=f"{tolerance}"))[0]
        assert misaligned.one_step_rms > 1.1 * declared.one_step_rms


def test_creep_begins_on_another_record_as_after_a_long_rest():
    recording = record(5, "creep", 0.2, {"tau": 2.0, "start": 0.9})
    model = ac.Model.linear().add("creep", shapes={"creep": {"tau": 2.0, "start": 0.9}})
    fit = ac.fit(recording, model.freeze(**{"creep.tau": 2.0, "creep.start": 0.9}))
    [term] = (term for term in values_on(fit, record(6)).terms if term.name == "creep")
    assert (term.shape["start"], term.shape["tau"]) == (0.0, 2.0)
    assert values_on(fit, record(6)).by_name == fit.values().by_name
    assert left_out(fit, record(6)) == ("creep: begins on this recording as after a long rest",)
    [remaining] = (term for term in values_on(fit, recording).terms if term.name == "creep")
    assert remaining.shape["start"] == 0.9


def test_effects_of_motion_are_carried(stepped):
    stays = {effect.name for effect in BUILT_IN if of_one_record(effect)}
    assert {"bias_step", "encoder_step", "warm_up", "bias_random_walk", "bias_gauss_markov", "shape_of_time"} <= stays
    assert not {"coulomb", "quadratic", "creep", "hysteresis", "temperature_bias", "shape_of_position"} & stays
    assert left_out(stepped[0], record(4)) == ()
