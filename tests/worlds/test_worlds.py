"""The worlds against closed forms, and their strength of effects against dense covariances and against records."""

from __future__ import annotations

import ast
import csv
import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.interpolate import make_interp_spline
from scipy.signal import welch
from scipy.stats import chi2, norm

from . import CATALOGUE, EFFECTS, MOTIONS, OUTSIDE, SENSORS, Hidden, Nuisances, Record, World, at_d, d2, signatures
from .motion import move
from .numerics import STEP, Array, double_integral, interpolate, lag, play, resonate
from .strength import contamination, encoder_variance, whiten
from .world import ACCEL_RATE, ENCODER_RATE, RESOLUTION, encoder_error, pass_through, time_constant

SHORT = World(motion="tones", sensor="CXL02", seconds=12.0, seed=3)


def with_effect(name: str, magnitude: float | None = None, world: World = SHORT, **shape: float) -> World:
    return replace(world, hidden=(Hidden(name, EFFECTS[name].typical if magnitude is None else magnitude, shape),))


def amplitude(y: Array, t: Array, f: float) -> complex:
    """Return the complex amplitude of the line f in y, by least squares."""
    columns = np.column_stack((np.cos(2 * np.pi * f * t), np.sin(2 * np.pi * f * t), np.ones_like(t)))
    c, s, _ = np.linalg.lstsq(columns, y, rcond=None)[0]
    return complex(c, -s)


# --- independence and completeness ----------------------------------------------------------------------------------


def test_no_world_imports_the_product() -> None:
    for path in Path(__file__).parent.glob("*.py"):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.Import):
                modules = [alias.name for alias in node.names]
            elif isinstance(node, ast.ImportFrom):
                modules = [node.module or ""]
            else:
                continue
            assert not any("accelcal" in module for module in modules), f"{path.name}: {modules}"


def test_at_least_eight_effects_are_outside_the_catalogue() -> None:
    assert len(OUTSIDE) >= 8
    assert not set(OUTSIDE) & set(CATALOGUE), "what is outside the catalogue has another name than what is in it"


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_cites_its_source_and_changes_what_is_measured(name: str) -> None:
    effect = EFFECTS[name]
    assert "(" in effect.source or ":" in effect.source or "IEEE" in effect.source or "Data" in effect.source
    assert effect.explains
    plain, changed = SHORT.record(), with_effect(name).record()
    moved = not np.array_equal(plain.accel, changed.accel) or not np.array_equal(plain.position, changed.position)
    assert moved
    if effect.place in ("scale", "encoder", "reading"):
        assert np.array_equal(plain.accel, changed.accel)
    else:
        assert np.array_equal(plain.position, changed.position)


@pytest.mark.parametrize("name", EFFECTS)
def test_every_effect_can_be_set_to_a_strength_unless_it_hides_in_the_base(name: str) -> None:
    world = with_effect(name)
    if EFFECTS[name].kind == "invisible":
        assert d2(world) < 1e-4  # second order in the angle is all that is left
        with pytest.raises(ValueError, match="hides in the base"):
            at_d(world, 20)
    else:
        assert np.sqrt(d2(at_d(world, 20))) == pytest.approx(20, rel=0.011)  # at_d stops at 1 %


# --- motion ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("name", MOTIONS)
def test_position_is_the_double_integral_of_acceleration(name: str) -> None:
    m = move(name, 4, 60.0)
    begin = 10  # the outermost step of the quadrature is a trapezoid
    result = double_integral(m.a[begin:]) + m.p[begin] + m.v[begin] * (m.t[begin:] - m.t[begin])
    line = np.polynomial.Polynomial.fit(m.t[begin:], result - m.p[begin:], 1)  # what that first trapezoid leaves
    # steps of 0.1 ms: (w h)^4 = 1e-6 of the finest motion, whose amplitude is below 0.1 mm
    np.testing.assert_allclose(result - line(m.t[begin:]), m.p[begin:], atol=2e-10)
    np.testing.assert_allclose(np.gradient(m.a, STEP)[5:-5], m.jerk[5:-5], atol=2e-3 * float(np.std(m.jerk)))


@pytest.mark.parametrize("name", [name for name in MOTIONS if name != "fast"])
def test_only_the_fast_motion_exceeds_the_encoder(name: str) -> None:
    for seed in range(5):
        assert np.max(np.abs(move(name, seed, 60.0).v)) <= 0.1


def test_fast_motion_nears_two_g() -> None:
    peaks = [np.max(np.abs(move("fast", seed, 60.0).a)) for seed in range(5)]
    assert min(peaks) > 15
    assert max(peaks) < 18.5


