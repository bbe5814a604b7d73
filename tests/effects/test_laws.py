"""Closed forms that single effects must meet."""

import dataclasses

import numpy as np
import pytest

from accelcal import _core
from accelcal.data.rig import Rig
from accelcal.effects import BUILT_IN, find
from accelcal.effects.building_blocks import lagged, lagged_at, play, wave
from accelcal.effects.curves import CUBIC, bumped, cosines, curve, rippled, splines

from .motions import PERIOD, moves, sines

AMPLITUDE = 3.0
CYCLES = 60.0
W = 2.0 * np.pi * CYCLES / PERIOD


def one_tone(**more):
    return sines(((CYCLES, AMPLITUDE, 0.0),), n=60_000, **more)


def harmonic(y, k):
    """Sine and cosine amplitude of the k-th harmonic over the second half of the record."""
    t = one_tone().t
    late = slice(len(t) // 2, None)
    angle = k * W * t[late]
    factor = 1.0 if k == 0 else 2.0
    return factor * np.mean(y[late] * np.sin(angle)), factor * np.mean(y[late] * np.cos(angle))


@pytest.mark.parametrize(
    ("name", "k", "sine", "cosine"),
    [
        ("quadratic", 0, 0.0, AMPLITUDE**2 / 2.0),
        ("quadratic", 2, 0.0, -(AMPLITUDE**2) / 2.0),
        ("cubic", 1, 0.75 * AMPLITUDE**3, 0.0),
        ("cubic", 3, -0.25 * AMPLITUDE**3, 0.0),
        ("odd_quadratic", 1, 8.0 / (3.0 * np.pi) * AMPLITUDE**2, 0.0),
        ("odd_quadratic", 3, -8.0 / (15.0 * np.pi) * AMPLITUDE**2, 0.0),
        ("velocity", 1, 0.0, -AMPLITUDE / W),
        ("time_offset", 1, 0.0, -1.01 * AMPLITUDE * W),
        ("rail_slope", 1, -AMPLITUDE / W**2, 0.0),
        ("sensor_resonance", 1, 1.01 * AMPLITUDE * W**2, 0.0),
        ("vibration_rectification", 0, 0.0, 3.0 / 8.0 * (AMPLITUDE / W) ** 4),
        ("vibration", 0, 0.0, 3.0 / 16.0 * (AMPLITUDE / W) ** 4),
    ],
)
def test_harmonics_of_a_sine(name, k, sine, cosine):
    size = abs(sine) + abs(cosine)
    # Derivatives of fourth order err by (w h)^4/30, below 1e-9; corners of a|a| between samples by 1e-6.
    np.testing.assert_allclose(harmonic(find(name).column(one_tone()), k), (sine, cosine), atol=3e-6 * size)


def test_rounded_corners_are_the_sharp_ones_away_from_zero():
    s = one_tone()
    # width 0.2 % of the amplitude: the step is sharp beyond it, the root to w²/2a
    far = np.abs(s.a) > 0.02 * AMPLITUDE
    np.testing.assert_array_equal(find("dead_zone").column(s, width=s.a_width)[far], np.sign(s.a)[far])
    np.testing.assert_allclose(find("scale_asymmetry").column(s), np.abs(s.a), atol=0.0021 * AMPLITUDE)
    assert np.mean(find("scale_asymmetry").column(s)) == pytest.approx(2.0 * AMPLITUDE / np.pi, rel=1e-4)


def test_corners_are_as_wide_as_the_noise_asks():
    exact, noisy = one_tone(), one_tone(a_std=0.1)
    assert exact.a_width == pytest.approx(0.002 * AMPLITUDE, rel=1e-6)
    assert noisy.a_width == pytest.approx(0.4)
    least, most = find("dead_zone").shapes["width"].span(noisy)
    assert least == pytest.approx(0.4)
    assert most > least


@pytest.mark.parametrize("name", ["sensor_lag", "creep"])
@pytest.mark.parametrize("tau", [1e-3, 8e-3, 0.3])
def test_a_lag_has_the_gain_and_phase_of_its_pole(name, tau):
    s = one_tone(scale=1.0)
    begin = {"start": 0.0} if name == "creep" else {}
    sine, cosine = harmonic(find(name).column(s, tau=tau, **begin), 1)
    pole = 1.0 / (1.0 + 1j * W * tau) - (1.0 if name == "sensor_lag" else 0.0)
    # Straight lines between samples: (w h)²/12 = 1.3e-5 of the amplitude.
    np.testing.assert_allclose([sine / AMPLITUDE, cosine / AMPLITUDE], [pole.real, pole.imag], atol=2e-5)


@pytest.mark.parametrize("tau", [1e-3, 8e-3, 0.3])
def test_a_lag_of_the_encoder_has_the_gain_and_phase_of_its_pole(tau):
    sine, cosine = harmonic(find("encoder_lag").column(one_tone(), tau=tau), 1)
    shown = -AMPLITUDE / W**2 * (1.0 / (1.0 + 1j * W * tau) - 1.0)  # of the position -A/w² sin(w t)
    # Only what lies beyond p - tau v is filtered, so that straight lines between samples cost tau² of their 2e-5.
    size = AMPLITUDE / W**2 * (W * tau) ** 2
    np.testing.assert_allclose([sine, cosine], [shown.real, shown.imag], atol=2e-5 * size)


def test_an_upright_or_turned_stage_moves_its_lagging_encoder_alike():
    level = one_tone()
    rig = Rig(axis="up", mount="reversed")
    turned = dataclasses.replace(level, a=rig.polarity * (level.a + rig.gravity), rig=rig)
    assert turned.rest == pytest.approx(-9.80665)
    expected = find("encoder_lag").column(level, tau=8e-3)
    np.testing.assert_allclose(find("encoder_lag").column(turned, tau=8e-3), expected, atol=1e-12)


@pytest.mark.parametrize("tau", [1e-3, 0.3, 40.0])
def test_a_high_pass_passes_what_its_corner_lets_through(tau):
    s = one_tone(scale=1.0)
    y = s.a + find("ac_coupling").column(s, tau=tau)
    sine, cosine = harmonic(y, 1)
    pole = 1j * W * tau / (1.0 + 1j * W * tau)
    transient = np.exp(-30.0 / tau) if tau < 30.0 else 0.02  # the second half begins after 30 s
    expected = [pole.real, pole.imag]
    np.testing.assert_allclose([sine / AMPLITUDE, cosine / AMPLITUDE], expected, atol=2e-5 + transient)


def test_a_high_pass_leaves_nothing_of_a_lasting_tilt():
    s = sines(rig=Rig(axis="up"), scale=1.0)
    tilted = dataclasses.replace(s, a=s.rest + 0.2 * (s.t >= 10.0))
    y = tilted.a + find("ac_coupling").column(tilted, tau=2.0)
    np.testing.assert_allclose(y[s.t < 9.9], 0.0, atol=1e-12)  # gravity went before the record
    after = s.t > 10.01
    np.testing.assert_allclose(y[after], 0.2 * np.exp(-(s.t[after] - 10.0) / 2.0), atol=2e-4)


def test_a_lag_at_unequal_times_is_the_lag_at_equal_ones():
    s = one_tone()
    every = lagged(s.a, 0.02, s.step, 0.0)
    remaining = np.sort(np.random.default_rng(3).choice(len(s.t), len(s.t) // 2, replace=False))
    assert np.ptp(np.diff(remaining)) > 3
    remaining[0] = 0
    thinned = lagged_at(s.t[remaining], s.a[remaining], 0.02, 0.0)
    # Gaps of at most a dozen samples, straight in between: (12 w h)²/12.
    np.testing.assert_allclose(thinned, every[remaining], atol=2e-3 * AMPLITUDE)
    np.testing.assert_allclose(lagged_at(s.t, s.a, 0.02, 0.0), every, atol=1e-9)


def test_self_heating_settles_at_the_mean_square():
    s = one_tone()
    begun_at_rest = dataclasses.replace(s, v=np.where(s.t < s.t[0] + 0.2, 0.0, s.v))
    y = find("self_heating").column(begun_at_rest, tau=2.0, start=0.0)
    assert y[0] == 0.0
    assert find("self_heating").column(s, tau=2.0, start=0.0)[0] == pytest.approx(AMPLITUDE**2 / 2.0, rel=0.05)
    assert np.mean(y[-30_000:]) == pytest.approx(AMPLITUDE**2 / 2.0, rel=1e-5)  # e^-15 after 30 s


def test_memory_begins_at_rest_in_gravity():
    s = sines(rig=Rig(axis="up"))
    assert s.rest == pytest.approx(9.80665)
    upright = dataclasses.replace(s, a=np.full_like(s.a, s.rest))
    np.testing.assert_allclose(find("creep").column(upright, tau=5.0, start=0.0), s.rest, rtol=1e-12)
    np.testing.assert_allclose(find("self_heating").column(upright, tau=5.0, start=0.0), s.rest**2, rtol=1e-12)


def by_hand(x, width, start):
    y, held = [], start
    for value in x:
        if value - held > width / 2:
            held = value - width / 2
        elif held - value > width / 2:
            held = value + width / 2
        y.append(held)
    return np.array(y)


@pytest.mark.parametrize("width", [0.0, 0.1, 1.3, 50.0])
def test_play_equals_a_plain_loop(width):
    x = np.cumsum(np.random.default_rng(4).standard_normal(5000))
    np.testing.assert_array_equal(_core.play(x, width, 0.4), by_hand(x, width, 0.4))


def test_the_loop_of_play_has_its_area_at_any_rate():
    width = 1.0
    for cycles in (15.0, CYCLES):
        s = sines(((cycles, AMPLITUDE, 0.0),), n=120_000)
        y = find("hysteresis").column(s, width=width)
        late = slice(60_000, None)
        area = -np.sum(0.5 * (y[late][1:] + y[late][:-1]) * np.diff(s.a[late])) / cycles
        # A parallelogram, `width` wide and 2 A - width high; samples cut its corners by (w h)²/8.
        assert abs(area) == pytest.approx(width * (2.0 * AMPLITUDE - width), rel=1e-4)


def test_a_play_keeps_its_memory_through_rests():
    s = moves()
    y = find("hysteresis").column(s, width=0.1)
    resting = (np.mod(s.t, 6.0) > 2.1) & (np.mod(s.t, 6.0) < 3.9)
    np.testing.assert_allclose(np.abs(y[resting]), 0.05, atol=1e-9)  # half the width, left by the braking


def test_backlash_knows_the_last_direction_in_rests():
    s = moves()
    y = find("encoder_backlash").column(s, width=4e-6)
    phase = np.mod(s.t, 6.0)
    assert np.all(y[s.t < 1.0] == 0.0)
    np.testing.assert_allclose(y[(phase > 2.0) & (phase < 4.0)], 0.5)
    np.testing.assert_allclose(y[(s.t > 6.0) & ((phase > 5.0) | (phase < 1.0))], -0.5)


def test_backlash_is_not_written_by_noise_at_rest():
    s = moves()
    noise = 1e-7 * np.random.default_rng(3).standard_normal(len(s.t))
    noisy = dataclasses.replace(s, p=s.p + noise, p_std=1e-6)
    phase = np.mod(s.t, 6.0)
    y = find("encoder_backlash").column(noisy, width=find("encoder_backlash").shapes["width"].span(noisy)[0])
    assert np.all(y[(phase > 2.0) & (phase < 4.0)] > 0.4)


@pytest.mark.parametrize("seed", range(3))
def test_a_slack_finer_than_the_noise_of_the_position_closes_where_a_move_begins(seed):
    plain, width = moves(), 2e-6
    rng = np.random.default_rng(seed)
    p_noise, v_noise = (lagged(rng.standard_normal(len(plain.t)), 0.01, 2.4e-3, 0.0) for _ in range(2))
    noise = {"p": 5e-7 / p_noise.std() * p_noise, "v": 3e-5 / v_noise.std() * v_noise}
    noisy = dataclasses.replace(plain, p=plain.p + noise["p"], v=plain.v + noise["v"], p_std=5e-7, v_std=3e-5)
    wanted = find("encoder_backlash").column(plain, width=width)
    moved = find("encoder_backlash").column(noisy, width=width)
    later = plain.t > 3.0  # the first direction is known from the first move on
    off = np.abs(moved - wanted)[later]
    assert np.mean(off) < 0.05
    raw = (noisy.p - play(noisy.p, width, float(noisy.p[0]))) / width
    assert np.mean(np.abs(raw - wanted)[later]) > 3.0 * np.mean(off)


def test_time_since_reversal_starts_anew_at_each_turn():
    s = moves()
    y = find("shape_since_reversal").column(s)
    both, odd = y[:, :4], y[:, 4:]
    assert np.all(odd[s.t < 1.0] == 0.0)
    np.testing.assert_allclose(both.sum(axis=1), 1.0)  # a constant, which every base holds
    phase = np.mod(s.t, 6.0)
    assert np.all(both[(phase > 3.9) & (phase < 4.0), 3] == 1.0)  # 2.5 s and more after the turn
    np.testing.assert_allclose(odd[(phase > 3.0) & (phase < 4.0)].sum(axis=1), 1.0)
    np.testing.assert_allclose(odd[(s.t > 6.0) & (phase < 1.0)].sum(axis=1), -1.0)


def test_clipping_with_coefficient_one_is_a_clipped_output():
    s = one_tone()
    level = 0.8 * AMPLITUDE
    output = s.scale * s.a + s.bias
    assert np.max(np.abs(output + find("saturation").column(s, level=level))) == pytest.approx(level)


def test_an_output_with_a_bias_clips_on_one_side_first():
    s = dataclasses.replace(one_tone(), bias=0.3 * AMPLITUDE, scale=1.02)
    clipped = find("saturation").column(s, level=AMPLITUDE)
    assert np.min(clipped) == pytest.approx(-0.32 * AMPLITUDE, rel=1e-3)  # 1e4 points per period: the peak is met
    assert np.max(clipped) == 0.0


@pytest.mark.parametrize("name", ["bias_step", "encoder_step"])
def test_a_step_is_continuous_in_its_instant(name):
    s = one_tone()
    at = [np.sum(find(name).column(s, instant=20.0 + share * s.step)) for share in (0.0, 0.25, 0.5, 1.0)]
    np.testing.assert_allclose(at[0] - np.array(at), (0.0, 0.25, 0.5, 1.0), atol=1e-8)  # sums of 4e4 ones


def test_a_step_lies_where_its_coefficient_shows_before_and_behind():
    """At rest the acceleration is noise of the residual, which any step of a scale factor there would explain."""
    s = sines(n=2000)
    begin, end = 0.4 * PERIOD, 1.2 * PERIOD
    moving = (s.t > begin) & (s.t < end)
    s = dataclasses.replace(s, a=s.a * moving, jerk=s.jerk * moving)
    for name, first, last in (
        ("scale_step", begin, end),
        ("time_offset_step", begin, end),
        ("bias_step", 0.0, 2.0 * PERIOD),
    ):
        low, high = find(name).shapes["instant"].span(s)
        assert first < low < first + 0.1 * PERIOD
        assert last - 0.1 * PERIOD < high < last


def test_the_cosines_of_a_random_walk_have_its_covariance():
    s = sines(n=2000)
    effect = find("bias_random_walk")
    y = effect.column(s, start=0.0, length=s.length)
    t = s.t
    centred = np.eye(len(t)) - 1.0 / len(t)
    random_process = centred @ np.minimum.outer(t, t) @ centred
    spectrum = np.linalg.eigvalsh(random_process)[::-1][: effect.width]
    result = np.linalg.eigvalsh(y.T @ y)[::-1]
    # On 2000 samples instead of a line: an end counts half a spacing too much, j/2000 of a column.
    np.testing.assert_allclose(result, spectrum, rtol=0.02)
    # What is cut off: sum over j > 32 of 1/j², of pi²/6.
    share = np.sum(1.0 / np.arange(1, effect.width + 1) ** 2) / (np.pi**2 / 6.0)
    assert np.sum(result) / np.trace(random_process) == pytest.approx(share, rel=0.01)


def test_a_slow_gauss_markov_bias_is_a_random_walk():
    s = sines(n=500)
    tau = 1e4 * s.length
    markov = find("bias_gauss_markov").column(s, start=0.0, length=s.length, tau=tau)[:, :-1]
    random_process = find("bias_random_walk").column(s, start=0.0, length=s.length)
    np.testing.assert_allclose(markov, random_process * np.sqrt(2.0 / tau), rtol=1e-6, atol=1e-9)


def test_a_fast_gauss_markov_bias_has_variance_one():
    tau, length = 3.0, 600.0
    w = np.pi * np.arange(1, 200_000) / length
    weights = np.sqrt(4.0 * tau / length / (1.0 + (w * tau) ** 2))
    # The mean square of a cosine is a half; the series sums to coth(L/tau) - tau/L, and its tail here is 2e-4.
    assert 0.5 * np.sum(weights**2) == pytest.approx(1.0 - tau / length, abs=3e-4)
    s = sines(n=500)
    columns = find("bias_gauss_markov").column(s, start=0.0, length=length, tau=tau)
    np.testing.assert_allclose(columns[0, :-1], weights[: columns.shape[1] - 1], rtol=1e-9)
    np.testing.assert_allclose(columns[:, -1], np.sqrt(2.0 * tau / length), rtol=1e-12)


def test_the_mean_of_a_gauss_markov_process_over_a_record_has_the_variance_of_its_column():
    """Against the exact double integral of the autocorrelation: 2 tau/L (1 - tau/L (1 - exp(-L/tau)))."""
    tau, length = 3.0, 600.0
    exact = 2.0 * tau / length * (1.0 - tau / length * (1.0 - np.exp(-length / tau)))
    column = find("scale_gauss_markov").column(sines(n=500), start=0.0, length=length, tau=tau)[:, -1]
    moving = np.abs(sines(n=500).a) > 1e-3
    np.testing.assert_allclose((column / sines(n=500).a)[moving] ** 2, exact, rtol=1.1 * tau / length)


def test_a_random_scale_factor_is_a_random_bias_times_the_acceleration():
    s = sines(n=500)
    for kind, tau in (("random_walk", {}), ("gauss_markov", {"tau": 3.0})):
        bias, scale = (
            find(f"{parameter}_{kind}").column(s, start=0.0, length=s.length, **tau) for parameter in ("bias", "scale")
        )
        np.testing.assert_allclose(scale, s.a[:, None] * bias, rtol=1e-12)


def test_cosines_are_cosines():
    t = np.linspace(0.0, 7.0, 1001)
    y = cosines(t, 0.0, 7.0, np.ones(16))
    np.testing.assert_allclose(y, np.cos(np.outer(t, np.pi * np.arange(1, 17) / 7.0)), atol=1e-12)  # 16 recursions


def test_splines_hold_every_cubic_and_sum_to_one():
    x = np.linspace(-2.0, 5.0, 400)
    B = splines(x, -2.0, 5.0)
    np.testing.assert_allclose(B.sum(axis=1), 1.0, atol=1e-14)
    for power in (1, 2, 3):
        weights, *_ = np.linalg.lstsq(B, x**power, rcond=None)
        np.testing.assert_allclose(B @ weights, x**power, atol=1e-11)  # of values up to 125
    np.testing.assert_array_equal(splines(np.array([-9.0, 9.0]), -2.0, 5.0), B[[0, -1]])


def test_a_curve_is_any_cubic_spline_but_for_the_constant_and_begins_with_the_cubics():
    x = np.linspace(-2.0, 5.0, 400)
    whole = np.column_stack([np.ones_like(x), curve(x, -2.0, 5.0)])
    for power in range(CUBIC + 1):
        weights, *_ = np.linalg.lstsq(whole[:, : CUBIC + 1], x**power, rcond=None)
        np.testing.assert_allclose(whole[:, : CUBIC + 1] @ weights, x**power, atol=1e-11)
    B = splines(x, -2.0, 5.0)
    weights, *_ = np.linalg.lstsq(whole, B, rcond=None)
    np.testing.assert_allclose(whole @ weights, B, atol=1e-12)
    np.testing.assert_array_equal(curve(np.array([-9.0, 9.0]), -2.0, 5.0), whole[[0, -1], 1:])
    np.testing.assert_array_equal(curve(x, -2.0, 5.0, first=2), whole[:, 2:])


def test_knots_keep_their_distance_from_noise():
    effect = find("shape_of_acceleration")
    s = sines(a_std=0.5)
    low, high = (effect.shapes[name].grid(s)[0] for name in ("low", "high"))
    assert (high - low) / 7.0 == pytest.approx(6.0 * 0.5)
    assert low < np.min(s.a) < np.max(s.a) < high


def test_a_reversed_sensor_sees_the_stage_with_the_other_sign():
    s = sines()
    turned = dataclasses.replace(s, rig=Rig(mount="reversed"))
    for name in ("velocity", "velocity_squared", "rail_slope", "rail_curve", "coulomb", "tilt"):
        np.testing.assert_array_equal(find(name).column(turned), -find(name).column(s))
    np.testing.assert_array_equal(find("bias").column(turned), find("bias").column(s))


@pytest.mark.parametrize("mount", ["normal", "reversed"])
def test_resampled_motion_is_the_motion_at_those_times(mount):
    rig = Rig(axis="up", mount=mount)
    coarse, fine = sines(n=6000), sines(n=36_000)

    def felt(s):
        return dataclasses.replace(s, rig=rig, a=rig.polarity * (s.a + rig.gravity), jerk=rig.polarity * s.jerk)

    coarse, fine = felt(coarse), felt(fine)
    inside = fine.t < coarse.t[-1]
    fine = fine.at(inside)
    result = coarse.resampled(fine.t)
    # Cubic Hermite errs by (w h)^4/384, w h = 0.2: 4e-6 of the fastest line.
    for name in ("p", "v", "a"):
        wanted = getattr(fine, name)
        np.testing.assert_allclose(getattr(result, name), wanted, atol=5e-6 * np.ptp(wanted), err_msg=name)
    period = 5e-4  # m; the coarse grid passes it in a tenth of a spacing
    wanted = find("encoder_cyclic").column(fine, period=period)
    np.testing.assert_allclose(find("encoder_cyclic").column(result, period=period), wanted, atol=1e-2)
    every = [effect for effect in BUILT_IN if effect.port == "position"]
    assert len(every) == 7
    for effect in every:
        shape = {name: float(item.grid(fine)[0]) for name, item in effect.shapes.items()}
        noisy, exact = effect.column(result, **shape), effect.column(fine, **shape)
        np.testing.assert_allclose(noisy, exact, atol=2e-2 * np.max(np.abs(exact)), err_msg=effect.name)


def test_shapes_of_a_record_describe_the_same_function_on_another():
    first, second = sines(), sines(((8.0, 0.2, 0.0),))
    effect = find("shape_of_velocity")
    shape = {name: float(item.grid(first)[0]) for name, item in effect.shapes.items()}
    whole, part = effect.column(first, **shape), effect.column(second, **shape)
    for k in range(0, len(second.t), 5000):
        near = np.argmin(np.abs(first.v - second.v[k]))
        np.testing.assert_allclose(part[k], whole[near], atol=0.01)  # nearest of 25 000 speeds


@pytest.mark.parametrize("power", [0, 1, 2])
def test_a_drag_that_changes_along_the_rail_holds_any_parabola_of_position(power):
    s = one_tone()
    ends = {"low": float(np.min(s.p)), "high": float(np.max(s.p))}
    columns = find("shape_of_position_and_velocity").column(s, **ends)
    target = s.v * s.p**power
    left = target - columns @ np.linalg.lstsq(columns, target, rcond=None)[0]
    assert np.max(np.abs(left)) < 1e-9 * np.max(np.abs(target))


def test_a_rippling_characteristic_holds_its_ripple_at_any_phase():
    s = one_tone()
    low, high, period = -AMPLITUDE, AMPLITUDE, AMPLITUDE / 5.0
    columns = find("shape_of_acceleration").column(s, low=low, high=high, ripple=period)
    target = np.sin(2.0 * np.pi * s.a / period + 0.3) + (s.a / AMPLITUDE) ** 3
    bias_and_scale = np.column_stack([columns, np.ones_like(s.a), s.a])
    left = target - bias_and_scale @ np.linalg.lstsq(bias_and_scale, target, rcond=None)[0]
    assert np.max(np.abs(left)) < 1e-9


def test_no_sum_of_columns_of_a_curve_or_a_wave_holds_a_constant():
    """Zero mean over the range; the sister, a wave without its range, has one."""
    x = -2.0 + 7.0 * (np.arange(70_000) + 0.5) / 70_000
    for columns in (
        curve(x, -2.0, 5.0),
        rippled(x, -2.0, 5.0, 0.9),
        bumped(x, -2.0, 5.0, 4.5, 0.4),
        wave(x, 19.0, -2.0, 5.0),
    ):
        np.testing.assert_allclose(columns.mean(axis=0), 0.0, atol=1e-8)
    assert np.max(np.abs(wave(x, 19.0, 0.0, 0.0).mean(axis=0))) > 0.3
