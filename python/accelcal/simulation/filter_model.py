"""Records drawn from a filter's own model, for which an optimal filter must be consistent (paper II-H, III-A1).

Nothing here is a rig: the process noise is exactly the white noise that the ACI model (9) or the CWPA model (10)
assumes, and the readings carry exactly the noise that its update assumes. What `accelcal.simulate` adds to that is what
the models leave out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Channel, Recording
from accelcal.data.rig import Rig


@dataclass(frozen=True, slots=True)
class Matched:
    """A record and the states that the model went through."""

    recording: Recording
    t: Array
    """(n,) s: every instant at which either channel was sampled."""
    state: Array
    """(n, nx) SI: ACI (p, v, k, K0[, K2, K3]), CWPA (p, v, a, k, K0[, K2, K3])."""

    def at(self, t: float) -> Array:
        """State (nx,) at the last sampled instant not after t, s."""
        return np.asarray(self.state[np.searchsorted(self.t, t, side="right") - 1])


def matched_aci(
    control: Channel,
    position_t: Array,
    initial: Array,
    *,
    process_density: float,
    position_variance: float,
    rng: np.random.Generator,
) -> Matched:
    """Positions that model (9) would have produced under a given control.

    p' = v, v' = g + g' noise, g = (1 - k) w + K2 w² + K3 w³, w = u - K0 (equations (5), (6)); u is held between its
    samples. The noise enters with u, so it is multiplied by g' = dg/du.

    Parameters
    ----------
    control : Channel
        Accelerometer output u, m/s², known to the filter without error.
    position_t : (n,) s
        Encoder instants, rising, none before the first sample of the control.
    initial : (4,) or (6,)
        p, v, k, K0[, K2, K3] at the first sample of the control, parameters in the inverse sense of (5), (6).
    process_density : float
        Two-sided density q of the white noise on the control, (m/s²)²/Hz.
    position_variance : float
        R, m².
    rng : numpy.random.Generator
        Draws process and reading noise.
    """
    k, K0, K2, K3 = _padded(initial[2:])
    t, dt = _instants(control.t, position_t)
    w = control.y[np.searchsorted(control.t, t[:-1], side="right") - 1] - K0
    g = (1.0 - k) * w + K2 * w**2 + K3 * w**3
    slope = (1.0 - k) + 2.0 * K2 * w + 3.0 * K3 * w**2
    dp, dv = slope * np.sqrt(process_density) * _integrated_white_noise(dt, 2, rng)
    v = _accumulated(initial[1], g * dt + dv)
    p = _accumulated(initial[0], v[:-1] * dt + 0.5 * g * dt**2 + dp)

    position = _reading("position", "m", position_t, p[np.searchsorted(t, position_t)], position_variance, rng)
    return Matched(Recording(control, position, Rig()), t, _states((p, v), initial[2:]))


def matched_cwpa(
    accel_t: Array,
    position_t: Array,
    initial: Array,
    *,
    jerk_density: float,
    position_variance: float,
    accel_variance: float,
    rng: np.random.Generator,
) -> Matched:
    """Positions and outputs that model (10) would have produced: white jerk, readings with white noise.

    Parameters
    ----------
    accel_t, position_t : (m,), (n,) s
        Sampling instants, rising.
    initial : (5,) or (7,)
        p, v, a, k, K0[, K2, K3] at the earlier of the two first instants, parameters in the forward sense of (3), (4).
    jerk_density : float
        Two-sided density q of the white jerk, m²/s⁵.
    position_variance, accel_variance : float
        R of either channel, m² and (m/s²)².
    rng : numpy.random.Generator
        Draws process and reading noise.
    """
    k, K0, K2, K3 = _padded(initial[3:])
    t, dt = _instants(accel_t, position_t)
    dp, dv, da = np.sqrt(jerk_density) * _integrated_white_noise(dt, 3, rng)
    a = _accumulated(initial[2], da)
    v = _accumulated(initial[1], a[:-1] * dt + dv)
    p = _accumulated(initial[0], v[:-1] * dt + 0.5 * a[:-1] * dt**2 + dp)

    sensed = a[np.searchsorted(t, accel_t)]
    output = K0 + (1.0 + k) * sensed + K2 * sensed**2 + K3 * sensed**3
    recording = Recording(
        accel=_reading("accel", "m/s²", accel_t, output, accel_variance, rng),
        position=_reading("position", "m", position_t, p[np.searchsorted(t, position_t)], position_variance, rng),
        rig=Rig(),
    )
    return Matched(recording, t, _states((p, v, a), initial[3:]))


def _padded(theta: Array) -> Array:
    """k, K0, K2, K3 of a linear (2,) or cubic (4,) parameter set."""
    return np.concatenate([theta, np.zeros(4 - len(theta))])


def _instants(first: Array, second: Array) -> tuple[Array, Array]:
    """All sampling instants (n,) s and the steps (n - 1,) s between them."""
    t = np.union1d(first, second)
    return t, np.diff(t)


def _integrated_white_noise(dt: Array, order: int, rng: np.random.Generator) -> Array:
    """White noise of unit density, integrated 1 to `order` times over each step; (order, n), the most integrated first.

    Covariance of the i-th and j-th integral: dt^(i+j-1)/((i + j - 1) (i - 1)! (j - 1)!).
    """
    i = np.arange(order, 0, -1)
    factorial = np.array([1.0, 1.0, 2.0])[i - 1]
    unit = 1.0 / ((i[:, None] + i - 1) * factorial[:, None] * factorial)
    return np.asarray(np.linalg.cholesky(unit) @ rng.standard_normal((order, len(dt))) * dt ** (i[:, None] - 0.5))


def _accumulated(first: float, steps: Array) -> Array:
    """first, first + steps[0], ...; (n + 1,)."""
    return np.cumsum(np.concatenate([[first], steps]))


def _reading(name: str, unit: str, t: Array, y: Array, variance: float, rng: np.random.Generator) -> Channel:
    """A channel with white noise."""
    return Channel(name, t, y + np.sqrt(variance) * rng.standard_normal(len(t)), unit)


def _states(motion: tuple[Array, ...], theta: Array) -> Array:
    """Motion and constant parameters side by side; (n, nx)."""
    n = len(motion[0])
    return np.column_stack([*motion, np.broadcast_to(theta, (n, len(theta)))])
