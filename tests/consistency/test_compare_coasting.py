"""Unaided drift: it uses nothing that is withheld, it is as large as noise makes it, and set-up bias leaves it."""

from __future__ import annotations

import math
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest

from accelcal.data.recording import Recording
from accelcal.estimation.estimate import Fit, estimate
from accelcal.io import load
from accelcal.model import Model
from accelcal.simulation.sensor import CXL02_RIG, Simulated, simulate
from accelcal.validation.consistency import Consistency, chi_square_region
from accelcal.validation.evaluation import coast, compare
from accelcal.validation.prediction import Prediction
from tests.regimes.regimes import TABLE

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
CUBIC = {**TRUTH, "quadratic": -5e-4, "cubic": 1e-3}
PROBABILITY = 0.999


def run(seed: int, parameters: dict[str, float], seconds: float = 30.0) -> Simulated:
    return simulate(
        "interleaved",
        seconds=seconds,
        rig=CXL02_RIG,
        parameters=parameters,
        rng=np.random.default_rng([698, seed]),
        a_rms=1.0,
    )


@cache
def fitted(cubic: bool) -> Fit:
    return estimate(Model.cubic() if cubic else Model.linear(), run(0, CUBIC if cubic else TRUTH).recording)


def with_truth(fit: Fit, truth: dict[str, float]) -> Fit:
    """The fit with its estimates replaced by the truth: what remains is noise alone."""
    return replace(fit, estimates=tuple(replace(e, value=truth[e.name]) for e in fit.estimates))


@pytest.mark.parametrize("cubic", [False, True], ids=["linear", "cubic"])
@pytest.mark.parametrize("start", [2.0, 9.37, 18.8])
def test_withheld_positions_may_be_noise(start: float, cubic: bool) -> None:
    recording = run(1, CUBIC if cubic else TRUTH).recording
    position = recording.position
    y = position.y.copy()
    later = position.t > start
    y[later] = np.random.default_rng(3).standard_normal(int(later.sum()))
    spoiled = replace(recording, position=replace(position, y=y))
    coasted, two = coast(fitted(cubic), recording, start, 5.0), coast(fitted(cubic), spoiled, start, 5.0)
    for name in ("start", "t", "frozen", "rezeroed", "floor"):
        np.testing.assert_array_equal(getattr(coasted, name), getattr(two, name), err_msg=name)
    # The sister: readings before the start are felt.
    y = position.y.copy()
    y[(position.t > start - 0.1) & (position.t <= start)] += 1e-3
    felt = coast(fitted(cubic), replace(recording, position=replace(position, y=y)), start, 5.0)
    assert not np.array_equal(felt.frozen, coasted.frozen)


def drift(fit: Fit, recordings: list[Recording], horizon: float) -> Consistency:
    """Squared frozen drift over its floor, from starts so far apart that no two share their noise."""
    values = []
    for recording in recordings:
        ahead = Prediction.of(fit, recording)
        t = ahead.run.t
        for begin in np.arange(t[0] + 2.0, t[-1] - horizon - 0.1, horizon + 0.5):
            k, row = np.searchsorted(t, [begin, begin + horizon])
            frozen, _, std = ahead.along(int(k), np.array([row]))
            variance = std[0] ** 2 + ahead.noise.r
            values.append((ahead.run.z[row] - frozen[0]) ** 2 / variance)
    low, high = chi_square_region(1, len(values), PROBABILITY)
    return Consistency(float(np.mean(values)), 1, len(values), low, high, PROBABILITY)


@pytest.mark.parametrize("horizon", [1.0, 5.0])
def test_drift_of_a_true_model_equals_its_floor(horizon: float) -> None:
    recordings = [run(seed, TRUTH, 60.0).recording for seed in range(20, 26)]
    verdict = drift(with_truth(fitted(False), TRUTH), recordings, horizon)
    print(f"{horizon:g} s: drift²/floor² {verdict.mean:.2f} in [{verdict.low:.2f}, {verdict.high:.2f}], {verdict.runs}")
    assert verdict.verdict == "consistent"


def test_drift_of_a_model_that_lacks_an_effect_exceeds_its_floor() -> None:
    hidden = {**TRUTH, "cubic": 1e-3}
    recordings = [run(seed, hidden, 60.0).recording for seed in range(20, 26)]
    blind = estimate(Model.linear(), recordings[0])
    # The blind fit takes what it cannot explain for noise; the floor is that of the sensor's own.
    assert blind.noise().q > 4.0 * fitted(False).noise().q
    verdict = drift(replace(blind, runs=fitted(False).runs), recordings, 1.0)
    print(f"cubic hidden: drift²/floor² {verdict.mean:.2f}, above {verdict.high:.2f}")
    assert verdict.verdict == "overconfident"


