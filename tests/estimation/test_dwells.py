"""Static dwells: against generalised least squares, stacked problems, bounds and simulation; in files and verdicts."""

import dataclasses
import math

import numpy as np
import pytest
from scipy import optimize, stats

import accelcal as ac
from accelcal.data.dwells import Dwells
from accelcal.data.rig import Rig, Sensor, Uncertainty
from accelcal.effects import CATALOGUE, is_local
from accelcal.estimation.dwell_rows import acts_at_rest, determines
from accelcal.estimation.engines import rows_of_dwells
from accelcal.estimation.estimate import restored_states
from accelcal.estimation.rows import normal_equations
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG
from accelcal.validation.consistency import chi_square_region
from tests.tiers import drawn

G = 9.80665
TRUTH = {"bias": 0.05, "scale_factor": 0.004, "quadratic": 2e-5, "cubic": 3e-5}
NOISE = 20e-6 * G
"""(m/s²)/sqrt(Hz)"""


def tumble(
    rng, truth=TRUTH, *, count=24, angle_std=0.0, zero=0.0, instability=5e-5, further=0.0, rig=None, noise=NOISE
):
    """A tumble of a sensor about a horizontal axis, written down from IEEE 1293's equation and no code of ours."""
    angle = np.arange(count) * 2.0 * np.pi / count
    a = G * np.sin(angle + zero + angle_std * rng.standard_normal(count))
    white = noise**2 / 2.0 / 60.0
    mean = truth["bias"] + (1.0 + truth["scale_factor"]) * a + truth["quadratic"] * a**2 + truth["cubic"] * a**3
    mean = mean + math.sqrt(white + instability**2 + further**2) * rng.standard_normal(count)
    sensor = Sensor(noise=noise, bias_instability=instability or None)
    return Dwells(
        angle=angle,
        mean=mean,
        std=np.full(count, math.sqrt(white * 6000.0)),
        duration=np.full(count, 60.0),
        samples=np.full(count, 6000.0),
        group=("0",) * count,
        rig=rig or Rig(sensor=sensor),
        angle_std=angle_std,
        name="tumble.csv",
    )


def by_optimiser(dwells, std, order=4):
    """K0, k, K2, K3 and the angle zero by scipy's least squares on the same covariance."""

    def missed(x):
        a = dwells.gravity * math.exp(-0.5 * dwells.angle_std**2) * np.sin(dwells.angle + x[order])
        model = x[0] + (1.0 + x[1]) * a + x[2] * a**2 + x[3] * a**3
        return (dwells.mean - model) / std

    result = optimize.least_squares(missed, np.zeros(order + 1), method="lm", xtol=1e-15, ftol=1e-15, gtol=1e-15)
    x = result.x
    for _ in range(4):
        J = np.column_stack([(missed(x + h) - missed(x - h)) / (2.0 * 1e-5) for h in 1e-5 * np.eye(order + 1)])
        x = x - np.linalg.lstsq(J, missed(x), rcond=None)[0]
    return x, np.linalg.inv(J.T @ J)


def test_a_tumble_is_generalised_least_squares():
    dwells = tumble(np.random.default_rng(1), angle_std=1e-4, zero=2e-3)
    fit = ac.fit(dwells, ac.Model.cubic())
    x, covariance = by_optimiser(dwells, np.array(fit.dwells.std))
    angle = dwells.angle + x[4]
    assert fit.dwells.std == pytest.approx(np.sqrt(dwells.variance_at(angle, 1.0 + x[1])), rel=1e-3)
    std = np.sqrt(np.diag(covariance))[:4]
    assert np.array([e.value for e in fit.free]) == pytest.approx(x[:4], rel=1e-9, abs=1e-9 * float(np.min(std)))
    assert np.array([e.std for e in fit.free]) == pytest.approx(std, rel=1e-6)
    assert fit.dwells.zeros[0][1] == pytest.approx(x[4], rel=1e-7)
    assert fit["time_offset"].std == 0.0
    a = dwells.gravity * math.exp(-0.5 * dwells.angle_std**2) * np.sin(angle)
    by_hand = stats.norm.logpdf(dwells.mean, np.polyval([x[3], x[2], 1.0 + x[1], x[0]], a), fit.dwells.std)
    assert fit.log_likelihood == pytest.approx(np.sum(by_hand), rel=1e-6)
    assert fit.bic == pytest.approx(len(fit.free) * math.log(24) - 2.0 * np.sum(by_hand), rel=1e-6)


