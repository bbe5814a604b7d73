"""The live filters: accelerometer parameters estimated recursively from position.

Five independent choices make a filter (paper II-B, II-E, II-G): the sensor's form, the interpolation of its output, the
integrator, the order and the carrier of the covariance. The same compiled steps serve a record (`run`) and a stream
(`LiveFilter`), so both give the same bits.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike, NDArray

from accelcal import _core
from accelcal._core import FilterError
from accelcal.recording import Channel

__all__ = [
    "BatchRun",
    "FilterChoice",
    "FilterError",
    "FilterRun",
    "ForwardParameters",
    "LiveFilter",
    "Wander",
    "fixed_rate",
    "fixed_rate_with_effects",
    "forward_parameters",
    "run",
    "run_batch",
]

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]

MOTION = {"aci": ("p", "v"), "cwpa": ("p", "v", "a")}
PARAMETERS = {"linear": ("k", "K0"), "cubic": ("k", "K0", "K2", "K3")}


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
    """RK2 and RK4 on the coupled equations (11)-(14), or no integration error."""
    order: Literal[1, 2] = 1
    """First- or second-order filter."""
    carrier: Literal["dense", "factored"] = "dense"
    """Covariance in Joseph form, or as U D U'."""
    kernel: Literal["structured", "dense"] = "structured"
    """How the steps are computed: in blocks where the other choices have a structured kernel, or with whole matrices.

    The same filter up to rounding (1e-10 sigma). Smoothing, UD factors and a low-pass in CWPA always run dense.
    """

    def states(self, *, low_pass: bool = False) -> tuple[str, ...]:
        """Names of the states in order; a low-pass adds its output y to CWPA."""
        filtered = ("y",) if low_pass and self.system == "cwpa" else ()
        return (*MOTION[self.system], *filtered, *PARAMETERS[self.model])


@dataclass(frozen=True, slots=True)
class Wander:
    """How a parameter moves: theta' = -theta / tau + white noise of two-sided density q (paper II-D)."""

    q: float
    """Unit of the parameter squared per second."""
    tau: float = math.inf
    """Correlation time, s; infinite for a random walk."""

    def __post_init__(self) -> None:
        if not self.tau > 0:
            raise ValueError(f"Wander: tau = {self.tau:g} s is not positive.")