def test_long_rest_begins_and_ends_with_twenty_seconds_of_rest() -> None:
    m = move("long_rest", 1, 60.0)
    resting = (m.t < 19.9) | (m.t > 40.1)
    assert np.max(np.abs(m.a[resting])) < 1e-9
    assert np.std(m.a[~resting]) > 0.3


def test_motion_noise_and_effects_draw_from_separate_streams() -> None:
    plain, hidden = SHORT.record(), with_effect("bias_step", 0.05, instant=6.0).record()
    step = lag(hidden.contributions["bias_step"].output, time_constant(SHORT))  # type: ignore[arg-type]
    expected = interpolate(hidden.truth.t[0], step, hidden.t_accel)
    code = SENSORS["CXL02"].range / 2**15
    # both roundings
    np.testing.assert_allclose(hidden.accel - plain.accel, expected, atol=1.01 * code)


def test_the_same_world_gives_the_same_record() -> None:
    world = with_effect("timing_jitter")
    first, second = world.record(), world.record()
    assert np.array_equal(first.accel, second.accel)
    assert np.array_equal(first.position, second.position)
    assert not np.array_equal(first.accel, replace(world, seed=4).record().accel)


def test_a_settled_world_repeats_its_record_and_keeps_its_parameters_on_another_day() -> None:
    world = with_effect("saturation", 0.3)
    settled = world.settled()
    assert np.array_equal(world.record().accel, settled.record().accel)
    other = settled.again("bursts", 8).record()
    assert other.world.hidden[0].shape == settled.hidden[0].shape
    assert (other.world.bias, other.world.scale_factor) == (settled.bias, settled.scale_factor)


# --- physics against closed forms -----------------------------------------------------------------------------------


@pytest.mark.parametrize("f", [2.0, 20.0, 200.0])
def test_low_pass_has_gain_and_phase_of_an_rc(f: float) -> None:
    t = np.arange(40_000.0) * STEP
    tau = 1e-3
    result = amplitude(lag(np.cos(2 * np.pi * f * t), tau)[10_000:], t[10_000:], f)
    # cubic input: error (w h)^4/30 of the finest tone
    assert result == pytest.approx(1 / (1 + 2j * np.pi * f * tau), abs=2e-5)


@pytest.mark.parametrize("f", [2.0, 20.0, 300.0, 400.0])
def test_resonance_has_amplitude_and_phase_of_mass_on_spring(f: float) -> None:
    t = np.arange(60_000.0) * STEP
    f0, quality = 300.0, 5.0
    result = amplitude(resonate(np.cos(2 * np.pi * f * t), f0, quality)[30_000:], t[30_000:], f)
    ratio = f / f0
    expected = 1 / (1 - ratio**2 + 1j * ratio / quality)
    assert abs(result - expected) < 1e-3 * abs(expected)  # (w h)^4/30 at 400 Hz


def test_resonance_is_a_delay_of_its_magnitude_at_low_frequency() -> None:
    output = pass_through(with_effect("sensor_resonance", 2e-5, quality=5.0)).contributions[0].output
    truth = pass_through(SHORT).scene
    inner = slice(5000, -5000)
    slope = np.dot(output[inner], truth.jerk[inner]) / np.dot(truth.jerk[inner], truth.jerk[inner])  # type: ignore[index]
    scale = 1 + pass_through(SHORT).scale_factor
    assert slope == pytest.approx(-2e-5 * scale, rel=2e-2)  # next order (w/w0)^2 Q^2


def test_play_encloses_the_area_of_its_loop() -> None:
    t = np.arange(20_000) * STEP
    size, half_width = 2.0, 0.3
    u = size * np.sin(2 * np.pi * t)
    w = play(u, half_width)
    period = slice(10_000, 20_000)
    area = np.sum(u[period] * np.gradient(w)[period])
    assert area == pytest.approx(4 * half_width * (size - half_width), rel=1e-3)  # 1e4 points per loop


def test_play_equals_its_definition_step_by_step_and_remembers_through_rest() -> None:
    u = np.cumsum(np.random.default_rng(1).standard_normal(5000)) * 0.01
    u[2000:2500] = u[2000]
    expected, w = np.empty_like(u), u[0]
    for i, x in enumerate(u):
        w = max(min(w, x + 0.05), x - 0.05)
        expected[i] = w
    np.testing.assert_allclose(play(u, 0.05), expected, atol=2e-9)  # turning points are found on a grid of 1e-9


