"""A live filter that takes samples and readings one by one, in the order of their time stamps."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import NamedTuple, NoReturn

import numpy as np
from numpy.typing import ArrayLike

from accelcal import _core
from accelcal._support.errors import AccelcalError
from accelcal.data import Array, Flags
from accelcal.filters.choice import FilterChoice, GaussMarkov, core_prior, core_setup, rate_and_density


class Readings(NamedTuple):
    """Position readings that a filter took in, and how many events it refused."""

    table: Array
    """(n, 12) what the properties name, a reading a row."""
    refused: int = 0
    refusal: str = ""
    """Why the last of them was refused."""

    @classmethod
    def of(cls, rows: Sequence[Sequence[float]]) -> Readings:
        """Readings of rows of twelve numbers, or of none."""
        return cls(np.asarray(rows, dtype=np.float64).reshape(-1, 12))

    @property
    def t(self) -> Array:
        """(n,) stamps, s."""
        return self.table[:, 0]

    @property
    def position(self) -> Array:
        """(n,) values, m."""
        return self.table[:, 1]

    @property
    def e(self) -> Array:
        """(n,) innovations, reading minus expectation, m."""
        return self.table[:, 2]

    @property
    def variance(self) -> Array:
        """(n,) of the innovations as the filter expects it, m²."""
        return self.table[:, 3]

    @property
    def white(self) -> Array:
        """(n,) what the innovations before do not predict, m: `e` of a filter without the correction."""
        return self.table[:, 4]

    @property
    def white_variance(self) -> Array:
        """(n,) of that, m²."""
        return self.table[:, 5]

    @property
    def reading_share(self) -> Array:
        """(n,) of the noise of the readings in that variance, 1."""
        return self.table[:, 6]

    @property
    def slopes(self) -> Array:
        """(n, 2) of the log-likelihood by scale factor and bias, per unit; zero of a filter without the correction."""
        return self.table[:, 7:9]

    @property
    def informations(self) -> Array:
        """(n, 3) variances of the slopes, and their covariance."""
        return self.table[:, 9:12]


@dataclass(slots=True)
class LiveFilter:
    """The filter of `run` as a stream: one sample per step, results equal to the last bit.

    Give samples in time order, the accelerometer first at a tie. ACI with interpolation waits for the future it needs
    (linear: one output sample, cubic: two) and lags by as much; `finish` processes what is queued. Where a step fails,
    estimate and covariance are left as they were before it and its sample is dropped. Settings are those of `run`.

    Examples
    --------
    >>> import numpy as np
    >>> live = LiveFilter(
    ...     FilterChoice(), q=1e-6, r_position=1e-12, x0=np.zeros(4), P0=np.diag([1e-6, 1e-6, 1e-2, 1e-1])
    ... )
    >>> for k in range(100):
    ...     _ = live.step(0.001 * k, accel=0.05, position=0.0)
    >>> live.names
    ('p', 'v', 'k', 'K0')
    """

    choice: FilterChoice
    q: float = field(kw_only=True)
    r_position: float = field(kw_only=True)
    r_accel: float | None = field(default=None, kw_only=True)
    q_accel: float | None = field(default=None, kw_only=True)
    x0: ArrayLike = field(kw_only=True)
    P0: ArrayLike = field(kw_only=True)
    tau: float = field(default=0.0, kw_only=True)
    parameters: Mapping[str, GaussMarkov] | None = field(default=None, kw_only=True)
    gate: float | None = field(default=None, kw_only=True)
    _stream: _core.FilterStream = field(init=False, repr=False)

    def __post_init__(self) -> None:
        setup = core_setup(
            self.choice, self.q, self.r_position, self.r_accel, self.q_accel, self.tau, self.parameters, self.gate
        )
        self._stream = _core.FilterStream(setup, *core_prior(self.names, self.x0, self.P0))

    def __reduce__(self) -> NoReturn:
        raise TypeError("a LiveFilter is a running filter and cannot be pickled or copied: give its state to a new one")

    def step(self, t: float, *, accel: float | None = None, position: float | None = None) -> float | None:
        """Process a measurement at `t` (s): accel in m/s², position in m, or both.

        Returns the newest innovation this led to, or None if no reading could be processed yet.
        """
        e = None if accel is None else self._stream.output(t, accel)
        later = None if position is None else self._stream.position(t, position)
        return e if later is None else later

    def feed(self, t: Array, output: Flags, value: Array) -> Readings:
        """Process many measurements at once, in their order; one that is refused leaves the filter as it was.

        Parameters
        ----------
        t : (n,) stamps, s.
        output : (n,) whether each is one of the accelerometer, m/s², or of the position, m.
        value : (n,) the measurements.
        """
        return Readings(*self._stream.feed(t, output, value))

    def finish(self) -> Readings:
        """Process what is still queued, as at the end of a record."""
        return Readings(self._stream.finish())

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
    parameters: Mapping[str, GaussMarkov] | None = None,
    gate: float | None = None,
) -> _core.FixedRateFilter:
    """A filter for a control loop: one sample per call, no allocation, state copied on request only.

    `step(u)` or `step(u, z)` takes in the output (m/s²) and, where the encoder was read, the position (m) of the next
    sample, and returns the innovation or None. `run(u, z)` processes a whole record, (n,) each and NaN where position
    was not read, with results equal to the last bit; it fills `states` (n, N), `variances` (n, N), `innovations` (n,)
    and `innovation_variances` (n,) if the caller gives arrays for them. `x`, `covariance`, `innovation`,
    `innovation_variance`, `nis`, `score` (of `choice.scores`), `log_likelihood`, `rejected` and `samples` are
    properties; `read` copies states and variances into arrays of the caller's.

    Parameters
    ----------
    dt : float
        Time between samples, s. The prior belongs to the first one, which is read like all others.

    Other parameters are those of `run`. Nothing waits for a later sample: a cubic goes through the last four. UD
    factors in CWPA or without the exact integrator, a low-pass in CWPA, and consider parameters are refused. States and
    variances are checked at every step.

    Raises
    ------
    ValueError
        What this filter cannot do.
    FilterError
        Unusable settings; `step` and `run` raise it where a step fails, and leave the filter as it was before it.
        Where a variance was lost, the sentence says rate, prior and what to choose instead.

    Examples
    --------
    >>> choice = FilterChoice("aci", "linear", integrator="rk4")
    >>> live = fixed_rate(choice, dt=1e-3, q=1e-6, r_position=1e-12, x0=[0.0] * 4, P0=np.eye(4))
    >>> live.step(0.1, 0.0), live.step(0.1), live.samples
    (0.0, None, 2)
    """
    choice.refuse_consider("fixed_rate")
    setup = core_setup(choice, q, r_position, r_accel, None, tau, parameters, gate)
    if choice.carrier == "factored" and (choice.system != "aci" or choice.integrator != "exact"):
        raise AccelcalError('fixed_rate: UD factors are those of aci with integrator="exact"; use LiveFilter.')
    if choice.system == "cwpa" and tau != 0:
        raise AccelcalError("fixed_rate: CWPA behind a low-pass has no structured kernel; use LiveFilter, or aci.")
    return _core.FixedRateFilter(setup, *core_prior(choice.states(), x0, P0), dt)


MOST_EFFECTS = 14
"""Effects that the compiled filter has room for in addition to k and K0."""


FACTORED = FilterChoice("aci", "linear", interpolation="cubic", carrier="factored", corrected=True)
"""First order, no integration error, UD factors, corrected for errors in variables: what runs live unless chosen
otherwise."""


def fixed_rate_with_effects(
    *,
    dt: float,
    q: float,
    r_position: float,
    x0: ArrayLike,
    P0: ArrayLike,
    rest: float = 0.0,
    tau: float = 0.0,
    parameters: Sequence[GaussMarkov | None] | None = None,
    choice: FilterChoice = FACTORED,
    gate: float | None = None,
    watch: tuple[list[float], int] | None = None,
) -> _core.FixedRateFilter:
    """ACI with a forward linear sensor and m effects whose columns the caller gives at every step.

    u = K0 + (1 + k) (p'' + rest) + sum c_j e_j, z = p + tau v + sum c_j b_j; states p, v, k, K0, c_1 ... c_m. No
    integration error, and a covariance in UD factors that cannot lose positive definiteness, unless chosen otherwise.
    `step_with_effects(u, z, columns, position_columns)` takes e_j per unit of c_j at the sample before, half-way
    and at this one, (3, m) m/s², and b_j at this one, (m,) m; `slopes`, (m,) de_j/du, let the correction for errors in
    variables reach effects that follow from the output; all else is as in `fixed_rate`, a cubic between samples.

    Parameters
    ----------
    rest : float
        Specific force at rest, m/s².
    parameters : sequence of GaussMarkov or None
        How k, K0, c_1 ... c_m move, (m + 2,); None where one is constant.

    choice : FilterChoice
        Order, integrator and carrier count: system, sensor and interpolation are given. RK4 needs the dense carrier.

    watch : tuple
        Typical sizes of J suspects, SI, and the samples of the shortest stretch; `step_with_effects` then takes m + J
        columns, those of suspects last, and `evidence` is (J, 6): logarithm of the e-value, size, its standard
        deviation, time since the likeliest start (s), score and information. It needs `choice.scores`.

    Other parameters are those of `fixed_rate`.

    Raises
    ------
    ValueError
        More than 14 effects, shapes that do not fit, or RK4 with UD factors.
    FilterError
        Unusable settings.
    """
    x = np.ascontiguousarray(x0, dtype=np.float64)
    m = len(x) - 4
    if not 0 <= m <= MOST_EFFECTS:
        raise AccelcalError(f"x0 has {len(x)} states; p, v, k, K0 and up to {MOST_EFFECTS} effects are possible.")
    names = ("p", "v", "k", "K0", *(f"c_{j}" for j in range(1, m + 1)))
    processes = [None] * (m + 2) if parameters is None else list(parameters)
    if len(processes) != m + 2:
        raise AccelcalError(f"parameters: {len(processes)} given for {m + 2}, {', '.join(names[2:])}.")
    choice.refuse_consider("fixed_rate_with_effects")
    if choice.carrier == "factored" and choice.integrator != "exact":
        raise AccelcalError('fixed_rate_with_effects: UD factors need integrator="exact".')
    if watch is not None and watch[0] and not choice.scores:
        raise AccelcalError("fixed_rate_with_effects: a watch follows whitened innovations, scores=True of the choice.")
    choice = replace(choice, system="aci", model="linear", form="forward", interpolation="cubic")
    setup = core_setup(choice, q, r_position, None, None, tau, None, gate)
    effects = (rest, [rate_and_density(w) for w in processes])
    return _core.FixedRateFilter(setup, *core_prior(names, x, P0), dt, effects, watch)
