"""Is the fit honest, and does it waste nothing? A small part of `benches/consistency.py`.

NEES against its chi-square region, intervals against what they promise, rms error against the Cramer-Rao bound. Every
region here is 99.9 %, so an honest fit on other seeds fails each single check once in a thousand.
"""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from accelcal.validation.consistency import consistency, coverage
from tests.consistency.campaign import (
    BOUNDED,
    SETTINGS,
    Outcome,
    Setting,
    bounds,
    collect,
    one_aci,
    one_fit,
    rms_region,
    slice_of,
)
from tests.consistency.cramer_rao import stationary

pytestmark = pytest.mark.statistics

RUNS = 10
SECONDS = 25.0
PROBABILITY = 0.999


@cache
def fitted(setting: Setting) -> Outcome:
    """Fits of one setting, for NEES and interval coverage; computed once, used twice."""
    return collect(setting.names, (one_fit(slice_of(setting, SECONDS), run) for run in range(RUNS)))


@pytest.mark.parametrize("setting", SETTINGS, ids=lambda s: s.name)
def test_nees_of_bias_and_scale_factor_lies_in_its_region(setting: Setting) -> None:
    verdict = consistency(fitted(setting).nees("bias", "scale_factor"), 2, PROBABILITY)
    print(f"NEES {verdict.mean:.2f} in [{verdict.low:.2f}, {verdict.high:.2f}], {verdict.runs} runs")
    assert verdict.verdict == "consistent"


def test_the_papers_filter_is_overconfident_where_the_motion_is_weak() -> None:
    # The sister that must fail: the noisy output as regressor (derivations 3.5), same runs, same statistic.
    runs = [one_aci(SETTINGS[0], run) for run in range(6)]
    verdict = consistency(collect(("bias", "scale_factor"), runs).nees("bias", "scale_factor"), 2, PROBABILITY)
    print(f"ACI filter: NEES {verdict.mean:.2f}, region [{verdict.low:.2f}, {verdict.high:.2f}]")
    assert verdict.verdict == "overconfident"


def normalised(parameter: str) -> tuple[np.ndarray, np.ndarray]:
    results = [fitted(setting) for setting in SETTINGS]
    column = results[0].names.index(parameter)
    return np.concatenate([f.error[:, column] for f in results]), np.concatenate([f.sigma[:, column] for f in results])


@pytest.mark.parametrize("parameter", SETTINGS[0].names)
def test_intervals_cover_what_they_promise(parameter: str) -> None:
    error, sigma = normalised(parameter)
    result = coverage(error, sigma, 0.95, PROBABILITY)
    print(f"{parameter}: {100 * result.rate:.1f} % of {result.count} intervals hold the truth")
    assert result.verdict == "consistent"


def test_intervals_half_as_long_are_caught() -> None:
    error, sigma = normalised("scale_factor")
    assert coverage(error, sigma / 2.0, 0.95, PROBABILITY).verdict == "overconfident"


@pytest.mark.parametrize("setting", BOUNDED, ids=lambda s: s.name)
def test_errors_reach_the_cramer_rao_bound(setting: Setting) -> None:
    collection = collect(setting.names, (one_fit(setting, run) for run in range(RUNS)))
    bound = bounds(setting, range(RUNS))
    rms = np.sqrt(np.mean((collection.error / bound) ** 2, axis=0))
    # 99.9 % for all parameters of the setting together
    low, high = rms_region(RUNS, 1.0 - (1.0 - PROBABILITY) / len(setting.names))
    print(dict(zip(setting.names, rms.round(3), strict=True)), f"in [{low:.2f}, {high:.2f}]")
    assert np.all((rms > low) & (rms < high))
    # The fit estimates its noise, which is known to some percent from 30 s of readings.
    np.testing.assert_allclose(collection.sigma.mean(axis=0), bound.mean(axis=0), rtol=0.05)


def test_a_fit_that_ignores_eight_ninths_of_the_record_misses_the_bound() -> None:
    setting = BOUNDED[1]
    of_a_ninth = collect(setting.names, (one_fit(setting, run, share=1.0 / 9.0) for run in range(RUNS)))
    rms = np.sqrt(np.mean((of_a_ninth.error / bounds(setting, range(RUNS))) ** 2, axis=0))
    _, high = rms_region(RUNS, PROBABILITY)
    assert np.all(rms > high)  # sqrt(9) = 3 is expected


@pytest.mark.parametrize("setting", BOUNDED, ids=lambda s: s.name)
def test_bound_by_recursion_equals_bound_by_spectrum(setting: Setting) -> None:
    sim = setting.simulate(0)
    variance = sim.truth.position_noise**2 + 1e-12 / 12.0
    by_spectrum = stationary(sim.truth, setting.names, setting.seconds, 1.0 / setting.position_rate, variance)
    # The spectrum takes the record for periodic: what happens at its two ends differs by a filter memory in 30 s.
    np.testing.assert_allclose(np.sqrt(np.diag(by_spectrum)), bounds(setting, [0])[0], rtol=3e-3)
