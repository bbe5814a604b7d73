"""Run a live filter over a whole record, or over many records at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike

from accelcal import _core
from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import immutable
from accelcal.data import Array, Channel, Counts, Flags
from accelcal.data.arrays import copied
from accelcal.filters.choice import PARAMETERS, FilterChoice, GaussMarkov, core_prior, core_samples, core_setup


@immutable
@dataclass(frozen=True, slots=True, eq=False)
class FilterRun(Result):
    """Result of a filter over one record: one row per event, n events, N states.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters={}, rng=rng)
    >>> accel, position = simulated.recording.accel, simulated.recording.position
    >>> run = ac.filters.run(
    ...     ac.FilterChoice(), accel, position, q=1e-6, r_position=1e-12, x0=np.zeros(4), P0=np.eye(4)
    ... )
    >>> run.states.shape == (len(run.times), 4)
    True
    """

    choice: FilterChoice
    names: tuple[str, ...]
    """(N,) names of the states."""
    times: Array
    """(n,) s."""
    from_position: Flags
    """(n,) true where the encoder was read, false where the accelerometer was."""
    states: Array
    """(n, N) SI: estimates after each event."""
    variances: Array
    """(n, N) SI: diagonal of the covariance after each event."""
    innovations: Array
    """(n,) unit of the reading: e = z - expected; NaN where the output drove the state."""
    innovation_variances: Array
    """(n,) unit of the reading squared: S; NaN likewise."""
    rejections: Counts
    """Indices of the readings that the gate rejected."""
    covariance: Array
    """(N, N) SI: the whole covariance after the last event."""
    log_likelihood: float
    """Sum of -(e²/S + ln 2 pi S)/2 over the readings taken in; no likelihood with consider parameters."""
    smoothed_states: Array | None = None
    """(n, N) SI: estimates given the whole record, if asked for."""
    smoothed_variances: Array | None = None
    """(n, N) SI."""

    def __repr__(self) -> str:
        last = ", ".join(
            f"{name} {x:.5g} ± {math.sqrt(max(v, 0.0)):.2g}"
            for name, x, v in zip(self.names, self.states[-1], self.variances[-1], strict=True)
        )
        return f"FilterRun({self.choice.system}: {len(self.times)} events; {last})"

    @property
    def estimate(self) -> dict[str, float]:
        """The last estimate of every state, by name."""
        return dict(zip(self.names, self.states[-1].tolist(), strict=True))


@dataclass(frozen=True, slots=True, eq=False)
class ForwardParameters:
    """Parameters in the forward sense (4), whichever form was estimated."""

    names: tuple[str, ...]
    values: Array
    """(m,) SI."""
    covariance: Array
    """(m, m) SI."""


@checked
def run(
    choice: FilterChoice,
    accel: Channel,
    position: Channel,
    *,
    q: float,
    r_position: float,
    r_accel: float | None = None,
    q_accel: float | None = None,
    x0: ArrayLike,
    P0: ArrayLike,
    tau: float = 0.0,
    parameters: Mapping[str, GaussMarkov] | None = None,
    gate: float | None = None,
    smooth: bool = False,
) -> FilterRun:
    """Run a filter over one record.

    Channels keep their own clocks; readings are taken in at their own instants. Outside the accelerometer's record its
    nearest sample is held.

    Parameters
    ----------
    choice : system, sensor model and the five choices.
    accel : output, (n_u,) m/s²; two samples or more.
    position : encoder, (n_z,) m; one sample or more.
    q : two-sided density of the process noise. ACI: of the output, (m/s²)² s, N²/2 for a one-sided density N. CWPA: of
        the jerk, m²/s⁵.
    r_position : variance of a position reading, m².
    r_accel : variance of an accelerometer reading, (m/s²)². CWPA only, and required there.
    q_accel : two-sided density of the noise in front of the low-pass, (m/s²)² s. CWPA with `tau` only, and required
        there.
    x0, P0 : (N,) and (N, N): the prior at the first event, in the order of `choice.states`.
    tau : time constant of a single-pole low-pass in front of the output, s. CWPA carries the filtered output as a
        state; ACI reads p + tau v.
    parameters : those that are not constant.
    gate : reject readings with e²/S above this (6.63: 99 %, 10.83: 99.9 %). None by default; never gate while
        parameters converge.
    smooth : also estimate every state from the whole record; not with consider parameters, whose gains the backward
        recursion does not know.

    Raises
    ------
    ValueError
        Settings that the system does not need or lacks; `smooth` with consider parameters.
    FilterError
        Unusable settings or record (`event` is None), or a step that failed at `event`, `t`: among them RK2 losing
        positive definiteness, `kind` "Variance", "Correlation" or "InnovationVariance"; the sentence then says rate,
        prior and what to choose instead. With `smooth` also where the filter lost it in more than two states at once.
    """
    if smooth:
        choice.refuse_consider("run with smooth=True")
    setup = core_setup(choice, q, r_position, r_accel, q_accel, tau, parameters, gate)
    names = choice.states(low_pass=tau != 0)
    rows = _core.run_filter(setup, *core_prior(names, x0, P0), core_samples(accel), core_samples(position), smooth)
    smoothed = rows.smoothed or (None, None)
    return FilterRun(
        choice=choice,
        names=names,
        times=rows.t,
        from_position=rows.position,
        states=rows.x,
        variances=rows.variance,
        innovations=rows.e,
        innovation_variances=rows.s,
        rejections=np.flatnonzero(np.isfinite(rows.s) & ~rows.accepted),
        covariance=rows.covariance,
        log_likelihood=rows.log_likelihood,
        smoothed_states=smoothed[0],
        smoothed_variances=smoothed[1],
    )


@dataclass(frozen=True, slots=True, eq=False)
class BatchRun:
    """Where each of r runs ended; N states."""

    choice: FilterChoice
    names: tuple[str, ...]
    """(N,) names of the states."""
    states: Array
    """(r, N) SI."""
    covariances: Array
    """(r, N, N) SI."""
    log_likelihoods: Array
    """(r,)"""
    faults: tuple[str | None, ...]
    """Per run: why its numbers are not to be used (a lost variance, a NaN), or None."""


def run_batch(
    choice: FilterChoice,
    accel: ArrayLike,
    position: ArrayLike,
    *,
    dt: float,
    q: float,
    r_position: float,
    r_accel: float | None = None,
    x0: ArrayLike,
    P0: ArrayLike,
    tau: float = 0.0,
    parameters: Mapping[str, GaussMarkov] | None = None,
    threads: int = 1,
) -> BatchRun:
    """Run one filter over many uniform records, several at a time on the processor's vector unit.

    The answer does not depend on lanes and threads, but for rounding. Dense Joseph carrier only, no gate, no
    consider parameters.

    Parameters
    ----------
    accel, position : array_like
        (r, n) m/s² and m, one row per run on one clock; a single row serves all runs. NaN or masked: not measured
        (position, and accel in CWPA).
    dt : float
        Time between samples, s. The prior belongs to sample 0, which is read like all others.
    x0, P0 : array_like
        (N,) or (r, N), and (N, N) or (r, N, N).
    threads : int
        Workers; the interpreter is released meanwhile.

    Other parameters are those of `run`.

    Raises
    ------
    ValueError
        Shapes that do not fit, UD factors, consider parameters.
    FilterError
        Unusable settings or records. A run that fails on its way is reported in `faults`.
    """
    choice.refuse_consider("run_batch")
    if choice.carrier != "dense":
        raise AccelcalError("run_batch: the factored carrier runs one record at a time; use run.")
    setup = core_setup(choice, q, r_position, r_accel, None, tau, parameters, None)
    names = choice.states()
    n = len(names)
    u, z = (np.ascontiguousarray(np.atleast_2d(copied(a)), dtype=np.float64) for a in (accel, position))
    x = np.ascontiguousarray(np.atleast_2d(x0), dtype=np.float64)
    P = np.ascontiguousarray(P0, dtype=np.float64).reshape(-1, n * n)
    runs = max(len(u), len(z), len(x), len(P))
    if u.shape[1] != z.shape[1] or x.shape[1] != n or any(len(a) not in {1, runs} for a in (u, z, x, P)):
        raise AccelcalError(
            f"run_batch: accel {u.shape}, position {z.shape}, x0 {x.shape} and P0 {P.shape} do not fit {runs} runs of "
            f"the {n} states {', '.join(names)}."
        )
    states, covariances, log_likelihoods, faults = _core.run_filter_batch(setup, x, P, u, z, dt, runs, threads)
    return BatchRun(choice, names, states, covariances.reshape(-1, n, n), log_likelihoods, tuple(faults))


def forward_parameters(run: FilterRun) -> ForwardParameters:
    """Map the estimate at the end of a run to the forward model (4), with its covariance.

    An inverse estimate travels through K2 = -K2'/s'³, K3 = (2 K2'² - s' K3')/s'⁵, s' = 1 - k' (derivations 2.3), its
    covariance through the Jacobian; terms of fourth order in the output are left out. A forward estimate is returned as
    it is.
    """
    names = PARAMETERS[run.choice.model]
    m = len(names)
    values, covariance = run.states[-1, -m:], run.covariance[-m:, -m:]
    if run.choice.form == "forward":
        return ForwardParameters(names, values.copy(), covariance.copy())
    swapped, jacobian = _core.swap_form("inverse", [*values.tolist(), *[0.0] * (4 - m)])
    J = np.array(jacobian)[:m, :m]
    return ForwardParameters(names, np.array(swapped[:m]), J @ covariance @ J.T)
