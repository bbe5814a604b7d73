"""Hypotheses: effects that may be missing from a model, and the trial shapes of each."""

from __future__ import annotations

import itertools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from accelcal.data import ACROSS, DERIVED, POSITION_ORDER, Array
from accelcal.effects import BUILT_IN, Effect, find, side_channels, users_own
from accelcal.effects.building_blocks import periods
from accelcal.effects.mechanisms import CARRIERS, mechanisms_of
from accelcal.estimation.columns import gradient_in_output
from accelcal.estimation.dwell_rows import acts_at_rest, shown as dwells_show
from accelcal.estimation.run_state import RunState
from accelcal.estimation.shape_parameters import linearised
from accelcal.model import Model, Term, terms_of
from accelcal.signals.processing import correlated, recursive_filter
from accelcal.signals.series import running_median

MOST_JUMPS = 8
"""Instants at which a jump of the encoder is tried."""
LONG_WAVES = tuple(1.0 / turns for turns in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75))
"""Periods that are always tried, in strokes: a part of a wave on the stroke, one wave, nearly two."""
MOST_WAVES = 6
"""Further periods: those at which the innovations, folded over position, agree best."""
LONGEST_SEARCHED = 0.53
"""The longest of them, in strokes."""
MOST_CELLS = 2**17
"""Cells of position; a longer travel raises the shortest period."""
CELLS_PER_PERIOD = 6.0
"""Cells of the shortest period."""
PADDED = 2.5
"""Length of a spectrum over position, in strokes."""
LINE_HALF_WIDTH = 3
"""Lines of the spectrum on either side that one period fills."""
LOCAL_LINES = 33
"""Neighbours in the spectrum over position that a line is compared with."""
FEWEST_RIPPLES, MOST_RIPPLES = 3.0, 64.0
"""Periods within the range of acceleration: fewer are represented by splines, more are not resolved."""
BUMP_CELLS = 2048
"""Cells of the stroke in which something local is sought."""
BUMP_WIDTHS = (0.002, 0.003, 0.0045, 0.007, 0.01, 0.015, 0.022, 0.033, 0.05)
"""Standard deviations of a bump that are tried, in strokes; a wider one is a smooth curve."""
LEAST_BUMP_SIGMA = 3.0
"""Standard deviations of the position that the width of a bump must exceed."""
BUMP_DEGREE = 7
"""Degree of the smooth curve that it stands out from."""
LEAST_SIGMA_PERIODS = 6.0
"""Standard deviations of the acceleration that a period must span; shorter ones are averaged out."""


@dataclass(frozen=True, slots=True)
class InitialShape:
    """A value of a shape parameter to try."""

    value: float
    bracket: tuple[float, float] | None = None
    """Interval within which it may be refined; None: between its neighbours on the grid."""
    comparisons: int = 1
    """Values among which it was selected."""
    also: Mapping[str, float] = field(default_factory=dict)
    """Values of further shape parameters that were found with it."""


