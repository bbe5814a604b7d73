"""Adjoint of the steady filter: gradients of the log-likelihood in the output and in each reading."""

from __future__ import annotations

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.estimation.run_state import RunState


def gradient_in_output(state: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in the output, held over the interval after each reading, up to a factor, (m,).

    Parameters
    ----------
    state : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    T = state.run.reading_step
    return _transposed(state, y, np.array([[T * T / 2.0], [T]]), np.array([[1.0, 0.0]]), 0.0)


def gradient_in_readings(state: RunState, y: Array) -> Array:
    """Gradient of the log-likelihood in an error of each reading, up to a factor, (m,).

    Parameters
    ----------
    state : the run.
    y : (m,) whitened innovations of the readings that count.
    """
    F, K, _ = _steady(state)
    return _transposed(state, y, F @ K, np.array([[-1.0, 0.0]]), 1.0)


def _transposed(state: RunState, y: Array, B: Array, C: Array, D: float) -> Array:
    """Run x(n+1) = F (I - K H) x + B d, e = C x + D d backwards over uniform times; lost readings count as zero."""
    F, K, H = _steady(state)
    t = state.run.t[state.counts]
    place = np.rint((t - t[0]) / state.run.reading_step).astype(np.intp)
    e = np.zeros(int(place[-1]) + 1)
    e[place] = y
    b, a = scipy.signal.ss2tf(F @ (np.eye(2) - K @ H), B, C, np.array([[D]]))
    return np.asarray(scipy.signal.lfilter(b[0], a, e[::-1])[::-1][place])


def _steady(state: RunState) -> tuple[Array, Array, Array]:
    """Transition, median gains and measurement of the filter for position and velocity."""
    gains = [[float(np.median(state.track.series(name)))] for name in ("gain_p", "gain_v")]
    return np.array([[1.0, state.run.reading_step], [0.0, 1.0]]), np.array(gains), np.array([[1.0, 0.0]])
