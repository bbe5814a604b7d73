"""Which rivals share a class with an effect, and which of two that look the same comes first."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import accelcal as ac
from accelcal.diagnosis.findings import NEXT_STEPS, TO_GO_ON, USUAL_STEP
from accelcal.diagnosis.search.beam import SearchRules
from accelcal.diagnosis.search.confounding import Weights, confounding_class, plainest
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scan import Candidate, Scan
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.verdict import RULES as JUDGED_BY
from accelcal.diagnosis.verdict import UNSTEADY, Case, judgement
from accelcal.effects import find
from accelcal.estimation.remarks import KINDS, Remark

RULES = SearchRules(examined=180, blocks=200, alpha=0.005)
PLAIN = SimpleNamespace(inflation=lambda i, given: 1.0)


def scores(names: tuple[str, str], d: float, correlation: float, noise: float = 0.0) -> CandidateScores:
    """Scores of two effects of which the first is true, d from zero; `noise` favours the second by so many sigma."""
    evidence = CandidateScores.__new__(CandidateScores)
    evidence.items = [Hypothesis(find(name), {}) for name in names]
    evidence.terms = [term for item in evidence.items for term in item.terms]
    evidence.columns = [slice(0, 1), slice(1, 2)]
    evidence.G = np.array([[1.0, correlation], [correlation, 1.0]])
    evidence.c = d * evidence.G[0] + noise * np.array([0.0, 1.0])
    evidence.rounding = np.zeros(2)
    evidence._plain, evidence._positive = np.ones(2, dtype=bool), np.zeros(2, dtype=bool)
    evidence._degenerate = np.full(2, 1e-5)
    evidence._given, evidence._gains = {(): (evidence.G, evidence.c)}, {}
    return evidence


@pytest.mark.parametrize(("d", "tied"), [(10.0, True), (20.0, False), (60.0, False)])
def test_a_rival_that_looks_alike_is_tied_until_the_record_decides(d: float, tied: bool) -> None:
    """At a correlation of 0.97 the rival explains 6 % less: 3 at d = 10, 106 at d = 60 in log-evidence."""
    members = tuple(confounding_class(scores(("cubic", "odd_quadratic"), d, 0.97), PLAIN, 0, (), RULES))
    assert members == (("cubic", "odd_quadratic") if tied else ("cubic",))


def test_a_rival_within_what_shape_and_motion_may_err_is_tied_at_any_strength() -> None:
    """At a correlation of 0.997 it explains 0.6 % less, and a tenth of the effect is 1 %."""
    assert len(confounding_class(scores(("cubic", "odd_quadratic"), 200.0, 0.997), PLAIN, 0, (), RULES)) == 2
    assert len(confounding_class(scores(("cubic", "odd_quadratic"), 200.0, 0.985), PLAIN, 0, (), RULES)) == 1


def test_in_a_tie_what_an_effect_includes_comes_first() -> None:
    tied = scores(("cross_axis", "cross_axis_product"), 20.0, 0.99, noise=0.3)
    assert plainest(tied, PLAIN, (1,), RULES) == (0,)
    assert plainest(tied, PLAIN, (0,), RULES) == (0,)
    apart = scores(("cross_axis_product", "cross_axis"), 20.0, 0.9)  # the twin: the product is true, and shown
    assert plainest(apart, PLAIN, (0,), RULES) == (0,)


def test_a_name_is_given_with_its_nearest_rival() -> None:
    def candidate(name: str, gain: float) -> Candidate:
        return Candidate(name, {}, (1.0,), (0.1,), "1", gain, 1, 0.0, 0.0, 0.5 * gain, 1.0, {name: Weights()})

    alone = SimpleNamespace(effect="cubic", members=("cubic",), experiment="")
    for gain, worse in ((3721.0, 105), (100.0, 1916)):
        scan = Scan((candidate("cubic", 3931.0), candidate("odd_quadratic", gain)), (alone,), 180, 200)
        verdict, text = judgement(Case(SimpleNamespace(runs=[1], remarks=()), scan, (), groups=(alone,)))
        assert verdict == "named"
        assert f"Its nearest rival is odd_quadratic, worse by {worse} in log-evidence." in text


@pytest.mark.parametrize("code", [*UNSTEADY, *(code for code, kind in KINDS.items() if kind.place == "verdict")])
def test_what_nothing_explains_ends_in_what_to_do(code):
    """Whatever the cause; the twin without the step is the sentence of the rule itself."""
    noise = SimpleNamespace(ratio=9.0, band=None)
    fit = SimpleNamespace(runs=[SimpleNamespace(noise=noise)], seen_by_runs=(), spreads=(), remarks=())
    case = Case(fit, Scan((), (), 180, 200), (), remarks=(Remark(code, "Something is wrong", {}),))
    verdict, text = judgement(case)
    if verdict == "adequate":  # the remark is the cause, and no effect
        return
    assert verdict == "unexplained"
    assert text.endswith(f"{TO_GO_ON} {NEXT_STEPS.get(code, USUAL_STEP)}.")
    plain = next(judged for rule in JUDGED_BY if (judged := rule(case)) is not None)
    assert TO_GO_ON not in plain[1]


def test_every_effect_of_a_set_has_its_largest_contribution() -> None:
    """The second one of a set has no place among the candidates for the first."""
    truth, rng = {"bias": 0.05, "cubic": 3e-3}, np.random.default_rng(31)
    simulated = ac.simulate(
        "interleaved", seconds=15.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng
    ).recording
    p, accel = simulated.position, simulated.accel
    v = np.interp(accel.t, p.t, np.gradient(p.y, p.t))
    recording = replace(simulated, accel=replace(accel, y=accel.y + 0.6 * v))
    diagnosis = ac.diagnose(ac.fit(recording), recording)
    assert {"cubic", "velocity"} <= {*diagnosis.effects}
    assert "velocity" not in {candidate.effect for candidate in diagnosis.scan.candidates}
    assert diagnosis.sizes["velocity"].value == pytest.approx(0.6 * float(np.max(np.abs(v))), rel=0.1)
