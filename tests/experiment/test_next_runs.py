"""The run that separates a class of causes is ranked first, and joint diagnosis after it agrees with what was expected.

An effect of a user's own that equals `quadratic` on the rig of the record cannot be separated; one that has the sign of
the mount is separated by turning the sensor, and by nothing else.
"""

from __future__ import annotations

import dataclasses
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy import special

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.diagnosis.experiment.design import Limits
from accelcal.diagnosis.experiment.next_runs import (
    Beliefs,
    Further,
    added,
    class_with_weights,
    enlarged,
    fitted_without,
    further,
    likeliest,
    saturates,
    within_range,
)
from accelcal.diagnosis.findings import Confounded
from accelcal.diagnosis.policy import CLASS_WEIGHT
from accelcal.diagnosis.runs import repeated
from accelcal.diagnosis.search.confounding import Weights
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.effects import find
from accelcal.simulation import CXL02_RIG
from accelcal.simulation.motion import Motion, Tones
from benches.next_runs import Stage, Trial
from tests.commands import accelcal
from tests.schemas import require_published

REVERSED = dataclasses.replace(CXL02_RIG, mount="reversed")
TRUTH = {"bias": 0.05, "quadratic": 1e-3}
TURNED = "the same motion with the sensor turned by 180 degrees, its input axis reversed"
AGAIN = "the same motion again"


def on_one_tone(rig=CXL02_RIG, seed=1, truth=TRUTH) -> ac.Recording:
    """20 s at 3 Hz and 2 m/s², on which a², v² and p² are one signature."""
    tone = Motion((Tones(np.array([2.0 / (6.0 * math.pi) ** 2]), np.array([3.0]), np.zeros(1)),), 20.0, name="tone")
    return ac.simulate(tone, seconds=20.0, rig=rig, parameters=truth, rng=np.random.default_rng(seed)).recording


def on_many_motions(rig=CXL02_RIG, seed=1) -> ac.Recording:
    """20 s on which only the mount is left to separate what has its sign."""
    simulation = ac.simulate("interleaved", seconds=20.0, rig=rig, parameters=TRUTH, rng=np.random.default_rng(seed))
    return simulation.recording


def diagnosed(*recordings: ac.Recording) -> ac.Diagnosis:
    return ac.diagnose(ac.fit(recordings[0]), recordings, extra=())


@pytest.fixture(scope="module")
def tone():
    record = on_one_tone()
    diagnosis = diagnosed(record)
    return record, diagnosis, ac.next_experiments(diagnosis, record)


@pytest.fixture(scope="module", params=[True, False], ids=["sign of the mount", "none"])
def twin(request):
    """A record on which `quadratic` is confounded with a user's effect alone, and whether that has the mount's sign."""
    sign = request.param
    name = "mount_square" if sign else "sensor_square"

    @ac.effect(name, unit="(m/s²)⁻¹", owner="rig" if sign else "sensor", symbol="ms", scale=1e-3)
    def square(s):
        """A square of the specific force."""
        return (s.rig.polarity if sign else 1.0) * s.a**2

    record = on_many_motions()
    extra = (find(name),)
    diagnosis = ac.diagnose(ac.fit(record), record, extra=extra)
    assert set(diagnosis.classes[0].members) == {"quadratic", name}
    return sign, record, diagnosis, ac.next_experiments(diagnosis, record), extra


def test_turning_the_sensor_separates_what_has_the_sign_of_the_mount_and_nothing_else_does(twin):
    sign, *_, result, _ = twin
    assert result.entropy == pytest.approx(math.log(2.0), abs=0.02)
    falls = {run.run: run.fall for run in result.ranked}
    if sign:
        assert result.separable
        best = result.ranked[0]
        assert best.run == TURNED
        assert best.fall > 0.99 * result.entropy
        assert best.decided > 0.99
        assert best.separation > 20.0
        assert max(fall for run, fall in falls.items() if run != TURNED and "dwells" not in run) < 0.01
    else:
        assert not result.separable
        assert max(falls.values()) < 0.05
        assert result.sentence == f"None of these can separate them: {', '.join(c.effect for c in result.causes)}."


