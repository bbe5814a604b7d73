"""Detection limits against closed forms, an independent bound, and detections in simulated records."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import binom, norm

import accelcal as ac
from accelcal.data.rig import Rig, Sensor
from accelcal.diagnosis.experiment import power, power_of_motion, through
from accelcal.diagnosis.experiment.detectability import Power
from accelcal.diagnosis.experiment.power_analysis import (
    detectability_of,
    intensity,
    planned_noise,
    planned_state,
    with_drift,
)
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.diagnosis.search.beam import entry_gains
from accelcal.diagnosis.search.scan import scan
from accelcal.effects import BUILT_IN
from accelcal.model import Model
from accelcal.simulation import ADXL105_RIG
from accelcal.simulation.motion import Motion, Tones, motion
from accelcal.simulation.sensor import PARAMETERS, Truth
from tests.consistency.cramer_rao import bound
from tests.worlds import World

from .trials import Pair, any_enters, fitted, least_distance, predicted_detection

PLAIN = Rig(sensor=Sensor(noise=2e-3), resolution=1e-6)
"""No low-pass, so that nothing but the base is projected out."""
TONES = motion("tones", 40.0, np.random.default_rng(5))
RECORDS, PREDICTED = 12, 4
"""Records in which an effect is sought, and those on which its detection is predicted: it differs little."""
RNG = np.random.default_rng


def single_tone(seconds: float = 20.0) -> Motion:
    return Motion((Tones(np.array([0.01]), np.array([3.0]), np.array([0.4])),), seconds, name="one tone")


# Probability


def test_detection_of_one_coefficient_is_that_of_a_normal_beyond_its_threshold():
    z = -norm.ppf(FAMILYWISE_ALPHA / 96 / 2)
    for d in (0.0, 2.0, 4.0, 6.0):
        expected = norm.sf(z - d) + norm.cdf(-z - d)
        assert predicted_detection(d, 96, FAMILYWISE_ALPHA) == pytest.approx(
            expected, rel=1e-8, abs=1e-12
        )  # series of both laws


def test_detection_falls_with_alternatives_and_with_coefficients():
    few, many = predicted_detection(4.0, 10, FAMILYWISE_ALPHA), predicted_detection(4.0, 1000, FAMILYWISE_ALPHA)
    assert few > predicted_detection(4.0, 100, FAMILYWISE_ALPHA) > many
    by_freedom = [predicted_detection(5.0, 100, FAMILYWISE_ALPHA, dof=dof) for dof in (1, 2, 8)]
    assert by_freedom == sorted(by_freedom, reverse=True)
    assert predicted_detection(5.0, 100, FAMILYWISE_ALPHA, comparisons=100) < by_freedom[0]


def test_the_price_of_coefficients_counts_where_it_exceeds_significance():
    # 240 blocks and 10 coefficients cost 10 ln 240 + 2 ln 100 = 64, above the 0.005/100 point of chi-square, 37.
    free = predicted_detection(7.0, 100, FAMILYWISE_ALPHA, dof=10)
    assert predicted_detection(7.0, 100, FAMILYWISE_ALPHA, dof=10, blocks=240) < 0.5 < free


def test_the_smallest_size_is_detected_with_95_percent():
    powers = power_of_motion(TONES, PLAIN)
    limit = powers["quadratic"]
    probability = predicted_detection(
        limit.smallest[0] * limit.d[0], powers.examined, FAMILYWISE_ALPHA, blocks=powers.blocks
    )
    assert probability == pytest.approx(0.95, abs=1e-6)  # inverse of a smooth function


def test_detection_with_rivals_and_scatter_is_near_that_of_one_effect_and_below_alpha_without_one():
    powers = power_of_motion(TONES, PLAIN)
    d = powers["quadratic"].d[0]
    for distance in (3.0, 4.0, 5.0):
        probability = predicted_detection(distance, powers.examined, FAMILYWISE_ALPHA, blocks=powers.blocks)
        # Scatter of 2 to 5 % costs up to 0.1 sigma, 4 points; rivals bring up to 10; draws err by 0.8.
        assert probability - 0.05 < powers.detection("quadratic", distance / d) < probability + 0.1
    assert 0.0 < powers.detection("quadratic", 0.0) <= FAMILYWISE_ALPHA + 0.004  # 4 sigma of 4000 draws


# Information


@pytest.mark.parametrize("name", ["quadratic", "cubic"])
def test_information_is_that_of_the_cramer_rao_bound(name):
    moving = motion("bursts", 20.0, np.random.default_rng(2))
    t = np.arange(0.0, 20.0, 1.0 / 833.5)
    truth = Truth(moving, dict.fromkeys(PARAMETERS, 0.0), 2e-3, 1e-6)
    names = ["bias", "scale_factor", "time_offset", name]
    variance = 1e-12 + 1e-12 / 12.0
    covariance = bound([truth], names, t, variance)[0]
    d = power_of_motion(moving, PLAIN)[name].d[0]
    # Blocks of whitened samples lose under 1 %, the settling of the filter 0.3 % of the record.
    assert d == pytest.approx(1.0 / math.sqrt(covariance[3, 3]), rel=0.02)


def test_a_plan_and_its_record_agree():
    rig = ADXL105_RIG
    moving = motion("interleaved", 20.0, np.random.default_rng(3))
    simulation = ac.simulate(moving, seconds=20.0, rig=rig, parameters={"bias": 0.05}, rng=np.random.default_rng(4))
    ahead, after = power_of_motion(moving, rig), power(Model.linear(), simulation.recording)
    assert (ahead.examined, ahead.alpha) == (after.examined, after.alpha)
    for name in ("quadratic", "cubic", "coulomb", "bias_drift", "clock_skew", "encoder_backlash"):
        # The fitted density is uncertain by 3 % on 20 s.
        assert ahead[name].d[0] == pytest.approx(after[name].d[0], rel=0.1), name


def test_d_grows_with_the_square_root_of_time():
    short = power_of_motion(TONES, PLAIN, seconds=10.0)
    long = power_of_motion(TONES, PLAIN, seconds=40.0)
    for name in ("quadratic", "cubic", "odd_quadratic", "coulomb"):
        # The start of the filter, 0.2 s of 10 s, is not used.
        assert long[name].d[0] / short[name].d[0] == pytest.approx(2.0, rel=0.03), name
    ratio = long["bias_drift"].d[0] / short["bias_drift"].d[0]
    assert ratio == pytest.approx(8.0, rel=0.1)  # a slope gains with T^(3/2); the base takes out the rest


def test_d_is_inversely_proportional_to_the_noise_of_sensor_and_encoder():
    noisier = replace(PLAIN, sensor=Sensor(noise=4e-3), resolution=2e-6)
    plain, twice = power_of_motion(TONES, PLAIN), power_of_motion(TONES, noisier)
    assert plain["quadratic"].d[0] == pytest.approx(2.0 * twice["quadratic"].d[0], rel=1e-6)  # gains stay as they are


def test_effects_of_the_model_are_no_candidates():
    powers = power_of_motion(TONES, PLAIN, model=Model.cubic())
    names = {limit.effect for limit in powers.detectabilities}
    assert "quadratic" not in names
    assert "odd_quadratic" in names
    with pytest.raises(KeyError, match="in the model"):
        powers["cubic"]


def test_set_points_are_followed_through_jerk():
    t = np.arange(0.0, 5.0, 1e-3)
    exact = TONES.derivatives(t)
    near = through(t, exact[0]).derivatives(t)
    inside = slice(50, -50)
    for order, (a, b) in enumerate(zip(exact, near, strict=True)):
        # Degree 7 at 160 samples a period; each derivative loses three digits of the doubles in p.
        np.testing.assert_allclose(b[inside], a[inside], atol=1e-5 * np.ptp(a), err_msg=f"derivative {order}")


# Confounded effects


def test_one_tone_confounds_odd_powers_and_hides_functions_of_position():
    powers = power_of_motion(single_tone(), PLAIN)
    assert "odd_quadratic" in powers["cubic"].members
    assert any({"cubic", "odd_quadratic"} <= set(group.members) for group in powers.ties)
    assert not powers["rail_slope"].visible  # p is a times a constant: it belongs to the scale factor
    again = Power.from_json(powers.to_json())
    assert again["rail_slope"].smallest == (math.inf,)
    assert again["cubic"].smallest[0] > 0.0
    with pytest.raises(ValueError, match=r"detection_model is not stored in this JSON: accelcal\.power"):
        again.of_run  # noqa: B018


def test_confounded_groups_exceed_the_correlation_and_name_an_experiment():
    for group in power_of_motion(single_tone(), PLAIN).ties:
        assert 0.95 < group.correlation <= 1.0
        assert len(group.members) > 1
        assert group.experiment


# Refusals


@pytest.mark.parametrize(
    ("rig", "message"),
    [(Rig(resolution=1e-6), "noise density"), (Rig(sensor=Sensor(noise=1e-3)), "resolution")],
)
def test_a_plan_without_a_data_sheet_is_refused_with_the_cure(rig, message):
    with pytest.raises(ValueError, match=message):
        power_of_motion(TONES, rig)


def test_a_plan_that_stands_still_is_refused():
    with pytest.raises(ac.NotIdentifiable, match="throughout"):
        power_of_motion(motion("rest", 10.0, np.random.default_rng(1)), PLAIN)


def test_too_few_set_points_are_refused():
    with pytest.raises(ValueError, match="at least 8"):
        through(np.arange(5.0), np.arange(5.0))


# Predicted against observed, on worlds that share no code with the product

SLICE = (
    Pair("bias_step", "interleaved", "CXL02", 4.5, {"instant": 11.3}),
    Pair("encoder_nonlinearity", "fast", "ADXL105", 4.5, {"cubic_per_m": 8.0}),
)
"""One coefficient with a shape to be found, two coefficients; `benches.power` has twenty pairs."""


def band(p: float) -> tuple[int, int]:
    """Counts that hold 99.9 % of a binomial law."""
    return int(binom.ppf(0.0005, RECORDS, p)), int(binom.ppf(0.9995, RECORDS, p))


@pytest.mark.statistics
@pytest.mark.parametrize("pair", SLICE, ids=lambda pair: pair.effect)
def test_detections_are_as_frequent_as_predicted_and_not_as_for_twice_the_size(pair):
    # False alarms: one in a thousand for each pair.
    sized = pair.sized()
    records = [sized.record(seed) for seed in range(RECORDS)]
    count = sum(any_enters(state) for state in records)
    right, twice = np.mean(
        [[sized.predicted(state), sized.predicted(state, 2.0)] for state in records[:PREDICTED]], axis=0
    )
    print(f"{pair.effect}: {count} of {RECORDS}; {band(right)} predicted, {band(twice)} for twice the size")
    assert [low <= count <= high for low, high in (band(right), band(twice))] == [True, False]


# Diagnosis and power agree


def test_limits_of_a_diagnosis_are_those_of_power():
    state = fitted(World("interleaved", "CXL02", seconds=20.0, seed=3))
    limits, drifting = (
        scan([state], Model.linear()).detection_limits,
        with_drift(detectability_of(state, Model.linear())),
    )
    sizes = {limit.effect: min(limit.smallest) for limit in drifting.detectabilities}
    random_processes = {effect.name for effect in BUILT_IN if effect.port == "process"}
    # Instants of jumps and periods of waves come from the record in a diagnosis, and are spread evenly by power.
    assert set(limits) == set(sizes) - random_processes
    for name in set(limits) - {"encoder_step", "rail_wave"}:
        assert limits[name] == pytest.approx(sizes[name], rel=1e-12), name
    assert math.isfinite(limits["cubic"])


@pytest.mark.parametrize(("moving", "visible"), [(single_tone(), False), (motion("moves", 20.0, RNG(3)), True)])
def test_an_effect_that_the_base_contains_has_no_limit(moving, visible):
    # On one tone p is a times a constant, so a sloping rail is a scale factor; moves separate the two.
    state = planned_state(moving, PLAIN, 20.0, planned_noise(PLAIN), Model.linear())
    limit = scan([state], Model.linear()).detection_limits["rail_slope"]
    assert math.isfinite(limit) == visible
    assert power_of_motion(moving, PLAIN)["rail_slope"].visible == visible


def test_two_parts_require_a_larger_distance_and_each_part_has_its_size():
    powers = power_of_motion(TONES, PLAIN)
    two_parts = powers["encoder_nonlinearity"]
    both = [size * d for size, d in zip(two_parts.smallest, two_parts.d, strict=True)]
    assert both == pytest.approx([least_distance(powers.examined, powers.blocks, FAMILYWISE_ALPHA, dof=2)] * 2)
    assert both[0] > least_distance(powers.examined, powers.blocks, FAMILYWISE_ALPHA)
    with pytest.raises(ValueError, match="2 parts"):
        powers.detection("encoder_nonlinearity", (1.0, 2.0, 3.0))


def detected(A: np.ndarray, s: float, required: float) -> float:
    """Share of paths of a random process of intensity s whose best likelihood ratio over intensities reaches a gain."""
    rng = np.random.default_rng(77)
    b = np.linalg.cholesky(A + s**2 * A @ A) @ rng.standard_normal((len(A), 1500))

    def log_density(size: float) -> np.ndarray:
        S = A + size**2 * A @ A
        return -0.5 * (np.sum(b * np.linalg.solve(S, b), axis=0) + np.linalg.slogdet(S)[1])

    grid = s * np.geomspace(0.02, 50.0, 80)
    best = np.max([log_density(size) for size in grid], axis=0)
    return float(np.mean(2.0 * (best - log_density(0.0)) >= required))


@pytest.mark.parametrize("seed", [1, 2, 3])
def test_a_random_process_of_the_intensity_at_the_limit_is_detected(seed):
    """By densities of the scores in whole matrices. The limit is a quantile of 40 paths: 0.85 to 0.995 (99 %)."""
    rng = np.random.default_rng(seed)
    A = rng.standard_normal((8, 8)) * np.geomspace(1.0, 0.1, 8)
    A = A @ A.T + 1e-3 * np.eye(8)
    rules = SimpleNamespace(examined=30, blocks=20, alpha=0.005)
    limit = intensity(SimpleNamespace(G=A, columns=[slice(0, 8)]), 0, rules)
    required = max(entry_gains(30, 20, 0.005))
    assert 0.85 < detected(A, limit, required) < 0.995
    assert detected(A, 0.4 * limit, required) < 0.8
