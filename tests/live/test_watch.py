"""A watch on a live filter: its sums against two runs of the filter, its e-values, its names, and its sentences."""

from __future__ import annotations

import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.integrate import quad
from scipy.stats import norm

from accelcal.data import Rig
from accelcal.filters.live_model import LiveModel, Suspicion
from accelcal.filters.stream import FACTORED, fixed_rate_with_effects
from accelcal.live import Naming, watchable
from accelcal.model import Model, Prior
from tests.commands import accelcal

RATE, NOISE, READING = 200.0, 0.0025, 1e-6
"""Samples per second, noise density of the output in (m/s²)/√Hz, and noise of a reading in m."""
Q = NOISE**2 / 2.0
START = np.diag([1e-12, 1e-2, 1e-4, 1e-2])


def record(seconds: float, seed: int, noise: float = 1.0) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Output and readings of a motion of two tones, and its acceleration, (n,) each."""
    rng, t = np.random.default_rng(seed), np.arange(round(seconds * RATE)) / RATE
    tones = [(2.0, 2.0 * math.pi * 1.3, 0.4), (1.0, 2.0 * math.pi * 3.1, 1.1)]
    a = sum(size * np.sin(w * t + phase) for size, w, phase in tones)
    p = sum(-size / w**2 * np.sin(w * t + phase) for size, w, phase in tones)
    u = a + noise * NOISE * math.sqrt(RATE / 2.0) * rng.standard_normal(len(t))
    return u, p + noise * READING * rng.standard_normal(len(t)), a


def start_of(z: np.ndarray) -> np.ndarray:
    """Position and velocity at the first sample, and a sensor without error."""
    return np.array([z[0], (z[1] - z[0]) * RATE, 0.0, 0.0])


def columns_of(u: np.ndarray) -> np.ndarray:
    """Square and cube of the output at the sample before, half-way, and at each sample, (n, 3, 2)."""
    e = np.stack([u**2, u**3], axis=-1)
    before = np.concatenate([e[:1], e[:-1]])
    return np.stack([before, 0.5 * (before + e), e], axis=1)


def watched(
    u: np.ndarray,
    z: np.ndarray,
    columns: np.ndarray,
    *,
    added: float | None = None,
    P0: np.ndarray = START,
    position: np.ndarray | None = None,
    slopes: np.ndarray | None = None,
    scales: tuple[float, ...] = (1e-3, 1e-3),
    stretch: int = 10**9,
) -> tuple[np.ndarray, np.ndarray]:
    """Scores of a filter (n, 8), and the evidence of its watch (J, 6); or scores with `added` of the first suspect
    subtracted as a coefficient without uncertainty."""
    x0, spread = start_of(z), P0
    if added is not None:
        x0, spread = np.append(x0, added), np.zeros((5, 5))
        spread[:4, :4] = P0
        columns = columns[:, :, :1]
    filtered = fixed_rate_with_effects(
        dt=1.0 / RATE, q=Q, r_position=READING**2, x0=x0, P0=spread, choice=replace(FACTORED, scores=True),
        watch=None if added is not None else (list(scales), stretch),
    )  # fmt: skip
    scores, width = np.full((len(u), 8), np.nan), columns.shape[2]
    position = np.zeros((len(u), width)) if position is None else position[:, :width]
    slopes = np.zeros((len(u), width)) if slopes is None else slopes
    for j in range(len(u)):
        z_j = None if np.isnan(z[j]) else float(z[j])
        filtered.step_with_effects(u[j], z_j, np.ascontiguousarray(columns[j]), position[j], slopes[j])
        if z_j is not None and filtered.score is not None:
            scores[j] = filtered.score
    return scores, filtered.evidence if added is None else np.empty((0, 6))


@pytest.mark.parametrize(
    ("declared", "port"), [(True, "output"), (False, "output"), (True, "position"), (False, "position")]
)
def test_score_and_information_are_those_of_the_difference_of_two_filters(declared: bool, port: str) -> None:
    u, z, _ = record(20.0, 1)
    z[2::3] = np.nan
    columns, position = columns_of(u), np.zeros((len(u), 2))
    if port == "position":
        columns, position = np.zeros_like(columns), np.stack([np.cos(30.0 * u), u], axis=-1)
    P0 = np.diag([1e-12, 1e-2, 0.0, 0.0]) if declared else START
    scores, evidence = watched(u, z, columns, P0=P0, position=position)
    size = 1e-7
    without, _ = watched(u, z, columns, P0=P0, position=position, added=0.0)
    less, _ = watched(u, z, columns, P0=P0, position=position, added=size)
    read = ~np.isnan(scores[:, 0])
    np.testing.assert_allclose(scores[read, :2], without[read, :2], rtol=1e-6)  # one filter with an idle state more
    psi = (without[read, 0] - less[read, 0]) / size
    left, variance = scores[read, 0], scores[read, 1]
    # Parameters that are not known yet change gains by what the suspect changes them, and have a share of noise.
    tolerance = 1e-6 if declared else 2e-3
    information, score = np.sum(psi**2 / variance), np.sum(psi * left / variance)
    assert evidence[0, 5] == pytest.approx(information, rel=tolerance)
    assert evidence[0, 4] == pytest.approx(score, abs=tolerance * math.sqrt(information), rel=tolerance)
    wrong = np.sum((columns[read, 2, 0] + position[read, 0]) ** 2 / variance)
    assert evidence[0, 5] != pytest.approx(wrong, rel=0.5)  # what it is without a filter


def test_the_e_value_is_the_mean_of_the_likelihood_ratio_over_its_prior() -> None:
    u, z, _ = record(20.0, 2)
    (log_e, size, std, since, b, G), _ = watched(u, z, columns_of(u))[1]
    low, high = b / G - 8.0 / math.sqrt(G), b / G + 8.0 / math.sqrt(G)  # where the likelihood is not nothing
    priors = [norm(0.0, tail * 1e-3) for tail in (1.0, 10.0, 100.0)]

    def posterior(c: float, power: int) -> float:
        return c**power * math.exp(b * c - 0.5 * G * c * c) * sum(prior.pdf(c) for prior in priors) / 3.0

    total, mean, square = (quad(posterior, low, high, args=(power,), points=[b / G])[0] for power in range(3))
    # The watch gives half of its weight to effects that are there from the begin on; no later start has come yet.
    assert log_e == pytest.approx(math.log(0.5 * total), abs=1e-6)
    assert size == pytest.approx(mean / total, rel=1e-5)
    assert std == pytest.approx(math.sqrt(square / total - (mean / total) ** 2), rel=1e-5)
    assert since == pytest.approx(20.0)


def test_an_honest_sensor_is_chance_and_one_with_a_square_is_not() -> None:
    """Means of 30 standard normal scores leave ±0.6, and their mean square 0.4 .. 1.9, in 1 of 1000; the twin has no
    model of the noise."""
    scores, twins = [], []
    for seed in range(30):
        u, z, a = record(20.0, 100 + seed)
        e = watched(u, z, columns_of(u), slopes=np.stack([2.0 * u, 3.0 * u**2], axis=-1))[1]
        scores.append(e[:, 4] / np.sqrt(e[:, 5]))
        bent = watched(u + 2e-3 * a**2, z, columns_of(u))[1]
        twins.append(bent[0, 4] / np.sqrt(bent[0, 5]))
        assert np.max(e[:, 0]) < math.log(2.0 / 0.005)  # by Ville, one of 200 would exceed it
    z_scores = np.array(scores)
    means, squares = z_scores.mean(axis=0), np.mean(z_scores**2, axis=0)
    print(f"means {means}, mean squares {squares}; with a square {np.mean(twins):.1f}")
    assert np.all(np.abs(z_scores.mean(axis=0)) < 0.6)
    assert np.all((np.mean(z_scores**2, axis=0) > 0.4) & (np.mean(z_scores**2, axis=0) < 1.9))
    assert np.mean(twins) > 3.0


LINEAR = Model.linear().freeze(time_offset=0.0)


def followed(u: np.ndarray, z: np.ndarray, watch: tuple[str, ...]) -> LiveModel:
    """A model that begins at the right sensor."""
    priors = {"scale_factor": Prior(0.0, 1e-3), "bias": Prior(0.0, 1e-3)}
    live = LiveModel(
        replace(LINEAR, priors=priors), Rig(), rate=RATE, q=Q, r_position=READING**2, position=z[0], watch=watch
    )
    live.run(u, z)
    return live


WATCH = ("cubic", "velocity", "scale_step", "bias_step")


def test_a_model_names_what_it_lacks_with_its_size_and_its_begin() -> None:
    u, z, a = record(18.0, 3)
    nothing = followed(u, z, WATCH)
    assert nothing.named() == ()
    assert [suspicion.name for suspicion in nothing.watched] == list(WATCH)
    (cubic,) = followed(u + 1e-3 * a**3, z, WATCH).named()
    assert cubic.name == "cubic"
    assert abs(cubic.size - 1e-3) < 5.0 * cubic.std < 5e-4  # 5 standard deviations: 1 of 10^6
    assert cubic.since == pytest.approx(18.0)
    after = np.arange(len(u)) >= 12.0 * RATE
    (step,) = followed(u + 0.02 * a * after, z, WATCH).named()
    assert step.name == "scale_step"
    assert 0.01 < step.size < 0.03  # since the start at 10 s, 2 s too early
    assert step.since == pytest.approx(8.0, abs=0.1)


def test_a_watch_goes_on_behind_a_hole() -> None:
    u, z, a = record(8.0, 4)
    bent = u + 1e-3 * a**3
    live = followed(bent[:800], z[:800], ("cubic",))
    before = live.watched[0]
    live.restart(z[900], (z[901] - z[900]) * RATE, 900 / RATE)
    live.run(bent[900:], z[900:])
    (after,) = live.watched
    assert after.log_e > before.log_e + 5.0
    assert after.std < before.std
    anew = followed(bent[900:], z[900:], ("cubic",)).watched[0]
    assert after.std < anew.std


@pytest.mark.parametrize(
    ("watch", "sentence"),
    [
        (("bias",), "bias cannot be watched: the model has it already"),
        (("cubic", "cubic"), "cubic cannot be watched: it is given twice"),
        (("vibration",), "vibration cannot be watched: it acts on the noise"),
        (("hysteresis",), "hysteresis cannot be watched: it has shape parameters"),
        (("clock_skew",), "clock_skew cannot be watched: it follows how fast the output changes"),
    ],
)
def test_what_cannot_be_watched_is_refused_with_its_reason(watch: tuple[str, ...], sentence: str) -> None:
    with pytest.raises(ValueError, match=sentence):
        LiveModel(LINEAR, Rig(), rate=RATE, q=Q, r_position=READING**2, position=0.0, watch=watch)


def test_auto_is_every_effect_that_lacks_and_can_be_watched() -> None:
    names = watchable(LINEAR, ())
    assert {"cubic", "velocity", "scale_step"} <= set(names)
    assert not {"temperature_bias", "clock_skew", "hysteresis", "bias"} & set(names)
    assert set(watchable(LINEAR, ("temperature",))) - set(names) == {
        "temperature_bias", "temperature_scale", "temperature_rate",
    }  # fmt: skip
    assert "cubic" not in watchable(LINEAR.add("cubic"), ())


def test_a_name_is_one_line_with_its_begin_size_odds_and_false_rate() -> None:
    suspects = (
        Suspicion("cubic", "(m/s²)⁻²", 3.1e-4, 4e-6, 30.0, 100.0),
        Suspicion("odd_quadratic", "(m/s²)⁻¹", 1e-3, 1e-4, 28.0, 100.0),
    )
    assert Naming(152.0, suspects, 10).sentence == (
        "since about t = 52 s: cubic or odd_quadratic, which act alike so far; the size is that of the first, "
        "3.100(40)e−4 (m/s²)⁻², odds 10^12.0 to 1 against chance among 10 suspects; "
        "a false name in one of 200 operations"
    )


def test_the_command_prints_the_name_once(tmp_path: Path) -> None:
    refused = accelcal("live", "--file", "x.csv", "--rig", "x.toml", "--watch", "cubic")
    assert refused.returncode == 2
    assert "--watch: needs --model" in refused.stderr
    first, second, model = tmp_path / "first.csv", tmp_path / "second.csv", tmp_path / "m.json"
    for path, more in ((first, ["--seconds", "5"]), (second, ["--seconds", "2", "--cubic", "1e-3", "--seed", "2"])):
        assert accelcal("simulate", "-o", str(path), "--motion", "tones", *more).returncode == 0
    assert accelcal("fit", str(first), "-o", str(model)).returncode == 0
    live = accelcal(
        "live", "--file", str(second), "--rig", str(second.with_suffix(".toml")), "--model", str(model),
        "--watch", "cubic, velocity",
    )  # fmt: skip
    assert live.returncode == 0, live.stderr
    named = [line for line in live.stderr.splitlines() if line.startswith("watch:")]
    assert len(named) == 1
    assert ": cubic, " in named[0]
