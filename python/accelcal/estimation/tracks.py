"""Estimates as readings come in: the parameters and their uncertainty from the readings up to each instant."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from accelcal._support.result import Result
from accelcal._support.values import immutable, listing
from accelcal.data import DERIVED, Array, Recording
from accelcal.effects import Effect, Variable, find, has_time_constant
from accelcal.effects.building_blocks import since_reversal
from accelcal.effects.curves import AGES
from accelcal.effects.drift import beyond_cosines
from accelcal.effects.mechanisms import driver_of, mechanisms_of, memories, memory
from accelcal.estimation.estimate import Fit, require_channels, solve_runs
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.rows import rows_of_run
from accelcal.estimation.shape_parameters import MovedCoefficient, moves
from accelcal.model import Model, Term
from accelcal.signals.signals import TINY, Signals

SINGULAR = 1e-10
"""Least eigenvalue of the scaled information at which a model is determined."""


@immutable
@dataclass(frozen=True, slots=True)
class Track(Result):
    """Estimates of every free parameter over time."""

    names: tuple[str, ...]
    units: tuple[str, ...]
    t: Array
    """(n,) s"""
    values: Array
    """(n, m) SI; NaN while the readings do not determine the model."""
    std: Array
    """(n, m) SI"""

    def __repr__(self) -> str:
        return f"Track({', '.join(self.names)}: {len(self.t)} instants)"


def track(
    fit: Fit, recording: Recording, *, start: float | None = None, end: float | None = None, points: int = 240
) -> Track:
    """Estimate the parameters of a model from the readings up to each instant of a recording.

    Parameters
    ----------
    fit : its model and origins are used; the parameters are estimated anew.
    recording : one run.
    start, end : s, optional; only this part is used.
    points : instants, evenly spread.

    Raises
    ------
    NotIdentifiable
        If the whole record does not determine the model.

    Notes
    -----
    Information adds up: beta(t) = beta + G(t)^-1 s(t), with the Gram matrix G and the score s of the readings up to t,
    as a Kalman filter with the parameters in its state would. Noise and smoothed regressors are those of the whole
    record. Where a band was imposed, deviations are scaled to the robust ones at the end.
    """
    engine = fit.engine
    return track_of(
        solve_runs(fit.model, [recording], start=start, end=end, origins=fit.origins, engine=engine), points
    )


def track_of(solution: Solution, points: int = 240) -> Track:
    """The track of a run that has just been solved; `points` are as of `track`."""
    state, model = solution.states[0], solution.model
    run = state.run
    belief = solution.layout.prior_information(model)
    m = len(model.free)
    gram, score = np.diag(belief), belief * (solution.layout.prior_mean(model) - solution.x)
    at = np.linspace(run.t[0], run.t[-1], points + 1)[1:]
    values, std = np.full((points, m), np.nan), np.full((points, m), np.nan)
    k = 0
    for t, columns, y in rows_of_run(state, model.free):
        ends = np.searchsorted(t, at[k:], side="right")
        begin = 0
        for end in [*(int(place) for place in ends if place < len(t)), len(t)]:
            gram = gram + columns[begin:end].T @ columns[begin:end]
            score = score + columns[begin:end].T @ y[begin:end]
            if end < len(t):
                values[k], std[k] = estimate_from(gram, score, solution.x)
                k += 1
            begin = end
    values[k:], std[k:] = estimate_from(gram, score, solution.x)
    if state.band is not None:
        std = std * (np.sqrt(np.diag(solution.covariance)) / std[-1])
    return Track(
        names=tuple(term.name for term in model.free),
        units=tuple(term.unit for term in model.free),
        t=at,
        values=values,
        std=std,
    )


def estimate_from(gram: Array, score: Array, x: Array) -> tuple[Array, Array]:
    """Estimates and standard deviations from a Gram matrix and a score, NaN while the information is singular."""
    nothing = np.full(len(x), np.nan)
    size = np.sqrt(np.diag(gram))
    if not np.all(size > 0.0):
        return nothing, nothing
    eigenvalues, vectors = np.linalg.eigh(gram / np.outer(size, size))
    if eigenvalues[0] < SINGULAR:
        return nothing, nothing
    covariance = (vectors / eigenvalues) @ vectors.T / np.outer(size, size)
    return x + covariance @ score, np.sqrt(np.diag(covariance))


TRIALS = 25
"""Time constants of a memory that are tried for a driver."""


@dataclass(frozen=True, slots=True)
class Follower:
    """A driver that the random part of a coefficient's path may follow."""

    mechanism: str
    """Name of the effect that says so."""
    share: float
    """Of the path's variance that the memory of the driver explains, 0 to 1."""
    tau: float
    """Time constant at which it explains most, s."""
    value: Array
    """(n,) the path with that in place of its random part, in the unit of the coefficient."""


