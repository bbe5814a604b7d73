"""Which rivals share a class with an effect, and which of two that look the same comes first."""

from __future__ import annotations

import re
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest

import accelcal as ac
from accelcal.cli.data import checked_recording
from accelcal.diagnosis.findings import NEXT_STEPS, TO_GO_ON, USUAL_STEP
from accelcal.diagnosis.policy import INDEPENDENT_PIECES
from accelcal.diagnosis.search.beam import SearchRules
from accelcal.diagnosis.search.confounding import CLASS_ODDS, Weights, confounding_class, plainest
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scan import Candidate, Scan
from accelcal.diagnosis.search.scores import CandidateScores
from accelcal.diagnosis.verdict import RULES as JUDGED_BY, UNSTEADY, Case, judgement
from accelcal.effects import SizePrior, find
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


def test_what_an_effect_adds_significantly_to_what_it_includes_keeps_its_place() -> None:
    """At d = 55 and a correlation of 0.994 it explains 6 sigma more; saturated evidence leaves a tie."""
    strong = scores(("cross_axis_product", "cross_axis"), 55.0, 0.994)
    gains, _ = strong.gains()
    nearer = [RULES.net_gain(float(gain), 1, item) for gain, item in zip(gains, strong.items, strict=True)]
    assert nearer[0] - nearer[1] < 2.0 * CLASS_ODDS
    assert plainest(strong, PLAIN, (0,), RULES) == (0,)
    weaker = scores(("cross_axis_product", "cross_axis"), 55.0, 0.9985)  # the twin: 3 sigma more are chance
    assert plainest(weaker, PLAIN, (0,), RULES) == (1,)


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


def test_the_second_set_is_the_evidence_ratio_under_the_priors_that_are_given() -> None:
    """Signatures alike at d = 10: the odds are those of two normal distributions, by their closed form."""
    priors = {"cubic": SizePrior(3.0, "run.toml", (1.0,)), "odd_quadratic": SizePrior(300.0, "fleet", (1.0,), 8.0)}
    alone, given = (
        confounding_class(scores(("cubic", "odd_quadratic"), 10.0, 1.0 - 1e-9), PLAIN, 0, (), rules)
        for rules in (RULES, replace(RULES, priors=priors))
    )
    assert {name: w.by_record for name, w in given.items()} == {name: w.by_record for name, w in alone.items()}
    assert [w.source for w in given.values()] == ["run.toml", "fleet"]
    C = 10.0**2 / (INDEPENDENT_PIECES * np.log1p(10.0**2 / INDEPENDENT_PIECES))  # as wide as the gain is discounted
    odds = 0.5 * ((8.0 - 10.0) ** 2 / (300.0**2 + C) + np.log1p(300.0**2 / C))
    odds -= 0.5 * (10.0**2 / (3.0**2 + C) + np.log1p(3.0**2 / C))
    cubic, rival = (given[name].with_sheets for name in ("cubic", "odd_quadratic"))
    assert np.log(cubic / rival) == pytest.approx(odds, rel=1e-6)  # columns differ by 1e-9
    assert not np.isclose(cubic, alone["cubic"].with_sheets, atol=0.1)  # the twin: by the catalogue
    none = confounding_class(scores(("cubic", "odd_quadratic"), 10.0, 0.97), PLAIN, 0, (), replace(RULES, priors=None))
    assert all(np.isnan(w.with_sheets) for w in none.values())


@pytest.fixture(scope="module")
def tie() -> tuple[ac.Fit, ac.Recording]:
    """K3 of six standard deviations, which two rivals explain nearly as well."""
    truth, rng = {"bias": 0.05, "cubic": 1.5e-4}, np.random.default_rng(1)
    run = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng).recording
    return ac.fit(run), run


def weights(diagnosis: ac.Diagnosis, which: str) -> dict[str, float]:
    """One set of weights of what the search named."""
    return {name: getattr(w, which) for name, w in diagnosis.scan.detected[0].weights.items()}