def test_backlash_shifts_the_reading_by_half_the_gap_either_way() -> None:
    chain = pass_through(with_effect("encoder_backlash", -4e-6))
    shift = chain.encoder - chain.scene.p
    moved = (np.abs(chain.scene.v) > 0.02) & (chain.scene.t > 0)  # it begins in the middle of the gap
    np.testing.assert_allclose(shift[moved], -2e-6 * np.sign(chain.scene.v[moved]), atol=1e-15)


def test_clock_skew_stretches_the_stamps() -> None:
    plain, skewed = pass_through(SHORT), pass_through(with_effect("clock_skew", 1e-3))
    t = np.linspace(1.0, 11.0, 999)
    begin = plain.scene.t[0]
    result = interpolate(begin, skewed.output, 1.001 * t)
    np.testing.assert_allclose(result, interpolate(begin, plain.output, t), atol=1e-6)  # two cubic interpolations


def test_positive_time_offset_makes_the_accelerometer_late() -> None:
    late = with_effect("time_offset", 2e-3).record()
    plain = SHORT.record()
    begin = plain.truth.t[0]
    expected = interpolate(begin, plain.truth.a, late.t_accel - 2e-3)
    early = interpolate(begin, plain.truth.a, late.t_accel + 2e-3)
    assert np.std(late.accel - expected) < np.std(late.accel - early)


def test_dead_zone_says_nothing_inside() -> None:
    chain = pass_through(with_effect("dead_zone", -0.2))
    inside = np.abs(chain.scene.a) < 0.19
    scale = 1 + chain.scale_factor
    np.testing.assert_allclose(chain.output[inside] - chain.bias, (scale - 1) * chain.scene.a[inside], atol=1e-12)


def test_saturation_stops_at_its_level() -> None:
    chain = pass_through(with_effect("saturation", 0.5))
    assert np.max(np.abs(chain.output)) == pytest.approx(chain.shapes[0]["level"], rel=1e-12)
    assert np.mean(np.abs(chain.output) > chain.shapes[0]["level"] * (1 - 1e-12)) > 1e-3


def test_rectified_vibration_has_the_mean_of_its_square() -> None:
    chain = pass_through(with_effect("vibration_rectification", 0.02, amplitude=2.0))
    truth, result = chain.scene, chain.contributions[0].output
    half_square = (2.0 * (truth.v / np.max(np.abs(truth.v))) ** 2) ** 2 / 2
    assert np.mean(result) == pytest.approx(0.02 * np.mean(half_square), rel=0.01)  # type: ignore[arg-type]


def test_readings_lie_on_the_codes_of_converter_and_encoder() -> None:
    record = with_effect("quantisation", 0.05).record()
    np.testing.assert_allclose(record.accel / 0.05, np.rint(record.accel / 0.05), atol=1e-9)
    np.testing.assert_allclose(record.position / RESOLUTION, np.rint(record.position / RESOLUTION), atol=1e-9)


def test_turning_the_sensor_round_reverses_acceleration_and_tilt_but_not_bias() -> None:
    world = replace(with_effect("tilt", 1e-3), bias=0.1, scale_factor=0.0)
    normal, turned = pass_through(world), pass_through(replace(world, mount="reversed"))
    np.testing.assert_allclose(normal.output + turned.output, 0.2, atol=1e-12)
    rolled = replace(with_effect("cross_axis_gravity", 1e-3), bias=0.0, scale_factor=0.0)
    up, down = pass_through(rolled), pass_through(replace(rolled, mount="rolled"))
    np.testing.assert_allclose(up.output + down.output, 2 * up.scene.a, atol=1e-12)


# --- noise ----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("sensor", SENSORS)
def test_noise_density_at_rest_is_that_of_the_data_sheet(sensor: str) -> None:
    powers = []
    for seed in range(3):
        record = World(motion="long_rest", sensor=sensor, seed=seed).record()
        for rest in (record.t_accel < 19.5, record.t_accel > 40.5):
            f, power = welch(record.accel[rest], fs=ACCEL_RATE, nperseg=4096)
            band = (f > 2) & (f < 100)
            powers.append(np.mean(power[band] * (1 + (2 * np.pi * f[band] * time_constant(record.world)) ** 2)))
    # 2 x 3 rests of 19.5 s x 98 Hz: standard error of the density 0.5 %; the 16-bit code adds 0.3 %
    assert np.sqrt(np.mean(powers)) == pytest.approx(SENSORS[sensor].noise, rel=0.03)


