"""Trial shapes that a record itself proposes where no coarse grid would meet the right one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data.arrays import Array
from accelcal.effects import find
from accelcal.estimation.adjoint import gradient_in_output
from accelcal.estimation.run_state import RunState

JUMPS = 8
"""Instants at which a jump of the encoder is tried."""
LONG_WAVES = tuple(1.0 / turns for turns in (0.25, 0.5, 0.75, 1.0, 1.25, 1.5, 1.75))
"""Periods that are always tried, in strokes: a part of a wave on the stroke, one, nearly two."""
WAVES = 6
"""Further periods, those on which the innovations fold best."""
SHORTER = 0.53
"""The longest of them, in strokes."""
MOST_CELLS = 2**17
"""Cells of position; a longer travel raises the shortest period."""
CELLS = 6.0
"""Cells of the shortest period."""
PADDED = 2.5
"""Length of a spectrum over position, in strokes."""
PADDING = 3
"""Lines of the spectrum to either side that one period fills."""
AROUND = 33
"""Neighbours in the spectrum over position that a line is compared with."""
FEWEST_RIPPLES, MOST_RIPPLES = 3.0, 64.0
"""Periods within the range of acceleration: fewer are within reach of splines, more are not sought."""
BLUR = 6.0
"""Periods of fewer standard deviations of the acceleration are blurred."""


@dataclass(frozen=True, slots=True)
class InitialShape:
    """A value of a shape parameter to try."""

    value: float
    near: tuple[float, float] | None = None
    """Where it may be refined; None: between its neighbours on the grid."""
    looks: int = 1
    """Values that it was picked from."""


def jumps(one: RunState) -> list[InitialShape]:
    """Instants at which readings may have jumped, on the clock of the effects, s, at most 8.

    The filter forgets a jump within its own time constant, so no coarse grid of instants would meet it: those where
    innovations look most like those after a jump are tried.
    """
    s = one.signals
    assert s is not None
    crossover = 2.0 * np.pi * one.run.crossover(one.noise)
    y = np.where(one.counts, one.whitened, 0.0)
    response = after_jump(one)
    loud = np.abs(scipy.signal.correlate(y, response, mode="full")[len(response) - 1 :])
    span = max(1, int(1.0 / (crossover * one.run.reading_step)))
    looks = max(1, int(s.length * crossover))
    found: list[InitialShape] = []
    for _ in range(JUMPS):
        k = int(np.argmax(loud))
        instant = float(one.run.t[k] - 0.5 * one.run.reading_step - one.run.origins.t)
        found.append(InitialShape(instant, (instant, instant), looks))
        loud[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return sorted(found, key=lambda pick: pick.value)


def after_jump(one: RunState) -> Array:
    """Innovations of the settled filter after a jump of the readings by one, as long as it remembers it, (m,)."""
    gain_p, gain_v = (float(np.median(one.track.series(name))) for name in ("gain_p", "gain_v"))
    step = one.run.reading_step
    impulse = np.zeros(max(2, int(one.run.wait(one.noise) / step)))
    impulse[0] = 1.0
    return np.asarray(
        scipy.signal.lfilter([1.0, -1.0], [1.0, gain_p + step * gain_v - 2.0, 1.0 - gain_p], impulse), dtype=np.float64
    )


def waves(one: RunState) -> list[InitialShape]:
    """Periods, m, at which the output may be a wave over position.

    A period is seen to one part in the number of periods on the stroke, so no coarse grid would meet a short one:
    those are tried on which the innovations, taken back through the filter to the output, fold best.
    """
    s = one.signals
    assert s is not None
    low, _ = find("rail_wave").shapes["period"].span(s)
    stroke = float(np.ptp(s.p))
    always = [stroke * share for share in LONG_WAVES if stroke * share > low]
    edges = [8.0 * stroke, *always, 0.5 * stroke]
    found = [InitialShape(p, (0.5 * (p + edges[k + 2]), 0.5 * (p + edges[k])), 1) for k, p in enumerate(always)]
    shortest = max(low, 2.0 * CELLS * stroke / MOST_CELLS)
    if stroke * SHORTER < 2.0 * shortest:
        return found
    kappa, power = folded(one, s.p, 1.0 / (SHORTER * stroke), 1.0 / shortest)
    score = power / np.maximum(scipy.ndimage.median_filter(power, AROUND, mode="reflect"), 1e-300)
    looks = max(1, int(stroke / shortest))
    for _ in range(min(WAVES, len(score) // 4)):
        k = int(np.argmax(score))
        best = float(kappa[k])
        found.append(
            InitialShape(1.0 / best, (1.0 / (best + 0.6 / stroke), 1.0 / max(best - 0.6 / stroke, 0.4 * best)), looks)
        )
        score[max(0, k - PADDING) : k + PADDING + 1] = 0.0
    return found


def folded(one: RunState, x: Array, lowest: float, highest: float) -> tuple[Array, Array]:
    """How well the innovations, taken back to the output, fold over a variable at wave numbers in a range.

    Parameters
    ----------
    x : the variable at the times of the signals, (n,).
    lowest, highest : cycles per unit of x.

    Returns
    -------
    Wave numbers, and the power at each.
    """
    s = one.signals
    assert s is not None
    low, span, cell = float(np.min(x)), float(np.ptp(x)), 1.0 / (CELLS * highest)
    n = scipy.fft.next_fast_len(int(PADDED * span / cell) + 2, real=True)
    place = (np.interp(one.run.t[one.counts] - one.run.origins.t, s.t, x) - low) / cell
    wanted = gradient_in_output(one, one.whitened[one.counts])
    cells = np.bincount(np.rint(np.maximum(place, 0.0)).astype(np.intp), wanted, n)
    kappa = np.fft.rfftfreq(n, cell)
    rows = slice(*np.searchsorted(kappa, [lowest, highest]))
    power: Array = np.abs(scipy.fft.rfft(cells)[rows]) ** 2
    return np.asarray(kappa[rows], dtype=np.float64), power


def ripples(one: RunState) -> list[InitialShape]:
    """Periods, m/s², at which the output may ripple over acceleration: 0, which is none, and the one on which the
    innovations fold best."""
    s = one.signals
    assert s is not None
    span = float(np.ptp(s.a))
    shortest = max(BLUR * s.a_std, span / MOST_RIPPLES)
    if span < 2.0 * FEWEST_RIPPLES * shortest:
        return [InitialShape(0.0)]
    kappa, power = folded(one, s.a, FEWEST_RIPPLES / span, 1.0 / shortest)
    return [InitialShape(0.0), InitialShape(1.0 / float(kappa[np.argmax(power)]), looks=int(span / shortest))]


PICKS = {"jumps": jumps, "waves": waves, "ripples": ripples}
"""How values of a shape parameter are sought in a record, by what is sought."""
