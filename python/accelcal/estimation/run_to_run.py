"""Coefficients that differ from run to run: spread by restricted maximum likelihood, mean, interval for the next run.

A coefficient b_r of run r is drawn from N(m, D). All other parameters eliminated, the Gram matrices of the runs leave
exp(-b'S b/2 + g'b) of b = (b_1 ... b_R); in the eigenvectors U of S these are independent readings y = U'b of
variances 1/lambda + D about m U'1 (derivations 6.10). No sample is read twice.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Array, Recording
from accelcal.data.arrays import VANISHING, unit_diagonal

REMARK_ALPHA = 0.01
"""Probability under the null below which a fit remarks on something, over all that is tried: values that differ from
run to run, a covariate that they go with, scatter between dwells, a term that a triad lacks."""
COVERAGE = 0.95
"""Of the intervals."""
GRID, DRAWS = 600, 200
"""Variances at which `q` is taken, and draws of chi-square, where an interval is averaged over the variance."""
LEAST_SPREAD = 1e-6
"""Least variance between runs, as a share of the variance of one run: 0 would leave no slot to a run."""


@dataclass(frozen=True, slots=True)
class Spread:
    """How much one coefficient differs from run to run."""

    name: str
    symbol: str
    unit: str
    value: float
    """Standard deviation between runs."""
    low: float
    """Lower end of its 95 % interval, exact for normal differences."""
    high: float
    """Upper end."""
    p_value: float
    """Of the differences under one value for all runs."""
    runs: tuple[float, ...]
    """The coefficient in each run."""
    mean_half: float
    """Half the 95 % interval of the mean over runs."""
    next_half: float
    """Half the 95 % interval of the coefficient in a run to come, about that mean."""

    def sentence(self, mean: float) -> str:
        """For people; `mean` is the estimate over all runs."""
        unit = self.unit.removeprefix("1")
        p = f"p = {self.p_value:.1g}" if self.p_value > 0.0 else "p < 1e-300"
        if not math.isfinite(self.next_half):
            return f"{self.name} was let differ from run to run, but these runs do not say how much it does"
        if self.p_value >= REMARK_ALPHA:
            most = f"{self.high:.2g} {unit}".rstrip()
            return (
                f"{self.name} was let differ from run to run, but no difference is seen over {len(self.runs)} runs "
                f"({p}): its standard deviation is at most {most} (95 %)"
            )
        return (
            f"{self.name} differs from run to run: standard deviation {self.value:.2g} {unit}".rstrip()
            + f" (95 %: {self.low:.2g} to {self.high:.2g}) over {len(self.runs)} runs, {p}; "
            + f"in the next run it is {mean:.4g} ± {self.next_half:.2g} {unit}".rstrip()
            + " (95 %)"
        )


@dataclass(frozen=True, slots=True)
class BetweenRuns:
    """One coefficient of all runs in independent readings."""

    y: Array
    """(n,)"""
    v: Array
    """Variance of each within its run, (n,)."""
    u: Array
    """Share of the mean in each, (n,)."""
    turn: Array
    """Share of every run in each, (n, runs)."""

    @classmethod
    def of(cls, information: Array, right: Array, rows: Sequence[int]) -> BetweenRuns:
        """From normal equations A x = `right`, (m, m) and (m,), in which `rows` are the coefficient in each run."""
        columns_own, rest = list(rows), [i for i in range(len(right)) if i not in set(rows)]
        A, size = unit_diagonal(information)
        b = right / size
        eliminated = A[np.ix_(columns_own, rest)] @ np.linalg.pinv(A[np.ix_(rest, rest)], rcond=1e-12, hermitian=True)
        S = A[np.ix_(columns_own, columns_own)] - eliminated @ A[np.ix_(rest, columns_own)]
        g = b[columns_own] - eliminated @ b[rest]
        S, g = S * np.outer(size[columns_own], size[columns_own]), g * size[columns_own]
        weight, U = scipy.linalg.eigh(0.5 * (S + S.T))
        visible = weight > VANISHING * weight[-1]
        return cls(
            (U.T @ g)[visible] / weight[visible], 1.0 / weight[visible], np.sum(U, axis=0)[visible], U.T[visible]
        )

    def at(self, D: Array) -> tuple[Array, Array, Array]:
        """Mean over runs, its variance, and the weighted sum of squares about it, at variances D between runs, (k,)
        each; the sum is chi-square of n - 1 where D is the true variance."""
        w = 1.0 / (self.v + np.asarray(D)[:, None])
        variance = 1.0 / (w @ self.u**2)
        mean = variance * (w @ (self.u * self.y))
        return mean, variance, np.sum(w * (self.y - np.outer(mean, self.u)) ** 2, axis=1)

    def mean(self, D: float) -> tuple[float, float]:
        """Mean over runs and its variance at a variance D between them."""
        mean, variance, _ = self.at(np.array([D]))
        return float(mean[0]), float(variance[0])

    def q(self, D: float) -> float:
        """Weighted sum of squares about the mean."""
        return float(self.at(np.array([D]))[2][0])

    @property
    def p_value(self) -> float:
        """Of the differences under one value for all runs."""
        return float(scipy.special.chdtrc(len(self.y) - 1, self.q(0.0))) if len(self.y) > 1 else 1.0

    @property
    def least(self) -> float:
        """Least variance that is told from none."""
        return LEAST_SPREAD * float(np.min(self.v))

    @property
    def _scatter(self) -> float:
        """Sum of squares about the mean at no variance between runs: no likely variance is many times that."""
        return float(np.sum((self.y - self.u * self.mean(0.0)[0]) ** 2)) + float(np.max(self.v))

    @property
    def _widest(self) -> float:
        """Variance beyond every interval."""
        return 1e9 * self._scatter

    def log_likelihood(self, D: Array) -> Array:
        """Restricted log-likelihood of variances between runs, (k,), up to a constant."""
        _, variance, q = self.at(D)
        return np.asarray(-0.5 * (np.sum(np.log(self.v + np.asarray(D)[:, None]), axis=1) - np.log(variance) + q))

    @property
    def variance(self) -> float:
        """Most likely variance between runs."""
        if len(self.y) < 2:
            return self.least
        trials = np.geomspace(self.least, 10.0 * self._scatter, 60)
        k = int(np.argmax(self.log_likelihood(trials)))
        optimum = scipy.optimize.minimize_scalar(
            lambda log_D: -self.log_likelihood(np.exp([log_D]))[0],
            bounds=(math.log(trials[max(k - 1, 0)]), math.log(trials[min(k + 1, len(trials) - 1)])),
            method="bounded",
            options={"xatol": 1e-10},
        )
        return math.exp(float(optimum.x))

    def interval(self) -> tuple[float, float]:
        """95 % interval of the variance between runs: where `q` has its quantiles (Viechtbauer 2007)."""
        if len(self.y) < 2:
            return 0.0, math.inf
        ends = []
        for probability in (0.5 - COVERAGE / 2.0, 0.5 + COVERAGE / 2.0):
            target = float(scipy.special.chdtri(len(self.y) - 1, probability))
            inside = self.q(0.0) > target
            end = scipy.optimize.brentq(lambda D, t=target: self.q(D) - t, 0.0, self._widest) if inside else 0.0
            ends.append(float(end))
        return ends[0], ends[1]

    def halves(self) -> tuple[float, float]:
        """Half the 95 % intervals of the mean, and of the coefficient in a run to come, about the likely mean.

        Their variance D is not known: it has the distribution in which `q` is chi-square (generalised intervals,
        Iyer, Wang, Mathew 2004), that of Student where the runs themselves are exact.
        """
        if len(self.y) < 2:
            return math.inf, math.inf
        grid = np.array([0.0, *np.geomspace(self.least, self._widest, GRID)])
        drawn = scipy.special.chdtri(len(self.y) - 1, (np.arange(DRAWS) + 0.5) / DRAWS)
        D = np.interp(-drawn, -self.at(grid)[2], grid)
        mean, variance, _ = self.at(D)
        centre = self.mean(self.variance)[0]

        def half(std: Array) -> float:
            def missing(h: float) -> float:
                ends = (scipy.special.ndtr((centre + side * h - mean) / std) for side in (1.0, -1.0))
                return COVERAGE - float(np.mean(next(ends) - next(ends)))

            widest = 2.0 * float(np.max(np.abs(mean - centre) + 4.0 * std))
            return float(scipy.optimize.brentq(missing, 0.0, widest))

        return half(np.sqrt(variance)), half(np.sqrt(D + variance))


@dataclass(frozen=True, slots=True)
class SeenByRuns:
    """An effect that no single run shows, and that explains how runs differ."""

    effect: str
    unit: str
    value: float
    std: float
    instead: str
    """Coefficient that would otherwise differ from run to run."""

    @property
    def sentence(self) -> str:
        """For people."""
        unit = self.unit.removeprefix("1")
        size = f"{self.value:.3g} ± {self.std:.2g} {unit}".rstrip()
        return (
            f"the runs differ as {self.effect} of {size} would make them ({abs(self.value) / self.std:.0f} sigma), "
            f"which no single run shows; a {self.instead} that differs from run to run would too. Add {self.effect}, "
            "or record a further run that tells them apart"
        )


def penalty(count: int, D: float) -> Array:
    """Information on R coefficients that are drawn about an unknown mean with variance D, (R, R)."""
    return np.asarray((np.eye(count) - 1.0 / count) / D)


COVARIATE_DRAWS, COVARIATE_GRID = 4000, 40
"""Simulated campaigns, and variances between runs at which each likelihood is taken."""
SEED = 1293
"""Of the simulation: equal campaigns give equal answers."""
AS_LIKELY = 3.0
"""Log-likelihood below the best one within which another covariate is confounded with it."""
FEWEST_RUNS = 4
DAY_ONE = 1.0
"""Days from the first run at which the logarithm of time begins."""


@dataclass(frozen=True, slots=True)
class Covariate:
    """What runs may differ with."""

    name: str
    """line, logarithm and walk over the dates; mounting, operator, temperature."""
    columns: Array
    """(runs, k); k = 0 for a walk."""
    covariance: Array | None = None
    """Covariance of a walk over the dates, of mean diagonal 1, (runs, runs)."""
    unit: str = ""
    """Of one unit of the column."""


@dataclass(frozen=True, slots=True)
class GoesWith:
    """A covariate that a coefficient goes with."""

    parameter: str
    covariate: str
    members: tuple[str, ...]
    """Covariates that are about as likely, itself first."""
    slope: float
    """Per unit; NaN for groups and walks."""
    std: float
    unit: str
    p_value: float
    """Over all covariates that were tried."""
    tried: int
    left: float
    """Standard deviation between runs that it leaves, in the unit of the parameter; of a walk, how far it goes, rms."""

    @property
    def sentence(self) -> str:
        """For people."""
        size = f": {self.slope:.3g} ± {self.std:.2g} {self.unit}" if math.isfinite(self.slope) else ""
        words = {
            "line": "drifts with the date",
            "logarithm": "drifts with the logarithm of time",
            "walk": "walks from date to date",
        }.get(self.covariate, f"goes with the {self.covariate}")
        p = (
            f"p = {self.p_value:.1g}"
            if self.p_value > 1.0 / COVARIATE_DRAWS
            else f"p < {self.tried / COVARIATE_DRAWS:.1g}"
        )
        left = f"; {self.left:.2g} is left between runs"
        if self.covariate == "walk":
            size, left = f": {self.left:.2g} rms from the first run on", ""
        also = f"; confounded with {', '.join(self.members[1:])} on these runs" if len(self.members) > 1 else ""
        return f"{self.parameter} {words}{size} ({p}, {self.tried} tried){also}{left}"


def covariates_of(recordings: Sequence[Recording], unit: str) -> list[Covariate]:
    """Every covariate that all runs declare and that takes different values."""
    covariates: list[Covariate] = []
    dates = [recording.labels.date for recording in recordings]
    if all(date is not None for date in dates) and len(set(dates)) > 2:
        t = np.array(dates, dtype=np.float64)
        t = t - np.min(t)
        shared = np.minimum.outer(t, t)
        covariates += [
            Covariate("line", t[:, None], unit=f"{unit} per day"),
            Covariate("logarithm", np.log(t / DAY_ONE + 1.0)[:, None], unit=f"{unit} per factor e"),
            Covariate("walk", np.empty((len(t), 0)), shared / float(np.mean(np.diag(shared)))),
        ]
    for name in ("mounting", "operator"):
        labels = [getattr(recording.labels, name) for recording in recordings]
        kinds = sorted(set(labels))
        if all(labels) and 1 < len(kinds) < len(labels):
            columns = np.array([[label == kind for kind in kinds[1:]] for label in labels], dtype=np.float64)
            covariates.append(Covariate(name, columns))
    warm = [recording.side.get("temperature") for recording in recordings]
    means = np.array([float(np.mean(channel.y)) for channel in warm if channel is not None])
    if len(means) == len(recordings) and np.ptp(means) > 0.0:
        covariates.append(Covariate("temperature", means[:, None], unit=f"{unit} per K"))
    return [
        covariate
        for covariate in covariates
        if covariate.covariance is not None or np.linalg.matrix_rank(centred(covariate.columns)) > 0
    ]


def centred(columns: Array) -> Array:
    """Columns less their means."""
    return np.asarray(columns - np.mean(columns, axis=0))


def goes_with(parameter: str, between: BetweenRuns, covariates: Sequence[Covariate]) -> GoesWith | None:
    """The covariate that a coefficient goes with; None where no one is significant."""
    able = [
        covariate
        for covariate in covariates
        if len(between.y) >= FEWEST_RUNS and covariate.columns.shape[1] < len(between.y) - 2
    ]
    if not able:
        return None
    rng = np.random.default_rng(SEED)
    D = between.variance
    drawn = rng.standard_normal((COVARIATE_DRAWS, len(between.y))) * np.sqrt(between.v + D)
    y = np.vstack([between.y, drawn])
    grid = np.concatenate([[0.0], np.geomspace(between.least, 100.0 * (D + float(np.max(between.v))), COVARIATE_GRID)])
    null = best_likelihood(y, between, None, grid)
    gains = np.array([best_likelihood(y, between, covariate, grid) - null for covariate in able])
    # each is judged against its own null, all of them together by the least p
    ranks = np.argsort(np.argsort(-gains[:, 1:], axis=1), axis=1)
    p_values = np.array([np.count_nonzero(g[1:] >= g[0]) + 1 for g in gains]) / (COVARIATE_DRAWS + 1.0)
    least = np.min((ranks + 1.0) / COVARIATE_DRAWS, axis=0)
    k = int(np.argmin(p_values - 1e-9 * gains[:, 0]))
    p_value = max(
        (np.count_nonzero(least <= p_values[k]) + 1.0) / (COVARIATE_DRAWS + 1.0), 1.0 / (COVARIATE_DRAWS + 1.0)
    )
    if p_value >= REMARK_ALPHA:
        return None
    k = max(
        (j for j in range(len(able)) if p_values[j] <= max(2.0 * p_values[k], 2.0 / COVARIATE_DRAWS)),
        key=lambda j: gains[j, 0],
    )
    members = [able[k].name] + [
        covariate.name for j, covariate in enumerate(able) if j != k and gains[k, 0] - gains[j, 0] < AS_LIKELY
    ]
    slope, std, left = size_of(between, able[k], grid)
    return GoesWith(
        parameter, able[k].name, tuple(members), slope, std, able[k].unit, p_value, len(able), math.sqrt(left)
    )


def best_likelihood(y: Array, between: BetweenRuns, covariate: Covariate | None, grid: Array) -> Array:
    """Log-likelihood of readings (draws, n), the most likely over the variances of a grid, (draws,)."""
    return np.asarray(np.max([likelihood(y, between, covariate, float(D)) for D in grid], axis=0))


def likelihood(y: Array, between: BetweenRuns, covariate: Covariate | None, D: float) -> Array:
    """Log-likelihood at a variance between runs, up to a constant, (draws,)."""
    W, X = weights_and_design(between, covariate, D)
    A = X.T @ W
    left = W - A.T @ np.linalg.pinv(A @ X, hermitian=True) @ A
    _, log_det = np.linalg.slogdet(W)
    return np.asarray(0.5 * log_det - 0.5 * np.einsum("ki,ij,kj->k", y, left, y, optimize=True))


def weights_and_design(spread: BetweenRuns, covariate: Covariate | None, D: float) -> tuple[Array, Array]:
    """Inverse covariance of the readings, and the columns of mean and covariate."""
    if covariate is None or covariate.covariance is None:
        W = np.diag(1.0 / (spread.v + D))
    else:
        between = spread.turn @ covariate.covariance @ spread.turn.T
        W = np.asarray(np.linalg.inv(np.diag(spread.v) + D * between), dtype=np.float64)
    X = spread.u[:, None]
    if covariate is not None and covariate.columns.shape[1]:
        X = np.hstack([X, spread.turn @ centred(covariate.columns)])
    return W, X


def size_of(between: BetweenRuns, covariate: Covariate, grid: Array) -> tuple[float, float, float]:
    """Slope of a single column with its standard deviation, NaN for others, and the variance left between runs."""
    freedom = len(between.y) - 1 - covariate.columns.shape[1]
    at = [float(likelihood(between.y[None], between, covariate, float(D))[0]) for D in grid]
    D = float(grid[int(np.argmax(at))]) * len(between.y) / max(freedom, 1)  # of least squares, not of the most likely
    if covariate.columns.shape[1] != 1:
        return math.nan, math.nan, D
    W, X = weights_and_design(between, covariate, D)
    covariance = np.linalg.inv(X.T @ W @ X)
    return float((covariance @ X.T @ W @ between.y)[1]), math.sqrt(float(covariance[1, 1])), D


def over_all(p: float, count: int) -> float:
    """Probability that the least of `count` independent probabilities is `p` or less (Sidak)."""
    return -math.expm1(count * math.log1p(-min(p, 1.0 - 1e-16)))