def jumps(state: RunState) -> list[InitialShape]:
    """Instants at which readings may have jumped, on the clock of the effects, s, at most 8.

    The filter forgets a jump within its own time constant, so no coarse grid of instants would come close to it: those
    instants are tried at which the innovations match the response to a jump best.
    """
    s = state.signals
    crossover = 2.0 * np.pi * state.run.crossover(state.noise)
    y = np.where(state.counts, state.whitened, 0.0)
    match = np.abs(correlated(y, jump_response(state)))
    span = max(1, int(1.0 / (crossover * state.run.reading_step)))
    comparisons = max(1, int(s.length * crossover))
    shapes: list[InitialShape] = []
    for _ in range(MOST_JUMPS):
        k = int(np.argmax(match))
        instant = float(state.run.t[k] - 0.5 * state.run.reading_step - state.run.origins.t)
        shapes.append(InitialShape(instant, (instant, instant), comparisons))
        match[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return sorted(shapes, key=lambda shape: shape.value)


def jump_response(state: RunState) -> Array:
    """Innovations of the settled filter after a unit jump of the readings, until the filter has forgotten it, (m,)."""
    gain_p, gain_v = (float(np.median(state.series(name))) for name in ("gain_p", "gain_v"))
    step = state.run.reading_step
    impulse = np.zeros(max(2, int(state.run.wait(state.noise) / step)))
    impulse[0] = 1.0
    return recursive_filter([1.0, -1.0], [1.0, gain_p + step * gain_v - 2.0, 1.0 - gain_p], impulse)


def waves(state: RunState) -> list[InitialShape]:
    """Periods, m, at which the output may be a wave over position.

    The record resolves a period to one part in the number of periods on the stroke, so no coarse grid would come close
    to
    a short one: those are tried at which the innovations, referred back to the output and folded over position, agree
    best.
    """
    s = state.signals
    low, _ = periods(s)
    stroke = float(np.ptp(s.p))
    always = [stroke * share for share in LONG_WAVES if stroke * share > low]
    edges = [8.0 * stroke, *always, 0.5 * stroke]
    shapes = [InitialShape(p, (0.5 * (p + edges[k + 2]), 0.5 * (p + edges[k])), 1) for k, p in enumerate(always)]
    shortest = max(low, 2.0 * CELLS_PER_PERIOD * stroke / MOST_CELLS)
    if stroke * LONGEST_SEARCHED < 2.0 * shortest:
        return shapes
    kappa, power = folded_spectrum(state, s.p, 1.0 / (LONGEST_SEARCHED * stroke), 1.0 / shortest)
    score = power / np.maximum(running_median(power, LOCAL_LINES // 2, "symmetric"), 1e-300)
    comparisons = max(1, int(stroke / shortest))
    for _ in range(min(MOST_WAVES, len(score) // 4)):
        k = int(np.argmax(score))
        best = float(kappa[k])
        shapes.append(
            InitialShape(
                1.0 / best, (1.0 / (best + 0.6 / stroke), 1.0 / max(best - 0.6 / stroke, 0.4 * best)), comparisons
            )
        )
        score[max(0, k - LINE_HALF_WIDTH) : k + LINE_HALF_WIDTH + 1] = 0.0
    return shapes


def folded_spectrum(state: RunState, x: Array, lowest: float, highest: float) -> tuple[Array, Array]:
    """Spectrum of the innovations, referred back to the output, over a variable other than time.

    Parameters
    ----------
    x : the variable at the times of the signals, (n,).
    lowest, highest : cycles per unit of x.

    Returns
    -------
    Wave numbers, and the power at each.
    """
    s = state.signals
    low, span, cell = float(np.min(x)), float(np.ptp(x)), 1.0 / (CELLS_PER_PERIOD * highest)
    n = scipy.fft.next_fast_len(int(PADDED * span / cell) + 2, real=True)
    place = (np.interp(state.run.t[state.counts] - state.run.origins.t, s.t, x) - low) / cell
    output_score = gradient_in_output(state, state.whitened[state.counts])
    cells = np.bincount(np.rint(np.maximum(place, 0.0)).astype(np.intp), output_score, n)
    kappa = np.fft.rfftfreq(n, cell)
    rows = slice(*np.searchsorted(kappa, [lowest, highest]))
    power: Array = np.abs(scipy.fft.rfft(cells)[rows]) ** 2
    return np.asarray(kappa[rows], dtype=np.float64), power


def ripples(state: RunState) -> list[InitialShape]:
    """Periods, m/s², at which the output may ripple over acceleration: 0 (none), and the one at which the innovations,
    folded over acceleration, agree best."""
    s = state.signals
    span = float(np.ptp(s.a))
    shortest = max(LEAST_SIGMA_PERIODS * s.a_std, span / MOST_RIPPLES)
    if span < 2.0 * FEWEST_RIPPLES * shortest:
        return [InitialShape(0.0)]
    kappa, power = folded_spectrum(state, s.a, FEWEST_RIPPLES / span, 1.0 / shortest)
    return [InitialShape(0.0), InitialShape(1.0 / float(kappa[np.argmax(power)]), comparisons=int(span / shortest))]


def bumps(state: RunState) -> list[InitialShape]:
    """Place and width of something local on the rail, m: 0 (nothing), and where the innovations, referred back to the
    output, depart most from a smooth function of position, as a Gaussian bump or its slope."""
    s = state.signals
    stroke = float(np.ptp(s.p))
    cell = stroke / BUMP_CELLS
    widths = [share for share in BUMP_WIDTHS if share * stroke > LEAST_BUMP_SIGMA * s.p_std]
    if not stroke > 0.0 or not widths:
        return [InitialShape(0.0)]
    low = float(np.min(s.p))
    place = (np.interp(state.run.t[state.counts] - state.run.origins.t, s.t, s.p) - low) / cell
    score = gradient_in_output(state, state.whitened[state.counts])
    cells = np.minimum(np.maximum(place, 0.0).astype(np.intp), BUMP_CELLS - 1)
    sums = np.asarray(np.bincount(cells, score, BUMP_CELLS), dtype=np.float64)
    counts = np.asarray(np.bincount(cells, minlength=BUMP_CELLS), dtype=np.float64)
    smooth = np.polynomial.legendre.legvander(np.linspace(-1.0, 1.0, BUMP_CELLS), BUMP_DEGREE)
    root = np.sqrt(counts)
    c, *_ = np.linalg.lstsq(smooth * root[:, None], sums / np.maximum(root, 1.0), rcond=None)
    sums = sums - counts * (smooth @ c)
    best = (0.0, 0.0, 0.0)
    for width in widths:
        reach = int(4.0 * width * BUMP_CELLS)
        u = np.arange(-reach, reach + 1) / (width * BUMP_CELLS)
        bump = np.exp(-0.5 * u * u)
        power = np.zeros(BUMP_CELLS)
        for kernel in (bump, u * bump):
            matched, counted = (np.convolve(x, y[::-1], "same") for x, y in ((sums, kernel), (counts, kernel**2)))
            power += matched**2 / np.maximum(counted, 1.0)
        k = int(np.argmax(power))
        best = max(best, (float(power[k]), low + (k + 0.5) * cell, width * stroke))
    comparisons = int(1.0 / widths[0])
    return [InitialShape(0.0), InitialShape(best[1], comparisons=comparisons, also={"width": best[2]})]


PROPOSALS = {"jumps": jumps, "waves": waves, "ripples": ripples, "bumps": bumps}
"""Functions that propose values of a shape parameter from a record, by the name of the parameter's kind."""


@dataclass(frozen=True, slots=True)
class Hypothesis:
    """An effect at given shape parameters: what can enter a set."""

    effect: Effect
    shape: Mapping[str, float]
    comparisons: int = 1
    """Alternatives among which this one was selected before it was tried."""
    brackets: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Intervals within which shape parameters that the record proposed may be refined."""
    leading: int | None = None
    """Number of its columns, where it is the coarse form of a curve."""
    trials: int = 1
    """Hypotheses of its effect, equally likely before the record."""

    @property
    def alternatives(self) -> int:
        """Alternatives of its effect: hypotheses, or values among which the record proposed this one."""
        return max(self.trials, self.comparisons)

    @property
    def terms(self) -> tuple[Term, ...]:
        """Its coefficients."""
        return terms_of(self.effect, self.shape)[: self.leading]

    @property
    def held(self) -> tuple[Term, ...]:
        """Coefficients of its effect that it does without."""
        return terms_of(self.effect, self.shape)[len(self.terms) :]


def hypotheses_for(
    state: RunState, model: Model, extra: Sequence[Effect] | None = None, *, others: Sequence[RunState] = ()
) -> list[Hypothesis]:
    """Every effect that may be missing from a model on this record, at each of its trial shapes.

    Parameters
    ----------
    state : a fitted run.
    model : effects that it has are not offered again, but for the fine form of a coarse curve.
    extra : users' effects to consider besides the built-in catalogue; by default all that are registered.
    others : further runs: one whose position was read is enough for errors of it.
    """
    recorded = [(name, channel.unit) for name, channel in state.run.recording.side.items() if name not in DERIVED]
    offered = (*BUILT_IN, *side_channels(recorded), *(users_own() if extra is None else extra))
    return trials_of(offered, state, model, others)


def mechanisms_for(state: RunState, model: Model, others: Sequence[RunState] = ()) -> list[Hypothesis]:
    """Every coefficient that may follow the memory of a driver, at trial time constants."""
    recorded = [name for name in state.run.recording.side if name not in DERIVED]
    return trials_of([e for e in mechanisms_of(CARRIERS, recorded) if e not in BUILT_IN], state, model, others)


def trials_of(
    offered: Sequence[Effect], state: RunState, model: Model, others: Sequence[RunState] = ()
) -> list[Hypothesis]:
    """Those of several effects that may be missing from a model on this record, at each of their trial shapes."""
    s, dwells = state.signals, state.run.recording.dwells
    processes = [find(name) for name in model.effects if find(name).port == "process"]
    columns_in_time = {process.traits.changes: process.width for process in processes if process.traits.changes}
    hypotheses: list[Hypothesis] = []
    for effect in offered:
        if may_be_refined(model, effect):
            hypotheses.append(Hypothesis(effect, model.shapes[effect.name]))
            continue
        shown = effect.traits.visible or (dwells is not None and effect.seen_by_sets)
        excluded = effect.name in model.effects or not shown or effect.port == "noise"
        premature = effect.search.beside and effect.search.beside not in model.effects
        unknown = dwells is not None and acts_at_rest(effect) and not dwells_show(dwells, effect)
        foreign = lacks_its_position(effect, (state, *others)) or of_a_stage(effect, (state, *others))
        lacks_a_channel = any(name not in run.signals.side for name in effect.needs for run in (state, *others))
        if excluded or premature or unknown or foreign or lacks_a_channel:
            continue
        tried = {
            n: [InitialShape(float(v)) for v in shape.grid(s)] for n, shape in effect.shapes.items() if not shape.picked
        }
        # a state that a record carries over is refined from rest
        carried = {n: shape.at_rest for n, shape in effect.shapes.items() if shape.added and shape.at_rest is not None}
        tried |= {n: [InitialShape(value)] for n, value in carried.items()}
        tried |= {n: PROPOSALS[shape.picked](state) for n, shape in effect.shapes.items() if shape.picked}
        first = len(hypotheses)
        for trial in itertools.product(*tried.values()):
            chosen = dict(zip(tried, trial, strict=True))
            brackets = {name: proposed.bracket for name, proposed in chosen.items() if proposed.bracket}
            comparisons = math.prod(proposed.comparisons for proposed in trial)
            if effect.port != "process":  # beside one it is a column among others
                comparisons *= columns_in_time.get(effect.traits.changes, 1)
            shape = {name: proposed.value for name, proposed in chosen.items()}
            for proposed in trial:
                shape |= proposed.also
            hypotheses.append(Hypothesis(effect, shape, comparisons, brackets))
        if effect.coarse:
            hypotheses.append(replace(hypotheses[first], leading=effect.coarse))
        hypotheses[first:] = [replace(item, trials=len(hypotheses) - first) for item in hypotheses[first:]]
    return hypotheses


def lacks_its_position(effect: Effect, states: Sequence[RunState]) -> bool:
    """Whether it is an error of a position as it is read, and no run has one.

    Behind a velocity or an acceleration none is looked for: the position is their integral, whose slow part is noise.
    """
    error = effect in BUILT_IN and effect.port == "position" and not effect.traits.of_any_reference
    return error and all(state.run.order != POSITION_ORDER for state in states)


def of_a_stage(effect: Effect, states: Sequence[RunState]) -> bool:
    """Whether it comes from guides, cables or the encoder of a stage, and every run is of a tracked body, which has
    none; lines and lags are everybody's."""
    stage = effect in BUILT_IN and effect.owner in ("rig", "encoder") and not effect.needs
    lines = any(shape.unit == "Hz" or name == "tau" for name, shape in effect.shapes.items())
    return stage and not lines and all(ACROSS[0] in state.run.recording.side for state in states)


def may_be_refined(model: Model, effect: Effect) -> bool:
    """Whether a model has an effect in its coarse form, so that the fine one may be missing."""
    if effect.name not in model.effects or not effect.coarse:
        return False
    inner = terms_of(effect, model.shapes[effect.name])[effect.coarse :]
    return all(model.fixed.get(term.name) == 0.0 for term in inner)


def nuisances(state: RunState, model: Model) -> list[tuple[Term, float]]:
    """Nuisance parameters of every test, each with its prior standard deviation.

    Shape parameters of the effects in the model are among them: an effect that only corrects the shape of another must
    not be credited for it. So is the time constant of the low-pass, with its declared tolerance, or with the five
    percent
    of the delay rule where none is declared: five percent of a millisecond exceed a delay when the motion is fast.
    """
    tolerance = state.run.rig.lowpass_tolerance
    terms = [(Term(find("lowpass_error")), tolerance)] if tolerance > 0.0 else []
    return terms + [(shape.term, shape.prior_std) for shape in linearised(model, state)]
