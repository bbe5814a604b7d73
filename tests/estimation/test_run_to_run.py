"""Coefficients that differ from run to run: against dense REML, closed forms, coverage by simulation, whole fits."""

import dataclasses

import numpy as np
import pytest
from scipy import optimize, stats

import accelcal as ac
from accelcal.calibration.characteristic import budget
from accelcal.data.rig import Uncertainty
from accelcal.estimation.run_to_run import REMARK_ALPHA, BetweenRuns
from accelcal.model import Prior
from accelcal.results import model_file
from accelcal.simulation import CXL02_RIG
from accelcal.validation.prediction import values_on

BIASES = (0.020, 0.021, 0.022, 0.023, 0.024, 0.025)
"""m/s², of six runs."""


def drawn(rng, runs, D, v):
    b = 1.0 + np.sqrt(D) * rng.standard_normal(runs) + np.sqrt(v) * rng.standard_normal(runs)
    return b, BetweenRuns.of(np.diag(1.0 / v), b / v, range(runs))


def test_equal_variances_give_the_analysis_of_variance():
    b, result = drawn(np.random.default_rng(1), 7, 2.0, np.full(7, 0.5))
    D = result.variance
    assert pytest.approx(np.var(b, ddof=1) - 0.5, rel=1e-4) == D
    assert result.mean(D) == pytest.approx((np.mean(b), (D + 0.5) / 7), rel=1e-9)
    chi2 = 6.0 * np.var(b, ddof=1) / 0.5
    assert result.p_value == pytest.approx(stats.chi2.sf(chi2, 6), rel=1e-9)
    low, high = result.interval()
    assert low == pytest.approx(6.0 * np.var(b, ddof=1) / stats.chi2.isf(0.025, 6) - 0.5, rel=1e-9)
    assert high == pytest.approx(6.0 * np.var(b, ddof=1) / stats.chi2.isf(0.975, 6) - 0.5, rel=1e-9)


def test_exact_runs_give_the_intervals_of_student():
    b, result = drawn(np.random.default_rng(2), 6, 1.0, np.full(6, 1e-8))
    s, t = np.std(b, ddof=1), stats.t.isf(0.025, 5)
    mean_half, next_half = result.halves()
    assert mean_half == pytest.approx(t * s / np.sqrt(6), rel=0.01)
    assert next_half == pytest.approx(t * s * np.sqrt(1 + 1 / 6), rel=0.01)


@pytest.mark.parametrize("biases", [(0.3, 0.0), (0.0, 0.3), (0.3, 0.301), (0.5, 1e-5)])
def test_runs_that_share_a_parameter_tightly_have_the_spread_of_their_difference(biases):
    """A scale factor that both runs see at one gravity turns the eigenvectors: their signs and means are arbitrary."""
    A = 1e8 * np.array([[1.0, 0.0, 9.8], [0.0, 1.0, 9.8], [9.8, 9.8, 193.0]])
    result = BetweenRuns.of(A, A @ np.array([*biases, 0.01]), range(2))
    difference = 0.5 * (biases[0] - biases[1]) ** 2
    assert result.variance == pytest.approx(difference, rel=0.05)
    low, high = result.interval()
    assert low < difference < high
    assert np.isfinite(result.halves()).all()


def stacked(rng, with_temperature):
    """Readings of five runs with a bias of their own, a shared slope, and a temperature that is one number a run."""
    groups, rows = np.repeat(np.arange(5), (20, 30, 25, 40, 22)), 137
    shared = np.column_stack([rng.standard_normal(rows), np.linspace(-1, 1, 5)[groups]])[:, : 1 + with_temperature]
    membership = (groups[:, None] == np.arange(5)).astype(float)
    y = shared @ np.array([2.0, 0.7])[: shared.shape[1]] + membership @ (3.0 + 1.5 * rng.standard_normal(5))
    return shared, membership, y + 0.8 * rng.standard_normal(rows)


