"""Shape parameters are estimated with the coefficients: errors are as large as the standard deviations say.

Over both effects 48 normalised errors are squared and summed: outside 0.1 % to 99.9 % of chi-square 48 with
probability 0.2 % for an honest fit. Errors of one fit depend on each other, so the bounds are those of half as many.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from accelcal.demo import TRUTH, with_effect
from accelcal.diagnosis.findings import explained_gain
from accelcal.effects import find
from accelcal.estimation.estimate import Fit, estimate
from accelcal.estimation.run import prepare
from accelcal.estimation.shape_parameters import beside_offset, linearised_shape
from accelcal.estimation.values import Values
from accelcal.model import Model
from accelcal.simulation.sensor import CXL02_RIG, simulate
from accelcal.verbs import add
from tests.effects.motions import moves, sines

HIDDEN = {"creep": (0.2, {"tau": 2.0, "start": 0.0}), "bias_step": (3e-3, {"instant": 3.1})}
STARTS = {"creep": {"tau": 1.2, "start": 0.0}, "bias_step": {"instant": 2.9}}
"""Where the fit begins, some standard deviations from the truth."""
RECORDS = 6


@pytest.fixture(scope="module")
def errors() -> tuple[np.ndarray, np.ndarray]:
    """Normalised errors of the fits, and of fits that take the shape they end at for exact."""
    honest, sure = [], []
    for name, (size, shape) in HIDDEN.items():
        for seed in range(RECORDS):
            rng = np.random.default_rng([17, seed])
            simulation = simulate("interleaved", seconds=30.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng)
            recording = with_effect(simulation, find(name), size, shape, prepare(simulation.recording).origins)
            fit = estimate(Model.linear().add(name, shapes={name: STARTS[name]}), recording)
            ended = {f"{name}.{key}": fit[f"{name}.{key}"].value for key in shape}
            held = estimate(fit.model.freeze(**ended), recording)
            truth = {"scale_factor": TRUTH["scale_factor"], name: size}
            honest.append(
                [
                    *normalised(fit, truth),
                    *normalised(fit, {f"{name}.{k}": v for k, v in shape.items() if k != "start"}),
                ]
            )
            sure.append(normalised(held, truth))
    return np.array(honest), np.array(sure)


def normalised(fit: Fit, truth: dict[str, float]) -> list[float]:
    return [(fit[key].value - value) / fit[key].std for key, value in truth.items()]


def test_errors_are_as_large_as_they_say(errors):
    honest, sure = errors
    low, high = stats.chi2.ppf([1e-3, 1.0 - 1e-3], honest.size // 2) / (honest.size // 2)
    rms = float(np.mean(honest**2))
    print(f"mean square of {honest.size} normalised errors: {rms:.2f} (allowed {low:.2f} to {high:.2f})")
    print(f"with the shape taken for exact: {float(np.mean(sure**2)):.2f} of {sure.size}")
    assert low < rms < high
    assert np.mean(sure[:RECORDS] ** 2) > 2.0 * np.mean(honest[:RECORDS, :2] ** 2)  # creep: the twin that must fail


def test_a_held_shape_stays_and_says_so():
    rng = np.random.default_rng(5)
    simulation = simulate("interleaved", seconds=20.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng)
    recording = with_effect(
        simulation, find("creep"), 0.2, {"tau": 2.0, "start": 0.0}, prepare(simulation.recording).origins
    )
    model = Model.linear().add("creep", shapes={"creep": {"tau": 1.0, "start": 0.0}}).freeze(**{"creep.tau": 1.5})
    held = estimate(model, recording)
    assert held["creep.tau"].value == 1.5
    assert held["creep.tau"].std == 0.0
    free = estimate(model.release("creep.tau"), recording)
    assert free["creep.tau"].std > 0.0
    assert abs(free["creep.tau"].value - 2.0) < 4.5 * free["creep.tau"].std
    assert free["creep"].std > held["creep"].std


def clipped(seed: int, softness: float, share: float) -> tuple[Fit, Fit]:
    """Fits of a clip at a share of the largest output: with what physics says of clips, and without."""
    simulation = simulate(
        "interleaved", seconds=30.0, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng([18, seed])
    )
    level = share * float(np.max(np.abs(simulation.recording.accel.y)))
    recording = with_effect(
        simulation, find("saturation"), softness, {"level": level}, prepare(simulation.recording).origins
    )
    believed = add(estimate(Model.linear(), recording), recording, "saturation")
    return believed, estimate(replace(believed.model, priors={}), recording)


@pytest.mark.parametrize("seed", [0, 2])
def test_a_clip_that_three_readings_reach_is_a_hard_one_until_more_is_known(seed):
    fits = clipped(seed, 1.0, 0.997)
    assert [any(note.code == "mostly_prior" for note in fit.remarks) for fit in fits] == [True, False]
    believed, alone = (fit["saturation"] for fit in fits)
    assert explained_gain(fits[0], "saturation")[0] < 2.0  # prior information explains nothing
    assert abs(believed.value - 1.0) < 2.5 * believed.std
    # its level and its softness trade places: far off, or hardly known
    assert abs(alone.value - 1.0) > 10.0 * alone.std or alone.std > 0.3


@pytest.mark.parametrize("seed", [0, 4])
def test_readings_that_show_a_soft_clip_outweigh_what_is_believed(seed):
    fits = clipped(seed, 0.4, 0.97)
    assert not any("prior" in note.sentence for note in fits[0].remarks)
    believed, alone = (fit["saturation"] for fit in fits)
    assert believed.value + 5.0 * believed.std < 1.0
    assert believed.value == pytest.approx(alone.value, abs=0.8 * alone.std)  # level and softness trade places


@pytest.mark.parametrize("share", [1e-3, 0.5])
def test_a_shape_is_linearised_over_a_share_of_its_span(share: float) -> None:
    model, signals = Model.linear().add("warm_up", shapes={"warm_up": {"tau": 20.0}}), moves(2500)
    effect, size = find("warm_up"), 0.3
    values = Values({term.name: size for term in model.free if term.effect is effect})
    low, high = effect.shapes["tau"].span(signals)
    below, above = max(20.0 - share * (high - low), low), 20.0 + share * (high - low)
    linear = linearised_shape(model, values, signals, effect, "tau", share)
    assert linear.span == (low, high)
    expected = size * (effect.column(signals, tau=above) - effect.column(signals, tau=below)) / (above - below)
    expected = (expected - expected[0]).ravel()  # where a constant of the effect belongs to the bias
    column = linear.term.column(signals)
    np.testing.assert_allclose(column - column[0], expected, atol=1e-9 * np.ptp(expected))


@pytest.mark.parametrize("moved", [1e-3, -0.5e-3])
def test_a_lag_beside_an_offset_is_the_output_moved_back_by_what_its_time_constant_grew(moved: float) -> None:
    """The exact output behind the lag at the later instant, less the sensor's own and the column of the offset."""
    w, tau = 2.0 * np.pi * 90.0 / 30.0, 4e-3
    signals = sines(lines=((90.0, 1.0, 0.4),), seconds=10.0, n=50_000, scale=1.0)
    t, later = signals.t, tau + moved
    gain, phase = 1.0 / np.hypot(1.0, w * later), np.arctan(w * later)
    expected = gain * np.sin(w * (t + moved) + 0.4 - phase) - signals.a - moved * signals.jerk
    trial = beside_offset(find("sensor_lag"), {"tau": tau}, Model.linear())
    column = trial.column(signals, tau=later).ravel()
    inside = slice(1000, -1000)
    np.testing.assert_allclose(column[inside], expected[inside], atol=5e-6)
    alone = beside_offset(find("sensor_lag"), {"tau": tau}, Model.linear().freeze(time_offset=0.0))
    assert np.max(np.abs(alone.column(signals, tau=later).ravel() - expected)[inside]) > 5e-4
