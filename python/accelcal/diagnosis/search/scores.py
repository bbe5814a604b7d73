"""Gram matrix and scores of the hypotheses, without the base model and without slow noise."""

from __future__ import annotations

import copy
import math
from collections.abc import Callable, Iterator, Sequence

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy import special

from accelcal.data import Array, Places, unit_diagonal
from accelcal.diagnosis.policy import FINALISTS, SLOW_NOISE_BEYOND_DOUBT
from accelcal.diagnosis.search.hypotheses import Hypothesis, jump_response, nuisances
from accelcal.diagnosis.search.slow_noise import SlowNoise, log_likelihood, slow_noise
from accelcal.estimation.columns import distinct
from accelcal.estimation.engines import rows_of_dwells, spectrum_of, sums_of, whole_columns
from accelcal.estimation.noise import MeasuredSpectrum, whitener
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term, evaluate

DEGENERATE = 1e-5
"""Share of a column's power, beyond base and chosen effects, below which nothing of it is left to test."""
ROUNDING = 1e-10
"""The same share of all of its power, whatever of that a straight line of the acceleration takes up exactly."""
DEGENERATE_MIX = 1e-3
"""The same share for a mixture of several columns, whose weakest direction errors of the smoothed motion favour."""


def scale_of(power: Array) -> Array:
    """Square roots of the powers of columns, to scale them by; 1 for a column of which nothing is left."""
    return np.sqrt(np.where(power > 0.0, power, 1.0))


def scaled_gram(G: Array) -> tuple[Array, Array]:
    """A Gram matrix scaled to a diagonal of ones, and the roots of its own; 1 for a column of which nothing is left."""
    size = scale_of(np.diag(G))
    return np.asarray(G / np.outer(size, size)), size


def project_out(G: Array, c: Array, columns: NDArray[np.intp], prior_std: float = math.inf) -> tuple[Array, Array]:
    """Gram matrix and scores with some columns projected out; their coefficients have mean zero and `prior_std`."""
    A, size = scaled_gram(G[np.ix_(columns, columns)] + np.eye(len(columns)) / prior_std**2)
    factor = scipy.linalg.cho_factor(A + 1e-9 * np.eye(len(columns)))
    left = scipy.linalg.cho_solve(factor, G[columns] / size[:, None]) / size[:, None]
    return G - G[:, columns] @ left, c - left.T @ c[columns]


def score_gain(A: Array, b: Array, before: Array | None = None) -> tuple[float, int, Array, Array]:
    """Gain b' A^-1 b of free coefficients, degrees of freedom, estimate and covariance.

    Directions that other columns already contain (less than `DEGENERATE` of their power left) are not counted.
    """
    reference = np.diag(A if before is None else before)
    if len(b) == 1:
        if A[0, 0] <= DEGENERATE * reference[0] or A[0, 0] <= 0.0:
            return 0.0, 0, np.zeros(1), np.full((1, 1), np.inf)
        return float(b[0] ** 2 / A[0, 0]), 1, b / A[0, 0], 1.0 / A
    size = scale_of(reference)
    values, vectors = np.linalg.eigh(A / np.outer(size, size))
    good = values > DEGENERATE_MIX
    inverse = (vectors[:, good] / values[good]) @ vectors[:, good].T / np.outer(size, size)
    return float(b @ inverse @ b), int(good.sum()), inverse @ b, inverse


def variance_gain(A: Array, b: Array) -> tuple[float, int, Array, Array]:
    """Gain of coefficients that are random with one unknown standard deviation s (derivations D3.4).

    2 log L = max_s [ b'(I/s² + A)^-1 b - log det(I + s² A) ].
    """
    values, vectors = np.linalg.eigh(A)
    values = np.maximum(values, 0.0)
    projected = (vectors.T @ b) ** 2

    def loss(log_s: float) -> float:
        s2 = math.exp(2.0 * log_s)
        return float(np.sum(np.log1p(s2 * values)) - np.sum(projected * s2 / (1.0 + s2 * values)))

    top = float(np.max(values, initial=1e-300))
    trials = -0.5 * math.log(top) + np.linspace(-2.0, 9.0, 23)
    scaled = np.exp(2.0 * trials)[:, None] * values
    explained = np.exp(2.0 * trials)[:, None] * projected / (1.0 + scaled)
    k = int(np.argmin(np.sum(np.log1p(scaled) - explained, axis=1)))
    low, high = trials[max(k - 1, 0)], trials[min(k + 1, len(trials) - 1)]
    best = scipy.optimize.minimize_scalar(loss, bounds=(low, high), method="bounded", options={"xatol": 0.02})
    gain = max(0.0, -float(best.fun))
    s = math.exp(float(best.x))
    return (
        gain,
        1,
        np.array([s]),
        np.array([[s**2 / max(1.0, 2.0 * np.sum((s**2 * values / (1 + s**2 * values)) ** 2))]]),
    )


