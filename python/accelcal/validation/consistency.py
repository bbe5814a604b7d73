"""Consistency of a filter: NEES, NIS, whiteness, rms error and coverage, each against what chance alone would give.

Statistics only; nothing here runs a filter. Source: Bar-Shalom, Li, Kirubarajan (2001), section 5.4; paper II-H.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np
from numpy.typing import ArrayLike
from scipy import special

from accelcal._support.errors import AccelcalError
from accelcal._support.values import listing
from accelcal.data import Array

ConsistencyVerdict = Literal["consistent", "overconfident", "underconfident"]


@dataclass(frozen=True, slots=True)
class Consistency:
    """Average normalised squared error over independent runs, against its chi-square region."""

    mean: float
    """Average of the normalised squares; `dof` when all is well."""
    dof: int
    """Degrees of freedom of one run: states for NEES, readings for NIS."""
    runs: int
    """N."""
    low: float
    high: float
    """Two-sided region of `mean`: N mean is chi-square with N dof degrees of freedom."""
    probability: float
    """Probability that a consistent filter falls inside the region."""

    @property
    def verdict(self) -> ConsistencyVerdict:
        """Overconfident: the errors are larger than the stated covariance."""
        if not self.mean <= self.high:  # also catches NaN
            return "overconfident"
        return "underconfident" if self.mean < self.low else "consistent"

    @property
    def normalised(self) -> float:
        """Mean per degree of freedom (ANEES); 1 when all is well."""
        return self.mean / self.dof


@dataclass(frozen=True, slots=True)
class Whiteness:
    """Autocorrelation of normalised innovations, and the Ljung-Box test of all its lags together."""

    autocorrelation: Array
    """(L,) at lags 1 to L."""
    samples: int
    """K; the standard deviation of each lag is 1/sqrt(K) when the sequence is white."""
    ljung_box: float
    """K (K + 2) sum rho_l²/(K - l): chi-square with L degrees of freedom when the sequence is white."""
    p_value: float
    """Probability of a larger value by chance."""
    alpha: float
    """False-alarm rate of the verdict."""

    @property
    def verdict(self) -> Literal["white", "coloured"]:
        return "white" if self.p_value >= self.alpha else "coloured"


@dataclass(frozen=True, slots=True)
class CumulativePeriodogram:
    """Power below each frequency as a share of all, to be compared with the straight line of white noise."""

    frequency: Array
    """(m,) cycles per sample, up to 1/2."""
    share: Array
    """(m,)"""
    limit: float
    """Largest distance from the line that white noise exceeds with probability 5 %."""

    @property
    def distance(self) -> float:
        """Largest distance from the line."""
        return float(np.max(np.abs(self.share - 2.0 * self.frequency)))


@dataclass(frozen=True, slots=True)
class Coverage:
    """Share of intervals that contain the truth, compared with their nominal probability."""

    inside: int
    count: int
    promised: float
    low: float
    high: float
    """Clopper-Pearson interval of the true rate."""
    probability: float
    """Confidence of that interval."""

    @property
    def rate(self) -> float:
        return self.inside / self.count

    @property
    def verdict(self) -> ConsistencyVerdict:
        """Overconfident: the intervals are too short."""
        if self.high < self.promised:
            return "overconfident"
        return "underconfident" if self.low > self.promised else "consistent"


def chi_square_region(dof: int, runs: int, probability: float = 0.95) -> tuple[float, float]:
    """Two-sided region of the average of `runs` independent chi-square variables.

    Parameters
    ----------
    dof : int
        Degrees of freedom n of each.
    runs : int
        N; N times the average is chi-square with N n degrees of freedom.
    probability : float
        Of falling inside; half of the rest lies on either side.

    Raises
    ------
    ValueError
        `dof` or `runs` below 1, `probability` outside (0, 1).

    Examples
    --------
    >>> low, high = chi_square_region(dof=2, runs=50)
    >>> round(low, 3), round(high, 3)
    (1.484, 2.591)
    """
    if dof < 1 or runs < 1 or not 0.0 < probability < 1.0:
        raise AccelcalError(f"no region for dof = {dof}, runs = {runs}, probability = {probability}.")
    tail = 0.5 * (1.0 - probability)
    half = 0.5 * dof * runs
    return (
        float(2.0 * special.gammaincinv(half, tail) / runs),
        float(2.0 * special.gammainccinv(half, tail) / runs),
    )


def nees(error: Array, covariance: Array) -> Array:
    """Normalised estimation error squared e' P⁻¹ e, one per run or instant.

    Parameters
    ----------
    error : (..., n)
        Estimate minus truth, any units.
    covariance : (..., n, n)
        P, in the products of those units. States are scaled by their own sigma before the solve, so that metres and
        (m/s²)⁻² may be mixed.

    Raises
    ------
    ValueError
        A variance that is not positive.
    numpy.linalg.LinAlgError
        A singular covariance.
    """
    variance = np.diagonal(covariance, axis1=-2, axis2=-1)
    if not np.all(variance > 0.0):
        raise AccelcalError(f"NEES needs positive variances; the least is {float(np.min(variance))}.")
    sigma = np.sqrt(variance)
    scaled = error / sigma
    correlation = covariance / (sigma[..., :, None] * sigma[..., None, :])
    return np.asarray(np.einsum("...i,...i->...", scaled, np.linalg.solve(correlation, scaled[..., None])[..., 0]))


def nis(innovation: Array, variance: Array) -> Array:
    """Normalised innovation squared e²/S of scalar readings; (n,) and (n,) in matching units."""
    return np.asarray(innovation**2 / variance)


def consistency(values: Array, dof: int, probability: float = 0.95) -> Consistency:
    """Average NEES or NIS over independent runs with its region.

    Parameters
    ----------
    values : (N,)
        One normalised square per independent run (or per white innovation).
    dof : int
        Degrees of freedom of each: states for NEES, 1 for a scalar innovation.
    probability : float
        Of the region.

    Examples
    --------
    >>> consistency(np.array([1.0, 3.0, 2.0, 2.5]), dof=2).verdict
    'consistent'
    """
    values = np.ravel(values)
    low, high = chi_square_region(dof, len(values), probability)
    return Consistency(float(np.mean(values)), dof, len(values), low, high, probability)


def whiteness(normalised: Array, lags: int = 20, alpha: float = 0.01) -> Whiteness:
    """Tests a sequence of normalised innovations e/sqrt(S) for correlation in time.

    Parameters
    ----------
    normalised : (K,)
        Innovations over their standard deviation, in order; their mean is expected to be zero.
    lags : int
        L.
    alpha : float
        False-alarm rate of the verdict.

    Raises
    ------
    ValueError
        Fewer samples than lags, or a sequence of zeros.
    """
    K = len(normalised)
    if not 0 < lags < K:
        raise AccelcalError(f"whiteness over {lags} lags needs more than {lags} samples, not {K}.")
    power = float(normalised @ normalised)
    if not power > 0.0:
        raise AccelcalError("whiteness of a sequence of zeros is not defined.")
    lag = np.arange(1, lags + 1)
    rho = np.array([normalised[:-l] @ normalised[l:] for l in lag]) / power
    ljung_box = float(K * (K + 2) * np.sum(rho**2 / (K - lag)))
    return Whiteness(rho, K, ljung_box, float(special.gammaincc(0.5 * lags, 0.5 * ljung_box)), alpha)


def cumulative_periodogram(normalised: Array) -> CumulativePeriodogram:
    """Cumulative periodogram of a sequence with its Kolmogorov-Smirnov limit (Bartlett 1955).

    Parameters
    ----------
    normalised : (K,)
        Innovations over their standard deviation, in order.

    Raises
    ------
    ValueError
        Fewer than 16 samples, or a constant sequence.
    """
    K = len(normalised)
    if K < 16:
        raise AccelcalError(f"a cumulative periodogram needs at least 16 samples, not {K}.")
    power = np.abs(np.fft.rfft(normalised - np.mean(normalised)))[1:] ** 2
    total = float(np.sum(power))
    if not total > 0.0:
        raise AccelcalError("the periodogram of a constant sequence is not defined.")
    m = len(power)
    return CumulativePeriodogram(np.arange(1, m + 1) / K, np.cumsum(power) / total, 1.358 / np.sqrt(m - 1.0))


def rms_error(estimates: Array, truth: ArrayLike) -> Array:
    """Equation (15): root mean square over runs, at each instant.

    Parameters
    ----------
    estimates : (N, ...)
        One run per row.
    truth : broadcastable to one run
        True value, same unit.

    Returns
    -------
    (...) in the unit of the estimates
    """
    return np.asarray(np.sqrt(np.mean((estimates - np.asarray(truth)) ** 2, axis=0)))


def coverage(error: Array, sigma: Array, promised: float = 0.95, probability: float = 0.99) -> Coverage:
    """Counts how often a Gaussian interval of level `promised` around the estimate held the truth.

    Parameters
    ----------
    error, sigma : (n,)
        Estimate minus truth of independent fits, and the standard deviations they reported, same unit.
    promised : float
        Level of the intervals.
    probability : float
        Confidence of the Clopper-Pearson interval of the true rate.

    Raises
    ------
    ValueError
        No fits.
    """
    count = len(error)
    if count == 0:
        raise AccelcalError("coverage needs at least one fit.")
    factor = special.ndtri(0.5 * (1.0 + promised))
    inside = int(np.count_nonzero(np.abs(error) <= factor * sigma))
    tail = 0.5 * (1.0 - probability)
    low = float(special.betaincinv(inside, count - inside + 1, tail)) if inside else 0.0
    high = float(special.betaincinv(inside + 1, count - inside, 1.0 - tail)) if inside < count else 1.0
    return Coverage(inside, count, promised, low, high, probability)


__dir__ = listing(globals())