@immutable
@dataclass(frozen=True, slots=True)
class Path(Result):
    """Value of a coefficient over a recording, as the random processes and mechanisms of a model move it."""

    coefficient: str
    unit: str
    itself: float
    """Coefficient of that name, in `unit`: what it is where its drivers are at zero."""
    itself_std: float
    mean: float
    """Its mean over the run, in `unit`."""
    mean_std: float
    t: Array
    """(n,) s"""
    value: Array
    """(n,) in `unit`"""
    std: Array
    """(n,) in `unit`; with what a process does faster than its cosines tell."""
    followers: tuple[Follower, ...] = ()
    """Drivers of what is random of it, by the share that each explains; empty where nothing is."""

    def __repr__(self) -> str:
        return f"Path({self.coefficient}: {len(self.t)} instants)"


def paths(fit: Fit, recording: Recording, *, start: float | None = None, end: float | None = None) -> tuple[Path, ...]:
    """Coefficients that processes and mechanisms of a model move, over a recording.

    Parameters
    ----------
    fit : its model and origins are used; the parameters are estimated anew.
    recording : one run.
    start, end : s, optional; only this part is used.

    Raises
    ------
    NotIdentifiable
        If the whole record does not determine the model.
    RecordingError
        If it lacks a channel that the model needs.
    """
    require_channels(fit.model, recording)
    model, engine = fit.model, fit.engine
    if recording.session not in {run.session for run in fit.runs}:  # what was carried over belongs to another record
        model = replace(model, shapes={name: find(name).rested(shape) for name, shape in model.shapes.items()})
    return paths_of(solve_runs(model, [recording], start=start, end=end, origins=fit.origins, engine=engine))


def paths_of(solution: Solution) -> tuple[Path, ...]:
    """The paths of a run that has just been solved."""
    moving = {moves(term): None for term in solution.model.terms if moves(term)}
    return tuple(_path(solution, coefficient) for coefficient in moving)


def _path(solution: Solution, coefficient: str) -> Path:
    state, moved = solution.states[0], MovedCoefficient.of(solution, coefficient)
    s, columns, size, std = state.signals, moved.columns[:-1], moved.size, moved.std[:-1]
    random = [k for k, term in enumerate(moved.terms) if term.effect.port == "process"]
    channels = [name for name in state.run.recording.side if name not in DERIVED]
    followers: list[Follower] = []
    if random:
        path = columns[:, random] @ size[random]
        asked, weight = mechanisms_of((coefficient,), channels), 1.0 / np.maximum(std, TINY) ** 2
        followers = [_follower(effect, path, weight, s, moved.t) for effect in asked]
        followers = [replace(follower, value=follower.value + columns @ size - path) for follower in followers]
    return Path(
        coefficient,
        find(coefficient).unit,
        state.values.by_name.get(coefficient, 0.0),
        moved.itself_std,
        float(moved.value[-1]),
        float(moved.std[-1]),
        moved.t + state.run.origins.t,
        columns @ size,
        np.sqrt(std**2 + _beyond_cosines(solution.model, [moved.terms[k] for k in random])),
        tuple(sorted(followers, key=lambda follower: follower.share, reverse=True)),
    )


def _beyond_cosines(model: Model, random: Sequence[Term]) -> float:
    """Variance of the processes of a coefficient that their cosines lack, each of the size in its prior."""
    variance = 0.0
    for term in {term.effect.name: term for term in random}.values():
        tau = term.shape["tau"] if has_time_constant(term.effect) else math.inf
        size = model.priors[term.name].std if term.name in model.priors else 0.0
        variance += size**2 * beyond_cosines(term.shape["length"], tau)
    return variance


