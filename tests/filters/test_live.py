"""Live filters that track effects of the catalogue: agreement with the replay, honesty, laws and refusals."""

from __future__ import annotations

import dataclasses
from dataclasses import replace

import numpy as np
import pytest
from scipy import stats

from accelcal.data.rig import Rig, Sensor
from accelcal.effects import BUILT_IN, is_local
from accelcal.estimation.estimate import estimate
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.filters.live_model import LiveModel
from accelcal.filters.stream import fixed_rate
from accelcal.model import Model, Prior
from accelcal.simulation.sensor import CXL02_RIG, simulate
from tests.filters.worlds import MODEL, NOISE, RATE, READING, RIG, TRUE, World, followed, world

SEEDS = range(1, 4)
FALSE_ALARM = 1e-3
"""Of a two-sided test on the mean normalised error of all seeds."""
FREE = list(TRUE)
REPLAY_SHARE = 0.5
"""Rms difference from the replay on the same record, in standard deviations: the same noise seen twice."""


def live_filter(model: Model, rig: Rig = RIG, **more: object) -> LiveModel:
    given: dict[str, object] = {"rate": RATE, "q": NOISE**2 / 2, "r_position": READING**2, "position": 0.0}
    return LiveModel(model, rig, **given | more)  # type: ignore[arg-type]


def normalised(live: LiveModel) -> float:
    """Mean squared error of all free coefficients, in standard deviations of their joint covariance."""
    rows = [live.names.index(name) for name in FREE if name in live.names]
    error = live.values[rows] - [TRUE[live.names[row]] for row in rows]
    return float(error @ np.linalg.solve(live.covariance[np.ix_(rows, rows)], error) / len(rows))


@pytest.fixture(scope="module")
def records() -> list[World]:
    return [world(seed) for seed in SEEDS]


def test_live_estimates_of_effects_are_honest_and_near_the_replay(records: list[World]) -> None:
    errors, apart = [], []
    for made in records:
        live = followed(MODEL, made)
        errors.append(normalised(live))
        replayed = estimate(MODEL, made.recording)
        shift = replayed.origins.temperature - 25.0
        bias = replayed["bias"].value - replayed["temperature_bias"].value * shift
        for name in FREE[1:]:
            apart.append((live[name].value - replayed[name].value) / replayed[name].std)
        assert abs(bias - live["bias"].value) < 4 * live["bias"].std
    dof = len(SEEDS) * len(FREE)
    low, high = stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], dof) / dof
    mean, rms = float(np.mean(errors)), float(np.sqrt(np.mean(np.square(apart))))
    print(f"\n{len(SEEDS)} seeds: normalised error {mean:.2f} in [{low:.2f}, {high:.2f}]; off the replay {rms:.2f} std")
    assert low < mean < high
    assert rms < REPLAY_SHARE


def test_a_live_filter_without_the_effect_is_found_out(records: list[World]) -> None:
    poor = MODEL.drop("quadratic")
    dof = len(SEEDS) * (len(FREE) - 1)
    high = stats.chi2.ppf(1 - FALSE_ALARM / 2, dof) / dof
    assert np.mean([normalised(followed(poor, made)) for made in records]) > high


@pytest.mark.parametrize(
    "rig", [dataclasses.replace(RIG, axis="up"), dataclasses.replace(RIG, axis="down", mount="reversed")]
)
def test_mount_and_gravity_are_subtracted(rig: Rig) -> None:
    live = followed(MODEL, world(3, rig=rig), rig=rig)
    # False alarm 1e-4 for one record of six coefficients.
    assert normalised(live) * len(FREE) < stats.chi2.ppf(1 - 1e-4, len(FREE))