def test_angles_do_not_take_the_scale_factor():
    """At +-1 g any angle is as good, and those dwells weigh most: a wrong scale must not turn them."""
    for seed in range(20):
        dwells = tumble(np.random.default_rng(seed), {**TRUTH, "scale_factor": 0.03}, angle_std=9e-4, instability=0.0)
        fit = ac.fit(dwells, ac.Model.cubic())
        assert abs(fit.dwells.zeros[0][1]) < 4.0 * 9e-4
        assert abs(fit["scale_factor"].value - 0.03) < 5.0 * fit["scale_factor"].std


@drawn(100)
@pytest.mark.parametrize("understated", [False, True])
def test_tumbles_with_errors_of_the_angle_are_consistent(understated, draws):
    """NEES of the tumbles in its 99 % region; the twin declares a third of the error of the angles."""
    results = []
    for seed in range(draws):
        dwells = tumble(np.random.default_rng(seed), angle_std=1e-3, zero=3e-3)
        if understated:
            dwells = dataclasses.replace(dwells, angle_std=3e-4)
        fit = ac.fit(dwells, ac.Model.cubic())
        error = np.array([e.value - TRUTH[e.name] for e in fit.free])
        scatter = fit.covariance if not understated else fit.covariance * (1e-9 + _declared_share(fit))
        results.append(error @ np.linalg.solve(scatter, error))
    low, high = chi_square_region(4, draws, 0.99)
    print(f"NEES {np.mean(results):.2f} of 4 over {draws} tumbles ({low:.2f} to {high:.2f})")
    assert (low < np.mean(results) < high) is not understated


def _declared_share(fit):
    """What the covariance would be had the scatter between dwells not been taken into it."""
    return 1.0 / (1.0 + (fit.dwells.scatter / (3e-4 * G)) ** 2)


def test_the_moments_of_an_uncertain_angle_are_exact():
    rng = np.random.default_rng(3)
    dwells = dataclasses.replace(tumble(rng, count=8), angle_std=0.2)
    plain = dataclasses.replace(dwells, angle_std=0.0)
    drawn = G * np.sin(dwells.angle + 0.2 * rng.standard_normal((200_000, 8)))
    assert dwells.specific_force(dwells.angle) == pytest.approx(np.mean(drawn, axis=0), abs=0.02)
    assert dwells.variance - plain.variance == pytest.approx(np.var(drawn, axis=0), rel=0.02)


@pytest.fixture(scope="module")
def motion():
    rng = np.random.default_rng(3)
    recording = ac.simulate("tones", seconds=20.0, rig=ADXL105_RIG, parameters=TRUTH, rng=rng).recording
    return dataclasses.replace(recording, digest="motion")


def test_motion_and_dwells_together_are_the_stacked_problem(motion):
    dwells = tumble(np.random.default_rng(4), rig=motion.rig, noise=225e-6 * G, instability=0.0)
    fit = ac.fit([motion, dwells], ac.Model.cubic())
    assert fit.model.added == ("quadratic", "cubic", "tilt")  # dwells separate it
    states = restored_states(fit, [motion.with_dwells(dwells)])
    joint = normal_equations(states[0], fit.model.free)
    recording = states[0].run.recording
    states[0].run = dataclasses.replace(states[0].run, recording=motion)
    alone = normal_equations(states[0], fit.model.free)
    states[0].run = dataclasses.replace(states[0].run, recording=recording)
    # the dwells by hand: columns of IEEE 1293 and of the angle zero, eliminated
    zero = rows_of_dwells(states[0], ()).zeros["0"]
    a = G * np.sin(dwells.angle + zero)
    columns = {"bias": np.ones_like(a), "scale_factor": a, "quadratic": a**2, "cubic": a**3}
    X = np.column_stack([columns.get(term.name, np.zeros_like(a)) for term in fit.model.free])
    slope = 1.0 + fit["scale_factor"].value + 2.0 * fit["quadratic"].value * a + 3.0 * fit["cubic"].value * a**2
    Z = (slope * G * np.cos(dwells.angle + zero))[:, None]
    W = np.diag(rows_of_dwells(states[0], ()).std ** -2.0)
    schur = X.T @ W @ X - X.T @ W @ Z @ np.linalg.solve(Z.T @ W @ Z, Z.T @ W @ X)
    size = np.sqrt(np.diag(joint.gram))
    assert joint.gram / np.outer(size, size) == pytest.approx((alone.gram + schur) / np.outer(size, size), abs=1e-9)
    bound = np.sqrt(np.diag(np.linalg.inv(joint.gram)))
    assert np.array([e.std for e in fit.free]) == pytest.approx(bound, rel=0.01)