def test_missing_readings_have_the_declared_share() -> None:
    record = World(seconds=20.0, nuisances=Nuisances(missing=0.1, missing_accel=0.05)).record()
    assert np.mean(np.isnan(record.position)) == pytest.approx(0.1, abs=0.01)  # 4.3 binomial sigma of 16 670
    assert np.mean(np.isnan(record.accel)) == pytest.approx(0.05, abs=0.005)


# --- strength -------------------------------------------------------------------------------------------------------


def dense_d2(world: World) -> float:
    """Return d² from the full covariance of z − ∬u, the start state as two free columns."""
    chain = pass_through(world)
    t = np.arange(int(world.seconds * ENCODER_RATE)) / ENCODER_RATE
    near, far = np.minimum.outer(t, t), np.maximum.outer(t, t)
    q = SENSORS[world.sensor].noise ** 2 / 2
    covariance = q * near**2 * (3 * far - near) / 6 + encoder_variance(world) * np.eye(len(t))
    root = np.linalg.cholesky(covariance)
    begin = chain.scene.t[0]

    def through(output: Array) -> Array:
        return interpolate(begin, -double_integral(output), t)

    truth, output = chain.scene, chain.contributions[0].output
    base = np.column_stack([np.ones_like(t), t, *map(through, (np.ones_like(truth.t), truth.a, truth.jerk))])
    column = encoder_error(world, chain, 0, t) if output is None else through(output)
    white_base = np.linalg.solve(root, base / np.linalg.norm(base, axis=0))
    white = np.linalg.solve(root, column)
    return float(np.sum((white - white_base @ np.linalg.lstsq(white_base, white, rcond=None)[0]) ** 2))


@pytest.mark.parametrize("sensor", SENSORS)
@pytest.mark.parametrize("name", ["cubic", "bias_step", "hysteresis", "rail_curve", "encoder_cyclic", "clock_skew"])
def test_d2_equals_the_likelihood_of_the_dense_covariance(name: str, sensor: str) -> None:
    world = with_effect(name, world=replace(SHORT, sensor=sensor, seconds=2.0))
    assert d2(world) == pytest.approx(dense_d2(world), rel=0.03)


@pytest.mark.parametrize("name", ["cubic", "sensor_lag", "clock_skew", "rail_wave", "encoder_backlash"])
def test_d_grows_in_proportion_to_a_small_magnitude(name: str) -> None:
    small = {"sensor_lag": 1e-5}.get(name, EFFECTS[name].typical / 10)
    ratio = d2(with_effect(name, 2 * small, period=0.05)) / d2(with_effect(name, small, period=0.05))
    assert np.sqrt(ratio) == pytest.approx(2, rel=0.02)


def test_signatures_give_strengths_and_mutual_correlation() -> None:
    world = replace(SHORT, hidden=(Hidden("cubic", 1e-3), Hidden("odd_quadratic", 1e-3), Hidden("bias_drift", 1e-4)))
    columns = signatures(world)
    d = np.linalg.norm(columns, axis=0)
    assert d[0] ** 2 == pytest.approx(d2(world, index=0), rel=1e-6)
    correlation = columns.T @ columns / np.outer(d, d)
    assert abs(correlation[0, 1]) > 0.9
    assert abs(correlation[0, 2]) < 0.2


def test_random_walk_has_the_strength_of_its_cosine_series() -> None:
    """Beside a free constant the walk is Σ θj cos(pi j t/L) with var θj = 2 m² L/(pi j)², so λj = (m L/(pi j))²/q."""
    world = with_effect("bias_random_walk", 1e-3, World(sensor="ADXL105", motion="moves"))
    q = SENSORS["ADXL105"].noise ** 2 / 2
    power = (1e-3 * 60 / np.pi / np.arange(1, 41)) ** 2 / q
    # the unknown start state takes a little of it
    assert d2(world, base=("1",)) == pytest.approx(np.sum(power - np.log1p(power)), rel=0.01)


def test_contamination_equals_the_mean_likelihood_gain_of_draws() -> None:
    rng, n, share, size = np.random.default_rng(2), 400_000, 0.02, 2.0
    x = rng.standard_normal(n) * np.where(rng.random(n) < share, np.hypot(1, size), 1.0)
    mixed = (1 - share) * norm.pdf(x) + share * norm.pdf(x, scale=np.hypot(1, size))
    gains = 2 * np.log(mixed / norm.pdf(x))
    assert contamination(share, 1.0, size) == pytest.approx(gains.mean(), abs=4 * gains.std() / np.sqrt(n))


