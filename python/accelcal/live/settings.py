"""What the filter of a live view is set to: by the sidecar alone, or by a model that was fitted before."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import TypeVar

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.channel_filter import unsupported
from accelcal.data.recording import RecordingError
from accelcal.data.rig import Rig
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.recursive import PARAMETER_OF, PRIOR_STD
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov
from accelcal.filters.prior import spread_start
from accelcal.filters.stage_sense import to_stage
from accelcal.model import BASE, Estimate

TRACKED = (*BASE, *PARAMETER_OF.values(), "lowpass_error")
"""Effects of a model that a live view takes: it estimates the parameters of its filter and keeps the rest."""
Scalar = TypeVar("Scalar", float, Array)
SPEED = 10.0
"""Standard deviation of the velocity at the start, m/s."""
ACCELERATION = 100.0
"""Standard deviation of the acceleration between the start and the first reading, m/s²."""


@dataclass(frozen=True, slots=True)
class LiveSettings:
    """A live filter of `accelcal.filters` in full; the start of its motion is left to the first reading."""

    choice: FilterChoice
    rig: Rig
    q: float
    """Two-sided density of the noise of the output, (m/s²)² s."""
    r_position: float
    """Variance of a position reading, m²."""
    theta: Array
    """(m,) parameters at the start, as the filter sees them (`to_stage`), SI."""
    covariance: Array
    """(m, m) SI."""
    tau: float = 0.0
    """Time constant of the declared low-pass, s."""
    offset: float = 0.0
    """What the stamps of the output are late by, s."""
    parameters: Mapping[str, GaussMarkov] = field(default_factory=dict)
    """How parameters move that are not constant."""

    @property
    def names(self) -> tuple[str, ...]:
        """(m,) names of the parameters in the filter."""
        return PARAMETERS[self.choice.model]

    def stage_output(self, accel: Scalar) -> Scalar:
        """The output as a level, normally mounted sensor would give it, m/s²."""
        return self.rig.polarity * accel - self.rig.gravity

    def start(self, position: float, ahead: float) -> tuple[Array, Array]:
        """Mean (N,) and covariance (N, N) of all states, `ahead` (s) before the first reading of `position` (m)."""
        x0 = np.concatenate([[position, 0.0], self.theta])
        P0 = np.zeros((len(x0), len(x0)))
        P0[0, 0], P0[1, 1] = self.r_position, SPEED**2
        P0[2:, 2:] = self.covariance
        spread_start(P0, v_std=SPEED, a_std=ACCELERATION, ahead=ahead, lag=self.tau)
        return x0, P0

    def estimates(self, states: Array, covariance: Array) -> tuple[Estimate, ...]:
        """Parameters of the sensor, by their public names, from all states (N,) and their covariance (N, N)."""
        T = np.linalg.inv(to_stage(self.names, self.rig.polarity, self.rig.gravity))
        values, spread = T @ states[2:], T @ covariance[2:, 2:] @ T.T
        found = []
        for i, name in enumerate(self.names):
            effect = find(PARAMETER_OF[name])
            std = math.sqrt(max(0.0, float(spread[i, i])))
            found.append(Estimate(effect.name, effect.symbol, effect.unit, float(values[i]), std, effect.owner))
        return tuple(found)


def settings_of(rig: Rig, fit: Fit | None = None) -> LiveSettings:
    """Settings for a rig, and for the parameters, their uncertainty, noise and time offset of a fit.

    Without a fit the parameters start at zero, as wide as any working sensor, and the noise is that of the sidecar.

    Raises
    ------
    RecordingError
        For a filter that a live filter does not undo, for noise that is not declared, and for a model with effects that
        it does not track. The sentence says what to do.
    """
    refused = unsupported(rig.filters, "a live view")
    if refused:
        raise RecordingError(refused)
    tau = rig.lowpass.tau if rig.lowpass is not None else 0.0
    walk = rig.sensor.random_walk
    parameters = {"K0": GaussMarkov(walk**2)} if walk else {}
    if fit is None:
        q, r = declared_noise(rig)
        choice = _choice("linear")
        spread = np.diag([PRIOR_STD[name] ** 2 for name in PARAMETERS["linear"]])
        return LiveSettings(choice, rig, q, r, np.zeros(len(spread)), spread, tau, 0.0, parameters)
    theta, spread, choice = _of_fit(fit)
    A = to_stage(PARAMETERS[choice.model], rig.polarity, rig.gravity)
    values, noise = fit.values(), fit.noise().usual
    tau = max(0.0, tau + values.lowpass_error)
    return LiveSettings(
        choice,
        rig,
        noise.q * values.scale**2,
        noise.r,
        A @ theta,
        A @ spread @ A.T,
        tau,
        values.by_name.get("time_offset", 0.0),
        parameters,
    )


def declared_noise(rig: Rig) -> tuple[float, float]:
    """Density of the output's noise and variance of a reading, as the sidecar declares them.

    Raises
    ------
    RecordingError
        If one of them is not declared.
    """
    if not rig.sensor.noise:
        raise RecordingError(
            "live: the sidecar declares no noise of the sensor, and there is no model to tell it; write "
            '[sensor] noise = "250 ug/sqrt(Hz)" from its data sheet, or give --model'
        )
    if not rig.resolution:
        raise RecordingError(
            "live: the sidecar declares no resolution of the position, which tells its noise where there is no model; "
            'write position = { column = "position", unit = "mm", resolution = "1 um" }, or give --model'
        )
    return rig.sensor.noise**2 / 2.0, rig.resolution**2 / 12.0


def _choice(model: str) -> FilterChoice:
    """Exact integrals, straight lines between outputs, and UD factors, which no rate and no prior makes indefinite."""
    return FilterChoice("aci", "cubic" if model == "cubic" else "linear", interpolation="linear", carrier="factored")


def _of_fit(fit: Fit) -> tuple[Array, Array, FilterChoice]:
    """Parameters of a fit and their covariance, in the order of the filter that tracks them."""
    other = [name for name in fit.model.effects if name not in TRACKED]
    if other:
        raise RecordingError(
            f"live: {', '.join(other)} cannot be tracked from time, output and position alone; a live view tracks "
            f"{', '.join(PARAMETER_OF.values())}: drop the rest with accelcal drop"
        )
    by_name = {e.name: e.value for e in fit.estimates}
    choice = _choice("cubic" if {"quadratic", "cubic"} & set(by_name) else "linear")
    names = [PARAMETER_OF[name] for name in PARAMETERS[choice.model]]
    rows = {e.name: i for i, e in enumerate(fit.free)}
    spread = np.zeros((len(names), len(names)))
    for i, one in enumerate(names):
        for j, two in enumerate(names):
            if one in rows and two in rows:
                spread[i, j] = fit.covariance[rows[one], rows[two]]
    return np.array([by_name.get(name, 0.0) for name in names]), spread, choice
