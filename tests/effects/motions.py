"""Signals with closed forms: sums of sines whose two halves span the same range."""

import numpy as np

from accelcal.data.orientation import ACROSS, ANGULAR_ACCELERATION, LEVELS, LEVERS, OF_ARM, RATES, TURNED
from accelcal.data.rig import Rig
from accelcal.signals.signals import Signals

PERIOD = 30.0
"""All lines are multiples of 1/30 Hz: the second half of a minute repeats the first."""


def sines(
    lines=((8.0, 0.7, 0.3), (31.0, 1.5, 1.1), (97.0, 0.9, 2.0)), seconds=60.0, n=25_000, start=0.0, p0=0.0, **more
) -> Signals:
    """Acceleration sum A sin(w t + phi), lines (cycles in 30 s, A in m/s², phi), with its exact p, v and jerk."""
    t = np.arange(n) * (seconds / n)
    p, v, a, jerk = np.zeros((4, n))
    for cycles, amplitude, phase in lines:
        w = 2.0 * np.pi * cycles / PERIOD
        angle = w * t + phase
        p -= amplitude / w**2 * np.sin(angle)
        v -= amplitude / w * np.cos(angle)
        a += amplitude * np.sin(angle)
        jerk += amplitude * w * np.cos(angle)
    side = {"temperature": 0.4 * np.sin(2.0 * np.pi * t / PERIOD), "a_y": np.cos(2.0 * np.pi * 7.0 * t / PERIOD)}
    side["a_z"] = np.cos(2.0 * np.pi * 5.0 * t / PERIOD + 0.4)
    turning = (*TURNED, *LEVERS, *RATES, ANGULAR_ACCELERATION, *OF_ARM, *ACROSS, *LEVELS)
    side |= {name: 0.1 * np.sin(2.0 * np.pi * (k + 2.0) * t / PERIOD) for k, name in enumerate(turning)}
    return Signals(
        t=start + t, p=p0 + p, v=v, a=a, jerk=jerk, **{"scale": 1.01, "rig": Rig(), "cutoff": 25.0, "side": side} | more
    )


def moves(n=25_000) -> Signals:
    """There and back between rests: forwards 1 s, rest 2 s, backwards 1 s, rest 2 s, ten times."""
    t = np.arange(n) * (60.0 / n)
    phase = np.mod(t, 6.0)
    u = np.where(phase < 3.0, np.clip(phase - 1.0, 0.0, 1.0), 1.0 - np.clip(phase - 4.0, 0.0, 1.0))
    p = 0.1 * u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    v = np.gradient(p, t)
    a = np.gradient(v, t)
    return Signals(t=t, p=p, v=v, a=a, jerk=np.gradient(a, t), scale=1.0, rig=Rig(), cutoff=25.0)
