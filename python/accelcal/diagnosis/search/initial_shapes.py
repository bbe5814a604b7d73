"""Trial shapes that a record itself proposes, where no coarse grid would come close to the right one."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np
import scipy

from accelcal.data import Array
from accelcal.effects.building_blocks import periods
from accelcal.estimation.columns import gradient_in_output
from accelcal.estimation.run_state import RunState

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
    response = jump_response(state)
    match = np.abs(scipy.signal.correlate(y, response, mode="full")[len(response) - 1 :])
    span = max(1, int(1.0 / (crossover * state.run.reading_step)))
    comparisons = max(1, int(s.length * crossover))
    found: list[InitialShape] = []
    for _ in range(MOST_JUMPS):
        k = int(np.argmax(match))
        instant = float(state.run.t[k] - 0.5 * state.run.reading_step - state.run.origins.t)
        found.append(InitialShape(instant, (instant, instant), comparisons))
        match[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return sorted(found, key=lambda shape: shape.value)


def jump_response(state: RunState) -> Array:
    """Innovations of the settled filter after a unit jump of the readings, until the filter has forgotten it, (m,)."""
    gain_p, gain_v = (float(np.median(state.track.series(name))) for name in ("gain_p", "gain_v"))
    step = state.run.reading_step
    impulse = np.zeros(max(2, int(state.run.wait(state.noise) / step)))
    impulse[0] = 1.0
    return np.asarray(
        scipy.signal.lfilter([1.0, -1.0], [1.0, gain_p + step * gain_v - 2.0, 1.0 - gain_p], impulse), dtype=np.float64
    )


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
    found = [InitialShape(p, (0.5 * (p + edges[k + 2]), 0.5 * (p + edges[k])), 1) for k, p in enumerate(always)]
    shortest = max(low, 2.0 * CELLS_PER_PERIOD * stroke / MOST_CELLS)
    if stroke * LONGEST_SEARCHED < 2.0 * shortest:
        return found
    kappa, power = folded_spectrum(state, s.p, 1.0 / (LONGEST_SEARCHED * stroke), 1.0 / shortest)
    score = power / np.maximum(scipy.ndimage.median_filter(power, LOCAL_LINES, mode="reflect"), 1e-300)
    comparisons = max(1, int(stroke / shortest))
    for _ in range(min(MOST_WAVES, len(score) // 4)):
        k = int(np.argmax(score))
        best = float(kappa[k])
        found.append(
            InitialShape(
                1.0 / best, (1.0 / (best + 0.6 / stroke), 1.0 / max(best - 0.6 / stroke, 0.4 * best)), comparisons
            )
        )
        score[max(0, k - LINE_HALF_WIDTH) : k + LINE_HALF_WIDTH + 1] = 0.0
    return found


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