@dataclass(frozen=True, slots=True, eq=False)
class FilterRun:
    """What a filter made of one record: one row per event, n events, N states."""

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
    rejections: NDArray[np.intp]
    """Indices of the readings that the gate rejected."""
    covariance: Array
    """(N, N) SI: the whole covariance after the last event."""
    log_likelihood: float
    """Sum of -(e²/S + ln 2 pi S)/2 over the readings taken in."""
    smoothed_states: Array | None = None
    """(n, N) SI: estimates given the whole record, if asked for."""
    smoothed_variances: Array | None = None
    """(n, N) SI."""

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
    parameters: Mapping[str, Wander] | None = None,
    gate: float | None = None,
    smooth: bool = False,
) -> FilterRun:
    """Run a filter over one record.

    Channels keep their own clocks; readings are taken in at their own instants. Outside the accelerometer's record its
    nearest sample is held.

    Parameters
    ----------
    choice : FilterChoice
    accel : Channel
        Output, (n_u,) m/s²; two samples or more.
    position : Channel
        Encoder, (n_z,) m; one sample or more.
    q : float
        Two-sided density of the process noise. ACI: of the output, (m/s²)² s, N²/2 for a one-sided density N.
        CWPA: of the jerk, m²/s⁵.
    r_position : float
        Variance of a position reading, m².
    r_accel : float
        Variance of an accelerometer reading, (m/s²)². CWPA only, and required there.
    q_accel : float
        Two-sided density of the noise in front of the low-pass, (m/s²)² s. CWPA with `tau` only, and required there.
    x0, P0 : array_like
        (N,) and (N, N): the prior at the first event, in the order of `choice.states`.
    tau : float
        Time constant of a single-pole low-pass in front of the output, s. CWPA carries the filtered output as a state;
        ACI reads p + tau v.
    parameters : mapping of str to Wander
        Parameters that are not constant.
    gate : float
        Reject readings with e²/S above this (6.63: 99 %, 10.83: 99.9 %). None by default; never gate while parameters
        converge.
    smooth : bool
        Also estimate every state from the whole record.

    Raises
    ------
    FilterError
        Unusable settings or record (`event` is None), or a step that failed at `event`, `t`: among them RK2 losing
        positive definiteness, `kind` "Variance", "Correlation" or "InnovationVariance".
    """
    setup = _setup(choice, q, r_position, r_accel, q_accel, tau, parameters, gate)
    names = choice.states(low_pass=tau != 0)
    rows = _core.run_filter(setup, *_prior(names, x0, P0), _samples(accel), _samples(position), smooth)
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
    """Per run: why its numbers are not to be used, or None."""


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
    parameters: Mapping[str, Wander] | None = None,
    threads: int = 1,
) -> BatchRun:
    """Run one filter over many uniform records, several at a time on the processor's vector unit.

    The answer does not depend on lanes and threads, but for rounding. Dense Joseph carrier only, no gate.

    Parameters
    ----------
    accel, position : array_like
        (r, n) m/s² and m, one row per run on one clock; a single row serves all runs. NaN: not measured (position, and
        accel in CWPA).
    dt : float
        Time between samples, s. The prior belongs to sample 0, which is read like all others.
    x0, P0 : array_like
        (N,) or (r, N), and (N, N) or (r, N, N).
    threads : int
        Workers; the interpreter is released meanwhile.

    Other parameters are those of `run`.

    Raises
    ------
    FilterError
        Unusable settings or records. A run that fails on its way is reported in `faults`.
    """
    if choice.carrier != "dense":
        raise ValueError("run_batch: the factored carrier runs one record at a time; use run.")
    setup = _setup(choice, q, r_position, r_accel, None, tau, parameters, None)
    names = choice.states()
    n = len(names)
    u, z = (np.ascontiguousarray(np.atleast_2d(a), dtype=np.float64) for a in (accel, position))
    x = np.ascontiguousarray(np.atleast_2d(x0), dtype=np.float64)
    P = np.ascontiguousarray(P0, dtype=np.float64).reshape(-1, n * n)
    runs = max(len(u), len(z), len(x), len(P))
    if u.shape[1] != z.shape[1] or x.shape[1] != n or any(len(a) not in {1, runs} for a in (u, z, x, P)):
        raise ValueError(
            f"run_batch: accel {u.shape}, position {z.shape}, x0 {x.shape} and P0 {P.shape} do not fit {runs} runs of "
            f"the {n} states {', '.join(names)}."
        )
    states, covariances, log_likelihoods, faults = _core.run_filter_batch(setup, x, P, u, z, dt, runs, threads)
    return BatchRun(choice, names, states, covariances.reshape(-1, n, n), log_likelihoods, tuple(faults))


