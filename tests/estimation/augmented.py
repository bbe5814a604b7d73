"""The augmented Kalman filter in plain NumPy: state (p, v, theta), dense, exact discretisation (derivations 3.2, 5.1).

p'' = input + sum theta_j c_j + w with E w w' = q, reading z = p + sum theta_j d_j + e with var e = R. What drives the
motion over an interval comes as its two integrals; nothing is shared with the replay but these numbers.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]


def augmented_filter(
    t: Array,
    z: Array,
    drive: tuple[Array, Array],
    columns: tuple[Array, Array],
    direct: Array,
    *,
    q: float,
    R: float,
    motion: tuple[Array, Array],
    precision: Array,
) -> tuple[Array, Array]:
    """Estimate of theta and its covariance after the last reading.

    Parameters
    ----------
    t, z : (n,) s, m.
    drive : velocity and position that the input adds over the interval ending at each reading, (n,) each.
    columns : the same for one unit of each parameter, (n, m) each.
    direct : (n, m) what one unit of each parameter adds to the reading, m.
    q, R : process density and reading variance.
    motion : mean (2,) and covariance (2, 2) of (p, v) at the first reading, before it and for theta = 0.
    precision : (m,) prior inverse variances of theta, mean 0.
    """
    m = direct.shape[1]
    x = np.concatenate([motion[0], np.zeros(m)])
    P = np.zeros((2 + m, 2 + m))
    P[:2, :2] = motion[1]
    P[2:, 2:] = np.diag(1.0 / precision)
    # The first reading is the expected position: what a parameter adds to it is taken off the position.
    tie = np.eye(2 + m)
    tie[0, 2:] = -direct[0]
    P = tie @ P @ tie.T
    for k in range(len(t)):
        if k > 0:
            h = t[k] - t[k - 1]
            F = np.eye(2 + m)
            F[0, 1] = h
            F[0, 2:], F[1, 2:] = columns[1][k], columns[0][k]
            x = F @ x
            x[:2] += drive[1][k], drive[0][k]
            P = F @ P @ F.T
            P[:2, :2] += q * np.array([[h**3 / 3.0, h**2 / 2.0], [h**2 / 2.0, h]])
        H = np.concatenate([[1.0, 0.0], direct[k]])
        PH = P @ H
        S = H @ PH + R
        gain = PH / S
        x = x + gain * (z[k] - H @ x)
        IKH = np.eye(2 + m) - np.outer(gain, H)
        P = IKH @ P @ IKH.T + R * np.outer(gain, gain)
    return x[2:], P[2:, 2:]