def fitted(record: Record, q_factor: float = 1.0) -> tuple[float, float, int]:
    """Fit base and true contribution to a record: (estimate/true − 1) d, whitened sum of squares, its freedom."""
    world, tau = record.world, time_constant(record.world)
    spline = make_interp_spline(record.t_accel, record.accel, k=3)
    once, twice = spline.antiderivative(1), spline.antiderivative(2)
    inside = (record.t_position > record.t_accel[2]) & (record.t_position < record.t_accel[-3])
    t, z = record.t_position[inside], record.position[inside]
    chain, begin = record.chain, record.truth.t[0]
    truth = record.truth

    def through(output: Array) -> Array:
        return interpolate(begin, -double_integral(output), t)

    scale = 1 / (1 + chain.scale_factor)
    output = chain.contributions[0].output
    contribution = encoder_error(world, chain, 0, t) if output is None else scale * through(output)
    base = [through(np.ones_like(truth.t)), through(truth.a), through(truth.jerk)]
    y = z - scale * (twice(t) + tau * once(t))
    q = SENSORS[world.sensor].noise ** 2 / 2 * scale**2 * q_factor
    white = whiten(np.column_stack((*base, contribution, y)), q, encoder_variance(world), 1 / ENCODER_RATE)[400:]
    basis, _ = np.linalg.qr(white[:, :3] / np.linalg.norm(white[:, :3], axis=0))
    column, reading = (white[:, j] - basis @ (basis.T @ white[:, j]) for j in (3, 4))
    d = float(np.linalg.norm(column))
    estimate = float(column @ reading) / d**2
    return (estimate - 1) * d, float(np.sum((reading - estimate * column) ** 2)), len(white) - 4


RECORDS = 12
TRIED = [
    ("quadratic", "CXL02"),
    ("temperature_scale", "ADXL105"),
    ("saturation", "CXL02"),
    ("encoder_backlash", "CXL02"),
    ("encoder_cyclic", "ADXL105"),
]


@pytest.fixture(scope="module", params=TRIED)
def fits(request: pytest.FixtureRequest) -> list[Record]:
    name, sensor = request.param
    world = World(motion="bursts", sensor=sensor, seconds=20.0, hidden=(Hidden(name, EFFECTS[name].typical),))
    return [at_d(replace(world, seed=seed), 15.0).record() for seed in range(RECORDS)]


def test_records_hold_the_effect_with_the_stated_strength_in_white_noise(fits: list[Record]) -> None:
    """Whole chain: RC, clocks, noise, rounding. False alarm 0.1 % per effect (99.9 % region)."""
    results = [fitted(record) for record in fits]
    errors = sum(error**2 for error, _, _ in results)
    assert chi2.ppf(0.0005, RECORDS) < errors < chi2.ppf(0.9995, RECORDS)
    squares, freedom = sum(r[1] for r in results), sum(r[2] for r in results)
    assert squares / freedom == pytest.approx(1, abs=4 * np.sqrt(2 / freedom) + 0.01)  # 1 % for the converter's codes


def test_the_same_check_fails_with_a_wrong_noise_intensity(fits: list[Record]) -> None:
    results = [fitted(record, q_factor=0.3) for record in fits]
    squares, freedom = sum(r[1] for r in results), sum(r[2] for r in results)
    assert squares / freedom != pytest.approx(1, abs=4 * np.sqrt(2 / freedom) + 0.01)


# --- files ----------------------------------------------------------------------------------------------------------


def test_written_files_say_what_was_measured(tmp_path: Path) -> None:
    world = replace(SHORT, nuisances=Nuisances(missing=0.1, lowpass_tolerance=0.05, clock_tolerance=20e-6))
    record = world.record()
    path = record.write(tmp_path, "null")
    with path.open(encoding="utf-8", newline="") as file:
        rows = list(csv.DictReader(file))
    stamps = [float(row["t_position"]) for row in rows if row["t_position"]]
    readings = [float(row["position"]) if row["position"] else np.nan for row in rows if row["t_position"]]
    np.testing.assert_allclose(stamps, record.t_position, atol=6e-10)  # nine decimals
    np.testing.assert_allclose(readings, record.position, rtol=1e-8)
    sidecar = tomllib.loads(path.with_suffix(".toml").read_text(encoding="utf-8"))
    assert sidecar["channels"]["accel"]["lowpass"] == {"kind": "RC", "fc": "159 Hz", "tolerance": 0.05}
    assert sidecar["channels"]["position"]["resolution"] == "1 um"
    assert sidecar["clock"]["offset_tolerance"] == "20 us"
    assert sidecar["sensor"]["noise"] == "20 ug/sqrt(Hz)"
    assert set(sidecar["channels"]) == {"accel", "position", "temperature", "a_y"}
