"""Gauss-Newton over all runs: the coefficients at the fixed point of nominal, noise and smoothed regressors."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import NamedTuple, Protocol

import numpy as np
import scipy

from accelcal._support.errors import AccelcalError
from accelcal.data import Array
from accelcal.estimation.dwell_rows import DwellRows, column_basis, further_variance, position_rows
from accelcal.estimation.engines import ENGINES, Engine, settle_dwells
from accelcal.estimation.rows import NormalEquations, inverse, normal_equations
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState, initial_estimate
from accelcal.estimation.run_to_run import BetweenRuns, SeenByRuns, penalty
from accelcal.estimation.values import NoiseGrowth, Values
from accelcal.model import Estimate, Model, Term

LEAST_ROUNDS, ROUNDS_OF_GROWN = 3, 2
"""Least rounds of a fit that begins at an initial estimate, and at the fit of a smaller model."""
MAX_ROUNDS = 12
"""Rounds of linearisation; a start within a fifth of a period of the true delay needs four."""
USUAL_ROUNDS = 6
"""Rounds that a well-behaved record takes; the measure of progress."""
NOISE_ROUNDS = 5
"""Rounds in which the noise is estimated anew."""
CONVERGED = 0.01
"""A round that moves every parameter by less than this share of its standard deviation is the last."""
DWELL_STEPS = 3
"""Newton steps of the angle zeros of dwells at coefficients that stay."""
ASTRAY = 1.0
"""A trial whose steps grow when its noise is settled, and move a parameter by more standard deviations than this, is
given up: it does not converge in the rounds that are left."""
TRIAL_SETTLED = 0.3
"""A trial whose last step moves no parameter by more standard deviations than this has an answer: bands are ranked by
uncertainties, and a limit cycle far below one takes nothing from them. A fit whose estimates stay within it is not said
to be unsettled."""
PER_RUN_OWNERS = ("timing",)
"""Owners whose coefficients belong to each run of a joint fit, to all axes of it."""
PER_AXIS_OWNERS = ("sensor", "mounting")
"""Owners whose coefficients belong to each axis of a sensor with several outputs, in all runs of it."""


class NotIdentifiable(AccelcalError):
    """The record cannot determine the model. The text says what was not excited and what to do.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> still = ac.Recording.from_arrays(
    ...     np.arange(1000.0) / 100.0, np.random.default_rng(1).standard_normal(1000), np.zeros(1000),
    ...     units={"accel": "m/s^2", "position": "m"},
    ... )
    >>> try:
    ...     _ = ac.fit(still)
    ... except ac.NotIdentifiable:
    ...     print("the stage never moves")
    the stage never moves
    """


@dataclass(frozen=True, slots=True)
class BandTrial:
    """Scale and delay of one run in one band; half 95 % intervals by the scatter of its blocks."""

    band: float
    """Hz"""
    periods: float
    """Of the band in the run."""
    signal: float
    """Power of the motion over that of the residual."""
    scale: float
    """1 + k"""
    scale_interval: float
    delay: float | None
    """s; None where it is not estimated."""
    delay_interval: float

    @property
    def relative(self) -> float:
        """Half a 95 % interval of 1 + k over 1 + k."""
        return self.scale_interval / max(abs(self.scale), 1e-300)


LEAST_TESTED = 1e-6
"""Share of the motion in the information of both, below which positions are not compared with it."""


@dataclass(frozen=True, slots=True)
class Agreement:
    """Whether static positions and the motion of one fit agree on what both determine."""

    squares: float
    """Chi-square of their difference."""
    freedom: int
    rows: tuple[int, ...]
    """Rows of the coefficient, of all axes, that explains most of it."""
    difference: tuple[float, ...]
    """By which those of the positions exceed those of the motion, all others shared."""
    std: tuple[float, ...]

    @property
    def p_value(self) -> float:
        """Of a chi-square as large where they agree."""
        return float(scipy.special.chdtrc(self.freedom, self.squares)) if self.freedom else 1.0

    @classmethod
    def of(cls, X: Array, left: Array, bound: Array, covariance: Array, layout: Layout) -> Agreement:
        """By whitened rows (n, m) of positions, what the joint solution leaves of them, and its covariance, once as by
        the rows alone and once from the scatter of the motion (derivations 6.11)."""
        basis, W = column_basis(X), np.eye(len(X)) - X @ bound @ X.T
        S = W + X @ (covariance - bound) @ X.T
        shares, U = np.linalg.eigh(basis.T @ S @ basis)
        tested = shares > LEAST_TESTED
        of_name = [
            (rows, inverse(X[:, rows].T @ W @ X[:, rows]) @ X[:, rows].T)
            for rows in (layout.rows_of(name) for name in dict.fromkeys(term.name for term in layout.terms))
        ]
        rows, gain = max(of_name, key=lambda item: float(left @ X[:, item[0]] @ item[1] @ left))
        return cls(
            float(np.sum((U.T @ basis.T @ left)[tested] ** 2 / shares[tested])),
            int(np.count_nonzero(tested)),
            tuple(rows),
            tuple((gain @ left).tolist()),
            tuple(np.sqrt(np.diag(gain @ S @ gain.T)).tolist()),
        )


@dataclass(frozen=True, slots=True)
class Solution:
    """Estimates at the end of the iteration, and the states of the runs there."""

    model: Model
    """The model that was asked for, with what the rigs of the runs add to it."""
    layout: Layout
    x: Array
    covariance: Array
    states: list[RunState]
    converged: bool
    chosen: tuple[float | None, ...] = ()
    """Band of each run that was chosen because its noise is not white, Hz."""
    shapes: tuple[Estimate, ...] = ()
    """Shape parameters that were estimated."""
    joint: Array | None = None
    """Covariance of the coefficients, then of `shapes`, (m + b, m + b); None where no shape was estimated."""
    by_band: tuple[tuple[BandTrial, ...], ...] = ()
    """Of each run whose noise is not white: what single bands say."""
    between: Mapping[str, BetweenRuns] = field(default_factory=dict)
    """Coefficients that differ from run to run."""
    seen_by_runs: tuple[SeenByRuns, ...] = ()
    """Effects that no single run shows and that explain how the runs differ."""
    engine: Engine = ENGINES["auto"]
    """Engine that was asked for."""
    agreement: Agreement | None = None
    """Of the static positions of the fit with its motion; None where it has none."""
    moving: float = 0.0
    """Largest range of an estimate over the last rounds, in standard deviations; 0 where the iteration converged."""

    @property
    def at_shapes(self) -> Array:
        """Covariance of the coefficients, were the shapes known exactly, (m, m)."""
        if self.joint is None:
            return self.covariance
        across, among = np.split(self.joint[:, len(self.x) :], [len(self.x)])
        return np.asarray(self.covariance - across @ np.linalg.solve(among, across.T))

    @property
    def log_likelihood(self) -> float:
        """Innovation log-likelihood of all runs."""
        return sum(state.log_likelihood for state in self.states)


def iterate(
    model: Model,
    runs: Sequence[PreparedRun],
    bands: Sequence[float | None],
    progress: Callable[[float], None] = lambda share: None,
) -> Solution:
    """Gauss-Newton to the fixed point of nominal, noise and smoothed regressors, with the states of the runs there.

    Raises
    ------
    NotIdentifiable
        If the information matrix is singular.
    """
    solution = estimated(model, initial_states(model, runs, bands), progress)
    for index, state in enumerate(solution.states):
        state.refresh(solution.layout.scatter(solution.x, model, index), search_noise=False)
        settle_dwells(state, model, DWELL_STEPS)
    return solution


def initial_states(model: Model, runs: Sequence[PreparedRun], bands: Sequence[float | None]) -> list[RunState]:
    """States of all runs at their initial estimates, parameters of the sensor shared."""
    initial = [initial_estimate(run, model) for run in runs]
    layout = layout_of(model, runs)
    x = layout.gather([values for values, _ in initial])
    growth = tuple(NoiseGrowth(effect) for effect in model.noise_effects)
    return [
        RunState.at(run, layout.scatter(x, model, index), replace(noise, growth=growth), band, search_noise=True)
        for index, (run, band, (_, noise)) in enumerate(zip(runs, bands, initial, strict=True))
    ]


@np.errstate(over="ignore", invalid="ignore")  # a step too far is told by an information that is not finite
def estimated(
    model: Model,
    states: list[RunState],
    progress: Callable[[float], None] = lambda share: None,
    *,
    least: int = LEAST_ROUNDS,
    trial: bool = False,
) -> Solution:
    """Iterate without the last re-linearisation, when only estimates and covariance are needed.

    Parameters
    ----------
    model : its free coefficients are estimated.
    states : runs at which the first step is linearised; each moves with the steps that follow.
    progress : called with the share of the work that is done, 0 to 1.
    least : rounds at least; two suffice where the states come from a fit of a smaller model.
    trial : whether a solution that does not converge is of no use, so that it is given up early.

    Raises
    ------
    NotIdentifiable
        If the information matrix is singular.
    """
    layout = layout_of(model, [state.run for state in states])
    x = layout.gather([state.values for state in states])
    belief, mean = layout.prior_information(model), layout.prior_mean(model)
    converged, moved = False, math.inf
    rounds: list[tuple[Array, Array]] = []
    for round_number in range(MAX_ROUNDS):
        information, score = np.diag(belief), belief * (mean - x)
        normals = []
        for index, state in enumerate(states):
            values = layout.scatter(x, model, index) if round_number > 0 else None
            search = round_number < NOISE_ROUNDS or bool(model.shapes and moved > ASTRAY)
            ENGINES[state.run.engine].settle(state, model, values, search=search)
            normals.append(normal_equations(state, model.free))
            rows = layout.rows(index)
            information[np.ix_(rows, rows)] += normals[index].gram
            score[rows] += normals[index].score
        drawn = np.zeros_like(information)
        between = {}
        for name in model.per_run if len({output.recording for output in layout.outputs}) > 1 else ():
            rows = layout.rows_of(name)
            if len(rows) > 1:
                between[name] = BetweenRuns.of(information + drawn, score + information @ x, rows)
                drawn[np.ix_(rows, rows)] += penalty(len(rows), between[name].variance)
        still = rows_of_positions(model, layout, states)
        X, y = (np.zeros((0, len(x))), np.zeros(0)) if still is None else (still.columns, still.y)
        step, covariance = solve(information + drawn + X.T @ X, score - drawn @ x + X.T @ y, layout)
        x = x + step
        for index, state in enumerate(states):
            state.values = replace(state.values, nuisances=normals[index].at(step[layout.rows(index)]))
        progress(min(0.9, (round_number + 1) / USUAL_ROUNDS))
        before, moved = moved, float(np.max(np.abs(step) / np.sqrt(np.diag(covariance)), initial=0.0))
        converged = moved <= CONVERGED
        if round_number >= NOISE_ROUNDS:
            rounds.append((x, covariance))
        astray = trial and round_number >= NOISE_ROUNDS and moved > max(ASTRAY, before)
        if astray or (round_number + 1 >= least and converged):
            break
    converged = converged or (trial and moved <= TRIAL_SETTLED)
    bound = covariance
    if any(state.band is not None for state in states):
        covariance = robust(covariance, layout, normals, np.diag(belief) + drawn + X.T @ X)
    agreement = None if still is None else Agreement.of(X, y - X @ step, bound, covariance, layout)
    over_rounds = np.ptp([estimates for estimates, _ in rounds], axis=0) if len(rounds) > 1 else math.inf
    moving = 0.0 if converged else float(np.max(over_rounds / np.sqrt(np.diag(bound)), initial=moved))
    if covariance is bound and not converged and len(rounds) > 1:
        covariance = unsettled(rounds)
    # The fit finds the offset of the stamps as they are: an error that all stamps of a channel share adds to it alone.
    clock_variance = [
        states[runs[0]].run.recording.stamp_std ** 2 if term.name == "time_offset" else 0.0
        for term, runs in layout.slots
    ]
    covariance = covariance + np.diag(clock_variance)
    return Solution(
        model, layout, x, covariance, states, converged, between=between, agreement=agreement, moving=moving
    )


def unsettled(rounds: Sequence[tuple[Array, Array]]) -> Array:
    """Covariance, (n, n), where the iteration does not settle: the mean over rounds, and that of their estimates.

    Which round is the last is chance, and down to rounding errors (law of total variance).
    """
    estimates, covariances = (np.array(values) for values in zip(*rounds, strict=True))
    scatter = np.cov(estimates, rowvar=False, bias=True).reshape(covariances[0].shape)
    return np.asarray(np.mean(covariances, axis=0) + scatter)


def robust(covariance: Array, layout: Layout, normals: Sequence[NormalEquations], belief: Array) -> Array:
    """Covariance from the scatter of block scores where the noise model does not hold (sandwich form)."""
    middle = belief.copy()
    for index, normal in enumerate(normals):
        rows = layout.rows(index)
        middle[np.ix_(rows, rows)] += normal.gram if normal.spread is None else normal.spread
    return np.asarray(covariance @ middle @ covariance)


class Named(Protocol):
    """A recording, or the fit of one."""

    @property
    def name(self) -> str:
        """With the axis behind a space, where it has one."""

    @property
    def axis(self) -> str:
        """Which output of a sensor with several it is."""

    @property
    def digest(self) -> str:
        """Of what was read."""

    @property
    def session(self) -> str:
        """Digest of the whole recording that it is a part of."""


class Output(NamedTuple):
    """Which output a run of a joint fit is."""

    recording: int
    """Number of its recording."""
    axis: str = ""
    """Axis of a sensor with several outputs; empty where it has one."""


def outputs_of(recordings: Sequence[Named]) -> tuple[Output, ...]:
    """The output of each run; runs of different axes of one file are one recording."""
    numbers: dict[tuple[str, ...], int] = {}
    outputs: list[Output] = []
    for k, recording in enumerate(recordings):
        name = recording.name.removesuffix(f" {recording.axis}")
        key: tuple[str, ...] = (name, recording.session or recording.digest) if recording.axis else ("", str(k))
        while recording.axis and Output(numbers.get(key, -1), recording.axis) in outputs:
            key = (*key, "again")  # another part of the same file
        outputs.append(Output(numbers.setdefault(key, len(numbers)), recording.axis))
    return tuple(outputs)


@dataclass(frozen=True, slots=True)
class Layout:
    """Rows of the joint solve: each a coefficient, and the runs that share it."""

    terms: tuple[Term, ...]
    outputs: tuple[Output, ...]
    slots: tuple[tuple[Term, tuple[int, ...]], ...]

    @classmethod
    def of(cls, model: Model, outputs: Sequence[Output]) -> Layout:
        """Shared parameters have one row, those of timing one for each recording, those of a sensor one for each of
        its axes."""
        slots: list[tuple[Term, tuple[int, ...]]] = []
        for term in model.free:
            by_run = term.owner in PER_RUN_OWNERS or term.name in model.per_run
            by_axis = term.owner in PER_AXIS_OWNERS and not term.effect.axis
            members: dict[tuple[int, str], list[int]] = {}
            for run, output in enumerate(outputs):
                key = output.recording if by_run else 0, output.axis if by_axis else ""
                members.setdefault(key, []).append(run)
            slots += [(term, tuple(runs)) for runs in members.values()]
        return cls(model.free, tuple(outputs), tuple(slots))

    def rows_of(self, name: str) -> list[int]:
        """Rows of a coefficient, one for each run or axis that has its own."""
        return [i for i, (term, _) in enumerate(self.slots) if term.name == name]

    def rows(self, run: int) -> list[int]:
        """Row of each free coefficient of run `run`."""
        return [
            next(i for i, (slot, runs) in enumerate(self.slots) if slot.name == term.name and run in runs)
            for term in self.terms
        ]

    def gather(self, values: Sequence[Values]) -> Array:
        """Coefficients of all runs as one vector; shared ones are averaged over runs by median."""
        return np.array([float(np.median([values[k].by_name[term.name] for k in runs])) for term, runs in self.slots])

    def scatter(self, x: Array, model: Model, run: int) -> Values:
        """Coefficients of run `run`."""
        of_run = {term.name: float(x[i]) for i, (term, runs) in enumerate(self.slots) if run in runs}
        terms = model.terms
        return Values({t.name: of_run.get(t.name, model.fixed.get(t.name, 0.0)) for t in terms}, terms)

    def prior_information(self, model: Model) -> Array:
        """Inverse variances of the priors, 0 where there is none."""
        return np.array([model.priors[t.name].std ** -2 if t.name in model.priors else 0.0 for t, _ in self.slots])

    def prior_mean(self, model: Model) -> Array:
        """Means of the priors, 0 where there is none."""
        return np.array([model.priors[t.name].mean if t.name in model.priors else 0.0 for t, _ in self.slots])

    def estimates(self, x: Array, covariance: Array, model: Model) -> tuple[Estimate, ...]:
        """Free and fixed parameters in the order of the model."""
        estimates: list[Estimate] = []
        for term in model.terms:
            if term.name in model.fixed:
                estimates.append(Estimate(term.name, term.symbol, term.unit, model.fixed[term.name], 0.0, term.owner))
            for i, (slot, runs) in enumerate(self.slots):
                if slot.name == term.name:
                    at = float(x[i]), math.sqrt(covariance[i, i])
                    estimates.append(Estimate(term.name, term.symbol, term.unit, *at, term.owner, *self.whose(runs)))
        return tuple(estimates)

    def whose(self, runs: Sequence[int]) -> tuple[int | None, str]:
        """Run and axis of a row that some runs share: None where all recordings do, empty where all axes do."""
        some = [self.outputs[run] for run in runs]
        axes = {output.axis for output in self.outputs}
        axis = some[0].axis if {output.axis for output in some} != axes else ""
        recordings = {output.recording for output in self.outputs if axis in ("", output.axis)}
        return None if {output.recording for output in some} == recordings else runs[0], axis


def layout_of(model: Model, runs: Sequence[PreparedRun]) -> Layout:
    """Rows of the joint solve of a model for several runs."""
    return Layout.of(model, outputs_of([run.recording for run in runs]))


def solve(information: Array, score: Array, layout: Layout) -> tuple[Array, Array]:
    """Solve the normal equations scaled to unit diagonal.

    Raises
    ------
    NotIdentifiable
        If a column is empty or columns are collinear.
    """
    names = [term.name for term, _ in layout.slots]
    size = np.sqrt(np.diag(information))
    if not np.all(np.isfinite(information)):
        raise NotIdentifiable("the record is too violent for the model: the information matrix is not finite")
    unexcited = [n for n, s in zip(names, size, strict=True) if s == 0.0]
    if unexcited:
        raise NotIdentifiable(
            f"no motion above the noise tells {' or '.join(unexcited)}: not excited. Record a run with stronger or "
            "longer motion"
        )
    correlation = information / np.outer(size, size)
    eigenvalues, vectors = scipy.linalg.eigh(correlation)
    if eigenvalues[0] < 1e-10:
        tied = [n for n, w in zip(names, vectors[:, 0], strict=True) if abs(w) > 0.2]
        raise NotIdentifiable(
            f"{', '.join(tied)} are confounded on this record; drop all but one, or hold them with a value"
        )
    inverse = (vectors / eigenvalues) @ vectors.T
    covariance = inverse / np.outer(size, size)
    return covariance @ score, covariance


def rows_of_positions(
    model: Model, layout: Layout, states: Sequence[RunState], *, white: bool = False, scatter: float | None = None
) -> DwellRows | None:
    """Rows of the static positions of three outputs where all of them are fitted; None where there are none.

    `white` and `scatter` are those of `position_rows`; by default the scatter that the positions themselves show.
    """
    positions = next((state.run.recording.positions for state in states if state.run.recording.positions), None)
    runs = [next((k for k, output in enumerate(layout.outputs) if output.axis == axis), -1) for axis in "xyz"]
    if positions is None or -1 in runs:
        return None
    rows = partial(
        position_rows,
        positions,
        model.free,
        [states[k].values for k in runs],
        [layout.rows(k) for k in runs],
        len(layout.slots),
        states[0].run.origins,
        white=white,
        apart=[i for name in model.per_run for i in layout.rows_of(name)],
    )
    largest = float(np.max(positions.variance))
    return rows(scatter=further_variance(lambda v: rows(scatter=v), largest) if scatter is None else scatter)
