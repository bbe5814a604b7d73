"""Change points: instants from which the relation of output and encoder no longer holds."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal._support.values import listing
from accelcal.diagnosis.faults import glitches
from accelcal.diagnosis.policy import (
    BREAK_BAND_RATIO,
    BREAK_EXPLAINED,
    BREAK_LOG_LIKELIHOOD,
    BREAK_POWER_RATIO,
    IMPACT_COINCIDENCE,
    IMPACT_ENCODER_RATIO,
    IMPACT_OUTPUT_RATIO,
    IMPACT_PEAK_RATIO,
    RELATION_EXPLAINED,
    RELATION_LEAST_BLOCKS,
)
from accelcal.diagnosis.relation import (
    BANDS_PER_DECADE,
    MOST_BLOCKS,
    BandRelation,
    RelationColumns,
    _solve,
    unexplained,
)
from accelcal.estimation.run import PreparedRun, Source, prepared
from accelcal.signals.series import LOCAL


@dataclass(frozen=True, slots=True)
class Usable:
    """The part of a record on which one model can hold."""

    start: float
    """s"""
    end: float
    """s"""
    breaks: tuple[float, ...]
    """Instants from which no relation holds, s; empty when the whole record is usable."""
    columns: RelationColumns
    """Of the whole overlap of the channels."""


def usable(source: Source, columns: RelationColumns | None = None) -> Usable:
    """The part before the first break; the whole overlap of the channels if there is none.

    Parameters
    ----------
    source : with its position steps.
    columns : of every reading of it, if available.

    Raises
    ------
    RecordingError
        If the channels do not overlap.
    """
    run = prepared(source)
    if columns is None or run is not columns.run:
        columns = RelationColumns(run)
    breaks = find_breaks(columns)
    start, end = float(run.t[0]), float(run.t[-1])
    if breaks:
        before = run.t[run.t < breaks[0]]
        end = float(before[-1])
    return Usable(start, end, breaks, columns)


def find_breaks(columns: RelationColumns) -> tuple[float, ...]:
    """First instant from which no linear relation between output and encoder holds, to the end of the record.

    Parameters
    ----------
    columns : of a record; no fit is needed.

    Returns
    -------
    At most one instant, s on the position clock.

    Notes
    -----
    For every split of the record, each side is fitted separately; the log-likelihood of two variances against one
    selects the
    split. It is a break if the part before is explained, the part behind is not explained by any relation of its own,
    and its
    residual is larger by a factor that effects, vibration and a change from rest to motion do not reach. A slow
    departure shows
    in a narrow band first: the earliest instant counts, within a factor 8 of the widest band.
    """
    run = columns.run
    top = 0.1 / run.reading_step
    lowest = 4.0 * RELATION_LEAST_BLOCKS / float(run.t[-1] - run.t[0])
    if lowest >= top:
        return ()
    count = max(2, math.ceil(BANDS_PER_DECADE * math.log10(top / lowest)) + 1)
    widest, found = 0.0, math.inf
    for band in np.geomspace(top, lowest, count):
        if band < widest / BREAK_BAND_RATIO:
            break
        split = _split(columns.in_band(float(band)))
        if split is not None:
            widest, found = max(widest, float(band)), min(found, split)
    if widest == 0.0:
        found = impact(run)
    return (found,) if math.isfinite(found) else ()


IMPACT_SAMPLES = 5
"""An impact is shorter than twice this many samples."""


def impact(run: PreparedRun) -> float:
    """Instant of an impact that shows on both channels at once, s; infinite if there is none.

    An impact lasts for several samples of the output, exceeds all other peaks in it, and shifts the encoder within the
    same tenth of a second. It is the only sign of a break where no relation ever held (a barometer as encoder).
    """
    t, u = run.accel.t, run.accel.y
    if len(u) < 4 * LOCAL:
        return math.inf
    filtered = scipy.ndimage.median_filter(u, 2 * IMPACT_SAMPLES + 1, mode="nearest")
    excess = np.abs(u - filtered)
    pair = np.minimum(excess[1:], excess[:-1])
    hit = int(np.argmax(pair))
    if hit < 4 * LOCAL:
        return math.inf  # too little before it to know what is usual
    elsewhere = pair[np.abs(t[:-1] - t[hit]) > 2.0 * IMPACT_COINCIDENCE]
    before = slice(max(0, hit - 4 * LOCAL), max(1, hit - IMPACT_SAMPLES))
    spread = float(np.median(excess[before])) / 0.6745
    steps = np.abs(np.diff(u))
    spread = max(spread, float(np.min(steps[steps > 0.0], initial=math.inf)))
    if (
        pair[hit] < max(IMPACT_OUTPUT_RATIO * spread, IMPACT_PEAK_RATIO * float(np.max(elsewhere, initial=0.0)))
        or pair[hit] == 0.0
    ):
        return math.inf
    second_difference = np.abs(np.diff(run.z, 2))
    begin = int(np.searchsorted(run.t, t[hit] - IMPACT_COINCIDENCE))
    usually = float(np.median(second_difference[max(0, begin - 4 * LOCAL) : max(1, begin)])) + run.least_step
    jumps = run.t[1:-1][second_difference > IMPACT_ENCODER_RATIO * usually]
    disturbed = [*(f.time for f in glitches(run.recording, run)), *(float(time) for time in jumps)]
    near = [time for time in disturbed if abs(time - float(t[hit])) < IMPACT_COINCIDENCE]
    return min([float(t[hit]), *near]) if near else math.inf


def _split(relation: BandRelation) -> float | None:
    """Instant of the break inside one band, if there is one."""
    gram, edges = relation.blocks(MOST_BLOCKS)
    K = len(gram)
    if K < 2 * RELATION_LEAST_BLOCKS:
        return None
    forward = np.cumsum(gram, axis=0)
    backward = forward[-1] - forward
    before, behind = unexplained(forward[:-1]), unexplained(backward[:-1])
    n1, n2 = forward[:-1, -1, -1], backward[:-1, -1, -1]
    k = np.arange(1, K)
    with np.errstate(divide="ignore", invalid="ignore"):
        power1, power2 = before[0] / n1, behind[0] / n2
        whole = unexplained(forward[-1:])[0][0] / forward[-1, -1, -1]
        gain = 0.5 * (K * np.log(whole) - k * np.log(power1) - (K - k) * np.log(power2))
        lost = (behind[1] < BREAK_EXPLAINED) & (power2 > BREAK_POWER_RATIO * power1)
    possible = lost & (k >= RELATION_LEAST_BLOCKS) & (K - k >= 2) & np.isfinite(gain)
    if not possible.any():
        return None
    best = int(np.argmax(np.where(possible, gain, -np.inf)))
    if gain[best] < BREAK_LOG_LIKELIHOOD or before[1][best] < RELATION_EXPLAINED:
        return None
    held = _solve(forward[best])
    if np.median(relation.power(gram[best + 1 :], held)) < BREAK_POWER_RATIO * power1[best]:
        return None
    interval = (edges[max(0, best - 1)], edges[min(K, best + 4)])
    return relation.departure(held, float(power1[best]), interval)


__dir__ = listing(globals())
