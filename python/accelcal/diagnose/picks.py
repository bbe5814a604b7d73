"""Trial shapes that a record itself proposes where no coarse grid would meet the right one."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.effects import find
from accelcal.passes import Pass
from accelcal.recording import Array

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
AROUND = 33
"""Neighbours in the spectrum over position that a line is compared with."""


@dataclass(frozen=True, slots=True)
class Wave:
    """A period in position to try."""

    period: float
    near: tuple[float, float]
    """Where it may be refined, m."""
    looks: int
    """Periods that it was picked from."""


def jumps(one: Pass) -> list[float]:
    """Instants at which readings may have jumped, on the clock of the effects, s, at most 8.

    The filter forgets a jump within its own time constant, so no coarse grid of instants would meet it: those where
    innovations add up most over one time constant are tried.
    """
    span = max(1, int(1.0 / (2.0 * np.pi * one.run.crossover(one.noise) * one.run.reading_step)))
    y = np.where(one.counts, one.whitened, 0.0)
    loud = np.abs(np.convolve(y, np.ones(span), mode="full")[span - 1 :])
    found: list[float] = []
    for _ in range(JUMPS):
        k = int(np.argmax(loud))
        found.append(float(one.run.t[k] - 0.5 * one.run.reading_step - one.run.origins.t))
        loud[max(0, k - 4 * span) : k + 4 * span] = 0.0
    return sorted(found)


def waves(one: Pass) -> list[Wave]:
    """Periods at which the output may be a wave over position.

    A period is seen to one part in the number of periods on the stroke, so no coarse grid would meet a short one:
    those are tried on which the innovations, taken back through the filter to the output, fold best.
    """
    s = one.signals
    assert s is not None
    low, _ = find("rail_wave").shapes["period"].span(s)
    stroke = float(np.ptp(s.p))
    always = [stroke * share for share in LONG_WAVES if stroke * share > low]
    edges = [8.0 * stroke, *always, 0.5 * stroke]
    found = [Wave(p, (0.5 * (p + edges[k + 2]), 0.5 * (p + edges[k])), 1) for k, p in enumerate(always)]
    shortest = max(low, 12.0 * stroke / MOST_CELLS)
    if stroke * SHORTER < 2.0 * shortest:
        return found
    cell = shortest / 6.0
    n = scipy.fft.next_fast_len(int(2.5 * stroke / cell) + 2, real=True)
    place = (np.interp(one.run.t[one.counts] - one.run.origins.t, s.t, s.p) - float(np.min(s.p))) / cell
    cells = np.bincount(np.rint(np.maximum(place, 0.0)).astype(np.intp), asked_of_output(one), n)
    kappa = np.fft.rfftfreq(n, cell)
    rows = slice(*np.searchsorted(kappa, [1.0 / (SHORTER * stroke), 1.0 / shortest]))
    power = np.abs(scipy.fft.rfft(cells)[rows]) ** 2
    level = scipy.ndimage.median_filter(power, AROUND, mode="nearest")
    score = power / np.maximum(level, 1e-300)
    looks = max(1, int(stroke / shortest))
    for _ in range(min(WAVES, len(score) // 4)):
        k = int(np.argmax(score))
        best = float(kappa[rows][k])
        found.append(Wave(1.0 / best, (1.0 / (best + 0.6 / stroke), 1.0 / max(best - 0.6 / stroke, 0.4 * best)), looks))
        score[max(0, k - 3) : k + 4] = 0.0
    return found


def asked_of_output(one: Pass) -> Array:
    """What the innovations ask of the output at each reading that counts: the steady filter, transposed, (m,)."""
    T = one.run.reading_step
    kp, kv = (float(np.median(one.track.series(name))) for name in ("gain_p", "gain_v"))
    left = np.array([[1.0 - kp, 0.0], [-kv, 1.0]])
    F, G, H = np.array([[1.0, T], [0.0, 1.0]]), np.array([[T * T / 2.0], [T]]), np.array([[1.0, 0.0]])
    b, a = scipy.signal.ss2tf(F @ left, G, H, np.zeros((1, 1)))
    return np.asarray(scipy.signal.lfilter(b[0], a, one.whitened[one.counts][::-1])[::-1])
