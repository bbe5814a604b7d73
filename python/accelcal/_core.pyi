"""What the compiled core offers; kept by hand."""

from collections.abc import Sequence
from typing import final

import numpy as np
from numpy.typing import NDArray

_Array = NDArray[np.float64]
_Flags = NDArray[np.bool_]
_Record = tuple[_Array, _Array, _Array, _Array, _Flags, _Array, _Array]

__version__: str
__all__ = [
    "Bank",
    "FilterError",
    "FilterRows",
    "FilterSetup",
    "FilterStream",
    "FixedRateFilter",
    "Parts",
    "ReplayTrack",
    "__version__",
    "block_products",
    "cascade",
    "corrected",
    "dead_reckoning_variance",
    "displaced",
    "drive",
    "empty_call",
    "innovations",
    "lagged_at",
    "play",
    "run_filter",
    "run_filter_batch",
    "spline_weights",
    "swap_form",
]

class FilterError(ValueError):
    kind: str
    event: int | None
    t: float | None

@final
class FilterSetup:
    def __new__(
        cls,
        *,
        system: str,
        form: str,
        interpolation: str,
        integrator: str,
        order: str,
        carrier: str,
        consider: list[int],
        q: float,
        q_output: float,
        tau: float,
        gauss_markov: list[tuple[float, float]],
        r_position: float,
        r_output: float,
        gate: float,
        kernel: str,
        correction: str,
    ) -> FilterSetup: ...

@final
class FilterRows:
    t: _Array
    position: _Flags
    x: _Array
    variance: _Array
    e: _Array
    s: _Array
    accepted: _Flags
    smoothed: tuple[_Array, _Array] | None
    covariance: _Array
    log_likelihood: float

@final
class FilterStream:
    def __new__(cls, setup: FilterSetup, x0: _Array, P0: _Array) -> FilterStream: ...
    def output(self, t: float, value: float) -> float | None: ...
    def position(self, t: float, value: float) -> float | None: ...
    def feed(self, t: _Array, output: NDArray[np.bool_], value: _Array) -> tuple[_Array, int, str]: ...
    def finish(self) -> _Array: ...
    @property
    def t(self) -> float | None: ...
    @property
    def x(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def log_likelihood(self) -> float: ...
    @property
    def rejected(self) -> int: ...
    @property
    def waiting(self) -> int: ...

@final
class FixedRateFilter:
    def __new__(
        cls,
        setup: FilterSetup,
        x0: _Array,
        P0: _Array,
        dt: float,
        effects: tuple[float, list[tuple[float, float]]] | None = None,
        watch: tuple[list[float], int] | None = None,
    ) -> FixedRateFilter: ...
    def step(self, u: float, z: float | None = None) -> float | None: ...
    def step_with_effects(
        self,
        u: float,
        z: float | None,
        columns: _Array,
        position_columns: _Array,
        slopes: _Array | None = None,
    ) -> float | None: ...
    def begin(self, x0: _Array, P0: _Array) -> None: ...
    @property
    def evidence(self) -> _Array: ...
    def run(
        self,
        u: _Array,
        z: _Array,
        *,
        states: _Array | None = None,
        variances: _Array | None = None,
        innovations: _Array | None = None,
        innovation_variances: _Array | None = None,
    ) -> None: ...
    def read(self, into: _Array, variances: _Array | None) -> None: ...
    @property
    def x(self) -> _Array: ...
    @property
    def covariance(self) -> _Array: ...
    @property
    def innovation(self) -> float | None: ...
    @property
    def innovation_variance(self) -> float | None: ...
    @property
    def nis(self) -> float | None: ...
    @property
    def score(self) -> list[float] | None: ...
    @property
    def samples(self) -> int: ...
    @property
    def rejected(self) -> int: ...
    @property
    def log_likelihood(self) -> float: ...

def empty_call(first: float, second: float) -> None: ...
def run_filter(
    setup: FilterSetup,
    x0: _Array,
    P0: _Array,
    output: tuple[_Array, _Array],
    position: tuple[_Array, _Array],
    smoothing: bool,
) -> FilterRows: ...
def run_filter_batch(
    setup: FilterSetup,
    x0: _Array,
    P0: _Array,
    output: _Array,
    position: _Array,
    dt: float,
    runs: int,
    threads: int,
) -> tuple[_Array, _Array, _Array, list[str | None]]: ...
def play(x: _Array, width: float, start: float) -> _Array: ...
def lagged_at(t: _Array, y: _Array, tau: float, start: float) -> _Array: ...
def cascade(sections: Sequence[tuple[Sequence[float], Sequence[float], tuple[float, float]]], x: _Array) -> _Array: ...
def spline_weights(
    t: _Array, weight: _Array, powers: _Array, *, start: float, step: float, count: int
) -> tuple[_Array, NDArray[np.int32], NDArray[np.int32]]: ...
def dead_reckoning_variance(
    covariances: _Array, steps: _Array, slopes_p: _Array, slopes_v: _Array, lost: _Array, q: float
) -> _Array: ...
def corrected(
    last: _Array,
    steps: _Array,
    trial: tuple[_Array, _Array],
    acceleration: _Array,
    slopes: tuple[_Array, _Array],
) -> _Array: ...
def displaced(last: _Array, steps: _Array, added: _Array) -> tuple[_Array, _Array]: ...
def swap_form(form: str, parameters: list[float]) -> tuple[list[float], list[list[float]]]: ...
def drive(
    t: _Array, u: _Array, at: _Array, *, how: str, tau: float, delay: float, hole: float
) -> tuple[_Array, _Array, _Flags]: ...
def block_products(
    shared: _Record,
    drives: Sequence[tuple[_Array, _Array, _Array]],
    settled: _Flags,
    edges: _Array,
    *,
    q: float,
    r: float,
    prior: tuple[float, float, float, float],
) -> _Array: ...
def innovations(
    drives: list[_Record],
    *,
    q: float,
    r: float,
    prior: tuple[float, float, float, float],
) -> _Array: ...

@final
class Bank:
    def __new__(
        cls,
        track: ReplayTrack,
        t: _Array,
        restart: _Flags,
        counts: _Flags,
        *,
        grid: tuple[float, float, int],
        from_: int,
        to: int,
        group: int,
    ) -> Bank: ...
    @property
    def rows(self) -> int: ...
    def carry_inputs(self, columns: list[_Array], factor: float, state: _Array, sums: _Array) -> None: ...
    def carry_readings(self, columns: list[_Array], state: _Array, sums: _Array) -> None: ...

@final
class Parts:
    def __new__(cls, parts: list[tuple[_Record, _Flags]]) -> Parts: ...
    def log_likelihood(self, *, q: float, r: float, prior: tuple[float, float, float, float]) -> float: ...

@final
class ReplayTrack:
    def __new__(
        cls,
        t: _Array,
        z: _Array,
        first: _Array,
        second: _Array,
        restart: _Flags,
        extra_q: _Array,
        extra_r: _Array,
        *,
        q: float,
        r: float,
        prior: tuple[float, float, float, float],
    ) -> ReplayTrack: ...
    def smooth(
        self,
        t: _Array,
        z: _Array,
        first: _Array,
        second: _Array,
        restart: _Flags,
        extra_q: _Array,
        extra_r: _Array,
    ) -> tuple[_Array, _Array, _Array]: ...
    def series(self, name: str) -> _Array: ...
