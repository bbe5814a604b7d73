"""Choice of a live filter: system, sensor form, order, integrator, interpolation, covariance form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Literal

from accelcal._support.arguments import check_fields
from accelcal._support.errors import AccelcalError
from accelcal._support.values import immutable, short_repr

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

    def __post_init__(self) -> None:
        check_fields(self)
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
