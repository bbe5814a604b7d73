"""Bands of a run whose noise is not white: which determines the scale best, and whether they agree."""

from __future__ import annotations

import math
import pickle
from collections.abc import Hashable, Sequence
from itertools import combinations

import numpy as np
from scipy import special

from accelcal.data import POSITION_ORDER
from accelcal.effects import find
from accelcal.estimation.gauss_newton import BandTrial, Solution, estimated, initial_states
from accelcal.estimation.rows import LEAST_BLOCKS, normal_equations
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.signals.processing import NEARLY_NYQUIST

TRIAL_BANDS = 9
"""Bands that are tried where the noise is not white."""
JUDGED_PERIODS = 44.0
"""Periods of a band in a record below which no verdict is possible: twenty blocks of two, and those in
which the filter settles."""
LEAST_SIGNAL = 1.0
"""Power of the motion over that of the residual below which a band holds no signal."""
ALIKE = 2.0
"""Ratio of two uncertainties, each from the scatter of a few blocks, or of two shares of motion, up to which neither
band is the better one."""
DIFFERENT = 1.5
"""Half 95 % intervals, added in squares, by which scale or delay must differ to change with the band: three standard
deviations, for the few pairs that are compared."""


TRIALS = "bands"
"""First word of the question to a run what single bands say; a few readings less do not change the answer."""
NEEDED = "band needed"
"""Question to a run which of the others it answers because its noise needs a band."""


def question(model: Model, run: PreparedRun) -> tuple[Hashable, ...]:
    """The question to a run what single bands say of a model by its engine."""
    about = model, [find(name).digest for name in model.effects], run.engine
    return (TRIALS, pickle.dumps(about), *run.t[[0, -1]])


def in_its_band(run: PreparedRun, model: Model, state: RunState) -> PreparedRun:
    """A run with the same samples as that of a state, whose noise is known to need a band for a model."""
    return run.but(answers={**run.answers, NEEDED: question(model, state.run)})


def trials_needed(model: Model, run: PreparedRun) -> tuple[BandTrial, ...]:
    """Trials of single bands for a model on a run whose noise is known to need one; else none."""
    asked = run.answers.get(NEEDED)
    return run.answers.get(asked, ()) if asked and asked == question(model, run) else ()


def needs_band(state: RunState) -> bool:
    """Whether the crossover of the likelihood misleads: innovations are not white, or, of readings that were thinned
    because they are better than the output at every frequency, the likelihood leaves too few periods to judge.

    Thinned readings determine the motion up to the highest frequency in it, and rows are whitened by the spectrum of
    what the model leaves. A band would take faster motion from the output, with the effect that the model lacks in it,
    and leave few rows to show that effect. The noise of a reference that is no position is that of the weak form, whose
    spectrum is measured.
    """
    run = state.run
    if run.order != POSITION_ORDER:
        return False
    if run.every == 1:
        return state.coloured
    few = run.crossover(state.noise) * float(run.t[-1] - run.t[0]) < JUDGED_PERIODS
    return few or state.beyond_output


def trial_bands(model: Model, state: RunState) -> tuple[BandTrial, ...]:
    """Scale and delay of a run in each of nine bands.

    Where the noise is not white, a crossover from the likelihood follows the strongest part of the spectrum. Each
    trial band is fitted on its own; its uncertainty is measured, not modelled.
    """
    run = state.run
    span = float(run.t[-1] - run.t[0])
    least = LEAST_BLOCKS / span
    top = min(run.crossover(state.noise), 0.2 / run.reading_step)
    if run.every > 1:  # the readings that are left are better than the output at any of their frequencies
        top = NEARLY_NYQUIST / run.reading_step
    if least >= top:
        return ()
    trials_made: list[BandTrial] = []
    model = model.drop(*(effect.name for effect in model.noise_effects))  # what blocks scatter is measured
    for band in np.geomspace(least, top, TRIAL_BANDS):
        try:
            trial = estimated(model, initial_states(model, [run], [float(band)]), trial=True)
        except ValueError:
            continue
        answer = answer_of(trial, float(band), span)
        if answer is not None:
            trials_made.append(answer)
    return tuple(trials_made)


def answer_of(trial: Solution, band: float, span: float) -> BandTrial | None:
    """Trial of one band by the solution of one run in it; None where it did not settle, or its scale is held.

    The standard deviation is multiplied by the quantile of Student's distribution for the blocks that hold the motion.
    """
    slots = {term.name: i for i, (term, _) in enumerate(trial.layout.slots)}
    if "scale_factor" not in slots or not trial.converged:
        return None
    (state,), k = trial.states, slots["scale_factor"]
    normal = normal_equations(state, trial.model.free)
    scale = 1.0 + float(trial.x[k])
    if normal.blocks is None:
        return None
    signal = scale**2 * float(normal.gram[k, k]) / max(normal.power, 1e-300)
    quantile = special.stdtrit(np.maximum(1.0, normal.blocks - 1.0), 0.975)
    half = quantile * np.sqrt(np.diag(trial.covariance))
    late = slots.get("time_offset")
    delay = (None, 0.0) if late is None else (float(trial.x[late]), float(half[late]))
    return BandTrial(band, band * span, signal, scale, float(half[k]), *delay)


def best_band(trials: Sequence[BandTrial]) -> float | None:
    """The band that determines the scale factor best, Hz; None where there is no trial.

    One that holds no signal, or leaves too few periods for a verdict, is taken only where there is no other. Of those
    whose relative uncertainties a few blocks do not tell apart, and that hold as much motion above their residual, the
    fastest is taken: it has most periods.
    """
    if not trials:
        return None
    grade = {trial: (trial.signal < LEAST_SIGNAL, trial.periods < JUDGED_PERIODS) for trial in trials}
    level = [trial for trial in trials if grade[trial] == min(grade.values())]
    least = min(trial.relative for trial in level)
    alike = [trial for trial in level if trial.relative <= ALIKE * least]
    most = max(trial.signal for trial in alike)
    return max(trial.band for trial in alike if ALIKE * trial.signal >= most)


def change_with_band(trials: Sequence[BandTrial]) -> str | None:
    """The sentence on scale and delay in three bands, where they differ by more than their uncertainty.

    What changes with the band is no constant of the sensor: a lag, a high-pass or a resonance of either channel, or
    noise of the position that the output does not share.
    """
    trials = [trial for trial in trials if trial.signal >= LEAST_SIGNAL]
    if len(trials) < 3:
        return None
    three = (trials[0], trials[len(trials) // 2], trials[-1])
    pairs = list(combinations(three, 2))
    scales = any(abs(a.scale - b.scale) > DIFFERENT * math.hypot(a.scale_interval, b.scale_interval) for a, b in pairs)
    delays = any(
        abs(a.delay - b.delay) > DIFFERENT * math.hypot(a.delay_interval, b.delay_interval)
        for a, b in pairs
        if a.delay is not None and b.delay is not None
    )
    if not (scales or delays):
        return None
    described = "; ".join(
        f"{trial.band:.3g} Hz: 1 + k = {trial.scale:.4g} ± {trial.scale_interval:.2g}"
        + (f", delay {1e3 * trial.delay:.3g} ± {1e3 * trial.delay_interval:.2g} ms" if trial.delay is not None else "")
        for trial in three
    )
    which = " and ".join(name for name, differs in (("the scale", scales), ("the delay", delays)) if differs)
    return (
        f"{which} change{'' if scales and delays else 's'} with the band ({described}): a lag, a high-pass or a "
        "resonance of either channel does that, not a constant of the sensor"
    )
