"""A live filter that takes samples and readings one by one, in the order of their time stamps."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NoReturn

from numpy.typing import ArrayLike

from accelcal import _core
from accelcal.data.arrays import Array
from accelcal.filters.choice import FilterChoice, GaussMarkov
from accelcal.filters.core_settings import core_prior, core_setup


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

    def finish(self) -> float | None:
        """Process what is still queued, as at the end of a record."""
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