def log_survival(gain: float, dof: int) -> float:
    """Log of the probability that chi-square with `dof` exceeds `gain`; never saturates."""
    if dof == 0 or gain <= 0.0:
        return 0.0
    if dof == 1:
        return float(math.log(2.0) + special.log_ndtr(-math.sqrt(gain)))
    a, x = dof / 2.0, gain / 2.0
    if x < 600.0:
        return float(np.log(max(special.gammaincc(a, x), 1e-300)))
    series, term = 1.0, 1.0
    for k in range(1, 12):
        term *= (a - k) / x
        series += term
    return float((a - 1.0) * math.log(x) - x - special.gammaln(a) + math.log(series))


ALIKE = 0.05
"""Share of its power that an effect keeps beside another where the two are one, of those that only sets of runs show:
their columns differ by errors of the smoothed motion alone."""
MOST_CACHED = 1 << 23
"""Largest number of column samples of a run that is kept for a second pass: 67 MB."""
APART = 1e5
"""Time from the end of a motion to its dwells when blocks are counted, s."""
RUN_SPACING = 1e6
"""Time between the starts of two runs when blocks are counted, s."""


class BaseProjection:
    """Columns of one run's base model and its innovations, and the projection that removes the base.

    The base is projected out of each run separately, so that the offset of one run cannot count as an effect in
    another.
    """

    def __init__(
        self, state: RunState, model: Model, separate: Sequence[Term] = (), given_back: Sequence[Term] = ()
    ) -> None:
        """Of a model; what further terms `given_back` contribute at the state counts as unexplained again."""
        self.state = state
        self.column_filter = sums_of(state)
        self._cached: tuple[Sequence[Term], slice, Array] | None = None
        self._distinct: tuple[Sequence[Term], tuple[list[Term], Places, Array]] = (
            (),
            ([], np.empty(0, np.intp), np.ones(0)),
        )
        uncertain = [*nuisances(state, model), *((term, np.inf) for term in separate)]
        base = [term for term in model.terms if term.name not in model.fixed]
        plain = [term for term in base if term.name not in {other.name for other, _ in uncertain}]
        terms = [*plain, *(term for term, _ in uncertain)]
        line = [k for k, term in enumerate(terms) if term.name in ("bias", "scale_factor")]
        self.line = np.array(line, dtype=np.intp)
        """Rows of the base that are a straight line of the acceleration."""
        # a random process in the model keeps its intensity: left free, it would contain every other one
        processes = {term.name for term in plain if term.effect.port == "process"}
        drawn = {name: prior.std for name, prior in model.priors.items() if name in processes}
        stds = [*(drawn.get(term.name, np.inf) for term in plain), *(std for _, std in uncertain)]
        self.prior_information: Array = np.array(stds) ** -2.0
        self.B: Array = whole_columns(self.column_filter, terms)
        self.y: Array = self.column_filter.whitened
        if given_back:
            sizes = np.array([state.values.by_name[term.name] for term in given_back])
            self.y = self.y + sizes @ whole_columns(self.column_filter, given_back)
        scale_rows = [row for term, row in zip(base, self.B, strict=False) if term.name == "scale_factor"]
        self.motion = float(sum(row @ row for row in scale_rows))
        """Power of the motion itself in the innovations; 0 where the base leaves no scale factor free."""
        self.at: Array = np.array([state.values.by_name.get(term.name, 0.0) for term in terms])
        self.slow_noise: SlowNoise | None = None
        """Slow noise that the rows were whitened by, beyond the filter's own."""
        self.measured: MeasuredSpectrum | None = None
        """Spectrum that they were whitened by before, where no single density describes the run.

        Elsewhere it may be that of a missing effect: only the slow noise that all finalists leave counts.
        """
        if state.band is not None:
            self.measured = state.spectrum or spectrum_of(state, [*plain, *separate])
        whiten = whitener(self.measured, self.rate)
        self.B, self.y = whiten(self.B), whiten(self.y)
        rest = rows_of_dwells(state, terms)
        if rest is not None:
            self.B, self.y = np.hstack([self.B, rest.columns.T]), np.concatenate([self.y, rest.y])
        self._factorise()

    def _factorise(self) -> None:
        A, self.size = unit_diagonal(self.B @ self.B.T + np.diag(self.prior_information))
        self.factor = scipy.linalg.cho_factor(A + 1e-12 * np.eye(len(A)))
        # Belief pulls towards zero, not towards the values at hand.
        self.wy: Array = self.weights(self.B @ self.y - self.prior_information * self.at)

    @property
    def rate(self) -> float:
        """Of the rows of the motion, Hz."""
        return self.column_filter.rate

    @property
    def times(self) -> Array:
        """Time of each row, s; dwells lie apart behind the motion."""
        t = self.column_filter.times
        return np.concatenate([t, np.full(len(self.y) - len(t), t[-1] + APART)])

    def whitened(self, noise: SlowNoise | None) -> BaseProjection:
        """The same run, its rows whitened by the spectrum of slow noise."""
        if noise is None:
            return self
        projection = copy.copy(self)
        projection.slow_noise = noise
        whiten = whitener(noise, self.rate)
        n = self.column_filter.rows
        projection.B = np.hstack([whiten(self.B[:, :n]), self.B[:, n:]])
        projection.y = np.concatenate([whiten(self.y[:n]), self.y[n:]])
        projection._factorise()
        if self._cached is not None:
            terms, rows, Z = self._cached
            projection._cached = (terms, rows, whiten(Z))
        return projection

    def weights(self, products: Array) -> Array:
        """Weights with which the base, under its prior information, predicts columns from its products with them."""
        scaled = (products.T / self.size).T
        return np.asarray((scipy.linalg.cho_solve(self.factor, scaled).T / self.size).T)

    def distinct(self, terms: Sequence[Term]) -> tuple[list[Term], Places, Array]:
        """Terms with distinct columns, and the place and factor of each of all terms; of the last ones at hand."""
        if self._distinct[0] is not terms:
            self._distinct = terms, distinct(terms, self.column_filter.signals)
        return self._distinct[1]

    def stretches(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        """Columns stretch by stretch, those of dwells last; those of a short run are cached for a second pass."""
        picked, places, factors = self.distinct(terms)
        for rows, Z in self._of_motion(picked):
            columns = Z[places]
            columns *= factors[:, None]
            yield rows, columns
        rest = rows_of_dwells(self.state, terms)
        if rest is not None:
            yield slice(self.column_filter.rows, len(self.y)), rest.columns.T

    def _of_motion(self, terms: Sequence[Term]) -> Iterator[tuple[slice, Array]]:
        if self._cached is not None and self._cached[0] is terms:
            yield self._cached[1:]
            return
        self._cached = None
        measured, slow = whitener(self.measured, self.rate), whitener(self.slow_noise, self.rate)
        for rows, Z in self.column_filter.stretches(terms):
            columns = slow(measured(Z))
            if rows == slice(0, self.column_filter.rows) and Z.size <= MOST_CACHED:
                self._cached = (terms, rows, columns)
            yield rows, columns

    def remainder(
        self, terms: Sequence[Term], progress: Callable[[float], None] = lambda share: None
    ) -> tuple[Array, Array, Array, Array, Array]:
        """Project the base out of columns.

        Returns
        -------
        Gram matrix (m, m) and scores (m,) of the remainder, power of the columns before the projection (m,), the same
        beyond a straight line of the acceleration (m,), and the weights with which the base predicts them (base, m).

        Notes
        -----
        A power of the acceleration is nearly straight about the specific force of a vertical axis. The base has the
        same line to rounding, so that only what is beyond it counts as its power; of others all of it does.
        """
        picked, places, factors = self.distinct(terms)
        m = len(picked)
        G, products, score = np.zeros((m, m)), np.zeros((len(self.B), m)), np.zeros(m)
        for rows, Z in self._of_motion(picked):
            G += Z @ Z.T
            products += self.B[:, rows] @ Z.T
            score += Z @ self.y[rows]
            progress(rows.stop / len(self.y))
        G, products, score = G[np.ix_(places, places)], products[:, places] * factors, score[places] * factors
        G *= np.outer(factors, factors)
        rest = rows_of_dwells(self.state, terms)
        if rest is not None:
            rows = slice(self.column_filter.rows, len(self.y))
            G += rest.columns.T @ rest.columns
            products += self.B[:, rows] @ rest.columns
            score += self.y[rows] @ rest.columns
        weights, diagonal = self.weights(products), np.diag(G).copy()
        beyond_line = diagonal.copy()
        traits = [term.effect.traits.static for term in terms]
        static = np.array([of is not None and not of.thermal for of in traits], dtype=np.bool_)
        straight, B = products[np.ix_(self.line, static)], self.B[self.line]
        within = np.einsum("km,km->m", straight, np.linalg.pinv(B @ B.T, hermitian=True) @ straight)
        beyond_line[static] = np.maximum(diagonal[static] - within, ROUNDING / DEGENERATE * diagonal[static])
        G -= products.T @ weights
        score -= products.T @ self.wy
        return G, score, diagonal, beyond_line, weights


def columns_of(items: Sequence[Hypothesis]) -> tuple[list[Term], list[slice]]:
    """Coefficients of all hypotheses, and the columns of each: the coarse form of a curve is the beginning of the fine
    one."""
    terms: list[Term] = []
    begins: dict[tuple[object, ...], int] = {}
    keys = [(item.effect.name, *item.shape.items()) for item in items]
    for key, item in sorted(zip(keys, items, strict=True), key=lambda pair: pair[1].leading is not None):
        if key not in begins:
            begins[key] = len(terms)
            terms += item.terms
    return terms, [slice(begins[k], begins[k] + len(item.terms)) for k, item in zip(keys, items, strict=True)]


def rounding_variances(terms: Sequence[Term], runs: Sequence[BaseProjection], power: Array) -> Array:
    """Variance of each coefficient from rests of an encoder that noise does not dither, (terms,) in its unit squared.

    While the stage rests, the rounding error is one number, variance step²/12, the same at each rest on the same count.
    It enters where the column changes as a rest begins or ends, each time with the power of a jump of the readings;
    all of them count against the whole `power` of the column, (terms,), but as no more than one difference of two
    rests. Zero where noise dithers, and for what acts on the output.
    """
    variances, most = np.zeros(len(terms)), np.zeros(len(terms))
    at_reading = [k for k, term in enumerate(terms) if term.port == "position"]
    for state in (run.state for run in runs if at_reading and run.state.run.rounding > 0.0):
        variance = state.run.rounding**2 / 12.0
        begins, ends, counts = state.run.rests
        memory = state.run.wait(state.noise)
        jump = jump_response(state)
        jump_power = float(jump @ jump) / float(np.median(state.series("S")))
        around = np.concatenate([begins, ends, begins - memory, ends + memory]) - state.run.origins.t
        _, place = np.unique(counts, return_inverse=True)
        columns = evaluate([terms[k] for k in at_reading], state.signals)
        for k, column in zip(at_reading, columns, strict=True):
            inside, outside = np.split(np.interp(around, state.signals.t, column), 2)
            change = np.bincount(place, (inside - outside).reshape(2, -1).sum(axis=0))
            if power[k] > 0.0:
                variances[k] += variance * float(change @ change) * (jump_power / power[k]) ** 2
                most[k] = max(most[k], 2.0 * variance / float(np.max(np.abs(column))) ** 2)
    return np.minimum(variances, most)


class CandidateScores:
    """Gram matrix and scores of the hypotheses over all runs, and the gains that follow from them."""

    def __init__(
        self,
        runs: Sequence[BaseProjection],
        items: Sequence[Hypothesis],
        *,
        progress: Callable[[float], None] = lambda share: None,
    ) -> None:
        self.items = items
        self.terms, self.columns = columns_of(items)
        self.motion = sum(run.motion for run in runs)
        plain = [item.effect.width == 1 and item.effect.port != "process" for item in items]
        self._plain: NDArray[np.bool_] = np.array(plain, dtype=np.bool_)
        self._positive: NDArray[np.bool_] = np.array([item.effect.traits.positive for item in items], dtype=np.bool_)
        alike = [ALIKE if item.effect.seen_by_sets else DEGENERATE for item in items]
        self._degenerate: Array = np.array(alike)
        """Share of a column's power below which nothing of it is left beside those chosen, of each hypothesis."""
        self._sum(runs, progress)
        self.rounding: Array = rounding_variances(self.terms, runs, self.power)
        """Variance that rounding to counts leaves to each coefficient, in its unit squared."""

    def _sum(self, runs: Sequence[BaseProjection], progress: Callable[[float], None] = lambda share: None) -> None:
        """Sum Gram matrix and scores over the runs."""
        m = len(self.terms)
        self.runs = runs
        self.G, self.c = np.zeros((m, m)), np.zeros(m)
        self.power: Array = np.zeros(m)
        """Power of each column before the base is projected out."""
        self.beyond_line: Array = np.zeros(m)
        """The same beyond a straight line of the acceleration, of its powers."""
        self._weights: list[Array] = []
        for run in runs:
            G, c, diagonal, beyond_line, weights = run.remainder(self.terms, progress)
            self.G += G
            self.power += diagonal
            self.beyond_line += beyond_line
            self.c += c
            self._weights.append(weights)
        absorbed = np.diag(self.G) <= DEGENERATE * self.beyond_line
        self.G[absorbed], self.G[:, absorbed], self.c[absorbed] = 0.0, 0.0, 0.0
        self._given: dict[tuple[int, ...], tuple[Array, Array]] = {(): (self.G, self.c)}
        self._gains: dict[tuple[int, ...], tuple[Array, NDArray[np.intp]]] = {}
        self._costs: dict[tuple[int, ...], float] = {}

    def rows(self) -> Iterator[tuple[Array, Array, Array]]:
        """Second pass over the rows of the Gram matrix, the base projected out, stretch by stretch.

        Yields
        ------
        Time of each row, s, with a large gap between runs; the innovations, (rows,); the columns, (m, rows).
        """
        for number, (run, weights) in enumerate(zip(self.runs, self._weights, strict=True)):
            t = run.times
            t = t - t[0] + number * RUN_SPACING
            for rows, Z in run.stretches(self.terms):
                B = run.B[:, rows]
                yield t[rows], run.y[rows] - run.wy @ B, Z - weights.T @ B

    def against_slow_noise(self) -> CandidateScores:
        """The same hypotheses, their rows whitened by the slow noise that all of them together leave in each run.

        The scores themselves where what they leave is white.
        """
        noises = [self._slow_noise(number) for number in range(len(self.runs))]
        if not any(noises):
            return self
        coloured = copy.copy(self)
        coloured._sum([run.whitened(noise) for run, noise in zip(self.runs, noises, strict=True)])
        return coloured

    def _slow_noise(self, number: int) -> SlowNoise | None:
        """Slow noise of one run; only what its base leaves is examined where that is white already."""
        run, weights = self.runs[number], self._weights[number]
        crossover = run.state.run.crossover(run.state.noise)
        moving = slice(0, run.column_filter.rows)
        left = (run.y - run.wy @ run.B)[moving]
        if slow_noise(left, run.rate, crossover) is None:
            return None
        explained = np.zeros(len(left))
        for rows, Z in run.stretches(self.terms):
            if rows.start == moving.stop:
                continue
            if rows != moving:
                return None
            X = Z - weights.T @ run.B[:, moving]
            columns = self._beyond_doubt(left, X, run.rate, crossover)
            scaled, size = scaled_gram(self.G[np.ix_(columns, columns)])
            values, vectors = np.linalg.eigh(scaled + 1e-9 * np.eye(len(size)))
            good = values > DEGENERATE_MIX
            basis = vectors[:, good] / np.sqrt(values[good]) / size[:, None]
            left = left - (basis @ (basis.T @ self.c[columns])) @ X[columns]
            cosines = scipy.fft.dct(basis.T @ X[columns], norm="ortho", axis=1)
            explained = np.einsum("mn,mn->n", cosines, cosines)
        return slow_noise(left, run.rate, crossover, np.minimum(explained, 1.0))

    def _beyond_doubt(self, left: Array, X: Array, rate: float, crossover: float) -> NDArray[np.intp]:
        """Columns of the hypotheses that a residual shows beyond doubt, the spectrum of its noise unknown; of all where
        it shows none: together they take the slowest bands whole, and leave a guess of their noise."""
        columns = np.zeros(0, dtype=np.intp)
        best = log_likelihood(left, rate, crossover)
        for _ in range(FINALISTS):
            trials = []
            for item, place in zip(self.items, self.columns, strict=True):
                if item.effect.width > 1 or item.effect.port == "process" or place.start in columns:
                    continue
                several = np.append(columns, place.start)
                x = score_gain(self.G[np.ix_(several, several)], self.c[several])[2]
                trials.append((log_likelihood(left - x @ X[several], rate, crossover), place.start))
            likelihood, column = max(trials, default=(best, 0))
            if likelihood - best < SLOW_NOISE_BEYOND_DOUBT:
                break
            columns, best = np.append(columns, column), likelihood
        return columns if len(columns) else np.arange(len(self.terms))

    def given(self, chosen: Sequence[int]) -> tuple[Array, Array]:
        """Gram matrix and scores once some hypotheses have entered: constant coefficients first, then random processes.

        A random process enters with the intensity that it has given those before it. Were it left free, it would leave
        to the others what it cannot explain and yet be credited for what it can.
        """
        key = tuple(chosen)
        if key not in self._given:
            self._given[key] = self._projected(key)
        return self._given[key]

    def _projected(self, chosen: tuple[int, ...]) -> tuple[Array, Array]:
        G, c = self.G, self.c
        constant = [i for i in chosen if self.items[i].effect.port != "process"]
        if constant:
            columns = np.concatenate([np.arange(self.columns[i].start, self.columns[i].stop) for i in constant])
            G, c = project_out(G, c, columns)
        for i in chosen:
            if i not in constant:
                columns = np.arange(self.columns[i].start, self.columns[i].stop)
                _, _, intensity, _ = variance_gain(G[np.ix_(columns, columns)], c[columns])
                G, c = project_out(G, c, columns, float(intensity[0]))
        return G, c

    def gain(self, i: int, chosen: Sequence[int] = ()) -> tuple[float, int, Array, Array]:
        """Twice the log-likelihood gain of hypothesis `i` given those chosen, its degrees of freedom, estimate,
        covariance."""
        G, c = self.given(chosen)
        columns = self.columns[i]
        A, b = G[columns, columns], c[columns]
        if self.items[i].effect.port == "process":
            return variance_gain(A, b)
        gain, dof, estimate, covariance = score_gain(A, b, self.G[columns, columns])
        degenerate = chosen and len(b) == 1 and A[0, 0] <= self._degenerate[i] * self.G[columns, columns][0, 0]
        if degenerate or (self.items[i].effect.traits.positive and estimate[0] < 0.0):
            return 0.0, 0, estimate, covariance
        rounding = self.rounding[columns]
        if np.any(rounding) and dof:
            covariance = covariance + np.diag(rounding)
            gain = float(estimate @ np.linalg.solve(covariance, estimate))
        return gain, dof, estimate, covariance

    def cost(self, i: int, chosen: Sequence[int] = ()) -> float:
        """What the gain of a random process given those chosen has paid for its columns, log det(I + s² A); 0 of
        others."""
        if self.items[i].effect.port != "process":
            return 0.0
        key = (i, *chosen)
        if key not in self._costs:
            A = self.given(chosen)[0][self.columns[i], self.columns[i]]
            s = float(self.gain(i, chosen)[2][0])
            self._costs[key] = float(np.linalg.slogdet(np.eye(len(A)) + s**2 * A)[1])
        return self._costs[key]

    def gains(self, chosen: Sequence[int] = ()) -> tuple[Array, NDArray[np.intp]]:
        """Gain and degrees of freedom of every hypothesis given those chosen, (items,) each."""
        key = tuple(chosen)
        if key in self._gains:
            return self._gains[key]
        G, c = self.given(key)
        gain, dof = np.zeros(len(self.items)), np.zeros(len(self.items), dtype=np.intp)
        starts = np.array([columns.start for columns in self.columns], dtype=np.intp)[self._plain]
        A, b, before = np.diag(G)[starts], c[starts], np.diag(self.G)[starts]
        testable = (self._degenerate[self._plain] * before < A) & (A > 0.0) & ~(self._positive[self._plain] & (b < 0.0))
        shrunk = A / (1.0 + A * self.rounding[starts])
        gain[self._plain] = np.where(
            testable, b**2 / np.where(testable, A, 1.0) * shrunk / np.where(testable, A, 1.0), 0.0
        )
        dof[self._plain] = testable
        for i in np.flatnonzero(~self._plain):
            gain[i], dof[i], _, _ = self.gain(int(i), key)
        self._gains[key] = (gain, dof)
        return gain, dof
