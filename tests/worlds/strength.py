"""How strong a hidden effect is: d² = twice the expected gain of log-likelihood over the refitted base.

Mean effects: the record is z − ∬u, whose noise is the double integral of white acceleration noise (intensity q = N²/2)
plus white encoder noise R. The contribution and the base columns (1, a, jerk, and the unknown start state through a
diffuse prior) pass the Kalman filter of that noise model; d² is the squared length of what the base leaves of it
(fitting the coefficient as well adds the one that noise alone would gain).
Wandering effects: with eigenvalues λ of the whitened covariance beside the base, d² = Σ (λ − ln(1 + λ)).
Variance effects: the same sum over readings and frequencies, λ = added power / noise power, with motion and base known;
outliers: twice the relative entropy of the contaminated to the clean noise, times the number of readings, where clean
is what a reading leaves when all others are known. Vibration that is a nuisance counts as noise.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.signal import lfilter, lfiltic

from .numerics import Array, double_integral, interpolate
from .world import (
    SENSORS,
    Chain,
    Hidden,
    World,
    encoder_error,
    pass_through,
    time_constant,
)

BASE = ("1", "a", "jerk")
DELAYS = ("time_offset", "sensor_lag", "sensor_resonance")
"""Effects that the base's own time_offset takes up: for them d² is over a base without jerk, unless a base is given."""


def d2(world: World, base: Sequence[str] | None = None, index: int = -1) -> float:
    """Return d² of the hidden effect `index` of a world over the base columns; the default base is that of BASE."""
    index = range(len(world.hidden))[index]
    hidden = world.hidden[index]
    base = _default_base(hidden) if base is None else base
    chain = pass_through(world)
    if hidden.effect.kind == "random":
        return _random_process(world, hidden, chain, index, base)
    if hidden.effect.kind == "variance":
        return _variance(world, hidden, chain, index)
    return float(np.sum(_projected(world, chain, [index], base) ** 2))


def _default_base(hidden: Hidden) -> Sequence[str]:
    return ("1", "a") if hidden.name in DELAYS else BASE


def signatures(world: World, base: Sequence[str] = BASE) -> Array:
    """Return the whitened contributions of all mean effects beside the base, (n, number of effects).

    The norm of a column is d; the cosine of two columns is their mutual correlation on this record.
    """
    return _projected(world, pass_through(world), range(len(world.hidden)), base)


def at_d(world: World, d: float, index: int = -1, base: Sequence[str] | None = None) -> World:
    """Return the world with the magnitude of one hidden effect scaled so that sqrt(d²) is d within 1 %.

    Raises
    ------
    ValueError
        If the effect cannot be seen on this motion, or cannot reach this d.
    """
    if world.hidden[index].effect.kind == "invisible":
        raise ValueError(f"{world.hidden[index].name} hides in the base on a level rig; it has no d")
    tried: list[tuple[float, float]] = []
    magnitude = world.hidden[index].magnitude
    for _ in range(40):
        reached = np.sqrt(max(d2(_with(world, index, magnitude), base, index), 0.0))
        if abs(reached - d) <= 0.01 * d:
            return _with(world, index, magnitude)
        if not np.isfinite(reached) or reached < 1e-6 * d:
            raise ValueError(f"{world.hidden[index].name} leaves no trace on {world.motion}: d = {reached:.2g}")
        tried.append((np.log(abs(magnitude)), np.log(reached)))
        magnitude = np.copysign(np.exp(_next(tried, np.log(d))), magnitude)
    raise ValueError(f"{world.hidden[index].name} on {world.motion} does not reach d = {d}: last {reached:.3g}")


def _next(tried: list[tuple[float, float]], goal: float) -> float:
    """Return the next log-magnitude: a secant in logarithms, kept inside the bracket once there is one."""
    below = [x for x, y in tried if y < goal]
    above = [x for x, y in tried if y > goal]
    (x, y), slope = tried[-1], 1.0
    if len(tried) > 1 and tried[-2][0] != x:
        slope = float(np.clip((y - tried[-2][1]) / (x - tried[-2][0]), 0.3, 4.0))
    guess = x + (goal - y) / slope
    if below and above and not max(below) < guess < min(above):
        return 0.5 * (max(below) + min(above))
    return guess


def _with(world: World, index: int, magnitude: float) -> World:
    hidden = list(world.hidden)
    hidden[index] = replace(hidden[index], magnitude=float(magnitude))
    return replace(world, hidden=tuple(hidden))


