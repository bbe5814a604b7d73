"""A held-out record that would show an effect, and becomes worse with it, contradicts it; one that has it does not."""

from dataclasses import replace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.select.improvement import Step, contradicted
from accelcal.estimation.remarks import Remark
from accelcal.validation.differences import expected_distance, systematic_change
from tests.selection.test_cross_validation import record


@pytest.fixture(scope="module")
def improved():
    """By the friction of the held-out record, over that of the fitted one."""
    train = record(3, coulomb=2e-3)
    return {share: ac.improve(train, holdout=record(4, coulomb=share * 2e-3)) for share in (0.0, 1.0)}


def test_friction_that_the_held_out_record_lacks_is_contradicted_and_not_named(improved):
    denied = improved[0.0]
    notes = [note for note in denied.diagnosis.remarks if note.code == "contradicted"]
    assert "coulomb" in [note.values["effect"] for note in notes]
    for note in notes:
        assert note.values["d"] > 5.0
        assert note.values["sigma"] > 3.0
        assert note.sentence in denied.diagnosis.notes
        assert note.values["effect"] not in {*denied.effects, *denied.best.model.effects}
    assert [step.effects for step in denied.steps] == [()]
    assert denied.verdict == "unexplained"
    assert "it is contradicted by the held-out record" in denied.sentence


def test_friction_that_both_records_have_is_named(improved):
    same = improved[1.0]
    assert [step.effects for step in same.steps][:2] == [(), ("coulomb",)]
    assert "coulomb" in same.best.model.effects
    assert not [note for note in same.diagnosis.remarks if note.code == "contradicted"]


def test_a_record_contradicts_only_what_its_systematic_error_would_show():
    """Of a line above the band hardly anything is in that error, and what is there may rise by chance; with more of it
    in the band the same record contradicts it."""
    run, other = (record(seed, coulomb=2e-3) for seed in (5, 6))
    line = 0.02 * np.sin(2.0 * np.pi * 211.0 * run.accel.t)
    shaken = replace(run, accel=replace(run.accel, y=run.accel.y + line))
    base = ac.fit(shaken)
    fits = [base, ac.add(base, shaken, "tone")]
    before, after = ac.compare(fits, other)
    assert expected_distance(before.resolved, after.resolved) < 1.0

    def rising(share: float) -> Remark | None:
        more = tuple(replace(part, coordinates=(1.0 + share) * part.coordinates) for part in before.resolved)
        worse = replace(after, resolved=more)
        assert systematic_change(before.resolved, more).sigma > 3.0
        return contradicted([Step((), fits[0], before, before), Step(("tone",), fits[1], worse, worse)])

    assert rising(1e-3) is None
    assert rising(1.0).values["effect"] == "tone"


def test_what_entered_after_a_contradicted_effect_enters_again():
    rig, truth = ac.simulation.CXL02_RIG, {"bias": 0.05, "quadratic": 1e-3}
    train, other, same = (
        ac.simulate(
            "interleaved", seconds=40.0, rig=rig, parameters=truth | {"cubic": cubic}, rng=np.random.default_rng(seed)
        ).recording
        for seed, cubic in ((311, 1e-3), (312, -1e-3), (313, 1e-3))
    )
    assert {*ac.improve(train, holdout=same).effects} == {"cubic", "quadratic"}  # the twin
    denied = ac.improve(train, holdout=other)
    assert "cubic" not in denied.best.model.effects
    assert "quadratic" in denied.best.model.effects
