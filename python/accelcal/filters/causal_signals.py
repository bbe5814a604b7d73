"""Signals of a live filter at the present step: state and the last four outputs in the place of smoothed motion."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.rig import Rig
from accelcal.signals.signals import Origins, Signals

INSTANTS = np.array([0.0, 0.5, 1.0])
"""Where effects are evaluated, shares of a step."""
_POWERS = np.linalg.inv(np.vander([-2.0, -1.0, 0.0, 1.0], increasing=True))
CUBIC = np.stack(
    [
        np.stack([INSTANTS**0, INSTANTS, INSTANTS**2, INSTANTS**3], axis=1) @ _POWERS,
        np.stack([0 * INSTANTS, INSTANTS**0, 2 * INSTANTS, 3 * INSTANTS**2], axis=1) @ _POWERS,
        np.stack([0 * INSTANTS, 0 * INSTANTS, 2 * INSTANTS**0, 6 * INSTANTS], axis=1) @ _POWERS,
    ]
)
"""(3, 3, 4): value, first and second difference at the three instants of the cubic through four samples."""


class CausalSignals:
    """Signals over one step from what a live filter knows then, with the fields that `smoothed_signals` fills offline.

    Position and velocity are predicted from the filter's state. The specific force is the output at the present
    estimates, a cubic through the last four samples, with all its noise and the low-pass undone; jerk is its
    derivative. Corners are rounded by the noise left and by the largest motion so far.
    """

    def __init__(self, rig: Rig, origins: Origins, step: float, q: float) -> None:
        self.rig, self.origins, self.step = rig, origins, step
        self.tau = rig.lowpass.tau if rig.lowpass is not None else 0.0
        self.a_std = math.sqrt(q / step)
        self.t = -origins.t
        self.outputs: tuple[float, ...] = ()
        self.reached = np.zeros((2, 1))

    def over(self, u: float, added: Array, x: Array, variances: Array, side: Mapping[str, float]) -> Signals:
        """Signals (3,) at the sample before, half-way and at that of output `u` (m/s²); all here if none is before.

        Parameters
        ----------
        added : (2,) what the effects add to the output at either end, m/s².
        x, variances : state of the filter at the sample before, position, velocity, k and K0 first, SI.
        side : side channels; temperature in degC.
        """
        (p, v, k, K0), polarity = x[:4], self.rig.polarity
        h = self.step if self.outputs else 0.0
        output, slope, curvature = self._output_with_derivatives(u) / (1.0 + k)
        rise = (added[1] - added[0]) / (1.0 + k)
        force = output - (K0 + added[0]) / (1.0 + k) - INSTANTS * rise
        slope = (slope - rise) / self.step
        curvature = curvature / self.step**2
        first, middle, last = moving = force - polarity * self.rig.gravity
        # The velocity of a parabola through the three, and the position that goes with it.
        speed = v + h / 24.0 * np.array([0.0, 5.0 * first + 8.0 * middle - last, 4.0 * (first + 4.0 * middle + last)])
        place = p + h * np.array([0.0, 0.25 * (speed[0] + speed[1]), (speed[0] + 4.0 * speed[1] + speed[2]) / 6.0])
        signals = Signals(
            t=self.t + h * (INSTANTS - 1.0),
            p=polarity * (place + self.tau * speed) - self.origins.p,
            v=polarity * (speed + self.tau * moving),
            a=force + self.tau * slope,
            jerk=slope + self.tau * curvature,
            scale=float(1.0 + k),
            bias=float(K0),
            rig=self.rig,
            side={name: np.full(3, y - self.origins.of(name)) for name, y in side.items()},
            side_origins=self.origins.side,
            p_std=math.sqrt(variances[0]),
            v_std=math.sqrt(variances[1]),
            a_std=self.a_std,
        )
        a, v = np.maximum(self.reached, np.max(np.abs([signals.a, signals.v]), axis=1, keepdims=True))
        return replace(signals, whole=replace(signals, a=a, v=v))

    def advance(self, u: float, signals: Signals) -> None:
        """The sample of output `u`, whose signals these were, has been taken in."""
        assert signals.whole is not None
        self.reached = np.array([signals.whole.a, signals.whole.v])
        self.t, self.outputs = self.t + self.step, (*self.outputs[-2:], u)

    def _output_with_derivatives(self, u: float) -> Array:
        """Output at the three instants and its first and second derivatives per step, (3, 3): the filter's own cubic
        through the last four samples, a line while there are fewer."""
        if len(self.outputs) == 3:
            return np.asarray(CUBIC @ np.array([*self.outputs, u]))
        before = self.outputs[-1] if self.outputs else u
        return np.array([before + INSTANTS * (u - before), np.full(3, u - before), np.zeros(3)])
