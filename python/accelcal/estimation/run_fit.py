"""Fits of single recordings: span, noise at rest and in motion, likelihood, and differences between runs."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import NO_LABELS, POSITION_ORDER, VELOCITY, Array, Flags, Recording, RunLabels, unit_diagonal
from accelcal.effects import BUILT_IN, find
from accelcal.estimation.engines import ENGINES, sums_of
from accelcal.estimation.gauss_newton import Solution, layout_of
from accelcal.estimation.noise import Level, NoiseReport, level, level_of
from accelcal.estimation.rows import NormalEquations, block_length, normal_equations
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.estimation.run_to_run import REMARK_ALPHA, BetweenRuns, SeenByRuns
from accelcal.estimation.values import Noise
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model, Term, terms_of
from accelcal.signals.signals import Signals


@dataclass(frozen=True, slots=True)
class RunFit:
    """Span, noise and likelihood of one recording of a fit."""

    name: str
    digest: str
    start: float
    """s"""
    end: float
    """s"""
    readings: int
    samples: int
    noise: NoiseReport
    log_likelihood: float
    nis: float | None
    """Mean normalised innovation squared, 1 when noise and innovations agree; None when a band was imposed."""
    session: str = ""
    """Digest of the whole recording that the run is a part of."""
    labels: RunLabels = NO_LABELS
    """When, how mounted, by whom."""
    axis: str = ""
    """Which output of a sensor with several; empty where it has one."""

    @property
    def file(self) -> str:
        """Name of the recording, without the axis."""
        return self.name.removesuffix(f" {self.axis}")


def run_fit(state: RunState, model: Model) -> RunFit:
    """Noise report and fit statistics of a run at the final values."""
    run = state.run
    y = state.whitened[state.counts] if run.order == POSITION_ORDER else sums_of(state).whitened
    return RunFit(
        name=run.recording.name,
        digest=run.recording.digest,
        start=float(run.t[0]),
        end=float(run.t[-1]),
        readings=ENGINES[run.engine].readings(run),
        samples=len(run.accel.t),
        noise=noise_of_run(state, model),
        log_likelihood=state.log_likelihood,
        nis=float(np.mean(y**2)) if state.band is None else None,
        session=run.recording.session,
        labels=run.recording.labels,
        axis=run.recording.axis,
    )


def noise_of_run(state: RunState, model: Model) -> NoiseReport:
    """Noise report by what the run was fitted with."""
    if state.run.order != POSITION_ORDER:
        return noise_report_of_reference(state)
    return noise_report(state) if state.band is None else noise_report_in_band(state, model)


def noise_report_of_reference(state: RunState) -> NoiseReport:
    """Noise by the likelihood of the weak form, whose reference is no position; not split into rest and motion.

    Of an acceleration only the sum of both noises is known; either has half of it.
    """
    sums, reference = sums_of(state), state.run.recording.reference
    assert isinstance(sums, WeakRows)
    assert reference is not None
    density, reading = abs(state.values.scale) * math.sqrt(2.0 * sums.noise.q), math.sqrt(sums.noise.r)
    share = 1.0 / math.sqrt(2.0 * sums.rows)
    return NoiseReport(
        noise=state.noise,
        all=Level(density, share * density, reading, share * reading, sums.rows),
        rest=None,
        motion=None,
        declared=state.run.rig.sensor.noise,
        crossover=state.run.crossover(state.noise),
        band=state.band,
        reference="velocity" if reference.name == VELOCITY else "reference_acceleration",
    )


def noise_report(state: RunState) -> NoiseReport:
    """Noise by likelihood: of all readings, of those at rest and of those in motion.

    At rest the readings of an encoder that noise does not dither share their rounding error, and scatter by nothing.
    """
    run, integrals, noise, scale = state.run, state.drive, state.noise, state.values.scale
    whole = level(run, integrals, noise, scale)
    moving = in_motion(run, state.signals)
    floor = run.resolved_variance if run.rounding > 0.0 else run.reading_variance_floor
    resting = run.held(~moving) if run.rounding > 0.0 else ~moving
    return NoiseReport(
        noise=noise,
        all=whole,
        rest=level_of(run, integrals, noise, resting, scale, floor),
        motion=level_of(run, integrals, noise, moving, scale),
        declared=run.rig.sensor.noise,
        crossover=run.crossover(noise),
    )


def noise_report_in_band(state: RunState, model: Model) -> NoiseReport:
    """Noise where a band was imposed, by the scatter of block scores, not split into rest and motion."""
    run, scale = state.run, state.values.scale
    noise = noise_of_blocks(state.noise, normal_equations(state, model.free))
    density, reading = abs(scale) * math.sqrt(2.0 * noise.q), math.sqrt(state.search.noise.r)
    blocks = int(float(run.t[-1] - run.t[0]) / block_length(state))
    share = 1.0 / math.sqrt(2.0 * max(1, blocks))
    return NoiseReport(
        noise=noise,
        all=Level(density, share * density, reading, math.nan, int(state.counts.sum())),
        rest=None,
        motion=None,
        declared=run.rig.sensor.noise,
        crossover=run.crossover(noise),
        band=state.band,
    )


def noise_of_blocks(noise: Noise, normal: NormalEquations) -> Noise:
    """Noise scaled so that the model's covariance equals the one that the blocks show."""
    if normal.spread is None:
        return noise
    ratio = np.diag(normal.spread) / np.diag(normal.gram)
    factor = float(np.exp(np.mean(np.log(ratio))))
    return noise.scaled(factor, factor)


