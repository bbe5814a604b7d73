"""Settings of a live filter as the compiled core takes them."""

from __future__ import annotations

import math
from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from accelcal import _core
from accelcal._support.errors import AccelcalError
from accelcal.data.arrays import Array
from accelcal.data.recording import Channel
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov


def core_setup(
    choice: FilterChoice,
    q: float,
    r_position: float,
    r_accel: float | None,
    q_accel: float | None,
    tau: float,
    parameters: Mapping[str, GaussMarkov] | None,
    gate: float | None,
) -> _core.FilterSetup:
    """The compiled set-up; what the chosen system needs must be given, and what it ignores must not."""
    reads_output = choice.system == "cwpa"
    for name, value, needed in (
        ("r_accel", r_accel, reads_output),
        ("q_accel", q_accel, reads_output and tau != 0),
    ):
        if (value is not None) != needed:
            verb = "needs" if needed else "has no use for"
            raise AccelcalError(f"{choice.system} with tau = {tau:g} s {verb} {name}.")
    moving = dict(parameters or {})
    unknown = set(moving) - set(PARAMETERS[choice.model])
    if unknown:
        raise AccelcalError(f"parameters: {sorted(unknown)} are not in the {choice.model} model.")
    states = choice.states(low_pass=tau != 0)
    processes = [moving.get(name) for name in PARAMETERS["cubic"]]
    return _core.FilterSetup(
        system=choice.system,
        form=choice.form,
        interpolation=choice.interpolation,
        integrator=choice.integrator,
        order=str(choice.order),
        carrier=choice.carrier,
        consider=[states.index(name) for name in choice.consider],
        q=q,
        q_output=q_accel or 0.0,
        tau=tau,
        gauss_markov=[rate_and_density(w) for w in processes],
        r_position=r_position,
        r_output=r_accel or 0.0,
        gate=math.inf if gate is None else gate,
        kernel=choice.kernel,
    )


def core_prior(names: tuple[str, ...], x0: ArrayLike, P0: ArrayLike) -> tuple[Array, Array]:
    x = np.ascontiguousarray(x0, dtype=np.float64)
    P = np.ascontiguousarray(P0, dtype=np.float64)
    n = len(names)
    if x.shape != (n,) or P.shape != (n, n):
        raise AccelcalError(f"x0 {x.shape} and P0 {P.shape} do not fit the {n} states {', '.join(names)}.")
    return x, P


def core_samples(channel: Channel) -> tuple[Array, Array]:
    """Contiguous stamps and samples; no copy if they are."""
    return np.ascontiguousarray(channel.t, dtype=np.float64), np.ascontiguousarray(channel.y, dtype=np.float64)


def rate_and_density(process: GaussMarkov | None) -> tuple[float, float]:
    """1/tau and q as the core takes them."""
    return (0.0, 0.0) if process is None else (1.0 / process.tau, process.q)