def test_a_prior_moves_the_second_set_alone(tie: tuple[ac.Fit, ac.Recording]) -> None:
    """The size that a sidecar declares, or a fleet has, leaves class, name and first set as they are, to the bit; the
    twin declares the size of the catalogue and moves nothing."""
    fit, run = tie
    catalogue_size = f"{find('odd_quadratic').prior.scale!r} (m/s^2)^-1"
    plain, same, sheet, fleet, none = (
        ac.diagnose(fit, replace(run, prior_sizes=sizes), prior=prior)
        for sizes, prior in (
            ({}, None),
            ({"odd_quadratic": catalogue_size}, None),
            ({"odd_quadratic": "1 g/g^2"}, None),
            ({"cubic": "1 g/g^3"}, {"cubic": ac.Prior(1.5e-4, 1e-6), "lever_arm.x": ac.Prior(0.0, 1.0)}),
            ({"odd_quadratic": "1 g/g^2"}, "none"),
        )
    )
    assert len(plain.classes[0].members) > 1
    for other in (same, sheet, fleet, none):
        assert (other.verdict, other.effects) == (plain.verdict, plain.effects)
        assert [group.members for group in other.classes] == [group.members for group in plain.classes]
        assert weights(other, "by_record") == weights(plain, "by_record")
    assert weights(same, "with_sheets") == weights(plain, "with_sheets")
    assert weights(sheet, "with_sheets")["odd_quadratic"] < 0.05 < 0.2 < weights(plain, "with_sheets")["odd_quadratic"]
    assert weights(fleet, "with_sheets")["cubic"] > 0.9 > 0.8 > weights(plain, "with_sheets")["cubic"]
    assert "with the sizes of data sheets (odd_quadratic: simulated interleaved): " in sheet.sentence
    assert "with the sizes of data sheets (cubic: fleet): " in fleet.sentence
    assert "with the sizes of data sheets: " in plain.sentence
    assert plain.sentence.startswith(none.sentence.removesuffix("."))
    assert "data sheets" not in none.sentence
    assert all(np.isnan(w) for w in weights(none, "with_sheets").values())


@pytest.mark.parametrize(
    ("sizes", "text"),
    [
        ({"cubik": "1 ug/g^3"}, "prior.cubik: there is no effect called 'cubik'; did you mean cubic"),
        ({"cubic": "1 mg"}, "prior.cubic: found '1 mg', expected a size in µg/g³ or a unit that converts to it"),
        ({"cross_axis": "1 mg"}, "prior.cross_axis: found '1 mg', expected a pure number"),
        ({"cubic": "0 ug/g^3"}, "prior.cubic: found '0 ug/g^3', expected a positive number with its unit"),
        ({"encoder_nonlinearity": "1 1/m"}, "its coefficients are in m⁻¹, m⁻², for which there is no one size"),
    ],
)
def test_a_size_that_no_effect_has_is_refused_before_the_search(
    tie: tuple[ac.Fit, ac.Recording], sizes: dict[str, str], text: str
) -> None:
    fit, run = tie
    run = replace(run, prior_sizes=sizes)
    with pytest.raises(ac.RecordingError) as error:
        ac.diagnose(fit, run)
    assert str(error.value).startswith(f"{run.name}: prior.")
    assert text in str(error.value)
    with pytest.raises(ac.RecordingError):
        ac.improve(run)
    with pytest.raises(ac.RecordingError, match=re.escape(str(error.value))):
        checked_recording(run)
    checked_recording(replace(run, prior_sizes={"cubic": "1 ug/g^3"}))


def test_recordings_that_declare_two_sizes_of_one_effect_are_refused(tie: tuple[ac.Fit, ac.Recording]) -> None:
    fit, run = tie
    runs = [replace(run, name=f"{i}.csv", prior_sizes={"cubic": f"{i} ug/g^3"}) for i in (1, 2)]
    with pytest.raises(ac.RecordingError, match=r"2.csv: prior.cubic: found 2 ug/g\^3, but 1.csv has another"):
        ac.diagnose(fit, runs)