@pytest.mark.parametrize("with_temperature", [False, True])
def test_gram_matrices_give_the_reml_of_the_stacked_readings(with_temperature):
    """What is one number a run (a temperature) takes a degree of freedom, but it stays determined."""
    shared, separate, y = stacked(np.random.default_rng(3), with_temperature)
    X = np.column_stack([shared, separate.sum(axis=1)])

    def dense(log_D):
        V = 0.64 * np.eye(len(y)) + np.exp(log_D) * separate @ separate.T
        A = X.T @ np.linalg.solve(V, X)
        r = y - X @ np.linalg.solve(A, X.T @ np.linalg.solve(V, y))
        return 0.5 * (np.linalg.slogdet(V)[1] + np.linalg.slogdet(A)[1] + r @ np.linalg.solve(V, r))

    best = optimize.minimize_scalar(dense, bounds=(-8, 6), method="bounded", options={"xatol": 1e-9})
    Z = np.column_stack([shared, separate])
    rows = range(shared.shape[1], Z.shape[1])
    result = BetweenRuns.of(Z.T @ Z / 0.64, Z.T @ y / 0.64, rows)
    assert result.variance == pytest.approx(np.exp(best.x), rel=1e-5)
    V = 0.64 * np.eye(len(y)) + result.variance * separate @ separate.T
    A = X.T @ np.linalg.solve(V, X)
    mean = np.linalg.solve(A, X.T @ np.linalg.solve(V, y))[-1]
    assert result.mean(result.variance) == pytest.approx((mean, np.linalg.inv(A)[-1, -1]), rel=1e-8)


def test_intervals_cover_and_equal_runs_are_called_so_at_the_stated_rate():
    """400 campaigns each, nine counts of 95 % at 0.1 %: false alarm below 1 %. The twin: intervals half as long."""
    rng, count = np.random.default_rng(4), 400
    low, high = stats.binom.ppf([5e-4, 1.0 - 5e-4], count, 0.95)
    for runs, D in ((4, 10.0), (8, 10.0), (6, 1000.0)):
        covered, short = np.zeros(3), 0
        for _ in range(count):
            v = np.exp(rng.uniform(-1.0, 1.0, runs))
            _, result = drawn(rng, runs, D, v)
            centre, halves, ends = result.mean(result.variance)[0], result.halves(), result.interval()
            new = 1.0 + np.sqrt(D) * rng.standard_normal()
            covered += [abs(1.0 - centre) < halves[0], abs(new - centre) < halves[1], ends[0] <= D <= ends[1]]
            short += abs(1.0 - centre) < 0.5 * halves[0]
        print(f"{runs} runs, D = {D:g}: mean, next run, spread covered in {covered} ({low:g} to {high:g})")
        assert np.all((covered >= low) & (covered <= high))
        assert short < low
    null = [drawn(rng, 6, 0.0, np.exp(rng.uniform(-1.0, 1.0, 6)))[1].p_value < REMARK_ALPHA for _ in range(1000)]
    print(f"equal runs told apart: {sum(null)} of 1000 at {REMARK_ALPHA}")
    assert stats.binom.ppf(1e-3, 1000, REMARK_ALPHA) <= sum(null) <= stats.binom.ppf(1 - 1e-3, 1000, REMARK_ALPHA)


def campaign(biases, seed):
    groups = []
    for number, bias in enumerate(biases):
        rng = np.random.default_rng([seed, number])
        truth = {"bias": bias, "scale_factor": 0.01}
        recording = ac.simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters=truth, rng=rng).recording
        groups.append(dataclasses.replace(recording, digest=f"{seed} {number}", name=f"run{number}.csv"))
    return groups


@pytest.fixture(scope="module")
def six():
    runs = campaign(BIASES, 11)
    return runs, ac.fit(runs)


def test_six_biases_are_six_and_their_spread_is_estimated(six):
    runs, result = six
    [spread] = result.spreads
    assert spread.value == pytest.approx(np.std(BIASES, ddof=1), rel=0.05)
    assert spread.low < np.std(BIASES, ddof=1) < spread.high
    assert spread.runs == pytest.approx(BIASES, abs=2e-4)
    assert result["bias"].value == pytest.approx(np.mean(BIASES), abs=2e-4)
    assert result["bias"].std == pytest.approx(np.std(BIASES, ddof=1) / np.sqrt(6), rel=0.05)
    assert result["bias"].run is None
    assert spread.next_half == pytest.approx(stats.t.isf(0.025, 5) * spread.value * np.sqrt(7 / 6), rel=0.02)
    assert abs(result["scale_factor"].value - 0.01) < 4.0 * result["scale_factor"].std
    assert any("bias differs from run to run" in remark.sentence for remark in result.remarks)
    assert not {"runs_disagree", "noise_beyond_declared"} & {remark.code for remark in result.remarks}
    judged = ac.diagnose(result, runs)
    assert judged.verdict == "adequate"
    [message] = (remark for remark in judged.remarks if remark.code == "run_to_run")
    assert message.values["std"] == pytest.approx(spread.value, rel=0.05)


def test_one_bias_for_all_is_one(six):
    fit = ac.fit(campaign([0.02] * 4, 12))
    assert fit.spreads == ()
    assert abs(fit["bias"].value - 0.02) < 4.0 * fit["bias"].std < 4e-4
    forced = ac.fit(campaign([0.02] * 4, 12), ac.Model.linear().vary("bias"))
    assert forced.spreads[0].low == 0.0
    assert any("no difference is seen" in remark.sentence for remark in forced.remarks)
    assert forced["bias"].value == pytest.approx(fit["bias"].value, abs=2.0 * fit["bias"].std)


