"""What is believed of the motion where a filter starts, at the last output before the first reading."""

from __future__ import annotations

from accelcal.data.arrays import Array


def spread_start(P0: Array, *, v_std: float, a_std: float, ahead: float, lag: float) -> None:
    """Make the position at the start as uncertain as velocity and acceleration leave it, in place.

    The reading comes `ahead` later, so p is z - v ahead; with ACI behind a low-pass, whose motion lags, it is
    z - (ahead + lag) v.

    Parameters
    ----------
    P0 : (N, N) SI, position and velocity first; the variance of the position is that of a reading.
    v_std, a_std : standard deviations there, m/s and m/s².
    ahead : from the start to the first reading, s.
    lag : time constant of the low-pass for ACI, else 0, s.
    """
    lever = ahead + lag
    P0[0, 0] += (lever * v_std) ** 2 + (a_std * ahead**2 / 2.0) ** 2
    P0[0, 1] = P0[1, 0] = -lever * v_std**2