def test_a_motion_and_dwells_are_more_certain_than_each(motion):
    dwells = tumble(np.random.default_rng(4), rig=motion.rig, noise=225e-6 * G, instability=0.0, angle_std=3e-4)
    together = ac.fit([motion, dwells], ac.Model.cubic())
    for alone in (ac.fit(motion, ac.Model.cubic()), ac.fit(dwells, ac.Model.cubic())):
        for name in ("scale_factor", "cubic"):
            assert together[name].std < alone[name].std
    for name, value in TRUTH.items():
        assert abs(together[name].value - value) < 4.0 * together[name].std


@pytest.mark.parametrize("size", [2e-3, 0.0])
def test_dwells_show_the_scale_of_the_encoder(motion, size):
    dwells = tumble(np.random.default_rng(5), rig=motion.rig, noise=225e-6 * G, instability=0.0)
    position = dataclasses.replace(motion.position, y=motion.position.y * (1.0 + size))
    both = dataclasses.replace(motion, position=position, digest="").with_dwells(dwells)
    diagnosis = ac.diagnose(ac.fit(both, ac.Model.cubic()), both)
    named = {member for group in diagnosis.classes for member in group.members}
    assert ("encoder_scale" in named) is (size > 0.0), diagnosis.sentence
    if size:
        grown = ac.add(diagnosis.fit, both, "encoder_scale")["encoder_scale"]
        assert abs(grown.value - size) < 4.0 * grown.std


def test_one_table_that_two_sidecars_name_counts_once(motion):
    dwells = dataclasses.replace(tumble(np.random.default_rng(6), rig=motion.rig), digest="the table")
    other = ac.simulate(
        "tones", seconds=20.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(8)
    ).recording
    once = ac.fit([motion.with_dwells(dwells), other])
    twice = ac.fit([motion.with_dwells(dwells), other.with_dwells(dwells)])
    assert [e.value for e in once.estimates] == pytest.approx([e.value for e in twice.estimates], rel=1e-12)


def test_a_bias_that_differs_from_run_to_run_differs_in_dwells_too(motion):
    dwells = tumble(np.random.default_rng(4), {**TRUTH, "bias": 0.3}, rig=motion.rig, instability=0.0)
    other = ac.simulate(
        "tones",
        seconds=20.0,
        rig=ADXL105_RIG,
        parameters={**TRUTH, "bias": 0.1},
        rng=np.random.default_rng(8),
    ).recording
    fit = ac.fit([motion, other, dwells], ac.Model.cubic().vary("bias"))
    assert abs(fit["cubic"].value - TRUTH["cubic"]) < 4.0 * fit["cubic"].std
    assert fit.dwells.p_value > 1e-3


def test_scatter_beyond_what_is_declared_is_reported_and_widens():
    linear = {**TRUTH, "quadratic": 0.0, "cubic": 0.0}
    plain, wild = (tumble(np.random.default_rng(7), linear, further=further) for further in (0.0, 5e-3))
    quiet, fit = (ac.fit(dwells) for dwells in (plain, wild))
    assert quiet.dwells.scatter == 0.0
    assert not any("more than is declared" in remark.sentence for remark in quiet.remarks)
    assert fit.dwells.scatter == pytest.approx(5e-3, rel=0.5)
    (message,) = [remark.sentence for remark in fit.remarks if "more than is declared" in remark.sentence]
    assert f", {round(fit.dwells.ratio, -1):.0f} times what noise within them explains" in message  # not 2e+02
    assert fit["bias"].std > 10.0 * quiet["bias"].std
    verdicts = [ac.diagnose(f, d).verdict for f, d in ((quiet, plain), (fit, wild))]
    assert verdicts == ["adequate", "unexplained"]


def test_noise_within_dwells_that_is_too_large_is_said():
    """Where std was written in mV and read in V, every effect hides in it; a false alarm is one tumble in 10 000."""
    dwells = tumble(np.random.default_rng(7), instability=0.0)
    for factor, remarks in ((1.0, 0), (1000.0, 1)):
        fit = ac.fit(dataclasses.replace(dwells, std=factor * dwells.std), ac.Model.linear().add("quadratic", "cubic"))
        assert sum("is std that of the samples" in note.sentence for note in fit.remarks) == remarks


