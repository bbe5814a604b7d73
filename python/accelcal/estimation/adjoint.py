"""The steady filter transposed: what innovations ask of the output, or of each reading."""

from __future__ import annotations

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.run_state import RunState


def asked_of_output(one: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in the output, held over the interval after each reading, up to a factor, (m,).

    Parameters
    ----------
    one : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    T = one.run.reading_step
    return _transposed(one, y, np.array([[T * T / 2.0], [T]]), np.array([[1.0, 0.0]]), 0.0)


def asked_of_readings(one: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in an error of each reading, up to a factor, (m,).

    Parameters
    ----------
    one : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    F, K, _ = _steady(one)
    return _transposed(one, y, F @ K, np.array([[-1.0, 0.0]]), 1.0)


def _transposed(one: RunState, y: Array, B: Array, C: Array, D: float) -> Array:
    """Run x(n+1) = F (I - K H) x + B d, e = C x + D d backwards over uniform times; lost readings ask for nothing."""
    F, K, H = _steady(one)
    t = one.run.t[one.counts]
    place = np.rint((t - t[0]) / one.run.reading_step).astype(np.intp)
    e = np.zeros(int(place[-1]) + 1)
    e[place] = y
    b, a = scipy.signal.ss2tf(F @ (np.eye(2) - K @ H), B, C, np.array([[D]]))
    return np.asarray(scipy.signal.lfilter(b[0], a, e[::-1])[::-1][place])


def _steady(one: RunState) -> tuple[Array, Array, Array]:
    """Transition, usual gains and measurement of the filter for position and velocity."""
    gains = [[float(np.median(one.track.series(name)))] for name in ("gain_p", "gain_v")]
    return np.array([[1.0, one.run.reading_step], [0.0, 1.0]]), np.array(gains), np.array([[1.0, 0.0]])