def test_each_run_has_its_own_and_a_new_one_the_mean(six, tmp_path):
    runs, result = six
    assert values_on(result, runs[4]).by_name["bias"] == result.spreads[0].runs[4]
    assert values_on(result, campaign([0.02], 99)[0]).by_name["bias"] == result["bias"].value
    model_file.save(result, tmp_path / "m.json")
    again = model_file.load(tmp_path / "m.json")
    assert again.spreads == result.spreads
    assert again.model == result.model
    assert again.values(2).by_name == result.values(2).by_name
    assert again.covariance == pytest.approx(result.covariance)


def test_what_cannot_differ_is_refused():
    with pytest.raises(ValueError, match="cubic"):
        ac.Model.linear().vary("cubic")
    believed = dataclasses.replace(ac.Model.linear(), priors={"bias": Prior(0.0, 1e-3)})
    with pytest.raises(ValueError, match="prior"):
        believed.vary("bias")


def test_gravity_in_one_of_two_runs_is_no_bias_that_differs():
    good, vertical = campaign((0.02, 0.02 + 9.80665), 13)
    with pytest.raises(ac.RecordingError, match=r"run1.csv: the output has a constant of 9\.\d+ m/s² close to gravity"):
        ac.fit([good, vertical])


def test_parts_of_one_recording_have_the_bias_of_their_own():
    whole = campaign([0.02], 14)[0]
    first, second = whole.part(0.0, 9.5), whole.part(10.0, 19.5)
    stepped = dataclasses.replace(second, accel=dataclasses.replace(second.accel, y=second.accel.y + 0.05))
    fit = ac.fit([first, stepped])
    assert values_on(fit, first).by_name["bias"] == fit.spreads[0].runs[0]
    assert values_on(fit, stepped).by_name["bias"] == fit.spreads[0].runs[1]


def test_the_budget_holds_the_next_run(six):
    _, result = six
    declared = Uncertainty(encoder_scale=1e-5, level=0.0, misalignment=0.0)
    lines = budget(dataclasses.replace(result, rig=dataclasses.replace(result.rig, uncertainty=declared))).lines
    [bias] = (line for line in lines if line.estimate.name == "bias")
    assert bias.expanded == pytest.approx(result.spreads[0].next_half, rel=0.01)


def directions(encoder_scale, biases, seed):
    """Runs with the axis level, up and down."""
    cosines = []
    for number, (axis, bias) in enumerate(zip(("level", "up", "down"), biases, strict=True)):
        rng = np.random.default_rng([seed, number])
        rig = dataclasses.replace(CXL02_RIG, axis=axis)
        truth = {"bias": bias, "scale_factor": 0.01}
        recording = ac.simulate("interleaved", seconds=20.0, rig=rig, parameters=truth, rng=rng).recording
        read = dataclasses.replace(recording.position, y=recording.position.y * (1.0 + encoder_scale))
        cosines.append(dataclasses.replace(recording, position=read, digest=f"{seed} {number}", name=f"{axis}.csv"))
    return cosines


def test_the_scale_of_the_encoder_that_no_single_run_shows_is_seen_by_runs_up_and_down():
    """Moved by 5e-4 of the travel; gravity does not move with the encoder. It enters as the sentence says."""
    runs = directions(5e-4, (0.02, 0.02, 0.02), 21)
    fit = ac.fit(runs)
    assert [seen_by_run.effect for seen_by_run in fit.seen_by_runs] == ["encoder_scale"]
    judged = ac.diagnose(fit, runs)
    assert judged.verdict == "tied"
    assert judged.sentence.startswith("The runs differ as encoder_scale of")
    assert judged.classes[0].members == ("encoder_scale", "bias")
    added = ac.add(fit, runs, "encoder_scale")
    assert added.spreads == ()
    assert abs(added["encoder_scale"].value - 5e-4) < 4.0 * added["encoder_scale"].std < 1.5e-4
    assert abs(added["scale_factor"].value - 0.01) < 4.0 * added["scale_factor"].std
    assert ac.diagnose(added, runs).verdict == "adequate"


def test_biases_of_runs_up_and_down_are_no_scale_of_the_encoder():
    fit = ac.fit(directions(0.0, (0.02, 0.021, 0.022), 22))
    assert fit.spreads[0].runs == pytest.approx((0.02, 0.021, 0.022), abs=6e-4)  # g times the uncertainty of k
    assert not any("encoder_scale" in remark.sentence for remark in fit.remarks)
