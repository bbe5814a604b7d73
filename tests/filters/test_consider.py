"""Consider parameters of the live filters: limits that are known, consistency, and what refuses them."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any, Literal

import numpy as np
import pytest

import accelcal as ac
from accelcal import _core, filters
from accelcal._core import FilterError, FilterSetup
from accelcal.data.recording import Channel
from accelcal.filters.choice import FilterChoice, GaussMarkov, core_setup
from accelcal.simulation.sensor import Simulated, simulate
from accelcal.validation.consistency import consistency, nees
from tests.filters.worlds import NOISE, RATE, READING, RIG

SIGMA = 0.02
"""Standard deviation of the scale factor before the first sample."""
RUNS, SECONDS, SEEN = 40, 3.0, 2.5
"""Records, their length, and how long the position is read, s."""
FALSE_ALARM = 1e-3
"""Of each verdict on the mean NEES, two-sided."""
LINEAR = FilterChoice("aci", "linear", interpolation="cubic")
Q, R = NOISE**2 / 2, READING**2


def record(seed: int, k: float, seconds: float = SECONDS) -> Simulated:
    rng = np.random.default_rng([seed, 71])
    given = {"scale_factor": k, "bias": 0.05 * rng.standard_normal()}
    return simulate("tones", seconds=seconds, rig=RIG, parameters=given, rng=rng, position_noise=READING)


def before(channel: Channel, end: float) -> Channel:
    return replace(channel, t=channel.t[channel.t < end], y=channel.y[channel.t < end])


def prior(simulated: Simulated, k_sigma: float) -> dict[str, Any]:
    p, v = simulated.truth.motion.derivatives(np.zeros(1))[:2, 0]
    return {"x0": [p, v, 0.0, 0.0], "P0": np.diag(np.square([1e-6, 1e-4, k_sigma, 0.05]))}


def motion_nees(choice: FilterChoice, k_sigma: float) -> list[float]:
    """NEES of p and v after half a second without position, one scale factor from the prior for each record."""
    values = []
    for seed in range(RUNS):
        recording = record(seed, SIGMA * float(np.random.default_rng([seed, 72]).standard_normal()))
        position = before(recording.recording.position, SEEN)
        track = filters.run(choice, recording.recording.accel, position, q=Q, r_position=R, **prior(recording, k_sigma))
        truth = recording.truth.motion.derivatives(track.times[-1:])[:2, 0]
        values.append(float(nees(track.states[-1, :2] - truth, track.covariance[:2, :2])))
    return values


def test_a_considered_parameter_leaves_the_other_states_consistent_and_an_ignored_one_does_not() -> None:
    considered = consistency(np.array(motion_nees(replace(LINEAR, consider=("k",)), SIGMA)), 2, 1.0 - FALSE_ALARM)
    ignored = consistency(np.array(motion_nees(LINEAR, 0.0)), 2, 1.0 - FALSE_ALARM)  # the twin that must fail
    print(f"\nNEES of p and v: considered {considered.mean:.2f}, ignored {ignored.mean:.3g}, expected 2")
    assert considered.verdict == "consistent"
    assert ignored.verdict == "overconfident"


@pytest.mark.parametrize("state", ["p", "K0"])
def test_without_variance_it_is_the_filter_that_knows_the_parameter(state: str) -> None:
    """u = K0 + (1 + k) a with k known is u / (1 + k) = K0 / (1 + k) + a, with noise that is smaller by 1 + k."""
    k = 0.1
    recording = record(5, k)
    accel, position = recording.recording.accel, recording.recording.position
    given = prior(recording, 0.0)
    given["x0"][2] = k
    held = filters.run(replace(LINEAR, consider=("k",)), accel, position, q=Q, r_position=R, **given)
    divided = prior(recording, 0.0)
    divided["P0"][3, 3] /= (1 + k) ** 2
    outcome = filters.run(
        LINEAR, replace(accel, y=accel.y / (1 + k)), position, q=Q / (1 + k) ** 2, r_position=R, **divided
    )
    i, unit = (0, 1.0) if state == "p" else (3, 1 + k)
    error = (held.states[:, i] - unit * outcome.states[:, i]) / np.sqrt(held.variances[:, i])
    assert np.max(np.abs(error)) < 1e-7  # 2e4 steps on two sets of numbers
    np.testing.assert_allclose(held.variances[:, i], unit**2 * outcome.variances[:, i], rtol=1e-7)  # likewise


SPREAD = {"p": 1e-4, "v": 1e-2, "a": 1.0, "k": 0.05, "K0": 0.2, "K2": 1e-3, "K3": 1e-4}


@pytest.mark.parametrize("system", ["aci", "cwpa"])
def test_mean_and_variance_of_a_considered_parameter_never_change(system: Literal["aci", "cwpa"]) -> None:
    recording = record(6, 0.01)
    choice = FilterChoice(system, "cubic", consider=("K3", "k"), order=2)
    sigma = np.array([SPREAD[name] for name in choice.states()])
    track = filters.run(
        choice,
        recording.recording.accel,
        recording.recording.position,
        q=Q if system == "aci" else 1e3,
        r_position=R,
        r_accel=0.5 * NOISE**2 * RATE if system == "cwpa" else None,
        x0=1e-3 * sigma,
        P0=np.diag(sigma**2),
    )
    for name in choice.consider:
        i = track.names.index(name)
        assert np.all(track.states[:, i] == 1e-3 * sigma[i])
        np.testing.assert_allclose(track.variances[:, i], sigma[i] ** 2, rtol=1e-12)  # rounding of Phi P Phi'
    K0 = track.names.index("K0")
    assert track.variances[-1, K0] < 0.3 * sigma[K0] ** 2


def test_a_considered_process_forgets_its_mean_and_keeps_its_variance() -> None:
    truth, tau = record(7, 0.0), 0.5
    given = prior(truth, SIGMA)
    given["x0"][2] = SIGMA
    track = filters.run(
        replace(LINEAR, consider=("k",)),
        truth.recording.accel,
        truth.recording.position,
        q=Q,
        r_position=R,
        parameters={"k": GaussMarkov(q=2 * SIGMA**2 / tau, tau=tau)},
        **given,
    )
    np.testing.assert_allclose(track.states[:, 2], SIGMA * np.exp(-track.times / tau), rtol=1e-10)  # 7500 products
    np.testing.assert_allclose(track.variances[:, 2], SIGMA**2, rtol=1e-10)


def test_the_stream_gives_the_record_to_the_last_bit() -> None:
    recording = record(8, 0.01, seconds=0.5)
    choice = FilterChoice("aci", "linear", consider=("k",))
    accel, position = recording.recording.accel, recording.recording.position
    given = prior(recording, SIGMA)
    track = filters.run(choice, accel, position, q=Q, r_position=R, **given)
    live = filters.LiveFilter(choice, q=Q, r_position=R, **given)
    events = sorted([(t, 0, y) for t, y in zip(accel.t, accel.y, strict=True)])
    events += sorted([(t, 1, y) for t, y in zip(position.t, position.y, strict=True)])
    for t, kind, value in sorted(events):
        live.step(t, **{"position" if kind else "accel": value})
    live.finish()
    np.testing.assert_array_equal(live.estimate, track.states[-1])
    np.testing.assert_array_equal(live.covariance, track.covariance)


CONSIDER = FilterChoice("aci", "linear", consider=("k",))
REFUSED: dict[str, tuple[Callable[[], object], str]] = {
    "UD factors": (lambda: replace(CONSIDER, carrier="factored"), "UD factors have no such update"),
    "a name that the model lacks": (lambda: FilterChoice("aci", "linear", consider=("K3",)), "K3 not in the linear"),
    "smoothing": (
        lambda: filters.run(CONSIDER, *channels(), q=Q, r_position=R, x0=np.zeros(4), P0=np.eye(4) * 1e-6, smooth=True),
        "smooth=True estimates every parameter",
    ),
    "a batch": (
        lambda: filters.run_batch(
            CONSIDER, np.zeros(9), np.zeros(9), dt=1e-3, q=Q, r_position=R, x0=np.zeros(4), P0=np.eye(4) * 1e-6
        ),
        "run_batch estimates every parameter",
    ),
    "a fixed rate": (
        lambda: filters.fixed_rate(CONSIDER, dt=1e-3, q=Q, r_position=R, x0=np.zeros(4), P0=np.eye(4) * 1e-6),
        "fixed_rate estimates every parameter",
    ),
    "effects": (
        lambda: filters.fixed_rate_with_effects(
            dt=1e-3, q=Q, r_position=R, x0=np.zeros(4), P0=np.eye(4) * 1e-6, choice=CONSIDER
        ),
        "fixed_rate_with_effects estimates every parameter",
    ),
    "a fit": (lambda: ac.fit(record(1, 0.0).recording, method=CONSIDER), "a fit by a live filter estimates every"),
}


def channels() -> tuple[Channel, Channel]:
    t = np.arange(9) * 1e-3
    return Channel("accel", t, np.zeros(9), "m/s²"), Channel("position", t, np.zeros(9), "m")


@pytest.mark.parametrize("what", sorted(REFUSED))
def test_what_cannot_consider_says_so(what: str) -> None:
    call, sentence = REFUSED[what]
    with pytest.raises(ValueError, match=sentence):
        call()


def test_the_compiled_core_refuses_by_itself() -> None:
    setup: FilterSetup = core_setup(CONSIDER, Q, R, None, None, 0.0, None, None)
    with pytest.raises(FilterError, match="state 2 is to be considered") as raised:
        _core.FixedRateFilter(setup, np.zeros(4), np.eye(4) * 1e-6, 1e-3)
    assert raised.value.kind == "Consider"
