"""Cramer-Rao bound from the truth alone (derivations 6.5: Riccati recursion along the true trajectory).

NumPy only; nothing of the fit is used. The stage obeys p'' = f⁻¹(output) + w with E w w' = (N²/2)/f'(a)², the encoder
reads p with variance R. A parameter moves the stage by a column; the predicted reading responds through the filter's
gains, and each reading adds g g'/S to the information.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from accelcal.simulation.sensor import Truth

Array = NDArray[np.float64]

NODES, WEIGHTS = np.polynomial.legendre.leggauss(4)
CHUNK = 1000


def bound(truths: Sequence[Truth], names: Sequence[str], t: Array, reading_variance: float) -> Array:
    """Cramer-Rao covariance of parameters `names` for several runs read at the same times.

    Parameters
    ----------
    truths : runs with one sensor; motion may differ.
    names : among bias, scale_factor, time_offset, quadratic, cubic.
    t : (n,) s, reading times.
    reading_variance : m².

    Returns
    -------
    (runs, m, m), SI.
    """
    runs, m = len(truths), len(names)
    information = np.zeros((runs, m, m))
    # Position and velocity at the start are unknown: the first reading and a speed of 10 m/s, as good as nothing.
    pp, pv, vv = np.full(runs, reading_variance), np.zeros(runs), np.full(runs, 100.0)
    sp, sv = np.zeros((runs, m)), np.zeros((runs, m))
    for begin in range(1, len(t), CHUNK):
        end = min(begin + CHUNK, len(t))
        first, second, q = _columns(truths, names, t[begin - 1 : end])
        responses, variances = np.empty((end - begin, runs, m)), np.empty((end - begin, runs))
        for k in range(end - begin):
            h = t[begin + k] - t[begin + k - 1]
            sp, sv = sp + h * sv + second[k], sv + first[k]
            pp = pp + h * (2.0 * pv + h * (vv + h * q[k] / 3.0))
            pv = pv + h * (vv + h * q[k] / 2.0)
            vv = vv + h * q[k]
            S = pp + reading_variance
            gain_p, gain_v = pp / S, pv / S
            responses[k], variances[k] = sp, S
            sp, sv = sp - gain_p[:, None] * sp, sv - gain_v[:, None] * responses[k]
            pp, pv, vv = pp * reading_variance / S, pv * reading_variance / S, vv - pv * gain_v
        information += np.einsum("kri,krj,kr->rij", responses, responses, 1.0 / variances)
    return np.asarray(np.linalg.inv(information))


def stationary(truth: Truth, names: Sequence[str], seconds: float, period: float, reading_variance: float) -> Array:
    """The same bound by weighting spectra, 1/(q + R period w⁴), good while the motion fades in and out."""
    rate = 1000.0
    t = np.arange(0.0, seconds, 1.0 / rate)
    columns, q = _acceleration(truth, names, t)
    spectrum = np.fft.rfft(columns, axis=0) / rate
    w = 2.0 * np.pi * np.fft.rfftfreq(len(t), 1.0 / rate)
    weight = 1.0 / (np.mean(q) + reading_variance * period * w**4)
    both_sides = np.where(w > 0.0, 2.0, 1.0) / seconds
    information = np.einsum("fi,fj,f->ij", spectrum.conj(), spectrum, weight * both_sides).real
    return np.asarray(np.linalg.inv(information))


def _acceleration(truth: Truth, names: Sequence[str], t: Array) -> tuple[Array, Array]:
    """What one unit of each parameter takes off the acceleration that the output implies (n, m), and q (n,)."""
    _, _, a, jerk = truth.motion.derivatives(t)
    theta = truth.parameters
    slope = 1.0 + theta["scale_factor"] + 2.0 * theta["quadratic"] * a + 3.0 * theta["cubic"] * a**2
    output = {
        "bias": np.ones_like(a),
        "scale_factor": a,
        "time_offset": -slope * jerk,
        "quadratic": a**2,
        "cubic": a**3,
    }
    return np.stack([output[name] / slope for name in names], axis=-1), 0.5 * truth.noise**2 / slope**2


def _columns(truths: Sequence[Truth], names: Sequence[str], t: Array) -> tuple[Array, Array, Array]:
    """Integrals of the columns between readings, (n - 1, runs, m) each, and the density of the noise (n - 1, runs)."""
    h = np.diff(t)
    nodes = t[:-1, None] + 0.5 * h[:, None] * (1.0 + NODES)
    weights = 0.5 * h[:, None] * WEIGHTS
    lever = weights * (t[1:, None] - nodes)
    shape = (len(h), len(truths), len(names))
    first, second, density = np.empty(shape), np.empty(shape), np.empty(shape[:2])
    for r, truth in enumerate(truths):
        column, q = _acceleration(truth, names, nodes.ravel())
        column = column.reshape(*nodes.shape, len(names))
        first[:, r] = np.einsum("ki,kim->km", weights, column)
        second[:, r] = np.einsum("ki,kim->km", lever, column)
        density[:, r] = q.reshape(nodes.shape).mean(axis=1)
    return first, second, density
