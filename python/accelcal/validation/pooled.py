"""One comparison of a model with several recordings: errors over all of their start points together."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import replace

import numpy as np

from accelcal.data.arrays import Array
from accelcal.validation.comparison import Evaluation, NoiseFloor, RmsInterval
from accelcal.validation.prediction import rms

APART = 4.0
"""Horizons between two recordings, so that no stretch of time over which errors are averaged holds both."""


def pooled(several: Sequence[Evaluation]) -> Evaluation:
    """Comparisons of one model with several recordings as one.

    Parameters
    ----------
    several : under one ruler, at least one.

    Returns
    -------
    Drifts, free-running and one-step errors and noise floor over all recordings; each start point, and each reading,
    counts the same. Curves, bins and what else is of one recording are those of the first.
    """
    first, *others = several
    if not others:
        return first
    readings = [len(seen.simulated[0]) for seen in several]
    innovations = [len(seen.residual[0]) for seen in several]
    drifts = {h: in_a_row([seen.drifts[h] for seen in several], APART * h) for h in first.drifts}
    return replace(
        first,
        recording=" and ".join(seen.recording for seen in several),
        drifts=drifts,
        coast_rms={horizon: rms(error) for horizon, (_, error) in drifts.items()},
        coast_starts={h: sum(seen.coast_starts[h] for seen in several) for h in first.coast_starts},
        coast_frozen_rms={h: over_starts(several, [s.coast_frozen_rms[h] for s in several], h) for h in drifts},
        coast_floor={h: over_starts(several, [s.coast_floor[h] for s in several], h) for h in drifts},
        simulated_rms=root_mean(zip((seen.simulated_rms for seen in several), readings, strict=True)),
        one_step_rms=root_mean(zip((seen.one_step_rms for seen in several), innovations, strict=True)),
        not_carried=tuple(dict.fromkeys(text for seen in several for text in seen.not_carried)),
        left_out=tuple(text for seen in several for text in seen.left_out),
        noise_scores=tuple(score for seen in several for score in seen.noise_scores),
        noise_floor=pooled_floor(several, readings),
    )


def in_a_row(series: Sequence[tuple[Array, Array]], gap: float) -> tuple[Array, Array]:
    """Instants (n,) s and errors (n,) of several recordings one behind the other, `gap` s between them."""
    instants, begin = [], 0.0
    for t, _ in series:
        if len(t):
            instants.append(t - t[0] + begin)
            begin = float(instants[-1][-1]) + gap
    return np.concatenate(instants or [np.empty(0)]), np.concatenate([error for _, error in series])


def root_mean(weighted: Iterable[tuple[float | None, int]]) -> float:
    """Root of the mean square of values with their numbers; NaN where there is none."""
    known = [(value, count) for value, count in weighted if value is not None and count]
    count = sum(count for _, count in known)
    return math.sqrt(sum(count * value**2 for value, count in known) / count) if count else math.nan


def over_starts(several: Sequence[Evaluation], values: Sequence[float | None], horizon: float) -> float | None:
    """Rms of values over the start points of a horizon; None where there are none."""
    found = root_mean(zip(values, (seen.coast_starts[horizon] for seen in several), strict=True))
    return None if math.isnan(found) else found


def pooled_floor(several: Sequence[Evaluation], readings: Sequence[int]) -> NoiseFloor | None:
    """The floor under the errors of several recordings, whose noises are independent; None where one has none."""
    floors = [seen.noise_floor for seen in several]
    known = [floor for floor in floors if floor is not None]
    if len(known) < len(floors):
        return None
    drift = {}
    for horizon in known[0].drift:
        found = [(floor.drift[horizon], seen.coast_starts[horizon]) for floor, seen in zip(known, several, strict=True)]
        drift[horizon] = together([(one, count) for one, count in found if one is not None and count])
    simulated = together([(floor.simulated, count) for floor, count in zip(known, readings, strict=True)])
    limits = [floor for floor in known if floor.sensor.is_limit]
    return NoiseFloor((limits or known)[0].sensor, drift, simulated or known[0].simulated)


def together(several: Sequence[tuple[RmsInterval, int]]) -> RmsInterval | None:
    """Independent root mean squares with their weights as one; the deviations of the squares add in quadrature."""
    total = sum(count for _, count in several)
    if not total:
        return None
    shares = [(one, count / total) for one, count in several]
    square = sum(share * one.value**2 for one, share in shares)
    above = math.sqrt(sum((share * (one.high**2 - one.value**2)) ** 2 for one, share in shares))
    below = math.sqrt(sum((share * (one.value**2 - one.low**2)) ** 2 for one, share in shares))
    return RmsInterval(math.sqrt(square), math.sqrt(max(0.0, square - below)), math.sqrt(square + above))
