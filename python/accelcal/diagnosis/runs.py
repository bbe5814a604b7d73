"""Recordings compared: parameters that differ between runs, and the further run that would separate two effects."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from accelcal._support.values import immutable
from accelcal.data import GRAVITY, Array, Dwells, Mount, Rig, unit_diagonal
from accelcal.data.rig import Axis
from accelcal.diagnosis.policy import HOMOGENEITY_ALPHA
from accelcal.diagnosis.search.homogeneity import different
from accelcal.effects import find
from accelcal.estimation.dwell_rows import dwell_rows
from accelcal.estimation.gauss_newton import PER_RUN_OWNERS, Layout, layout_of
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.rows import inverse, normal_equations
from accelcal.estimation.run_fit import SEEN_APART, SEEN_BY_RUNS
from accelcal.estimation.run_state import RunState
from accelcal.estimation.weak_form.rows import WeakRows
from accelcal.model import Model, Term, terms_of
from accelcal.signals.signals import Signals

POOLED_SHARE = 1e-4
"""Information of all runs, over what one run gets of it, so that a run that does not excite a parameter says nothing
about it."""


@immutable
@dataclass(frozen=True, slots=True, eq=False)
class RunValues:
    """Parameters that all runs share, as each run would have them alone.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> from accelcal.verbs import run_values
    >>> settings = {"seconds": 8.0, "rig": ac.simulation.CXL02_RIG, "parameters": {}, "rng": np.random.default_rng(1)}
    >>> first, second = (ac.simulate("tones", **settings).recording for _ in range(2))
    >>> values = run_values(ac.fit([first, second]), [first, second])
    >>> values.parameters, values.value.shape
    (('bias', 'scale_factor'), (2, 2))
    """

    runs: tuple[str, ...]
    """Names of the recordings."""
    parameters: tuple[str, ...]
    units: tuple[str, ...]
    value: Array
    """(runs, parameters), SI units."""
    std: Array
    """Of each, (runs, parameters)."""
    p_values: Array
    """Probability of such differences under one value for all runs, times the number of parameters, at most 1,
    (parameters,)."""

    def __repr__(self) -> str:
        p = ", ".join(f"{name} p {p:.2g}" for name, p in zip(self.parameters, self.p_values, strict=True))
        return f"RunValues({', '.join(self.runs)}: {p})"


def values_by_run(states: Sequence[RunState], model: Model, explained: Sequence[str] = ()) -> RunValues | None:
    """The shared parameters in each run; None where there is one run alone, or nothing is shared.

    Parameters
    ----------
    states : fitted runs.
    model : that they were fitted with.
    explained : parameters whose differences have a cause already.

    Notes
    -----
    Each run is one Gauss-Newton step from the common estimate. Its variances are those of the noise model, or of the
    scatter of block scores if that is larger; p is that of chi-square over the runs, times the number of parameters.
    """
    terms = [
        term
        for term in model.free
        if term.owner not in PER_RUN_OWNERS and term.name not in {*model.per_run, *explained}
    ]
    owned = [term for term in model.free if term not in terms]
    if len(states) < 2 or not terms or any(state.run.recording.axis for state in states):
        return None
    normals = [normal_equations(state, [*terms, *owned], scatter=True) for state in states]
    pooled = POOLED_SHARE * np.sum([normal.gram for normal in normals], axis=0)
    value, variance = np.empty((len(states), len(terms))), np.empty((len(states), len(terms)))
    for r, (state, normal) in enumerate(zip(states, normals, strict=True)):
        covariance = inverse(normal.gram + pooled)
        wider = covariance if normal.spread is None else covariance @ normal.spread @ covariance
        shared = slice(0, len(terms))
        at = np.array([state.values.by_name[term.name] for term in terms])
        value[r] = at + (covariance @ normal.score)[shared]
        variance[r] = np.maximum(np.diag(covariance), np.diag(wider))[shared]
    return RunValues(
        runs=tuple(state.run.recording.name or f"recording {r + 1}" for r, state in enumerate(states)),
        parameters=tuple(term.name for term in terms),
        units=tuple(term.unit for term in terms),
        value=value,
        std=np.sqrt(variance),
        p_values=np.minimum(1.0, len(terms) * different(value, 1.0 / variance)),
    )


def runs_disagree(values: RunValues | None) -> Iterator[Remark]:
    """Recording in which a shared parameter has another value; no remark where all agree."""
    k = 0 if values is None else int(np.argmin(values.p_values))
    if values is not None and values.p_values[k] <= HOMOGENEITY_ALPHA:
        value = values.value[:, k]
        r, others, sigma = odd_one_out(value, values.std[:, k] ** 2)
        yield remark(
            "runs_disagree",
            parameter=values.parameters[k],
            recording=values.runs[r],
            value=float(f"{value[r]:.4g}"),
            others=float(f"{others:.4g}"),
            sigma=sigma,
            p=float(values.p_values[k]),
        )


def odd_one_out(value: Array, variance: Array) -> tuple[int, float, float]:
    """The run that departs most from the mean of the others, that mean, and by how many standard deviations."""
    odd = (0, 0.0, -1.0)
    for r in range(len(value)):
        rest = np.arange(len(value)) != r
        weight = 1.0 / variance[rest]
        mean = float(weight @ value[rest] / np.sum(weight))
        sigma = abs(float(value[r]) - mean) / float(np.sqrt(variance[r] + 1.0 / np.sum(weight)))
        odd = max(odd, (r, mean, sigma), key=lambda candidate: candidate[2])
    return odd


MOTIONS: tuple[tuple[str, Axis | None, Mount | None], ...] = (
    ("the axis level", "level", None),
    ("the axis up", "up", None),
    ("the axis down", "down", None),
    ("the sensor turned by 180 degrees, its input axis reversed", None, "reversed"),
    ("the sensor rolled by 180 degrees about its input axis", None, "rolled"),
    ("the sensor as mounted normally", None, "normal"),
)
"""The same motion once more, with another axis or mount."""
DWELLS, DWELL = 24, 60.0
"""Dwells of a tumble, and the length of each, s."""
ANGLE_STD = math.radians(0.01)
"""Of its angles where no level is declared, rad."""
TELLS = 0.1
"""Share of its standard deviation that an effect keeps with a run that shows it."""
BETTER = 0.99
"""Ratio of standard deviations below which a run replaces one that is listed before it: two that show an effect equally
well, such as the axis up and down, do not change places by a rounding error."""
INSIDE = 1e-4
"""Component of an effect in the directions that nothing shows beyond which it is not seen."""


@dataclass(frozen=True, slots=True)
class FurtherRun:
    """One further run that separates an effect."""

    effect: str
    unit: str
    run: str
    """What to record."""
    std: float
    """Standard deviation that the effect would have, all recordings together."""

    @property
    def sentence(self) -> str:
        """For people; half a sentence."""
        unit = self.unit.removeprefix("1")
        return f"one further run with {self.run} gives {self.effect} to {self.std:.2g} {unit}".rstrip()


def further_runs(
    states: Sequence[RunState], model: Model, apart: Sequence[str] = (), only: Sequence[str] = SEEN_BY_RUNS
) -> tuple[FurtherRun, ...]:
    """For each effect that these runs do not show, the further run that shows it best.

    Parameters
    ----------
    states : fitted runs.
    model : that they were fitted with.
    apart : coefficients that are let differ from run to run.
    only : effects that are asked for; all others are taken to be absent.

    Notes
    -----
    The further run is the first one once more: the same motion and noise, with the signals of another rig; or a tumble
    of 24 dwells. All effects that only sets of runs show are estimated together.
    """
    first = states[0]
    if GRAVITY in first.run.recording.side or not first.run.rig.coupled:
        return ()
    model = model.vary(*(name for name in apart if name not in model.priors))
    sides = set.intersection(*(set(state.run.recording.side) for state in states))
    names = [n for n in only if n not in model.effects and set(find(n).needs) <= sides]
    extra = [term for name in names for term in terms_of(find(name))]
    if not extra:
        return ()
    fisher, layout = information(states, model, extra), layout_of(model, [state.run for state in states])
    before = deviations(fisher, len(extra))
    runs_by_effect: dict[str, FurtherRun] = {}
    for text, gram in tried(first, model, extra):
        together = added(fisher, gram, model, layout, extra)
        after = deviations(together, len(extra))
        for name, term, old, std in zip(names, extra, before, after, strict=True):
            shown = old > find(name).prior.typical and std < TELLS * old  # not by these runs, but with that one
            if shown and std < (BETTER * runs_by_effect[name].std if name in runs_by_effect else math.inf):
                runs_by_effect[name] = FurtherRun(name, term.unit, text, std)
    return tuple(runs_by_effect.values())


def tried(state: RunState, model: Model, extra: Sequence[Term]) -> list[tuple[str, Array]]:
    """Every further run with its Gram matrix of the free terms and the further ones."""
    terms = [*model.free, *extra]
    rig = state.run.rig
    motions = ((text, axis or rig.axis, mount or rig.mount) for text, axis, mount in MOTIONS)
    grams = [
        (text, normal_equations(turned(state, axis, mount), terms).gram)
        for text, axis, mount in motions
        if (axis, mount) != (rig.axis, rig.mount)
    ]
    angle_std = rig.uncertainty.level or ANGLE_STD
    X = dwell_rows(tumble(state, angle_std), terms, state.values, state.run.origins).columns
    text = f"{DWELLS} dwells of {DWELL:g} s around a turn in gravity, angles to {math.degrees(angle_std):.2g} degrees,"
    return [*grams, (text, X.T @ X)]


def turned(state: RunState, axis: Axis, mount: Mount) -> RunState:
    """The run as it would have been with another axis or mount."""
    old = state.run.rig
    rig = replace(old, axis=axis, mount=mount, gravity_along_axis=None if axis != old.axis else old.gravity_along_axis)
    return repeated(state, rig, lambda s: turned_signals(s, old, rig))


def repeated(state: RunState, rig: Rig, change: Callable[[Signals], Signals], dwells: Dwells | None = None) -> RunState:
    """The run once more, with changed signals on a rig, and dwells beside it."""
    again = copy.copy(state)
    again.run = replace(state.run, recording=replace(state.run.recording, rig=rig, dwells=dwells))
    again.signals = change(state.signals)
    if isinstance(state.weak, WeakRows):
        same = state.weak.signals is state.signals
        again.weak = state.weak.moved(again, again.signals if same else change(state.weak.signals))
    return again


def turned_signals(s: Signals, old: Rig, rig: Rig) -> Signals:
    """The signals of the same motion on another rig."""
    sign = rig.polarity * old.polarity
    return replace(s, rig=rig, a=sign * s.a + rig.polarity * (rig.gravity - old.gravity), jerk=sign * s.jerk)


def tumble(state: RunState, angle_std: float) -> Dwells:
    """Dwells of the sensor around a turn; their means do not matter here."""
    samples = 1e4
    white = math.sqrt(state.noise.usual.q / DWELL * samples) * abs(state.values.scale)
    warm = state.run.recording.side.get("temperature")
    return Dwells(
        angle=np.arange(DWELLS) * 2.0 * np.pi / DWELLS,
        mean=np.zeros(DWELLS),
        std=np.full(DWELLS, white),
        duration=np.full(DWELLS, DWELL),
        samples=np.full(DWELLS, samples),
        group=("",) * DWELLS,
        rig=state.run.rig,
        temperature=None if warm is None else np.full(DWELLS, float(np.mean(warm.y))),
        angle_std=angle_std,
    )


def information(states: Sequence[RunState], model: Model, extra: Sequence[Term]) -> Array:
    """Normal equations of all runs, those of further terms last."""
    layout = layout_of(model, [state.run for state in states])
    m = len(layout.slots)
    total = np.diag(np.concatenate([layout.prior_information(model), np.zeros(len(extra))]))
    for index, state in enumerate(states):
        rows = [*layout.rows(index), *range(m, m + len(extra))]
        total[np.ix_(rows, rows)] += normal_equations(state, [*model.free, *extra]).gram
    return total


def added(fisher: Array, gram: Array, model: Model, layout: Layout, extra: Sequence[Term]) -> Array:
    """Normal equations with one more run, whose own coefficients are eliminated."""
    free, first = layout.terms, layout.rows(0)
    per_run = [k for k, term in enumerate(free) if term.owner in PER_RUN_OWNERS or term.name in model.per_run]
    shared = [k for k in range(len(gram)) if k not in per_run]
    G, size = unit_diagonal(gram)
    left = (
        G[np.ix_(shared, shared)]
        - G[np.ix_(shared, per_run)]
        @ np.linalg.pinv(G[np.ix_(per_run, per_run)], rcond=1e-10, hermitian=True)
        @ G[np.ix_(per_run, shared)]
    )
    left = left * np.outer(size[shared], size[shared])
    m = len(layout.slots)
    place = [first[k] for k in shared if k < len(free)] + list(range(m, m + len(extra)))
    total = fisher.copy()
    total[np.ix_(place, place)] += left
    return total


def deviations(information: Array, count: int) -> list[float]:
    """Standard deviations of the last coefficients, infinite where nothing tells them from the others."""
    scaled, size = unit_diagonal(information)
    weights, vectors = scipy.linalg.eigh(scaled)
    blind = weights < SEEN_APART
    sigmas = []
    for k in range(len(size) - count, len(size)):
        hidden = float(np.sum(vectors[k, blind] ** 2))
        shown = vectors[k, ~blind]
        std = math.sqrt(float(np.sum(shown**2 / weights[~blind]))) / float(size[k])
        sigmas.append(math.inf if hidden > INSIDE or size[k] <= 1e-140 else std)
    return sigmas
