"""What differs between the runs of a joint fit: a coefficient, or an effect that no single run shows."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from accelcal.data import Array, Recording
from accelcal.effects import BUILT_IN, find
from accelcal.estimation.gauss_newton import Layout, Solution
from accelcal.estimation.rows import normal_equations
from accelcal.estimation.run_state import RunState
from accelcal.estimation.run_to_run import SPREAD_ALPHA, BetweenRuns, SeenByRuns
from accelcal.model import Model, Term, terms_of

LET_DIFFER = ("bias",)
"""Coefficients that differ from run to run in most laboratories: a set-up tilts, a sensor is turned on again."""
SEEN_BY_RUNS = tuple(e.name for e in BUILT_IN if e.seen_by_sets)
"""Effects that no single run shows, and that runs of other mounts and directions of the axis do."""
SEEN_SIGMA = 5.0
"""Standard deviations from which on such an effect explains how runs differ."""
SEEN_APART = 1e-8
"""Least eigenvalue of the scaled normal equations with such an effect: below it is confounded on these runs."""


WHOLE_RUNS = 3
"""Runs from which on one may be held out as a whole: a part of a run does not reveal what differs between runs. Of runs
with several poses as many must be left, since two are always alike with one effect more."""


def run_to_hold_out(recordings: Sequence[Recording]) -> int | None:
    """Number of the last run without which the others tell all that the set tells: its axis and mount are those of
    another. None where there is none, and of fewer than three; never the first, whose clock is that of the model."""
    poses = [(recording.rig.axis, recording.rig.mount) for recording in recordings]
    several = len(set(poses)) > 1
    if len(poses) < WHOLE_RUNS + several:
        return None
    return max((k for k in range(1, len(poses)) if poses.count(poses[k]) > 1), default=None)


def differing(solution: Solution) -> tuple[tuple[str, ...], tuple[SeenByRuns, ...]]:
    """Coefficients that all runs share in a solution and that differ between them, one step from it.

    Also effects that no single run shows and that make all runs alike. Until one is added the coefficient differs,
    since else all other estimates would bear the difference.
    """
    model, states = solution.model, solution.states
    found: list[str] = []
    coupled = len(states) > 1 and all(state.run.rig.coupled for state in states)
    names = [term.name for term in model.free if term.name in LET_DIFFER and term.name not in model.priors]
    for name in names if coupled else ():
        if between_runs(states, model, name)[0].p_value >= SPREAD_ALPHA:
            continue
        tried = (seen_by_runs(states, model, name, e) for e in SEEN_BY_RUNS if e not in model.effects)
        explaining = tuple(one for one in tried if one is not None)
        found += [name] if name not in model.per_run else []
        if explaining:
            return tuple(found), tuple(sorted(explaining, key=lambda one: one.std / abs(one.value)))
    return tuple(found), ()


def between_runs(
    states: Sequence[RunState], model: Model, name: str, further: Sequence[Term] = ()
) -> tuple[BetweenRuns, Array, Array]:
    """A coefficient of each run one step from a solution, and the normal equations A x = c, further terms last."""
    layout = Layout.of(model.vary(name), len(states))
    m = len(layout.slots)
    information, score = np.zeros((m + len(further), m + len(further))), np.zeros(m + len(further))
    belief = layout.prior_information(model)
    information[np.arange(m), np.arange(m)] = belief
    at = np.array([states[run or 0].values.by_name[term.name] for term, run in layout.slots])
    score[:m] = belief * (layout.prior_mean(model) - at)
    for index, state in enumerate(states):
        normal = normal_equations(state, [*model.free, *further])
        rows = [*layout.rows(index), *range(m, m + len(further))]
        information[np.ix_(rows, rows)] += normal.gram
        score[rows] += normal.score
    score += information @ np.concatenate([at, np.zeros(len(further))])  # of the coefficients, not of their steps
    return BetweenRuns.of(information, score, layout.rows_of(name)), information, score


def seen_by_runs(states: Sequence[RunState], model: Model, name: str, effect: str) -> SeenByRuns | None:
    """An effect as all runs together show it, with one value of a coefficient for all of them.

    None where the runs differ even so, do not show it, or cannot tell it from what they share. Two runs are always
    alike with it.
    """
    terms = terms_of(find(effect))
    if any(need not in state.run.recording.side for state in states for need in find(effect).needs):
        return None
    rest, information, score = between_runs(states, model, name, terms)
    own = Layout.of(model.vary(name), len(states)).rows_of(name)
    joined = np.delete(np.eye(len(score)), own[1:], axis=0)
    joined[own[0], own] = 1.0
    information, score = joined @ information @ joined.T, joined @ score
    size = np.sqrt(np.maximum(np.diag(information), 1e-300))
    weights, vectors = scipy.linalg.eigh(information / np.outer(size, size))
    if weights[0] < SEEN_APART or rest.p_value < SPREAD_ALPHA:
        return None
    covariance = (vectors / weights) @ vectors.T / np.outer(size, size)
    value, std = float((covariance @ score)[-1]), math.sqrt(float(covariance[-1, -1]))
    return SeenByRuns(effect, terms[0].unit, value, std, name) if abs(value) > SEEN_SIGMA * std else None