@dataclass(slots=True)
class LiveFilter:
    """The same filter as a stream: one sample per step, the same bits as `run`.

    Give samples in time order, the accelerometer first at a tie. ACI with interpolation waits for the future it needs
    (linear: one output sample, cubic: two) and lags by as much; `finish` processes what waits. Settings are those of
    `run`.
    """

    choice: FilterChoice
    q: float = field(kw_only=True)
    r_position: float = field(kw_only=True)
    r_accel: float | None = field(default=None, kw_only=True)
    q_accel: float | None = field(default=None, kw_only=True)
    x0: ArrayLike = field(kw_only=True)
    P0: ArrayLike = field(kw_only=True)
    tau: float = field(default=0.0, kw_only=True)
    parameters: Mapping[str, Wander] | None = field(default=None, kw_only=True)
    gate: float | None = field(default=None, kw_only=True)
    _stream: _core.FilterStream = field(init=False, repr=False)

    def __post_init__(self) -> None:
        setup = _setup(
            self.choice, self.q, self.r_position, self.r_accel, self.q_accel, self.tau, self.parameters, self.gate
        )
        self._stream = _core.FilterStream(setup, *_prior(self.names, self.x0, self.P0))

    def step(self, t: float, *, accel: float | None = None, position: float | None = None) -> float | None:
        """Take in what was measured at `t` (s): accel in m/s², position in m, or both.

        Returns the newest innovation this led to, or None if no reading could be processed yet.
        """
        e = None if accel is None else self._stream.output(t, accel)
        later = None if position is None else self._stream.position(t, position)
        return e if later is None else later

    def finish(self) -> float | None:
        """Process what still waits, as at the end of a record."""
        return self._stream.finish()

    @property
    def names(self) -> tuple[str, ...]:
        """(N,) names of the states."""
        return self.choice.states(low_pass=self.tau != 0)

    @property
    def time(self) -> float | None:
        """Instant of the estimate, s; None before the first sample."""
        return self._stream.t

    @property
    def estimate(self) -> Array:
        """(N,) SI."""
        return self._stream.x

    @property
    def covariance(self) -> Array:
        """(N, N) SI."""
        return self._stream.covariance

    @property
    def log_likelihood(self) -> float:
        """Of the readings taken in so far."""
        return self._stream.log_likelihood

    @property
    def rejected(self) -> int:
        """How many readings the gate rejected."""
        return self._stream.rejected

    @property
    def waiting(self) -> int:
        """How many samples wait for the next output sample."""
        return self._stream.waiting


def fixed_rate(
    choice: FilterChoice,
    *,
    dt: float,
    q: float,
    r_position: float,
    r_accel: float | None = None,
    x0: ArrayLike,
    P0: ArrayLike,
    tau: float = 0.0,
    parameters: Mapping[str, Wander] | None = None,
    gate: float | None = None,
) -> _core.FixedRateFilter:
    """A filter for a control loop: one sample per call, nothing allocated, the state read only when it is wanted.

    `step(u)` or `step(u, z)` takes in the output (m/s²) and, where the encoder was read, the position (m) of the next
    sample, and returns the innovation or None. `run(u, z)` takes a whole record in, (n,) each and NaN where position
    was not read, to the same bits; it fills `states` (n, N), `variances` (n, N), `innovations` (n,) and
    `innovation_variances` (n,) if the caller gives arrays for them. `x`, `covariance`, `innovation`,
    `innovation_variance`, `nis`, `log_likelihood`, `rejected` and `samples` are properties; `read` copies states and
    variances into arrays of the caller's.

    Parameters
    ----------
    dt : float
        Time between samples, s. The prior belongs to the first one, which is read like all others.

    Other parameters are those of `run`. Nothing waits for a later sample: a cubic goes through the last four. UD
    factors and a low-pass in CWPA are refused.

    Raises
    ------
    ValueError
        What this filter cannot do.
    FilterError
        Unusable settings; `step` and `run` raise it where a step fails, and leave the filter as it was before it.

    Examples
    --------
    >>> choice = FilterChoice("aci", "linear", integrator="rk4")
    >>> live = fixed_rate(choice, dt=1e-3, q=1e-6, r_position=1e-12, x0=[0.0] * 4, P0=np.eye(4))
    >>> live.step(0.1, 0.0), live.step(0.1), live.samples
    (0.0, None, 2)
    """
    setup = _setup(choice, q, r_position, r_accel, None, tau, parameters, gate)
    if choice.carrier != "dense":
        raise ValueError("fixed_rate: UD factors run from event to event; use LiveFilter.")
    if choice.system == "cwpa" and tau != 0:
        raise ValueError("fixed_rate: CWPA behind a low-pass has no structured kernel; use LiveFilter, or aci.")
    return _core.FixedRateFilter(setup, *_prior(choice.states(), x0, P0), dt)


MOST_EFFECTS = 14
"""Effects that the compiled filter has room for beside k and K0."""