def in_motion(run: PreparedRun, signals: Signals) -> Flags:
    """Readings at which the stage moves: speed or acceleration above 2 % of their largest, and a little around."""
    v, a = np.abs(signals.v), np.abs(signals.a - np.median(signals.a))
    busy = (v > 0.02 * np.quantile(v, 0.999)) | (a > 0.05 * np.quantile(a, 0.999))
    step = float(signals.t[1] - signals.t[0])
    margin = max(1, int(0.05 / step))
    near = np.convolve(busy, np.ones(2 * margin + 1), mode="same") > 0 if len(busy) > 2 * margin else busy
    index = np.clip(np.rint((run.t - run.origins.t - signals.t[0]) / step).astype(int), 0, len(near) - 1)
    return np.asarray(near[index])


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
    differing_names: list[str] = []
    coupled = len(states) > 1 and all(state.run.rig.coupled and not state.run.recording.axis for state in states)
    names = [term.name for term in model.free if term.name in LET_DIFFER and term.name not in model.priors]
    for name in names if coupled else ():
        if between_runs(states, model, name)[0].p_value >= REMARK_ALPHA:
            continue
        tried = (seen_by_runs(states, model, name, e) for e in SEEN_BY_RUNS if e not in model.effects)
        explaining = tuple(choice for choice in tried if choice is not None)
        differing_names += [name] if name not in model.per_run else []
        if explaining:
            return tuple(differing_names), tuple(sorted(explaining, key=lambda choice: choice.std / abs(choice.value)))
    return tuple(differing_names), ()


def between_runs(
    states: Sequence[RunState], model: Model, name: str, further: Sequence[Term] = ()
) -> tuple[BetweenRuns, Array, Array]:
    """A coefficient of each run one step from a solution, and the normal equations A x = c, further terms last."""
    layout = layout_of(model.vary(name), [state.run for state in states])
    m = len(layout.slots)
    information, score = np.zeros((m + len(further), m + len(further))), np.zeros(m + len(further))
    belief = layout.prior_information(model)
    information[np.arange(m), np.arange(m)] = belief
    at = np.array([states[runs[0]].values.by_name[term.name] for term, runs in layout.slots])
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
    rows_of_run = layout_of(model.vary(name), [state.run for state in states]).rows_of(name)
    joined = np.delete(np.eye(len(score)), rows_of_run[1:], axis=0)
    joined[rows_of_run[0], rows_of_run] = 1.0
    information, score = joined @ information @ joined.T, joined @ score
    scaled, size = unit_diagonal(information)
    weights, vectors = scipy.linalg.eigh(scaled)
    if weights[0] < SEEN_APART or rest.p_value < REMARK_ALPHA:
        return None
    covariance = (vectors / weights) @ vectors.T / np.outer(size, size)
    value, std = float((covariance @ score)[-1]), math.sqrt(float(covariance[-1, -1]))
    return SeenByRuns(effect, terms[0].unit, value, std, name) if abs(value) > SEEN_SIGMA * std else None