def test_comparison_reports_the_same_drift_as_single_coasts() -> None:
    recording = run(30, TRUTH, 20.0).recording
    ahead = Prediction.of(fitted(False), recording)
    starts = ahead.starts(1.0)
    comparison = compare(fitted(False), recording, horizons=(1.0,))
    assert comparison.coast_starts[1.0] == len(starts)
    t = ahead.run.t
    errors = []
    for k in starts[::40]:
        row = int(np.searchsorted(t, t[k] + 1.0))
        single = coast(fitted(False), recording, float(t[k]), 1.1)
        frozen, rezeroed, _ = ahead.along(int(k), np.array([row]))
        at = int(np.searchsorted(single.t, t[row]))
        errors.append((single.frozen[at] - frozen[0], single.rezeroed[at] - rezeroed[0]))
    np.testing.assert_allclose(errors, 0.0, atol=1e-9)  # a thousandth of the encoder's step; sums of 1e4 terms


def test_rezeroing_takes_out_the_set_up_bias() -> None:
    moved = {**TRUTH, "bias": TRUTH["bias"] + 0.01}
    comparison = compare(fitted(False), run(40, moved, 60.0).recording)
    frozen, rezeroed, floor = (
        series[5.0] for series in (comparison.coast_frozen_rms, comparison.coast_rms, comparison.coast_floor)
    )
    print(f"5 s: frozen {frozen:.2e} m, rezeroed {rezeroed:.2e} m, floor {floor:.2e} m")
    assert frozen is not None
    assert rezeroed is not None
    assert floor is not None
    assert frozen == pytest.approx(0.01 / 1.01 * 5.0**2 / 2.0, rel=0.05)  # K0 T²/2 rules the drift
    assert rezeroed < 2.5 * floor  # what the constant costs that was learned on the way
    assert frozen > 50.0 * floor


def test_set_up_bias_is_reported_within_its_uncertainty() -> None:
    # Three sigma, eight runs: an honest report fails with probability 2 %; the seeds are fixed.
    first = fitted(False)
    for seed in range(50, 58):
        step = 0.002 * (seed - 53)
        value, std = compare(first, run(seed, {**TRUTH, "bias": TRUTH["bias"] + step}).recording).setup_bias
        both = math.hypot(std, first["bias"].std)
        assert abs(value - step) < 3.0 * both
        assert std < 1e-4
    assert abs(value) > 20.0 * both  # and a step of 8 mm/s² is not lost in it


def test_horizons_beyond_the_record_are_none() -> None:
    comparison = compare(fitted(False), run(60, TRUTH, 4.0).recording)
    assert comparison.coast_rms[1.0] is not None
    for horizon in (5.0, 10.0):
        assert comparison.coast_rms[horizon] is None
        assert comparison.coast_frozen_rms[horizon] is None
        assert comparison.coast_floor[horizon] is None
        assert comparison.coast_starts[horizon] == 0


def test_coasting_where_nothing_is_known_is_refused() -> None:
    recording = run(61, TRUTH, 4.0).recording
    with pytest.raises(ValueError, match="no encoder reading precedes"):
        coast(fitted(False), recording, -1.0, 1.0)
    with pytest.raises(ValueError, match="does not reach"):
        coast(fitted(False), recording, float(recording.position.t[-1]), 1.0)


def test_the_floor_holds_what_jumps_between_samples_cost(tmp_path: Path):
    """Steps of the acceleration without a low-pass: 1 s of drift over its floor in three records, twin without them.

    The 99.9 % interval of the rms of 150 independent seconds is 0.81 to 1.20; the estimate itself adds a few per cent.
    """
    errors, blind = [], []
    for seed in range(3):
        recording = load(TABLE["a-trap-servo-norc"].build(7100 + seed).write(tmp_path, f"run{seed}"))
        prediction = Prediction.of(estimate(Model.linear(), recording), recording)
        stretch = prediction.at_horizon(1.0)
        errors.append(np.mean((stretch.frozen / stretch.floor) ** 2))
        prediction.unknown = np.zeros_like(prediction.unknown)
        blind.append(np.mean((stretch.frozen / prediction.at_horizon(1.0).floor) ** 2))
    assert 0.8 < math.sqrt(np.mean(errors)) < 1.25
    assert math.sqrt(np.mean(blind)) > 3.0
