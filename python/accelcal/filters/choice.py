"""Choice of a live filter: system, sensor form, order, integrator, interpolation, covariance form."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike

from accelcal import _core
from accelcal._support.arguments import check_fields
from accelcal._support.errors import AccelcalError
from accelcal._support.values import immutable, short_repr
from accelcal.data import Array, Channel

MOTION = {"aci": ("p", "v"), "cwpa": ("p", "v", "a")}
PARAMETERS = {"linear": ("k", "K0"), "cubic": ("k", "K0", "K2", "K3")}

STATE_UNITS = {
    **{"p": "m", "v": "m/s", "a": "m/s²", "y": "m/s²"},
    **{"k": "1", "K0": "m/s²", "K2": "(m/s²)⁻¹", "K3": "(m/s²)⁻²"},
}
"""Unit of every state, by its name."""


@immutable
@short_repr
@dataclass(frozen=True, slots=True)
class FilterChoice:
    """A system, a sensor model, and the five choices that are independent of them.

    Examples
    --------
    >>> FilterChoice("cwpa", "cubic", order=2).states()
    ('p', 'v', 'a', 'k', 'K0', 'K2', 'K3')
    """

    system: Literal["aci", "cwpa"] = "aci"
    """ACI: the output drives the motion (9). CWPA: white jerk, the output is a reading (10)."""
    model: Literal["linear", "cubic"] = "linear"
    """Parameters k, K0, or k, K0, K2, K3."""
    form: Literal["inverse", "forward"] = "forward"
    """Forward: the output is a polynomial of acceleration (3)(4). Inverse: the other way round (5)(6)."""
    interpolation: Literal["hold", "linear", "cubic"] = "linear"
    """The output between its samples; without effect in CWPA."""
    integrator: Literal["rk2", "rk4", "exact"] = "exact"
    """RK2 and RK4 on the coupled equations (11)-(14), which fail where a variance is lost; or no integration error."""
    order: Literal[1, 2] = 1
    """First- or second-order filter."""
    carrier: Literal["dense", "factored"] = "dense"
    """Covariance in Joseph form, or as U D U', which no prior and no rate can make indefinite."""
    kernel: Literal["structured", "dense"] = "structured"
    """How the steps are computed: in blocks where the other choices have a structured kernel, or with whole matrices.

    The same filter up to rounding (1e-10 sigma). Smoothing, UD factors, a low-pass in CWPA and consider parameters
    always run dense.
    """
    consider: tuple[str, ...] = ()
    """Parameters that are not estimated while their uncertainty counts: the Schmidt-Kalman filter (derivations 5.2).

    They keep the mean and the variance of the prior (moved by a `GaussMarkov` process, if they have one); gains and
    covariance of all other states account for them. Joseph form only: `run` without smoothing and `LiveFilter`.
    """

    corrected: bool = False
    """Take out of the estimate what the noise of the output does as it is in the gradient, too (derivations 3.5).

    ACI without integration error on UD factors only; the published filters do without.
    """

    scores: bool = False
    """Whiten the innovations, too, for a monitor (derivations 6.18); it takes twice the time."""

    def __post_init__(self) -> None:
        check_fields(self)
        if self.scores and not self.corrected:
            raise AccelcalError("scores: choose corrected=True, too.")
        needed = (self.system, self.integrator, self.carrier) == ("aci", "exact", "factored")
        if self.corrected and not needed:
            raise AccelcalError('corrected: choose system="aci", integrator="exact" and carrier="factored".')
        unknown = [name for name in self.consider if name not in PARAMETERS[self.model]]
        if unknown:
            raise AccelcalError(f"consider: {', '.join(unknown)} not in the {self.model} model.")
        if self.consider and self.carrier != "dense":
            raise AccelcalError('consider: UD factors have no such update; choose carrier="dense".')

    def refuse_consider(self, where: str) -> None:
        """Raise where consider parameters have no implementation.

        Raises
        ------
        ValueError
            If there are any; `where` begins the sentence.
        """
        if self.consider:
            raise AccelcalError(
                f"{where} estimates every parameter; consider {', '.join(self.consider)} in run or LiveFilter."
            )

    def states(self, *, low_pass: bool = False) -> tuple[str, ...]:
        """Names of the states in order; a low-pass adds its output y to CWPA."""
        filtered = ("y",) if low_pass and self.system == "cwpa" else ()
        return (*MOTION[self.system], *filtered, *PARAMETERS[self.model])


@dataclass(frozen=True, slots=True)
class GaussMarkov:
    """How a parameter moves: theta' = -theta / tau + white noise of two-sided density q (paper II-D)."""

    q: float
    """Unit of the parameter squared per second."""
    tau: float = math.inf
    """Correlation time, s; infinite for a random walk."""

    def __post_init__(self) -> None:
        if not self.tau > 0:
            raise AccelcalError(f"GaussMarkov: tau = {self.tau:g} s is not positive.")


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


POWER = {"K0": 0, "k": 1, "K2": 2, "K3": 3}
"""Power of the specific force that each parameter multiplies."""


def to_stage(names: Sequence[str], polarity: float, gravity: float) -> Array:
    """Matrix from the sensor's parameters to those of a level, normally mounted sensor, (m, m).

    The output is sum c_n f^n with f = polarity (a + gravity), so polarity * output - gravity is a polynomial of the
    acceleration a of the stage, whose coefficients are the binomial sums of polarity^(n+1) c_n gravity^(n-i).

    Parameters
    ----------
    names : of the parameters, of `POWER`.
    gravity : specific force at rest along the stage axis, m/s².
    """
    return np.array(
        [
            [_share(POWER[row], POWER[column], gravity) * polarity ** (POWER[column] + 1) for column in names]
            for row in names
        ]
    )


def _share(i: int, n: int, gravity: float) -> float:
    """Coefficient of a^i in (a + gravity)^n."""
    return math.comb(n, i) * gravity ** (n - i) if n >= i else 0.0


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
        correction="scores" if choice.scores else "estimate" if choice.corrected else "none",
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