# --- mean effects ---------------------------------------------------------------------------------------------------


def encoder_variance(world: World) -> float:
    """Return R per stamp, m²: white noise and rounding; missing stamps count as proportionally more noise."""
    return (world.encoder_noise**2 + world.resolution**2 / 12) / (1 - world.nuisances.missing)


def whiten(columns: Array, q: float, r: float, dt: float) -> Array:
    """Pass position-like columns (n, m) through the Kalman filter of p'' = w (intensity q), z = p + e (variance r).

    Diffuse start; the gains vary until they have converged, from then on the filter is a fixed recursion,
    (1 − z⁻¹)²/(1 − (2 − k1 − dt k2) z⁻¹ + (1 − k1) z⁻²) (Bar-Shalom, Li, Kirubarajan 2001, sections 5.2 and 6.5).
    """
    white = np.empty_like(columns)
    x = np.zeros((2, columns.shape[1]))
    transition = np.array([[1.0, dt], [0.0, 1.0]])
    noise = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]])
    P = np.diag([1.0, 100.0])
    before = np.zeros(2)
    errors = np.empty_like(columns[: min(len(columns), 20_000)])
    for k in range(len(columns)):
        s = P[0, 0] + r
        gain = P[:, 0] / s
        errors[k] = columns[k] - x[0]
        white[k] = errors[k] / np.sqrt(s)
        x = transition @ (x + np.outer(gain, errors[k]))
        P = transition @ (P - np.outer(gain, gain) * s) @ transition.T + noise
        if k > 2 and np.max(np.abs(gain / before - 1)) < 1e-9:
            break
        before = gain
    else:
        return white
    a, b = [1.0, -(2 - gain[0] - dt * gain[1]), 1 - gain[0]], [1.0, -2.0, 1.0]
    for j in range(columns.shape[1]):
        state = lfiltic(b, a, errors[[k, k - 1], j], columns[[k, k - 1], j])
        white[k + 1 :, j] = lfilter(b, a, columns[k + 1 :, j], zi=state)[0] / np.sqrt(s)
    return white


def _intensity(world: World) -> float:
    return SENSORS[world.sensor].noise ** 2 / 2


def _seen(world: World, chain: Chain, output: Array) -> Array:
    """Return what an addition to the output does to z − ∬u at nominal encoder stamps, (m,)."""
    return interpolate(float(chain.scene.t[0]), -double_integral(output), _encoder_times(world))


def _encoder_times(world: World) -> Array:
    return np.arange(int(world.seconds * world.encoder_rate)) / world.encoder_rate


def _base(world: World, chain: Chain, base: Sequence[str]) -> list[Array]:
    truth = chain.scene
    columns = {"1": np.ones_like(truth.t), "a": truth.a, "jerk": truth.jerk}
    return [_seen(world, chain, columns[name]) for name in base]


def _project(white: Array, rank: int) -> Array:
    """Return the columns after the first `rank` without what those explain."""
    if rank == 0:
        return white
    basis, _ = np.linalg.qr(white[:, :rank] / np.linalg.norm(white[:, :rank], axis=0))
    rest = white[:, rank:]
    rest = rest - basis @ (basis.T @ rest)
    return rest - basis @ (basis.T @ rest)


def _projected(world: World, chain: Chain, indices: Sequence[int], base: Sequence[str]) -> Array:
    columns = _base(world, chain, base)
    for index in indices:
        output = chain.contributions[index].output
        encoder = encoder_error(world, chain, index, _encoder_times(world))
        columns.append(encoder if output is None else _seen(world, chain, output))
    white = whiten(np.column_stack(columns), _intensity(world), encoder_variance(world), 1 / world.encoder_rate)
    return _project(white, len(base))


# --- random process -------------------------------------------------------------------------------------------------

_WAVES = 40


