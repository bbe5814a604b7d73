"""What a coefficient that differs from run to run goes with: date, mounting, operator, temperature (derivations 6.12).

Readings of the runs are those of `BetweenRuns`. A covariate is a column beside the mean, or a random walk over the
dates; its gain in likelihood, the variance between runs most likely each time, is compared with that of simulated
campaigns in which runs differ by chance alone.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.estimation.run_to_run import BetweenRuns

COVARIATE_ALPHA = 0.01
"""Probability, over all covariates that are tried, below which a coefficient is said to go with one."""
DRAWS, GRID = 4000, 40
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
        p = f"p = {self.p_value:.1g}" if self.p_value > 1.0 / DRAWS else f"p < {self.tried / DRAWS:.1g}"
        left = f"; {self.left:.2g} is left between runs"
        if self.covariate == "walk":
            size, left = f": {self.left:.2g} rms from the first run on", ""
        also = f"; confounded with {', '.join(self.members[1:])} on these runs" if len(self.members) > 1 else ""
        return f"{self.parameter} {words}{size} ({p}, {self.tried} tried){also}{left}"


def covariates_of(recordings: Sequence[Recording], unit: str) -> list[Covariate]:
    """Every covariate that all runs declare and that takes different values."""
    found: list[Covariate] = []
    dates = [recording.labels.date for recording in recordings]
    if all(date is not None for date in dates) and len(set(dates)) > 2:
        t = np.array(dates, dtype=np.float64)
        t = t - np.min(t)
        found.append(Covariate("line", t[:, None], unit=f"{unit} per day"))
        found.append(Covariate("logarithm", np.log(t / DAY_ONE + 1.0)[:, None], unit=f"{unit} per factor e"))
        shared = np.minimum.outer(t, t)
        found.append(Covariate("walk", np.empty((len(t), 0)), shared / float(np.mean(np.diag(shared)))))
    for name in ("mounting", "operator"):
        labels = [getattr(recording.labels, name) for recording in recordings]
        kinds = sorted(set(labels))
        if all(labels) and 1 < len(kinds) < len(labels):
            columns = np.array([[label == kind for kind in kinds[1:]] for label in labels], dtype=np.float64)
            found.append(Covariate(name, columns))
    warm = [recording.side.get("temperature") for recording in recordings]
    means = np.array([float(np.mean(channel.y)) for channel in warm if channel is not None])
    if len(means) == len(recordings) and np.ptp(means) > 0.0:
        found.append(Covariate("temperature", means[:, None], unit=f"{unit} per K"))
    return [one for one in found if one.covariance is not None or np.linalg.matrix_rank(centred(one.columns)) > 0]


def centred(columns: Array) -> Array:
    """Columns less their means."""
    return np.asarray(columns - np.mean(columns, axis=0))


def goes_with(parameter: str, seen: BetweenRuns, covariates: Sequence[Covariate]) -> GoesWith | None:
    """The covariate that a coefficient goes with; None where no one is significant."""
    able = [one for one in covariates if len(seen.y) >= FEWEST_RUNS and one.columns.shape[1] < len(seen.y) - 2]
    if not able:
        return None
    rng = np.random.default_rng(SEED)
    D = seen.variance
    drawn = rng.standard_normal((DRAWS, len(seen.y))) * np.sqrt(seen.v + D)
    y = np.vstack([seen.y, drawn])
    grid = np.concatenate([[0.0], np.geomspace(seen.least, 100.0 * (D + float(np.max(seen.v))), GRID)])
    null = best_likelihood(y, seen, None, grid)
    gains = np.array([best_likelihood(y, seen, one, grid) - null for one in able])
    # each is judged against its own null, all of them together by the least p
    ranks = np.argsort(np.argsort(-gains[:, 1:], axis=1), axis=1)
    own = np.array([np.count_nonzero(g[1:] >= g[0]) + 1 for g in gains]) / (DRAWS + 1.0)
    least = np.min((ranks + 1.0) / DRAWS, axis=0)
    k = int(np.argmin(own - 1e-9 * gains[:, 0]))
    p_value = max((np.count_nonzero(least <= own[k]) + 1.0) / (DRAWS + 1.0), 1.0 / (DRAWS + 1.0))
    if p_value >= COVARIATE_ALPHA:
        return None
    k = max((j for j in range(len(able)) if own[j] <= max(2.0 * own[k], 2.0 / DRAWS)), key=lambda j: gains[j, 0])
    members = [able[k].name] + [
        one.name for j, one in enumerate(able) if j != k and gains[k, 0] - gains[j, 0] < AS_LIKELY
    ]
    slope, std, left = size_of(seen, able[k], grid)
    return GoesWith(
        parameter, able[k].name, tuple(members), slope, std, able[k].unit, p_value, len(able), math.sqrt(left)
    )


def best_likelihood(y: Array, seen: BetweenRuns, covariate: Covariate | None, grid: Array) -> Array:
    """Log-likelihood of readings (draws, n), the most likely over the variances of a grid, (draws,)."""
    return np.asarray(np.max([likelihood(y, seen, covariate, float(D)) for D in grid], axis=0))


def likelihood(y: Array, seen: BetweenRuns, covariate: Covariate | None, D: float) -> Array:
    """Log-likelihood at a variance between runs, up to a constant, (draws,)."""
    W, X = weights_and_design(seen, covariate, D)
    A = X.T @ W
    left = W - A.T @ np.linalg.pinv(A @ X, hermitian=True) @ A
    _, log_det = np.linalg.slogdet(W)
    return np.asarray(0.5 * log_det - 0.5 * np.einsum("ki,ij,kj->k", y, left, y, optimize=True))


def weights_and_design(seen: BetweenRuns, covariate: Covariate | None, D: float) -> tuple[Array, Array]:
    """Inverse covariance of the readings, and the columns of mean and covariate."""
    if covariate is None or covariate.covariance is None:
        W = np.diag(1.0 / (seen.v + D))
    else:
        between = seen.turn @ covariate.covariance @ seen.turn.T
        W = np.asarray(np.linalg.inv(np.diag(seen.v) + D * between), dtype=np.float64)
    X = seen.u[:, None]
    if covariate is not None and covariate.columns.shape[1]:
        X = np.hstack([X, seen.turn @ centred(covariate.columns)])
    return W, X


def size_of(seen: BetweenRuns, covariate: Covariate, grid: Array) -> tuple[float, float, float]:
    """Slope of a single column with its standard deviation, NaN for others, and the variance left between runs."""
    freedom = len(seen.y) - 1 - covariate.columns.shape[1]
    at = [float(likelihood(seen.y[None], seen, covariate, float(D))[0]) for D in grid]
    D = float(grid[int(np.argmax(at))]) * len(seen.y) / max(freedom, 1)  # of least squares, not of the most likely
    if covariate.columns.shape[1] != 1:
        return math.nan, math.nan, D
    W, X = weights_and_design(seen, covariate, D)
    covariance = np.linalg.inv(X.T @ W @ X)
    return float((covariance @ X.T @ W @ seen.y)[1]), math.sqrt(float(covariance[1, 1])), D