@drawn(30)
def test_a_null_tumble_lacks_nothing_and_a_cubic_one_does(draws):
    """At a stated rate of 0.5 %; the twin has K3 at about ten standard deviations."""
    linear = {**TRUTH, "quadratic": 0.0, "cubic": 0.0}
    false = missed = 0
    for seed in range(draws):
        dwells = tumble(np.random.default_rng(seed), linear, angle_std=2e-4, zero=1e-3)
        false += ac.diagnose(ac.fit(dwells), dwells).verdict != "adequate"
        dwells = tumble(np.random.default_rng(seed), {**linear, "cubic": 2e-5}, angle_std=2e-4, zero=1e-3)
        missed += "cubic" not in ac.diagnose(ac.fit(dwells), dwells).members
    assert false <= stats.binom.ppf(0.975, draws, 0.005)
    assert missed == 0


def test_what_no_dwell_shows_is_refused(motion):
    dwells = tumble(np.random.default_rng(1))
    with pytest.raises(ac.NotIdentifiable, match="velocity does not act"):
        ac.fit(dwells, ac.Model.linear().add("velocity"))
    with pytest.raises(ac.NotIdentifiable, match="needs temperature"):
        ac.fit(dwells, ac.Model.linear().add("temperature_bias"))
    with pytest.raises(ac.NotIdentifiable, match=r"confounded.*2 dwells at 2 elevations"):
        ac.fit(dwells.rows(np.array([6, 18])), ac.Model.cubic())
    with pytest.raises(ac.RecordingError, match="dwells alone"):
        ac.compare(ac.fit(dwells), motion)[0]


def test_which_dwells_determine_the_bias():
    dwells = tumble(np.random.default_rng(1))
    flip, level = dwells.rows(np.array([6, 18])), dwells.rows(np.array([0, 0]))
    assert determines(flip, "bias")
    assert determines(flip, "scale_factor")
    assert determines(dwells, "bias")
    assert not determines(level, "bias")  # an angle zero is as likely
    sure = dataclasses.replace(level, rig=Rig(uncertainty=Uncertainty(level=1e-4)))
    assert determines(sure, "bias")
    assert not determines(sure, "scale_factor")


def test_every_effect_that_acts_at_rest_does_so_without_motion():
    """Of the whole catalogue: constant arguments give finite columns."""
    dwells = dataclasses.replace(tumble(np.random.default_rng(1)), temperature=np.linspace(20.0, 30.0, 24))
    from accelcal.estimation.dwell_rows import columns_at, signals_at
    from accelcal.model import terms_of

    s = signals_at(dwells, dwells.angle, 1.0, ac.fit(dwells).origins)
    tried = 0
    for effect in CATALOGUE.values():
        if not acts_at_rest(effect) or set(effect.needs) - {"temperature"}:
            continue
        try:
            shape = {name: float(np.median(p.grid(s))) for name, p in effect.shapes.items() if not p.picked}
        except (ValueError, ZeroDivisionError):
            continue
        if len(shape) < len(effect.shapes):
            continue
        X = columns_at(dwells, terms_of(effect, shape), s)
        assert np.all(np.isfinite(X)), effect.name
        tried += 1
    assert tried > 10
    assert any(not is_local(effect) for effect in CATALOGUE.values() if acts_at_rest(effect))


def test_a_model_file_keeps_the_dwells(tmp_path):
    fit = ac.fit(tumble(np.random.default_rng(1)))
    model_file.save(fit, tmp_path / "m.json")
    again = model_file.load(tmp_path / "m.json")
    assert again.dwells == fit.dwells
    assert again.runs == ()
    assert again.estimates == fit.estimates
    assert repr(again) == repr(fit)


@pytest.mark.parametrize(("k", "verdict"), [(0.5, "unexplained"), (0.004, "adequate")])
def test_nothing_is_called_adequate_beside_a_scale_factor_that_no_sensor_has(k, verdict):
    dwells = tumble(np.random.default_rng(3), {**TRUTH, "scale_factor": k, "quadratic": 0.0, "cubic": 0.0})
    judged = ac.diagnose(ac.fit(dwells), dwells)
    assert judged.verdict == verdict
    assert ("that of no working sensor" in judged.sentence) is (verdict == "unexplained")


def test_origins_of_temperature_are_those_of_the_dwells():
    rng = np.random.default_rng(2)
    dwells = tumble(rng, {**TRUTH, "quadratic": 0.0, "cubic": 0.0})
    warmth = rng.uniform(20.0, 40.0, len(dwells))
    warm = dataclasses.replace(dwells, temperature=warmth, mean=dwells.mean + 1e-3 * (warmth - warmth.mean()))
    diagnosis = ac.diagnose(ac.fit(warm), warm)
    assert diagnosis.verdict == "named"
    assert diagnosis.members == ("temperature_bias",)
    fit = ac.fit(warm, ac.Model.linear().add("temperature_bias"))
    assert abs(fit["temperature_bias"].value - 1e-3) < 4.0 * fit["temperature_bias"].std