def test_the_next_recording_closes_the_loop(twin):
    sign, record, before, _, extra = twin
    both = [record, on_many_motions(REVERSED, seed=2)]
    result = ac.next_experiments(ac.diagnose(ac.fit(record), both, extra=extra), both, before=before)
    weights = {cause.effect: (cause.before, cause.weight) for cause in result.causes}
    then, now = weights["quadratic"]
    assert then == pytest.approx(0.5, abs=0.02)
    if sign:
        assert now == 1.0
        assert result.sentence.startswith("quadratic remains")
        assert not result.ranked
    else:
        assert now == pytest.approx(0.5, abs=0.05)
        assert result.ranked


def test_what_is_expected_of_a_run_comes_true(tone):
    record, before, expected = tone
    assert {"quadratic", "velocity_squared", "rail_curve"} <= {cause.effect for cause in expected.causes}
    falls = {run.run: run.fall for run in expected.ranked}
    both = [record, on_one_tone(seed=3)]
    again = ac.next_experiments(diagnosed(*both), both, before=before)
    assert expected.entropy - falls[AGAIN] == pytest.approx(again.entropy, abs=0.15)
    both = [record, on_one_tone(REVERSED, seed=3)]
    other = ac.next_experiments(diagnosed(*both), both, before=before)
    # with `quadratic` true the rest of the weight goes; with one of the two others half of it stays: ln 2 in the mean
    assert other.causes[0].effect == "quadratic"
    assert other.causes[0].weight > 0.9
    assert falls[TURNED] == pytest.approx(expected.entropy - 2.0 / 3.0 * math.log(2.0), abs=0.2)
    assert other.entropy < 0.3


def two_rivals(d: float) -> tuple[Beliefs, np.ndarray]:
    """Two scalar members with known sizes, and the Gram matrix of a run in which their best fits are `d` apart."""
    size = 1e3
    beliefs = Beliefs(
        items=(Hypothesis(find("quadratic"), {}), Hypothesis(find("cubic"), {})),
        weights=np.array([0.5, 0.5]),
        basis=np.eye(2),
        places=(slice(0, 1), slice(1, 2)),
        mean=np.array([size, size]),
        gains=np.full(2, size**2),
        inflation=1.0,
    )
    share = 0.5 * (d / size) ** 2
    return beliefs, share * np.array([[1.0, -1.0], [-1.0, 1.0]])


@pytest.mark.parametrize("d", [0.0, 1.0, 3.0, 6.0])
def test_the_expected_entropy_is_that_of_normal_log_odds(d, monkeypatch):
    # Members whose sizes are known to 0.1 % of them: twice the log-odds are normal with mean and variance d².
    monkeypatch.setattr("accelcal.diagnosis.experiment.next_runs.INDEPENDENT_PIECES", 1e12)
    monkeypatch.setattr("accelcal.diagnosis.experiment.next_runs.DRAWS", 20_000)
    beliefs, G = two_rivals(d)
    predicted = beliefs.after(G, Further("", 60.0, lambda: None))
    separation = math.sqrt(G[0, 0]) * 2.0 * 1e3  # what remains where the rival keeps its size
    x, w = np.polynomial.hermite_e.hermegauss(61)
    w = w / w.sum()

    def entropy(distance):
        p = special.expit(0.5 * distance**2 + distance * x)
        return float(w @ (special.entr(p) + special.entr(1.0 - p)))

    assert predicted.fall == pytest.approx(math.log(2.0) - entropy(separation), abs=0.01)
    assert predicted.separation == pytest.approx(separation, abs=0.15)
    if d:  # the twin: another distance has another entropy
        assert abs(predicted.fall - (math.log(2.0) - entropy(0.5 * separation))) > 0.015


