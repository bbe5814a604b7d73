"""Noise tests find and measure effects that leave the mean unchanged, and nothing on records without such effects.

One test alarms at 1e-4; eight tests examine a record, so a good record alarms with a probability of at most 8e-4.
"""

from __future__ import annotations

import math
from dataclasses import replace
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

from accelcal.data.recording import Channel
from accelcal.diagnosis.clean_fit import run_noise_tests
from accelcal.diagnosis.noise.motion_noise import amplitude_from_power, rank_correlation, strongest_frequency
from accelcal.diagnosis.noise.noise_test import WHITENESS
from accelcal.diagnosis.noise.position import portmanteau
from accelcal.diagnosis.noise.residuals import (
    BlockSpectra,
    Residuals,
    contamination_test,
    outliers,
    power_trend_test,
    spread_of,
)
from accelcal.diagnosis.noise.spectra import is_single_line, motion_makes_lines, spectral_peaks
from accelcal.diagnosis.policy import NOISE_TEST_ALPHA
from accelcal.signals.series import local_spread
from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG, Vibration, simulate
from tests.diagnosis.noise_tests import disturbed as world

RIGS = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
RNG = np.random.default_rng
MOTIONS = ("tones", "interleaved", "moves", "fast", "rests")


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("motion", MOTIONS)
def test_nothing_is_found_where_there_is_nothing(motion, rig):
    """2 records each, 20 in all, 10 % missing: any alarm at 1e-4 has a chance of 2 x 8e-4 = 0.2 % here."""
    alarms, least = [], {}
    for seed in range(2):
        for test in run_noise_tests(world.fitted(world.good(motion, RIGS[rig], 100 + seed).recording)):
            least[test.effect] = min(least.get(test.effect, 1.0), test.p_value)
            alarms += [(seed, test.effect, test.p_value)] if test.p_value < NOISE_TEST_ALPHA else []
    print(f"{motion} {rig}: {len(alarms)} alarms in 2 records; least p", {k: f"{p:.2g}" for k, p in least.items()})
    assert alarms == []


@pytest.mark.parametrize("rig", RIGS)
@pytest.mark.parametrize("seconds", [0.5, 1.0, 2.0, 4.0, 8.0])
def test_nothing_is_found_in_short_records(seconds, rig):
    """4 records each, 40 in all, false-alarm rate as above: few bins and blocks must not make a test bolder."""
    alarms = []
    for seed in range(4):
        rng = np.random.default_rng(seed)
        record = simulate("tones", seconds=seconds, rig=RIGS[rig], parameters={"bias": 0.1}, rng=rng, missing=0.1)
        result = run_noise_tests(world.fitted(record.recording))
        alarms += [(seed, test.effect, test.p_value) for test in result if test.p_value < NOISE_TEST_ALPHA]
    assert alarms == []


@pytest.mark.parametrize("rig", RIGS)
def test_motion_that_is_not_subtracted_alarms(rig):
    """The sister that must fail: power of the plain output follows speed without any vibration."""
    residuals_seen = Residuals(world.fitted(world.good("interleaved", RIGS[rig], 100).recording))
    plain = np.interp(np.arange(residuals_seen.n), residuals_seen.place, residuals_seen.u) - np.mean(residuals_seen.u)
    spectra = BlockSpectra.of(plain, residuals_seen.sampled, residuals_seen.rate, 0.0)
    _, p_value = power_trend_test(spectra.power.mean(axis=1), spectra.means(residuals_seen.motion[0] ** 2))
    assert p_value < NOISE_TEST_ALPHA


NUISANCES = {
    "vibration 1 m/s²": (
        {"vibration": Vibration(1.0, 230.0)},
        {"vibration", "whiteness"},
    ),  # its own kinks, undersampled
    "vibration 0.5 m/s² at 300 Hz": ({"vibration": Vibration(0.5, 300.0)}, {"vibration"}),
    "step 0.01 m/s²": ({"lsb": 0.01}, {"quantisation"}),
}