def test_a_channel_that_the_dwells_lack_is_refused_and_its_effects_are_no_candidates(motion):
    """What a temperature that nobody recorded adds to the dwells is not known."""
    warm = ac.Channel("temperature", motion.accel.t, 20.0 + 0.5 * np.sin(motion.accel.t), "degC")
    both = dataclasses.replace(motion, side={"temperature": warm}).with_dwells(
        tumble(np.random.default_rng(4), rig=motion.rig, instability=0.0)
    )
    with pytest.raises(ac.RecordingError, match="temperature_bias needs temperature, which these dwells do not have"):
        ac.fit(both, ac.Model.cubic().add("temperature_bias"))
    diagnosis = ac.diagnose(ac.fit(both, ac.Model.cubic()), both)
    names = {candidate.effect for candidate in diagnosis.scan.candidates}
    assert not names & {"temperature_bias", "temperature_scale"}, names


def test_recordings_and_tables_that_are_given_twice_count_once(motion):
    shared = dataclasses.replace(tumble(np.random.default_rng(6), rig=motion.rig), digest="shared", name="shared.csv")
    further = dataclasses.replace(tumble(np.random.default_rng(7), rig=motion.rig), digest="further", name="more.csv")
    other = ac.simulate(
        "tones", seconds=20.0, rig=ADXL105_RIG, parameters=TRUTH, rng=np.random.default_rng(8)
    ).recording
    several = [motion.with_dwells(shared), other.with_dwells(shared), further]
    assert len(ac.fit(several).dwells.angle) == 48
    with pytest.raises(ac.RecordingError, match="once more: its readings would count twice"):
        ac.fit([motion, motion, shared])


def test_a_model_of_motion_and_dwells_is_used_again_on_either(motion):
    dwells = tumble(np.random.default_rng(4), rig=motion.rig, noise=225e-6 * G, instability=0.0)
    fit = ac.fit([motion, dwells], ac.Model.cubic())
    assert "tilt" in fit.model.effects
    assert ac.diagnose(fit, dwells).verdict == "adequate"
    assert ac.diagnose(fit, motion).verdict == "adequate"
    others = [
        ac.simulate(
            "tones",
            seconds=10.0,
            rig=ADXL105_RIG,
            parameters={**TRUTH, "bias": bias},
            rng=np.random.default_rng(k),
        ).recording
        for k, bias in enumerate((0.02, 0.09), 30)
    ]
    diagnosis = ac.diagnose(fit, [motion, *others, dwells])
    assert diagnosis.fit.spreads
    assert "tilt" not in diagnosis.fit.model.effects


def test_a_model_of_dwells_leaves_the_timing_of_a_motion_free(motion):
    fit = ac.fit(tumble(np.random.default_rng(4), rig=motion.rig, instability=0.0), ac.Model.cubic())
    late = dataclasses.replace(motion, accel=dataclasses.replace(motion.accel, t=motion.accel.t + 5e-4))
    diagnosis = ac.diagnose(fit, late)
    assert diagnosis.effects == ("time_offset",)
    assert abs(diagnosis.fit["time_offset"].value - 5e-4) < 5e-5


def test_dwells_without_any_noise_are_refused():
    with pytest.raises(ValueError, match=r"samples of dwell 1 do not scatter .* declare noise"):
        dataclasses.replace(tumble(np.random.default_rng(1)), std=np.zeros(24), rig=Rig())


@pytest.mark.parametrize("further", [0.0, 2e-3])
def test_candidates_of_a_tumble_are_tests_of_one_coefficient(further):
    """Normal where what is declared explains the scatter, Student's where the scatter is that of the dwells."""
    dwells = tumble(np.random.default_rng(17), TRUTH | {"quadratic": 0.0, "cubic": 0.0}, further=further)
    diagnosis = ac.diagnose(fit := ac.fit(dwells), dwells)
    assert (fit.dwells.scatter > 0.0) == (further > 0.0)
    freedom = len(dwells) - len(fit.free) - 2  # the zero of the angle, and the candidate
    assert len(diagnosis.candidates) > 3
    for candidate in diagnosis.candidates:
        statistic = abs(candidate.estimate / candidate.std)
        p = 2.0 * (stats.norm.sf(statistic) if further == 0.0 else stats.t.sf(statistic, freedom))
        assert candidate.sigma == pytest.approx(stats.norm.isf(0.5 * p), rel=1e-6), candidate.effect