def test_limits_allow_what_they_allow(tone):
    record, diagnosis, result = tone
    assert not any("times as large" in run.run for run in result.ranked)
    wider = ac.next_experiments(diagnosis, record, stroke=0.1, v_max=0.2, a_max=20.0, tiltable=True, setup=60.0)
    runs = {run.run: run for run in wider.ranked}
    (larger,) = (run for run in runs if "times as large" in run)
    top = 2.0 / (6.0 * math.pi)
    assert float(larger.split()[3]) == pytest.approx(0.2 / top, rel=0.02)  # the speed is the first limit
    assert runs["the same motion with the axis up"].minutes == pytest.approx((20.0 + 60.0) / 60.0, rel=0.01)
    half = 0.5 * max(run.fall for run in wider.ranked)
    strong = [run.per_minute for run in wider.ranked if run.fall >= half]
    weak = [run.per_minute for run in wider.ranked if run.fall < half]
    assert [run.per_minute for run in wider.ranked] == sorted(strong, reverse=True) + sorted(weak, reverse=True)
    assert weak[0] > strong[-1]  # the twin: by time alone a short run that says little would come before
    assert all(0.0 <= run.fall <= wider.entropy + 1e-9 and 0.0 <= run.decided <= 1.0 for run in wider.ranked)


def test_no_run_exceeds_the_limits_or_the_range_of_the_sensor(tone):
    record, diagnosis, _ = tone
    smaller = [run.run for run in ac.next_experiments(diagnosis, record, a_max=0.5).ranked]
    assert AGAIN not in smaller
    same = [run for run in smaller if run.startswith("the same motion")]
    assert same
    assert all(float(run.split()[3]) == pytest.approx(0.25, rel=0.02) for run in same)  # of 2 m/s²
    _, states = fitted_without(diagnosis, class_with_weights(diagnosis), [record], lambda share: None)
    limits = within_range(Limits(10.0, 10.0, 1000.0), states[0])
    assert limits.acceleration == CXL02_RIG.sensor.range
    wide = ac.next_experiments(diagnosis, record, stroke=10.0, v_max=10.0, a_max=1000.0)
    (larger,) = (run.run for run in wide.ranked if "times as large" in run.run)
    assert float(larger.split()[3]) == pytest.approx(CXL02_RIG.sensor.range / 2.0, rel=0.02)
    assert not saturates(states[0], states[0])
    assert saturates(repeated(states[0], CXL02_RIG, lambda s: enlarged(s, 11.0)), states[0])


def test_an_upright_sensor_is_turned_over_before_quick_runs_that_say_little():
    # Upright the specific force keeps its sign: a² and a|a| differ where the sensor is turned over, hardly elsewhere.
    upright = dataclasses.replace(CXL02_RIG, axis="up")
    simulation = ac.simulate("tones", seconds=20.0, rig=upright, parameters=TRUTH, rng=np.random.default_rng(3))
    diagnosis = diagnosed(simulation.recording)
    assert {"quadratic", "odd_quadratic"} <= set(diagnosis.classes[0].members)
    result = ac.next_experiments(diagnosis, simulation.recording, setup=3600.0)
    best, others = result.ranked[0], result.ranked[1:]
    assert best.run == TURNED
    assert best.fall > 0.5 * result.entropy
    assert max(run.per_minute for run in others) > best.per_minute


def test_a_temperature_that_rises_is_tried_where_one_was_recorded():
    from accelcal.diagnosis.experiment.next_runs import warmed

    record = on_one_tone()
    t = record.position.t
    recorded = dataclasses.replace(record, side={"temperature": ac.Channel("temperature", t, 20.0 + 0.0 * t, "degC")})
    group = class_with_weights(diagnosed(record))
    model, states = fitted_without(diagnosed(record), group, [recorded], lambda share: None)
    item = Hypothesis(find("temperature_bias"), {})
    tried = further(states[0], model, Limits(0.1, 0.2, 9.0), [item], tiltable=False, setup=0.0)
    runs = {run.text: run.state for run in tried}
    (warm,) = (run for run in runs if "temperature" in run)
    beliefs = Beliefs((item,), np.ones(1), np.eye(1), (slice(0, 1),), np.zeros(1), np.zeros(1), 1.0)
    cold, heated = (beliefs.gram(runs[run](), model)[0, 0] for run in (AGAIN, warm))
    assert cold == 0.0
    assert heated > 1e4
    assert np.ptp(warmed(states[0].signals).temperature) == pytest.approx(10.0)