@pytest.mark.parametrize("nuisance", NUISANCES)
@pytest.mark.parametrize("motion", MOTIONS)
def test_no_disturbance_passes_for_another(motion, nuisance):
    """15 records, the rigs in turn; false alarms as above, 8e-4 each."""
    rig = list(RIGS)[(MOTIONS.index(motion) + list(NUISANCES).index(nuisance)) % 2]
    more, allowed = NUISANCES[nuisance]
    result = world.findings(world.good(motion, RIGS[rig], 7, **more).recording)
    assert {name for name, test in result.items() if test.p_value < NOISE_TEST_ALPHA} <= allowed


CASES = {
    "vibration": (world.vibration, "vibration", 0.2, None, None),
    "accelerometer outliers": (world.accelerometer_outliers, "accelerometer_outliers", 1e-3, None, None),
    "encoder outliers": (world.encoder_outliers, "encoder_outliers", 1e-3, None, None),
    "cyclic 0.1 um": (
        partial(world.encoder_cyclic, amplitude=1e-7, period=20e-6),
        "encoder_cyclic",
        1e-7,
        "period",
        20e-6,
    ),
    "cyclic 0.3 um": (
        partial(world.encoder_cyclic, amplitude=3e-7, period=20e-6),
        "encoder_cyclic",
        3e-7,
        "period",
        20e-6,
    ),
    "cyclic 1 mm": (
        partial(world.encoder_cyclic, amplitude=2e-7, period=1e-3),
        "encoder_cyclic",
        2e-7,
        "period",
        1e-3,
    ),
    "hum 50 Hz": (partial(world.hum, amplitude=1e-2, frequency=50.03), "tone", 1e-2, "frequency", 50.03),
    "line below the crossover": (partial(world.hum, amplitude=1e-2, frequency=7.317), "tone", 1e-2, "frequency", 7.317),
    "step 0.1 m/s²": (world.coarse_converter, "quantisation", 0.1, "step", 0.1),
    "jitter 100 us": (partial(world.jitter, std=100e-6), "timing_jitter", 100e-6, None, None),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize(("motion", "rig"), [("interleaved", "ADXL105"), ("fast", "CXL02")])
def test_disturbance_is_found_and_measured(case, motion, rig):
    make, effect, size, particular, value = CASES[case]
    test = world.findings(make(motion, RIGS[rig], 7))[effect]
    result = f"{test.estimate:.4g} +- {test.std:.2g} {test.unit}"
    print(f"{case}, {motion} {rig}: p {test.p_value:.1g}, {result} (simulated {size})")
    assert test.p_value < NOISE_TEST_ALPHA
    # 4 standard deviations; 15 %: missed small outliers, harmonics of rounding, the RC's change over a vibration's line
    assert abs(test.estimate - size) < 4.0 * test.std + 0.15 * size
    assert "negligible" not in test.sentence
    if particular is not None:
        assert test.parts[particular] == pytest.approx(value, rel=3e-3)  # a third of a bin of the record's length


def test_jitter_of_30_us_is_found_where_jerk_is_large():
    test = world.findings(world.jitter("fast", ADXL105_RIG, 7, std=30e-6))["timing_jitter"]
    assert test.p_value < NOISE_TEST_ALPHA
    assert test.estimate == pytest.approx(30e-6, abs=4.0 * test.std)


@pytest.mark.parametrize("name", ["outliers", "steady outliers", "portmanteau", "lines", "ranks", "power", "few large"])
def test_p_values_are_no_smaller_than_they_say(name):
    """2000 draws under the stated null: the share below 1 % stays under 2 % (4.5 standard deviations)."""
    rng = np.random.default_rng(11)
    draw = {
        "outliers": lambda: (lambda y: outliers(y, local_spread(y), len(y)).p_value)(rng.standard_normal(4096)),
        "steady outliers": lambda: (lambda y: outliers(y, *_order(*spread_of(y), len(y))).p_value)(
            rng.standard_normal(16384)
        ),
        "power": lambda: power_trend_test(rng.gamma(16.0, size=400), np.cumsum(rng.standard_normal(400)) ** 4)[1],
        "few large": lambda: power_trend_test(
            rng.gamma(16.0, size=400), (rng.random(400) < 0.02) * rng.exponential(size=400)
        )[1],
        "portmanteau": lambda: portmanteau(rng.standard_normal(512) * np.linspace(0.2, 3.0, 512))[1],
        "lines": lambda: _line_p_value(rng.standard_normal(4096)),
        "ranks": lambda: rank_correlation(rng.standard_normal(300), np.cumsum(rng.standard_normal(300)))[1],
    }[name]
    p = np.array([draw() for _ in range(2000)])
    print(f"{name}: share below 1 %: {np.mean(p < 0.01):.4f}, below 0.1 %: {np.mean(p < 0.001):.4f}")
    assert np.mean(p < 0.01) < 0.02


def test_portmanteau_sees_colour():
    """The sister that must fail: a correlation of 0.3."""
    e = np.random.default_rng(12).standard_normal(2048)
    assert portmanteau(e[1:] + 0.3 * e[:-1])[1] < NOISE_TEST_ALPHA


@pytest.mark.parametrize(("size", "sentence"), [(0.0, "the innovations are white"), (0.02, "are correlated over ")])
def test_innovations_are_said_to_be_white_where_they_are(size, sentence):
    """A quadratic that the model lacks follows the motion, which is slower than the readings."""
    parameters = {"bias": 0.1, "quadratic": size}
    simulated = simulate("tones", seconds=8.0, rig=CXL02_RIG, parameters=parameters, rng=np.random.default_rng(3))
    tests = {test.effect: test for test in run_noise_tests(world.fitted(simulated.recording))}
    assert (tests[WHITENESS].p_value < NOISE_TEST_ALPHA) == (size > 0.0)
    assert sentence in tests[WHITENESS].sentence


def _order(spread, dof, n):
    return spread, n, dof


@pytest.mark.parametrize(("share", "size"), [(1e-3, 2.8), (3e-4, 4.0), (2e-5, 30.0)])
def test_contamination_is_detected_without_a_single_certain_outlier(share, size):
    """Twice the expected log-likelihood gain is about 12² each time; one in a hundred may be missed."""
    rng = np.random.default_rng(5)
    least = []
    for _ in range(20):
        wrong = np.zeros(100_000)
        wrong[rng.choice(len(wrong), round(share * len(wrong)), replace=False)] = 1.0
        y = rng.standard_normal(len(wrong)) + wrong * size * rng.standard_normal(len(wrong))
        least.append(contamination_test(np.abs(y), 200.0)[1])
    print(f"share {share}, size {size}: largest p of 20: {max(least):.2g}")
    assert sum(p < NOISE_TEST_ALPHA for p in least) >= 19


def test_a_tooth_of_a_comb_is_no_line():
    """Vibration whose frequency swings to and fro once a second has lines 1 Hz apart; a hum is a single line."""
    t = np.arange(100_000) / 1667.0
    noise = np.random.default_rng(6).standard_normal(len(t))
    swept = np.cos(2.0 * np.pi * 250.0 * t + 45.0 * np.sin(2.0 * np.pi * t))
    peaks, _ = spectral_peaks(noise + swept, 1667.0, 100.0, 833.0)
    assert all(chance > NOISE_TEST_ALPHA / 50_000 for _, _, chance in peaks)
    peaks, _ = spectral_peaks(noise + 0.1 * np.cos(2.0 * np.pi * 250.0 * t), 1667.0, 100.0, 833.0)
    assert peaks[0][0] == pytest.approx(250.0, abs=0.01)
    assert peaks[0][2] < NOISE_TEST_ALPHA / 50_000
    assert is_single_line(np.ones(200) + 99.0 * (np.arange(200) == 100), np.ones(200), 100, 50)


def _line_p_value(y):
    peaks, bins = spectral_peaks(y, 1.0, 0.0, 0.5)
    return min(1.0, peaks[0][2] * bins)


def test_a_periodic_motion_makes_lines_of_its_own_and_a_broad_one_makes_none():
    def signals_of(kind):
        state = world.fitted(simulate(kind, seconds=30.0, rig=CXL02_RIG, parameters={}, rng=RNG(5)).recording)
        return state.signals

    periodic, broad = signals_of("tones"), signals_of("interleaved")
    n = 16 * len(periodic.a)  # zero padding: a sixteenth of a bin
    spectrum = np.abs(np.fft.rfft(periodic.a * np.hanning(len(periodic.a)), n))
    strongest = float(np.fft.rfftfreq(n, periodic.step)[np.argmax(spectrum)])
    assert motion_makes_lines(periodic, 3.0 * strongest, 1e-3)
    assert not motion_makes_lines(broad, 3.0 * strongest, 1e-3)


@pytest.mark.parametrize("size", [3e-7, 1e-6])
def test_a_cyclic_error_is_found_on_a_motion_that_rests_at_few_places(size):
    simulation = simulate("moves", seconds=40.0, rig=CXL02_RIG, parameters={"bias": 0.1}, rng=RNG(6))
    z = simulation.recording.position
    wrong = z.y + size * np.sin(2.0 * np.pi * simulation.truth.motion.position(z.t) / 2e-5)
    spoiled = replace(simulation.recording, position=Channel(z.name, z.t, wrong, z.unit))
    result, good = (
        next(test for test in run_noise_tests(world.fitted(record)) if test.effect == "encoder_cyclic")
        for record in (spoiled, simulation.recording)
    )
    assert result.p_value < NOISE_TEST_ALPHA
    assert result.parts["period"] == pytest.approx(2e-5, rel=1e-3)
    assert good.p_value > NOISE_TEST_ALPHA


def test_rounding_coarser_than_the_declared_resolution_is_no_cyclic_error():
    # Rounding to 3 µm is a wave of that period over position; the rig declares 1 µm.
    record = simulate("interleaved", seconds=30.0, rig=ADXL105_RIG, parameters={"bias": 0.1}, rng=RNG(7)).recording
    z = record.position
    rounded = replace(record, position=Channel(z.name, z.t, 3e-6 * np.round(z.y / 3e-6), z.unit))
    tests = {test.effect: test for test in run_noise_tests(world.fitted(rounded))}
    assert tests["encoder_cyclic"].p_value > NOISE_TEST_ALPHA


def test_scatter_of_two_kinds_without_a_peak_is_outliers():
    """The test alarms on one clean series of 10 000; three in a hundred of three times the scatter are certain."""
    rng = np.random.default_rng(93)
    clean = np.clip(rng.standard_normal(20_000), -5.4, 5.4)
    mixed = np.clip(np.where(rng.random(20_000) < 0.03, 3.0 * clean, clean), -5.4, 5.4)
    alarmed, still = (outliers(y, np.ones(20_000), 20_000) for y in (mixed, clean))
    assert still.p_value > NOISE_TEST_ALPHA
    assert alarmed.p_value < 1e-30
    assert len(alarmed.peaks) == 0
    assert 20.0 < alarmed.count < 1200.0


def test_the_frequency_of_a_vibration_is_sought_within_half_a_bin_of_its_band() -> None:
    rng = np.random.default_rng(12)
    f, follows = np.arange(0.0, 60.0, 0.25), rng.uniform(0.0, 1.0, 40)
    power = 0.01 * rng.uniform(size=(40, len(f)))
    power[:, f == 21.75] += follows[:, None]  # a quarter of a bin beyond the last
    power[:, f == 25.0] += 9.0 * follows[:, None]  # stronger, but elsewhere
    spectra = SimpleNamespace(f=f, power=power, means=lambda _: follows)
    short = SimpleNamespace(window=np.ones(200))  # bins of 1 Hz at 200 Hz
    motion = (np.zeros(1),)
    residuals = SimpleNamespace(spectra=spectra, short_spectra=short, motion=motion, rate=200.0)
    bins = np.array([20.0, 21.5])
    assert strongest_frequency(residuals, bins) == 21.75  # type: ignore[arg-type]


def test_an_amplitude_and_its_uncertainty_grow_with_the_gain():
    """By propagation of a variance through the square root; a power below its uncertainty says no more than that."""
    size, std = amplitude_from_power(4.0, 0.01, 3.0)
    assert (size, std) == pytest.approx((6.0, 0.5 * 0.1 / 2.0 * 3.0))
    assert amplitude_from_power(-1.0, 0.01, 3.0) == pytest.approx((0.0, 0.5 * math.sqrt(0.1) * 3.0))
