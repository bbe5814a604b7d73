"""Recordings that disagree: whether the parameters that all runs share have one value in all of them."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal._support.values import immutable
from accelcal.data import Array
from accelcal.diagnosis.policy import HOMOGENEITY_ALPHA
from accelcal.diagnosis.search.homogeneity import different
from accelcal.estimation.gauss_newton import PER_RUN_OWNERS
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.rows import inverse, normal_equations
from accelcal.estimation.run_state import RunState
from accelcal.model import Model

POOLED_SHARE = 1e-4
"""Information of all runs, over what one run gets of it, so that a run that does not excite a parameter says nothing
about it."""


@immutable
@dataclass(frozen=True, slots=True, eq=False)
class RunValues:
    """Parameters that all runs share, as each run would have them alone.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> from accelcal.workflow import run_values
    >>> settings = {"seconds": 8.0, "rig": ac.simulation.CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(1)}
    >>> one, two = (ac.simulate("tones", **settings).recording for _ in range(2))
    >>> found = run_values(ac.fit([one, two]), [one, two])
    >>> found.parameters, found.value.shape
    (('bias', 'scale_factor'), (2, 2))
    """

    runs: tuple[str, ...]
    """Names of the recordings."""
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    """(runs, parameters), SI units."""
    std: Array
    """Of each, (runs, parameters)."""
    p_values: Array
    """Probability of such differences under one value for all runs, times the number of parameters, at most 1,
    (parameters,)."""

    def __repr__(self) -> str:
        p = ", ".join(f"{name} p {p:.2g}" for name, p in zip(self.parameters, self.p_values, strict=True))
        return f"RunValues({', '.join(self.runs)}: {p})"


def values_by_run(states: Sequence[RunState], model: Model, explained: Sequence[str] = ()) -> RunValues | None:
    """The shared parameters in each run; None where there is one run alone, or nothing is shared.

    Parameters
    ----------
    states : fitted runs.
    model : that they were fitted with.
    explained : parameters whose differences have a cause already.

    Notes
    -----
    Each run is one Gauss-Newton step from the common estimate. Its variances are those of the noise model, or of the
    scatter of block scores if that is larger; p is that of chi-square over the runs, times the number of parameters.
    """
    terms = [
        term
        for term in model.free
        if term.owner not in PER_RUN_OWNERS and term.name not in {*model.per_run, *explained}
    ]
    owned = [term for term in model.free if term not in terms]
    if len(states) < 2 or not terms:
        return None
    normals = [normal_equations(state, [*terms, *owned], scatter=True) for state in states]
    pooled = POOLED_SHARE * np.sum([normal.gram for normal in normals], axis=0)
    value, variance = np.empty((len(states), len(terms))), np.empty((len(states), len(terms)))
    for r, (state, normal) in enumerate(zip(states, normals, strict=True)):
        covariance = inverse(normal.gram + pooled)
        wider = covariance if normal.spread is None else covariance @ normal.spread @ covariance
        shared = slice(0, len(terms))
        at = np.array([state.values.by_name[term.name] for term in terms])
        value[r] = at + (covariance @ normal.score)[shared]
        variance[r] = np.maximum(np.diag(covariance), np.diag(wider))[shared]
    return RunValues(
        runs=tuple(state.run.recording.name or f"recording {r + 1}" for r, state in enumerate(states)),
        parameters=tuple(term.name for term in terms),
        units=tuple(term.unit for term in terms),
        value=value,
        std=np.sqrt(variance),
        p_values=np.minimum(1.0, len(terms) * different(value, 1.0 / variance)),
    )


def runs_disagree(found: RunValues | None) -> Iterator[Remark]:
    """Recording in which a shared parameter has another value; no remark where all agree."""
    k = 0 if found is None else int(np.argmin(found.p_values))
    if found is not None and found.p_values[k] <= HOMOGENEITY_ALPHA:
        value = found.value[:, k]
        r, others, sigma = odd_one_out(value, found.std[:, k] ** 2)
        yield remark(
            "runs_disagree",
            parameter=found.parameters[k],
            recording=found.runs[r],
            value=float(f"{value[r]:.4g}"),
            others=float(f"{others:.4g}"),
            sigma=sigma,
            p=float(found.p_values[k]),
        )


def odd_one_out(value: Array, variance: Array) -> tuple[int, float, float]:
    """The run that departs most from the mean of the others, that mean, and by how many standard deviations."""
    found = (0, 0.0, -1.0)
    for r in range(len(value)):
        rest = np.arange(len(value)) != r
        weight = 1.0 / variance[rest]
        mean = float(weight @ value[rest] / np.sum(weight))
        sigma = abs(float(value[r]) - mean) / float(np.sqrt(variance[r] + 1.0 / np.sum(weight)))
        found = max(found, (r, mean, sigma), key=lambda one: one[2])
    return found