def fixed_rate_with_effects(
    *,
    dt: float,
    q: float,
    r_position: float,
    x0: ArrayLike,
    P0: ArrayLike,
    rest: float = 0.0,
    tau: float = 0.0,
    parameters: Sequence[Wander | None] | None = None,
    order: Literal[1, 2] = 1,
    gate: float | None = None,
) -> _core.FixedRateFilter:
    """ACI with a forward linear sensor and m effects whose columns the caller gives at every step.

    u = K0 + (1 + k) (p'' + rest) + sum c_j e_j, z = p + tau v + sum c_j b_j; states p, v, k, K0, c_1 ... c_m; RK4.
    `step_with_effects(u, z, columns, leaning)` takes e_j per unit of c_j at the sample before, half-way and at this
    one, (3, m) m/s², and b_j at this one, (m,) m; everything else is as in `fixed_rate`, a cubic between samples.

    Parameters
    ----------
    rest : float
        Specific force while the stage stands still, m/s².
    parameters : sequence of Wander or None
        How k, K0, c_1 ... c_m move, (m + 2,); None where one is constant.

    Other parameters are those of `fixed_rate`.

    Raises
    ------
    ValueError
        More than 14 effects, or shapes that do not fit.
    FilterError
        Unusable settings.
    """
    x = np.ascontiguousarray(x0, dtype=np.float64)
    m = len(x) - 4
    if not 0 <= m <= MOST_EFFECTS:
        raise ValueError(f"x0 has {len(x)} states; p, v, k, K0 and up to {MOST_EFFECTS} effects are possible.")
    names = ("p", "v", "k", "K0", *(f"c_{j}" for j in range(1, m + 1)))
    wander = [None] * (m + 2) if parameters is None else list(parameters)
    if len(wander) != m + 2:
        raise ValueError(f"parameters: {len(wander)} given for {m + 2}, {', '.join(names[2:])}.")
    choice = FilterChoice("aci", "linear", interpolation="cubic", integrator="rk4", order=order)
    setup = _setup(choice, q, r_position, None, None, tau, None, gate)
    return _core.FixedRateFilter(setup, *_prior(names, x, P0), dt, (rest, [_rate_and_density(w) for w in wander]))


def _rate_and_density(wander: Wander | None) -> tuple[float, float]:
    """1/tau and q as the core takes them."""
    return (0.0, 0.0) if wander is None else (1.0 / wander.tau, wander.q)


def forward_parameters(run: FilterRun) -> ForwardParameters:
    """Map the estimate at the end of a run to the forward model (4), with its covariance.

    An inverse estimate travels through K2 = -K2'/s'³, K3 = (2 K2'² - s' K3')/s'⁵, s' = 1 - k' (physics 2.3), its
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


def _setup(
    choice: FilterChoice,
    q: float,
    r_position: float,
    r_accel: float | None,
    q_accel: float | None,
    tau: float,
    parameters: Mapping[str, Wander] | None,
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
            raise ValueError(f"{choice.system} with tau = {tau:g} s {verb} {name}.")
    wandering = dict(parameters or {})
    unknown = set(wandering) - set(PARAMETERS[choice.model])
    if unknown:
        raise ValueError(f"parameters: {sorted(unknown)} are not in the {choice.model} model.")
    wander = [wandering.get(name) for name in PARAMETERS["cubic"]]
    return _core.FilterSetup(
        system=choice.system,
        form=choice.form,
        interpolation=choice.interpolation,
        integrator=choice.integrator,
        order=str(choice.order),
        carrier=choice.carrier,
        q=q,
        q_output=q_accel or 0.0,
        tau=tau,
        wander=[_rate_and_density(w) for w in wander],
        r_position=r_position,
        r_output=r_accel or 0.0,
        gate=math.inf if gate is None else gate,
        kernel=choice.kernel,
    )


def _prior(names: tuple[str, ...], x0: ArrayLike, P0: ArrayLike) -> tuple[Array, Array]:
    x = np.ascontiguousarray(x0, dtype=np.float64)
    P = np.ascontiguousarray(P0, dtype=np.float64)
    n = len(names)
    if x.shape != (n,) or P.shape != (n, n):
        raise ValueError(f"x0 {x.shape} and P0 {P.shape} do not fit the {n} states {', '.join(names)}.")
    return x, P


def _samples(channel: Channel) -> tuple[Array, Array]:
    """Contiguous stamps and samples; no copy if they are."""
    return np.ascontiguousarray(channel.t, dtype=np.float64), np.ascontiguousarray(channel.y, dtype=np.float64)