def test_a_declared_low_pass_is_undone_before_effects_are_evaluated() -> None:
    rig = dataclasses.replace(CXL02_RIG, resolution=None)
    truth = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 1e-3}
    rng = np.random.default_rng(5)
    made = simulate("bursts", seconds=12.0, rig=rig, parameters=truth, rng=rng, a_rms=5.0, position_noise=READING)
    z = np.full(len(made.recording.accel), np.nan)
    z[::2] = made.recording.position.y
    model = Model.linear().add("quadratic").freeze(time_offset=0.0)
    assert rig.sensor.noise is not None

    def worst(seen: Rig) -> float:
        live = live_filter(model, seen, q=rig.sensor.noise**2 / 2, position=float(z[0]))  # type: ignore[operator]
        live.run(made.recording.accel.y, z)
        return max(abs(live[name].value - value) / live[name].std for name, value in truth.items())

    assert worst(rig) < 4.5
    assert worst(dataclasses.replace(rig, lowpass=None)) > 4.5  # the twin that must fail: 7


def test_a_small_time_offset_is_tracked() -> None:
    rng = np.random.default_rng(6)
    truth = {"bias": 0.05, "time_offset": 1e-4}
    made = simulate("bursts", seconds=12.0, rig=RIG, parameters=truth, rng=rng, a_rms=5.0, position_noise=READING)
    z = np.full(len(made.recording.accel), np.nan)
    z[::2] = made.recording.position.y
    live = live_filter(Model.linear(), position=float(z[0]))
    live.run(made.recording.accel.y, z)
    assert live["time_offset"].std < 2e-6
    assert abs(live["time_offset"].value - 1e-4) < 4.5 * live["time_offset"].std


def test_without_effects_it_is_the_forward_filter() -> None:
    made = world(2, seconds=2.0)
    model = Model.linear().freeze(time_offset=0.0)
    live = followed(model, made)
    choice = FilterChoice("aci", "linear", interpolation="cubic")
    P0 = np.diag([1e4 * READING**2, 1.0, 0.3**2, 3.0**2])
    given = {"q": NOISE**2 / 2, "r_position": READING**2, "x0": [made.z[0], 0.0, 0.0, 0.0], "P0": P0}
    same = fixed_rate(choice, dt=1 / RATE, **given)  # type: ignore[arg-type]
    same.run(made.u, made.z)
    deviation = np.sqrt(np.diag(same.covariance))[2:]
    assert (
        np.max(np.abs(live.values[:2] - same.x[2:]) / deviation) < 1e-7
    )  # two ways to round, 3334 steps, variances that fall by 1e8


def test_a_gauss_markov_coefficient_keeps_its_uncertainty() -> None:
    made = world(4, seconds=4.0)
    constant, walking = (
        LiveModel(
            MODEL,
            RIG,
            rate=RATE,
            q=NOISE**2 / 2,
            r_position=READING**2,
            position=float(made.z[0]),
            gauss_markov=processes,
        )
        for processes in ({}, {"bias": GaussMarkov(1e-4)})
    )
    for live in (constant, walking):
        live.run(made.u, made.z, temperature=made.temperature)
    assert walking["bias"].std > 2 * constant["bias"].std