def _follower(effect: Effect, path: Array, weight: Array, s: Signals, t: Array) -> Follower:
    """What a memory of a driver explains of a path, at the time constant at which it explains most."""
    assert effect.mechanism is not None
    driver = driver_of(effect.mechanism.driver)
    mean = float(np.average(path, weights=weight))
    left = path - mean
    rows = np.searchsorted(s.t, t)
    best = Follower(effect.name, 0.0, 0.0, np.zeros(len(rows)))
    for tau in np.geomspace(*memories(s), TRIALS):
        u = memory(s, driver, float(tau))[rows]
        u = u - np.average(u, weights=weight)
        power = float(np.sum(weight * u**2))
        c = float(np.sum(weight * u * left)) / power if power > 0.0 else 0.0
        whole = float(np.sum(weight * left**2))
        share = c**2 * power / whole if whole > 0.0 else 0.0
        if share > best.share:
            best = Follower(effect.name, share, float(tau), c * u + mean)
    return best


POINTS = 201
"""Points at which a curve is evaluated."""
STROKE = 0.1
"""Stroke of the motion on which a response to reversals is evaluated, m; the response does not depend on it."""


@dataclass(frozen=True, slots=True)
class Shape:
    """One function with its pointwise standard uncertainty."""

    effect: str
    label: str
    """Branch of the function; empty where there is one."""
    variable: str
    variable_unit: str
    unit: str
    x: Array
    """(n,) in `variable_unit`, on the clock and scale of the recording."""
    value: Array
    """(n,) in `unit`"""
    std: Array
    """(n,) in `unit`"""


def shapes(fit: Fit) -> tuple[Shape, ...]:
    """Every family in a model, as the function that was fitted."""
    shapes_found: list[Shape] = []
    for name in fit.model.added:
        family = find(name).family
        if family is None:
            continue
        if family.variable.letter == "reversal":
            shapes_found += [_since_reversal(fit, name, direction) for direction in (1.0, -1.0)]
        elif {"low", "start"} & set(fit.model.shapes.get(name, {})):
            shapes_found.append(_over_variable(fit, name, family.variable))
    return tuple(shapes_found)


def _over_variable(fit: Fit, name: str, variable: Variable) -> Shape:
    """The function over the range of its variable; a response to velocity or acceleration per unit of it."""
    shape = fit.model.shapes[name]
    low, high = (shape["low"], shape["high"]) if "low" in shape else (shape["start"], shape["start"] + shape["length"])
    x = np.linspace(low, high, POINTS)
    motion = {"v": np.ones(POINTS), "a": np.ones(POINTS)} | {variable.letter: x}
    t, p, v, a, jerk = (motion.get(key, np.zeros(POINTS)) for key in ("t", "p", "v", "a", "jerk"))
    side = {"temperature": x, "a_y": x}
    s = Signals(t=t, p=p, v=v, a=a, jerk=jerk, scale=fit.values().scale, rig=fit.rig, side=side)
    origins = fit.origins
    origin = {"t": origins.t, "p": origins.p}.get(variable.letter, origins.of(variable.letter))
    return _shape(fit, name, "", variable.name, variable.unit, s, x + origin, np.ones(POINTS, dtype=bool))


def _since_reversal(fit: Fit, name: str, direction: float) -> Shape:
    """Response to one reversal: the stage moves at a steady speed, turns, and moves back."""
    t = np.linspace(-AGES[-1], AGES[-1], 8 * POINTS)
    p = direction * STROKE * np.abs(t) / AGES[-1]
    zero = np.zeros(len(t))
    s = Signals(t=t, p=p, v=np.gradient(p, t), a=zero, jerk=zero, scale=fit.values().scale, rig=fit.rig)
    age = since_reversal(s)
    after = t > t[np.flatnonzero(age == 0.0)[-1]]
    label = "after turning to forwards" if direction > 0.0 else "after turning to backwards"
    return _shape(fit, name, label, "time since reversal", "s", s, age, after)


def _shape(
    fit: Fit, name: str, label: str, variable: str, variable_unit: str, s: Signals, x: Array, rows: Array
) -> Shape:
    effect = find(name)
    columns = effect.column(s, **fit.model.shapes.get(name, {}))
    terms = [term.name for term in fit.model.terms if term.effect.name == name]
    value = columns @ np.array([fit[term].value for term in terms])
    free = [e.name for e in fit.free]
    places = [i for i, term in enumerate(terms) if term in free]
    at = [free.index(terms[i]) for i in places]
    covariance = fit.covariance[np.ix_(at, at)]
    variance = np.einsum("ni,ij,nj->n", columns[:, places], covariance, columns[:, places])
    std = np.sqrt(np.maximum(variance, 0.0))
    return Shape(name, label, variable, variable_unit, effect.unit, x[rows], value[rows], std[rows])


__dir__ = listing(globals())