def test_an_enlarged_motion_is_the_motion_times_a_factor(tone):
    record, diagnosis, _ = tone
    _, states = fitted_without(diagnosis, class_with_weights(diagnosis), [record], lambda share: None)
    s = states[0].signals
    twice = enlarged(s, 2.0)
    np.testing.assert_allclose(np.gradient(twice.v, s.step)[5:-5], twice.a[5:-5], atol=0.05)
    np.testing.assert_allclose(twice.a, 2.0 * s.a, atol=1e-12)
    assert np.ptp(twice.p) == pytest.approx(2.0 * np.ptp(s.p))


def test_a_class_with_one_weight_of_99_percent_is_decided():
    def group(weight):
        weights = {"cubic": Weights(1.0 - weight), "quadratic": Weights(weight), "shape_of_time": Weights()}
        return Confounded("cubic", tuple(weights), "", weights=weights)

    assert likeliest(group(0.995)) == (0.995, "quadratic")
    assert class_with_weights(SimpleNamespace(classes=[group(0.995)])) is None
    undecided = group(0.98)
    assert class_with_weights(SimpleNamespace(classes=[group(0.995), undecided])) is undecided
    assert likeliest(Confounded("cubic", ("cubic", "tone"), "")) == (0.0, "cubic")


def test_where_nothing_is_confounded_there_is_nothing_to_separate(tone):
    alone = on_many_motions()
    with pytest.raises(ValueError, match=r"nothing to separate: .*the verdict is named"):
        ac.next_experiments(diagnosed(alone), alone)
    record, diagnosis, _ = tone
    with pytest.raises(ValueError, match="setup: found -1 s"):
        ac.next_experiments(diagnosis, record, setup=-1.0)
    with pytest.raises(ValueError, match="stroke must be positive"):
        ac.next_experiments(diagnosis, record, stroke=0.0)
    with pytest.raises(ValueError, match="no recordings; give those"):
        ac.next_experiments(diagnosis, [])


def test_dwells_whose_range_changes_the_column_of_a_rival_add_no_negative_information():
    # The loop of hysteresis is that of the whole range: about gravity the tone by itself has none.
    stage = Stage(Trial("cubic", 5.0, same=False, number=0, seed=26101))
    record = stage.run()
    result = ac.next_experiments(ac.diagnose(ac.fit(record), record, extra=()), record, a_max=8.0)
    assert "hysteresis" in {cause.effect for cause in result.causes}
    assert any("dwells" in run.run for run in result.ranked)
    before = np.diag([1.0, 2.0])
    assert np.linalg.eigvalsh(added(np.diag([0.0, 5.0]), before)).tolist() == pytest.approx([0.0, 3.0])


def test_the_command_prints_the_runs_then_the_cause_that_remains(tmp_path):
    write_recording(on_one_tone(), tmp_path / "one.csv")
    write_recording(on_many_motions(seed=5), tmp_path / "two.csv")
    write_recording(on_one_tone(truth={"bias": 0.05}), tmp_path / "null.csv")
    assert accelcal("fit", "one.csv", "-o", "m.json", cwd=tmp_path).returncode == 0
    first = accelcal("next", "m.json", "one.csv", "--stroke", "0.1 m", "--json", "--motion", "go.csv", cwd=tmp_path)
    content = json.loads(first.stdout)
    require_published(content)
    assert content["separable"]
    assert content["ranked"][0]["fall"] > content["ranked"][-1]["fall"]
    assert np.ptp(np.loadtxt(tmp_path / "go.csv", delimiter=",", skiprows=1)[:, 1]) <= 0.1
    second = accelcal("next", "m.json", "one.csv", "two.csv", cwd=tmp_path)
    assert "quadratic remains" in second.stdout
    refused = accelcal("next", "m.json", "null.csv", cwd=tmp_path)
    assert (refused.returncode, "nothing to separate" in refused.stderr) == (3, True)
    assert accelcal("next", "m.json", "one.csv", "--amax", "9", cwd=tmp_path).returncode == 2
    improved = accelcal("improve", "one.csv", "--next", cwd=tmp_path)
    assert "Further runs that separate" in improved.stdout
    assert f"probability that one has {100.0 * CLASS_WEIGHT:g} %" in improved.stdout