def test_a_random_scale_factor_is_tracked_as_one_more_state() -> None:
    """Scale factor and process at the end of 3 records, simulated by the exact recursion, against the truth."""
    sigma, tau = 0.02, 2.0
    shapes = {"scale_gauss_markov": {"start": 0.0, "length": 6.0, "tau": tau}}
    linear = Model.linear().freeze(time_offset=0.0)
    model = linear.add("scale_gauss_markov", shapes=shapes)
    model = replace(model, priors={term.name: Prior(0.0, sigma) for term in model.terms if term.effect.width > 1})
    at_end, without = [], []
    for seed in range(3):
        rng = np.random.default_rng([17, seed])
        rig = replace(RIG, sensor=Sensor(noise=NOISE))
        made = simulate("bursts", seconds=6.0, rig=rig, parameters={}, rng=rng, a_rms=5.0, position_noise=READING)
        t, n = made.recording.accel.t, len(made.recording.accel.t)
        keep = np.exp(-1.0 / (RATE * tau))
        process = np.empty(n)
        process[0] = sigma * rng.standard_normal()
        for k, shock in enumerate(sigma * np.sqrt(1.0 - keep**2) * rng.standard_normal(n - 1), 1):
            process[k] = keep * process[k - 1] + shock
        u = made.recording.accel.y + process * made.truth.motion.derivatives(t)[2]
        z = np.full(n, np.nan)
        z[::2] = made.recording.position.y
        for tracked, found in ((model, at_end), (linear, without)):
            live = live_filter(tracked, position=float(z[0]))
            live.run(u, z)
            rows = [live.names.index(name) for name in live.names if name.startswith("scale")]
            variance = float(np.sum(live.covariance[np.ix_(rows, rows)]))
            found.append(float(np.sum(live.values[rows]) - process[-1]) ** 2 / variance)
    low, high = stats.chi2.ppf([FALSE_ALARM / 2, 1 - FALSE_ALARM / 2], 3)
    print(f"\nnormalised square of 3: {sum(at_end):.1f} in [{low:.1f}, {high:.1f}]; constant {sum(without):.0f}")
    assert low < sum(at_end) < high
    assert sum(without) > 10.0 * high
    assert live_filter(model)["scale_gauss_markov"].std == pytest.approx(sigma)


REFUSED = {
    "vibration": "changes the noise",
    "temperature_rate": "other times",
    "hysteresis": "other times",
    "sensor_lag": "other times",
    "encoder_backlash": "other times",
    "encoder_lag": "other times",
    "ac_coupling": "other times",
}


@pytest.mark.parametrize("name", sorted(REFUSED))
def test_what_cannot_be_followed_live_is_refused_by_name(name: str) -> None:
    effect = next(effect for effect in BUILT_IN if effect.name == name)
    shapes = {name: {shape: 1.0 for shape in effect.shapes}}
    with pytest.raises(ValueError, match=f"{name} cannot be tracked live: .*{REFUSED[name]}"):
        live_filter(Model.linear().add(name, shapes=shapes))


def test_every_effect_with_memory_is_refused_and_every_local_mean_is_tracked() -> None:
    for effect in BUILT_IN:
        if effect.name in ("bias", "scale_factor", "time_offset"):
            continue
        model = Model.linear().add(
            effect.name, shapes={effect.name: {shape: -1.0 if shape == "low" else 1.0 for shape in effect.shapes}}
        )
        if effect.port == "process":
            with pytest.raises(ValueError, match=f"{effect.name} has no standard deviation; fit it"):
                live_filter(model)
            continue
        if effect.port == "noise" or not is_local(effect):
            with pytest.raises(ValueError, match=f"{effect.name} cannot be tracked live"):
                live_filter(model)
        else:
            live = live_filter(model)
            side = dict.fromkeys(effect.needs, 0.0)
            for j in range(4):
                live.step(0.1 * j, 1e-6 * j, **side)
            assert np.all(np.isfinite(live.values))


def test_an_unknown_instant_is_asked_for() -> None:
    with pytest.raises(ValueError, match="bias_step needs a value of instant"):
        Model.linear().add("bias_step")


def test_a_side_channel_that_was_never_given_is_asked_for() -> None:
    live = live_filter(Model.linear().add("temperature_bias"))
    with pytest.raises(ValueError, match="temperature_bias needs the channel 'temperature'"):
        live.step(0.0, 0.0)
    live.step(0.0, 0.0, temperature=21.0)
    live.step(0.0, 0.0)  # the last value holds


def test_too_many_coefficients_are_refused() -> None:
    names = ("shape_of_position", "shape_of_velocity")
    with pytest.raises(ValueError, match="room for 14 coefficients beside bias and scale_factor; the model has 19"):
        live_filter(Model.linear().add(*names, shapes={name: {"low": -1.0, "high": 1.0} for name in names}))


def test_a_process_of_a_missing_coefficient_is_refused() -> None:
    with pytest.raises(ValueError, match="cubic not in the model"):
        live_filter(Model.linear(), gauss_markov={"cubic": GaussMarkov(1.0)})
