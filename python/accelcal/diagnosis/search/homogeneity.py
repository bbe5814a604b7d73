"""Whether an effect has one size in all parts of a record, in all runs and at all frequencies that excite it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy
from scipy import special

from accelcal.data import Array
from accelcal.diagnosis.policy import (
    EQUAL_SIZE_SHARE,
    EXCITING_SHARE,
    HOMOGENEITY_ALPHA,
    MODEL_NOISE_BLOCKS,
    RECORD_PARTS,
)
from accelcal.diagnosis.search.hypotheses import Hypothesis
from accelcal.diagnosis.search.scores import RUN_SPACING, CandidateScores, score_gain
from accelcal.effects import OF_TIME

OF_FREQUENCY = "bands of frequency"
"""What a record is divided into where sizes are compared over frequency."""
FREQUENCY_BANDS = 16
"""Bands from one cosine of the run to half the rate of the rows, equally wide in the logarithm."""


def different(value: Array, weight: Array) -> Array:
    """Probability, for each parameter, that parts differ as much if they have one value; (parts, m) each -> (m,)."""
    mean = np.sum(weight * value, axis=0) / np.sum(weight, axis=0)
    chi2 = np.sum(weight * (value - mean) ** 2, axis=0)
    return np.asarray(special.gammaincc(0.5 * (len(value) - 1), 0.5 * chi2))


@dataclass(frozen=True, slots=True)
class PartSizes:
    """Sizes of an effect in those parts of the runs that excite it, over its size in all of them."""

    size: tuple[float, ...]
    std: tuple[float, ...]
    p_value: float
    """Probability of such differences if the size is the same everywhere; 1 where fewer than two parts excite it."""
    of_what: str = "parts"
    """What the record was divided into."""

    @property
    def homogeneous(self) -> bool:
        """Whether the sizes agree."""
        return self.p_value > HOMOGENEITY_ALPHA

    @property
    def text(self) -> str:
        """Description of the comparison; empty where there was none."""
        if len(self.size) < 2:
            return ""
        span = f"{min(self.size):.2f} to {max(self.size):.2f} times"
        if self.homogeneous:
            return f"one size holds in all {len(self.size)} {self.of_what} ({span}, p = {self.p_value:.2g})"
        return f"{span} its size in {len(self.size)} {self.of_what}, p = {self.p_value:.2g}"

    @classmethod
    def none(cls) -> PartSizes:
        """Nothing to compare."""
        return cls((), (), 1.0)

    @classmethod
    def of(cls, score: Array, information: Array, of_what: str = "parts") -> PartSizes:
        """Compare parts by their scores of what is left, and their information, both in units of the whole size.

        No part needs to be significant: one with little information says little, and counts little.
        """
        total = float(np.sum(information))
        exciting = information > EXCITING_SHARE * total / max(len(information), 1)
        if total <= 0.0 or np.count_nonzero(exciting) < 2:
            return cls.none()
        size, variance = 1.0 + score[exciting] / information[exciting], 1.0 / information[exciting]
        weight = 1.0 / (variance + EQUAL_SIZE_SHARE**2)
        p = float(different(size[:, None], weight[:, None])[0])
        return cls(tuple(size.tolist()), tuple(np.sqrt(variance).tolist()), p, of_what)


def exempt(item: Hypothesis) -> bool:
    """Whether the parts of a record are not asked for one size: what happens once, and what follows time alone."""
    effect = item.effect
    return "instant" in item.shape or bool(effect.name in OF_TIME and effect.shapes)


class PartScores:
    """Gram matrices and scores of the finalists in parts of every run and bands of frequency."""

    def __init__(self, evidence: CandidateScores, every: Array) -> None:
        self.evidence = evidence
        self.every = every
        ends = [float(run.column_filter.times[-1] - run.column_filter.times[0]) for run in evidence.runs]
        m, parts = len(evidence.G), max(2, RECORD_PARTS // len(ends))
        self.G: Array = np.zeros((len(ends) * parts, m, m))
        self.c: Array = np.zeros((len(ends) * parts, m))
        self.G_by_band: Array = np.zeros((FREQUENCY_BANDS, m, m))
        self.c_by_band: Array = np.zeros((FREQUENCY_BANDS, m))
        squares, counts = np.zeros(FREQUENCY_BANDS), np.zeros(FREQUENCY_BANDS)
        squares_of_part, counts_of_part = np.zeros(len(self.c)), np.zeros(len(self.c))
        for t, y, X in evidence.rows():
            number = (t / RUN_SPACING + 1e-9).astype(np.intp)
            within = np.minimum(((t - number * RUN_SPACING) * parts / np.take(ends, number)).astype(np.intp), parts - 1)
            part = number * parts + within
            for k in np.unique(part):
                here = part == k
                self.G[k] += X[:, here] @ X[:, here].T
                self.c[k] += X[:, here] @ y[here]
                squares_of_part[k] += float(np.sum((y[here] - every @ X[:, here]) ** 2))
                counts_of_part[k] += np.count_nonzero(here)
            if t[0] - number[0] * RUN_SPACING > ends[number[0]]:
                continue  # dwells have no frequency
            cosines, rest = (scipy.fft.dct(rows, norm="ortho", axis=-1) for rows in (X, y))
            edges = np.geomspace(1.0, len(y), FREQUENCY_BANDS + 1)[1:-1]
            for k, band in enumerate(np.split(np.arange(len(y)), edges.astype(np.intp))):
                self.G_by_band[k] += cosines[:, band] @ cosines[:, band].T
                self.c_by_band[k] += cosines[:, band] @ rest[band]
                squares[k] += float(np.sum((rest[band] - every @ cosines[:, band]) ** 2))
                counts[k] += len(band)
        self.level = float(np.sum(squares) / np.sum(counts))
        """Mean square of what all finalists leave; far below 1 where a band is imposed on the noise."""
        self.levels: Array = self._shrunk(squares, counts)
        """The same in each band of frequency; one of few cosines is shrunk to that of all."""
        self.levels_of_parts: Array = self._shrunk(squares_of_part, counts_of_part)
        """The same in each part: a motion that shakes more leaves more."""

    def _shrunk(self, squares: Array, counts: Array) -> Array:
        return np.asarray((squares + MODEL_NOISE_BLOCKS * self.level) / (counts + MODEL_NOISE_BLOCKS))

    def sizes(self, i: int, given: Sequence[int], inflation: float) -> PartSizes:
        """Sizes of a hypothesis in the parts, by what it and the others leave; it scatters `inflation` times more than
        the model says. Other finalists are not taken off: functions of time would hide the differences."""
        e = self.evidence
        columns = np.concatenate([np.arange(e.columns[k].start, e.columns[k].stop) for k in (i, *given)])
        estimate = np.zeros(len(e.G))
        estimate[columns] = score_gain(e.G[np.ix_(columns, columns)], e.c[columns])[2]
        return compared(self.G, self.c, estimate, direction_of(e, i, given), inflation * self.levels_of_parts)

    def sizes_by_frequency(self, i: int, given: Sequence[int], inflation: float) -> PartSizes:
        """Sizes in bands of frequency, by what all finalists leave: errors of the motion and filters that nobody
        declared have no one size."""
        direction = direction_of(self.evidence, i, given)
        return compared(self.G_by_band, self.c_by_band, self.every, direction, inflation * self.levels, OF_FREQUENCY)


def compared(
    G: Array, c: Array, estimate: Array, direction: Array, scatter: Array, of_what: str = "parts"
) -> PartSizes:
    """Sizes of one combination of columns in each part, of what an estimate leaves, whose variance is `scatter` times
    that of the model, (parts,)."""
    score, information = (c - G @ estimate) @ direction, np.einsum("i,kij,j->k", direction, G, direction)
    return PartSizes.of(score / scatter, information / scatter, of_what)


def direction_of(evidence: CandidateScores, i: int, given: Sequence[int]) -> Array:
    """Combination of all columns that is the contribution of a hypothesis without what others explain of it, (m,)."""
    column = evidence.columns[i]
    _, _, estimate, _ = evidence.gain(i, given)
    direction = np.zeros(len(evidence.G))
    direction[column] = estimate
    if given:
        rows = np.concatenate([np.arange(evidence.columns[j].start, evidence.columns[j].stop) for j in given])
        weights, *_ = np.linalg.lstsq(evidence.G[np.ix_(rows, rows)], evidence.G[rows, column] @ estimate, rcond=1e-9)
        direction[rows] = -weights
    return direction