def _random_process(world: World, hidden: Hidden, chain: Chain, index: int, base: Sequence[str]) -> float:
    """Expand the process in cosines cos(pi j t/L); covariance from its own kernel.

    Double integrals of the cosines of a bias are known; those of a scale factor are multiplied by the force first.
    """
    j = np.arange(1, _WAVES + 1)
    t = _encoder_times(world)
    w = np.pi * j / world.seconds
    if "acceleration" in hidden.effect.explains:
        waves = [_seen(world, chain, np.cos(item * chain.scene.t) * chain.scene.a) for item in w]
    else:
        waves = list((np.cos(np.outer(t, w)) / w**2).T)
    columns = [*_base(world, chain, base), *waves]
    white = whiten(np.column_stack(columns), _intensity(world), encoder_variance(world), 1 / world.encoder_rate)
    gram, rank = white.T @ white, len(base)
    given_base = gram[rank:, rank:] - gram[rank:, :rank] @ np.linalg.solve(gram[:rank, :rank], gram[:rank, rank:])
    coarse = (np.arange(800) + 0.5) / 800 * world.seconds
    cosines = np.cos(np.outer(coarse, w)) * (2 / len(coarse))
    prior = cosines.T @ _kernel(hidden, chain.shapes[index], coarse) @ cosines
    scale = np.linalg.cholesky(prior + 1e-14 * np.trace(prior) * np.eye(_WAVES))
    eigenvalues = np.maximum(np.linalg.eigvalsh(scale.T @ given_base @ scale), 0)
    return _gain(eigenvalues)


def _kernel(hidden: Hidden, shape: dict[str, float], t: Array) -> Array:
    if "tau" not in shape:
        return hidden.magnitude**2 * np.minimum.outer(t, t)
    return hidden.magnitude**2 * np.exp(-np.abs(np.subtract.outer(t, t)) / shape["tau"])


def _gain(power: Array) -> float:
    """Return Σ (λ − ln(1 + λ)): twice the expected gain when independent unit variances grow to 1 + λ."""
    return float(np.sum(power - np.log1p(power)))


# --- variance effects -----------------------------------------------------------------------------------------------


def _variance(world: World, hidden: Hidden, chain: Chain, index: int) -> float:
    shape, m = chain.shapes[index], hidden.magnitude
    n, rate = int(world.seconds * world.accel_rate), world.accel_rate
    tau = time_constant(world)
    variance, keep = SENSORS[world.sensor].noise ** 2 / (4 * tau), np.exp(-1 / (rate * tau))
    cycles = (np.arange(64) + 0.5) / 128
    floor = variance * (1 - keep**2) / (1 + keep**2 - 2 * keep * np.cos(2 * np.pi * cycles))
    speed = np.abs(chain.scene.v[::60])
    speed = speed / np.max(np.abs(chain.scene.v))
    band = (cycles * rate > 205) & (cycles * rate < 295)
    passed = band / (1 + (2 * np.pi * cycles * rate * tau) ** 2) * len(cycles) / np.sum(band) / 2
    noise = floor + (world.nuisances.vibration * speed[:, None] ** 2) ** 2 * passed
    if hidden.name == "accelerometer_outliers":
        return n * contamination(shape["share"], float(np.mean(1 / np.mean(noise, axis=0))) ** -0.5, m)
    if hidden.name == "encoder_outliers":
        readings = world.seconds * world.encoder_rate * (1 - world.nuisances.missing)
        return readings * contamination(shape["share"], _reading_deviation(world), m)
    if hidden.name == "quantisation":
        power = np.asarray(m**2 / 12 / noise)
    elif hidden.name == "timing_jitter":
        power = (m * chain.scene.jerk[::60, None]) ** 2 / noise
    else:
        power = (m * speed[:, None] ** shape["exponent"]) ** 2 * passed / noise
    return n * _gain(power) / int(power.size)


def _reading_deviation(world: World) -> float:
    """Return the standard deviation of what one encoder reading leaves when all others are known, m."""
    impulse = np.zeros((4000, 1))
    impulse[2000] = 1.0
    plain = replace(world, nuisances=replace(world.nuisances, missing=0.0))
    white = whiten(impulse, _intensity(world), encoder_variance(plain), 1 / world.encoder_rate)
    return float(np.sum(white**2) ** -0.5)


def contamination(share: float, clean: float, size: float) -> float:
    """Return twice the relative entropy of (1 − share) N(0, clean²) + share N(0, clean² + size²) to N(0, clean²)."""
    wide = np.hypot(clean, size)
    x = np.sinh(np.linspace(0, np.arcsinh(10 * wide / clean), 4000)) * clean

    def density(sigma: float) -> Array:
        return np.asarray(np.exp(-0.5 * (x / sigma) ** 2) / (np.sqrt(2 * np.pi) * sigma))

    log_clean = -0.5 * (x / clean) ** 2 - 0.5 * np.log(2 * np.pi) - np.log(clean)
    mixed = (1 - share) * density(clean) + share * density(wide)
    return 4 * float(np.trapezoid(mixed * (np.log(mixed) - log_clean), x))
