"""Residuals for noise tests: output above the motion, whitened innovations, spectra, robust sums, slow error."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import POSITION_ORDER, Array, Flags, Places, batches, within_spans
from accelcal.data.orientation import HOLE
from accelcal.diagnosis.policy import (
    FAST_SCATTER_RATIO,
    NOISE_TEST_ALPHA,
    OUTLIER_MOST_SAMPLES,
    OUTLIER_SIGMA,
    STEADY_SCATTER_RATIO,
)
from accelcal.estimation.channel_filters import LEAST_GAIN
from accelcal.estimation.engines import sums_of
from accelcal.estimation.run import LONG
from accelcal.estimation.run_state import RunState
from accelcal.signals.processing import (
    LONG_TRANSFORM,
    Spectrum,
    cosine_window,
    forget_plans,
    low_pass,
    noise_bandwidth,
    quintic,
    recursive_filter,
)
from accelcal.signals.series import LOCAL, bridged, grid_step, local_spread, widened
from accelcal.signals.signals import RESAMPLED, Signals
from accelcal.signals.unresolved import output_of

LONG_BLOCKS: Array = cosine_window(128, (0.35875, 0.48829, 0.14128, 0.01168))
"""Window of blocks that resolve colour: it suppresses a line 90 dB stronger at 100 Hz distance, at a few kHz."""
SHORT_BLOCKS: Array = cosine_window(32)
"""Window of blocks that resolve the peaks of a move's speed; for series without strong lines below them."""
MIDDLE_BLOCKS: Array = cosine_window(64)
"""Window of blocks between the two, which tells a band from one three bins below it."""
MOST_LAGS = 200
"""Blocks over which the scatter may be correlated."""


@dataclass(frozen=True, slots=True)
class BlockSpectra:
    """Power of short blocks at each frequency, in the unit of the series squared: white noise has its variance.

    Blocks overlap by half; with both windows such blocks are nearly independent.
    """

    f: Array
    """(F,) Hz"""
    power: Array
    """(K, F)"""
    complete: NDArray[np.bool_]
    """(all blocks,) whether a block holds enough samples to be among the K."""
    window: Array

    @classmethod
    def of(
        cls, y: Array, sampled: NDArray[np.bool_], rate: float, low: float, window: Array = LONG_BLOCKS
    ) -> BlockSpectra:
        """Blocks of a uniform series `y` (n,), frequencies from `low` on; `sampled` (n,) marks what was measured."""
        n = len(window)
        f = np.asarray(np.fft.rfftfreq(n, 1.0 / rate), dtype=np.float64)
        rows = slice(int(np.searchsorted(f, low)), len(f) - 1)
        complete = _block_means(sampled.astype(np.float64), window) > 0.7
        if len(y) < n:
            return cls(f[rows], np.zeros((0, len(f[rows]))), complete, window)
        blocks = np.lib.stride_tricks.sliding_window_view(y, n)[:: n // 2]
        weight = window / math.sqrt(float(window @ window))
        power = np.empty((int(np.sum(complete)), len(f[rows])))
        filled = 0
        for batch in batches(len(blocks), BATCH):
            part = blocks[batch][complete[batch]]
            transform = scipy.fft.rfft(part * weight, axis=1)[:, rows]
            power[filled : filled + len(part)] = transform.real**2 + transform.imag**2
            filled += len(part)
        return cls(f[rows], power, complete, window)

    def means(self, x: Array) -> Array:
        """Mean of a uniform series (n,) over each block that is kept, weighted as its power is, (K,)."""
        return _block_means(x, self.window)[self.complete]


def _block_means(x: Array, window: Array) -> Array:
    n = len(window)
    if len(x) < n:
        return np.zeros(0)
    weight = window**2 / float(window @ window)
    return np.asarray(np.lib.stride_tricks.sliding_window_view(x, n)[:: n // 2] @ weight)


def power_trend_test(power: Array, x: Array) -> tuple[float, float]:
    """Test whether the power of blocks grows with a variable: standardised score, and its probability under the null.

    Parameters
    ----------
    power, x : (K,), both not negative.

    Notes
    -----
    Score of x in power = c0 + c1 x at c1 = 0, one-sided. Its spread is that of the residual from the fitted line,
    correlation from block to block included (Bartlett). The few blocks in which x is large make it skew, and a gamma
    distribution with the same three cumulants (Pearson's type III) gives the tail.
    """
    largest = float(np.max(x, initial=0.0))
    if not 0.0 < largest < math.inf:
        return 0.0, 1.0
    x = x / largest  # the fourth power of a motion that a model sends astray has a cube beyond every number
    deviation = x - x.mean()
    total = float(deviation @ deviation)
    if total <= 0.0:
        return 0.0, 1.0
    c, _ = power_fit(power, np.column_stack([np.ones_like(x), x]))
    residual = power / np.maximum(c[0] + c[1] * x, 0.05 * float(np.median(power)) + 1e-300) - 1.0
    scatter = max(float(np.mean(residual**2)), 1e-12)
    correlation = 0.0
    for lag in range(1, min(MOST_LAGS, len(x) // 8)):
        lag_correlation = float(deviation[lag:] @ deviation[:-lag]) / total
        correlation += lag_correlation * float(residual[lag:] @ residual[:-lag]) / (len(residual) * scatter)
    scatter *= max(1.0, 1.0 + 2.0 * correlation)
    z = float(deviation @ (power / power.mean())) / math.sqrt(scatter * total)
    return z, float(pearson_tail(z, 2.0 * math.sqrt(scatter) * float(np.sum(deviation**3)) / total**1.5))


def pearson_tail(z: float | Array, skew: float | Array) -> Array:
    """Probability of a larger standardised value under Pearson's type III; normal where it is hardly skew."""
    shape = 4.0 / np.maximum(skew, 1e-3) ** 2
    tail = scipy.special.gammaincc(shape, np.maximum(0.0, shape + z * np.sqrt(shape)))
    return np.asarray(np.where(np.asarray(skew) < 1e-3, scipy.special.ndtr(-np.asarray(z)), tail))


def power_fit(power: Array, X: Array) -> tuple[Array, Array]:
    """Coefficients of power = X c, c not negative, spread proportional to the mean (quasi-likelihood), covariance."""
    size = np.maximum(np.max(np.abs(X), axis=0), 1e-300)
    X = X / size
    usual = float(np.median(power)) or float(np.mean(power)) or 1.0  # a channel that is exact has no power
    mean = np.full(len(power), usual)
    for _ in range(8):
        w = 1.0 / mean
        c, _ = scipy.optimize.nnls(X * w[:, None], power * w)
        mean = np.maximum(X @ c, 0.05 * usual + 1e-300)
    spread = max(float(np.mean((power / mean - 1.0) ** 2)), 1e-12)  # all at one floor scatters not at all
    A = (X / mean[:, None]).T @ (X / mean[:, None])
    covariance = spread * np.linalg.inv(A + 1e-12 * np.trace(A) * np.eye(len(A)))
    return c / size, covariance / np.outer(size, size)


LONG_SPANS = ((16384, 3200.0, 2), (1024, 200.0, 8), (256, 100.0, 8))
"""Longer spans over which a scale may be taken where the scatter is steady, the degrees of freedom it then has, and how
many such spans show that it is steady."""
LOG_MEDIAN_VARIANCE = 0.0213
"""Variance of the logarithm of the median of 64 absolute normal deviates."""
WIDTHS = (2.5, 5.0, 10.0, 30.0, 100.0, 1000.0)
"""Sizes of outliers that are tried, in standard deviations of the noise."""
SHARES = (1e-5, 1e-4, 1e-3, 3e-3)
"""Shares of outliers that are tried."""
BINNED = 3.0
"""Deviations up to here are counted in bins."""


@dataclass(frozen=True, slots=True)
class Outliers:
    """Outliers of a series."""

    size: float
    """Of the largest, in the unit of the series."""
    score: float
    """The largest in local standard deviations."""
    peaks: NDArray[np.intp]
    """Indices of the certain ones."""
    count: float
    """Number of certain ones; where none is certain, the number that the scatter implies."""
    p_value: float

    def sentence(self, what: str, unit: str) -> str:
        """How many and how large."""
        return f"{self.count:.0f} {what} are outliers of up to {self.size:.2g} {unit}"

    @property
    def parts(self) -> dict[str, float]:
        """Particulars."""
        return {"count": self.count, "largest": self.size}


def steady_spread(y: Array) -> tuple[Array, float] | None:
    """Robust standard deviation about each sample, (n,), over the longest span on which the scatter is steady, and its
    degrees of freedom; None where the scatter changes too fast for any span."""
    K = len(y) // LOCAL
    longest = LONG_SPANS[-1][0] // LOCAL
    if 8 * longest > K:
        return None
    medians = np.median(np.abs(y[: K * LOCAL].reshape(K, LOCAL)), axis=1, overwrite_input=True)
    usual = float(np.median(medians))
    if usual <= 0.0:
        return None
    logs = np.log(np.where(medians > 0.0, medians, usual))
    between = 0.5 * float(np.mean(np.diff(logs) ** 2))
    if between > FAST_SCATTER_RATIO * LOG_MEDIAN_VARIANCE:
        return None
    for span, dof, enough in LONG_SPANS:
        m = span // LOCAL
        groups = logs[: len(logs) // m * m].reshape(-1, m)
        if len(groups) >= enough and float(np.mean(groups.var(axis=1, ddof=1))) < STEADY_SCATTER_RATIO * between:
            spreads = np.abs(y[: len(groups) * span].reshape(-1, span))
            spreads = np.median(spreads, axis=1, overwrite_input=True) / 0.6745
            spreads = np.where(spreads > 0.0, spreads, usual / 0.6745)
            centres = (np.arange(len(spreads)) + 0.5) * span
            spread = np.empty(len(y))
            for part in batches(len(y), RESAMPLED):
                spread[part] = np.interp(np.arange(part.start, part.stop, dtype=np.float64), centres, spreads)
            return spread, dof
    return None


def spread_of(y: Array, step: float = 0.0) -> tuple[Array, float]:
    """Local scale (n,) and its degrees of freedom: over a long span where the scatter is steady, else over a short one.

    Values on a grid of spacing `step` have medians on the grid: they are blurred by one step, whose variance is
    subtracted again.
    """
    if step > 0.0:
        golden = np.modf(0.6180339887498949 * np.arange(len(y)))[0]
        y = y + step * (golden - 0.5)
    steady = steady_spread(y)
    spread, dof = steady if steady is not None else (local_spread(y), 0.7 * LOCAL)
    if step == 0.0:
        return spread, dof
    return np.sqrt(np.maximum(spread**2 - step**2 / 12.0, step**2 / 12.0)), dof


def contamination_test(size: Array, dof: float) -> tuple[float, float]:
    """Share of samples with a wider distribution than the rest, and the probability of such samples under the null, by
    their sizes (n,) in standard deviations.

    Likelihood ratio of (1 - share) t(dof) + share N(0, 1 + width²) to t(dof), averaged over a grid of shares and
    widths. Without outliers the expectation of that average is one, so it exceeds 1/p with a probability of at most p
    (Markov); nothing is taken from asymptotics, which rare outliers do not obey.
    """
    edges = np.linspace(0.0, BINNED, 301)
    count, _ = np.histogram(size, edges)
    tail = size[size > BINNED]
    x = np.append(0.5 * (edges[1:] + edges[:-1]), tail)
    count = np.append(count, np.ones(len(tail)))
    clean = scipy.special.gammaln(0.5 * (dof + 1.0)) - scipy.special.gammaln(0.5 * dof)
    clean += -0.5 * math.log(math.pi * dof) - 0.5 * (dof + 1.0) * np.log1p(x**2 / dof)
    gains = np.empty((len(WIDTHS), len(SHARES)))
    for i, width in enumerate(WIDTHS):
        variance = 1.0 + width**2
        wide = -0.5 * x**2 / variance - 0.5 * math.log(2.0 * math.pi * variance)
        for j, share in enumerate(SHARES):
            gains[i, j] = count @ np.logaddexp(math.log1p(-share), math.log(share) + wide - clean)
    evidence = float(scipy.special.logsumexp(gains)) - math.log(gains.size)
    return SHARES[int(np.argmax(gains)) % len(SHARES)], min(1.0, math.exp(-max(evidence, 0.0)))


def outliers(y: Array, spread: Array, n: int, dof: float = 0.7 * LOCAL) -> Outliers:
    """Samples that do not belong to the distribution of the rest, p value over n samples.

    Null: samples over a local spread that is itself estimated, Student's t with `dof` degrees of freedom. Three tests
    share the error probability: the largest sample, the number beyond 5.5 sigma (Poisson), and the likelihood of
    contamination.
    """
    if n < 8 * LOCAL:
        return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
    score = np.abs(y)
    score /= np.maximum(spread, 1e-300)
    share, p_share = contamination_test(score, dof)
    peaks = isolated_peaks(score, np.flatnonzero(score > OUTLIER_SIGMA))
    if len(peaks) == 0:
        largest = float(np.max(np.abs(y))) if p_share < NOISE_TEST_ALPHA else 0.0
        return Outliers(largest, float(np.max(score, initial=0.0)), peaks, share * n, min(1.0, 3.0 * p_share))
    top = int(peaks[np.argmax(score[peaks])])
    p_top = min(1.0, 2.0 * n * float(scipy.special.stdtr(dof, -score[top])))
    expected = 2.0 * n * float(scipy.special.stdtr(dof, -OUTLIER_SIGMA))
    p_count = float(scipy.special.gammainc(len(peaks), expected))
    limit = -float(scipy.special.stdtrit(dof, 0.5 * NOISE_TEST_ALPHA / max(n, 1)))
    certain = peaks[score[peaks] > limit]
    chosen = certain if len(certain) else peaks
    p_value = min(1.0, 3.0 * min(p_top, p_count, p_share))
    return Outliers(float(np.abs(y[top])), float(score[top]), chosen, float(len(chosen)), p_value)


def isolated_peaks(score: Array, large: NDArray[np.intp]) -> NDArray[np.intp]:
    """Peaks of short runs of `large` samples; a filter's ringing around a peak belongs to that peak."""
    if len(large) == 0:
        return large
    groups = np.split(large, np.flatnonzero(np.diff(large) > 8) + 1)
    peaks = []
    for group in groups:
        peak = group[int(np.argmax(score[group]))]
        if int(np.sum(score[group] > 0.5 * score[peak])) <= OUTLIER_MOST_SAMPLES:
            peaks.append(peak)
    return np.asarray(peaks, dtype=np.intp)


REACH = 16
"""Samples on either side that contribute to the interpolation of one."""
LEAST_INFORMATION = 0.5
"""Share of the information on a sample that lost neighbours may take away."""
BATCH = 4096
"""Blocks that are transformed, and samples whose lost neighbours are solved for, at a time."""
REGULAR = 1e-9
"""Added to the diagonal, in responses at distance 0: several lost samples in a row may form what the filter stops."""
MOST_ITERATIONS = 12
"""Iterations of conjugate gradients for lost samples; most of them are isolated, and few iterations suffice for those.
"""
DENSE_MOST = 1024
"""Up to this many lost samples are solved with a dense matrix, 8 MB; more of them with a transform of the series."""


@dataclass(frozen=True, slots=True)
class InterpolationError:
    """Filter that gives the interpolation error of each sample; the noise is white behind the filter's square root.

    A single wrong sample is white, so the matched filter divides by the power of the noise at each frequency.
    """

    gain: Array
    """At the frequencies of the transform, mean 1."""
    n: int
    """Samples of a series."""

    @classmethod
    def of(
        cls, spectra: BlockSpectra, n: int, rate: float, edge: float, least_power: float = 0.0
    ) -> InterpolationError:
        """The filter for noise with these spectra, above the frequency `edge`, Hz; power below `least_power` is taken
        as that much, so that a stop band is not magnified."""
        f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(n, real=True), 1.0 / rate)
        gain = soft_high_pass(f, edge)
        if len(spectra.power):
            gain /= np.interp(f, spectra.f, np.maximum(np.mean(spectra.power, axis=0), max(least_power, 1e-300)))
        return cls(gain / np.mean(gain), n)

    def __call__(self, y: Array) -> Array:
        """Interpolation error of each sample of a series, (n,)."""
        return filtered(y, self.gain)

    def correction(self, errors: Array, lost: Places) -> Array:
        """Correction (n,) of lost samples that makes their interpolation errors zero.

        Parameters
        ----------
        errors : (n,) interpolation errors with the lost samples as they are.
        lost : indices of the lost samples.
        """
        correction = np.zeros(self.n)
        if len(lost) == 0:
            return correction
        if len(lost) <= DENSE_MOST:
            matrix = self.response[np.abs(lost[:, None] - lost)]
            correction[lost] = solve_corrections(lambda x: matrix @ x, errors[lost])
            return correction

        def act(x: Array) -> Array:
            correction[lost] = x
            return self(correction)[lost]

        correction[lost] = solve_corrections(act, errors[lost])
        return correction

    def corrected(self, errors: Array, correction: Array, lost: Places) -> Array:
        """Interpolation errors (n,) once lost samples are corrected.

        Next to a lost sample less is known: errors there are scaled to the spread that they have elsewhere. Next to
        several lost samples too little is known, and the error is NaN.
        """
        if len(lost) == 0:
            return errors
        response = self.response[: 2 * REACH + 1]
        affected, information = remaining_information(response / response[0], lost, self.n)
        errors = errors - self(correction)
        errors[affected] /= np.sqrt(np.where(information > LEAST_INFORMATION, information, np.nan))
        errors[lost] = np.nan
        return errors

    @property
    def response(self) -> Array:
        """Effect of a unit error of one sample on the interpolation errors at each distance."""
        return np.asarray(scipy.fft.irfft(self.gain, scipy.fft.next_fast_len(self.n, real=True)))


def solve_corrections(act: Callable[[Array], Array], errors: Array) -> Array:
    """Corrections (m,) of lost samples with `errors` (m,); `act` maps corrections to the errors that they cause."""
    x, r = np.zeros_like(errors), errors
    p, power = r, float(r @ r)
    least = 1e-8 * power
    for _ in range(MOST_ITERATIONS):
        if power <= least:
            break
        q = act(p)
        step = power / float(p @ q)
        x, r = x + step * p, r - step * q
        before, power = power, float(r @ r)
        p = r + (power / before) * p
    return x


def remaining_information(response: Array, lost: Places, n: int) -> tuple[Places, Array]:
    """Samples near lost ones, but none of those, and the share of the information on them that remains, (m,) each.

    The lost samples about one, corrected together, take away c' R^-1 c, with c its response to each of them and R
    theirs to each other: the Schur complement of a Gaussian with that precision matrix.

    Parameters
    ----------
    response : of an interpolation error to a unit error at each distance from 0 on, over that at 0; twice the reach.
    lost : which of the `n` samples are lost, in rising order.
    """
    reach = (len(response) - 1) // 2
    absent = np.zeros(n, dtype=np.bool_)
    absent[lost] = True
    affected = np.flatnonzero(widened(absent, reach) & ~absent)
    first = np.searchsorted(lost, affected - reach)
    count = np.searchsorted(lost, affected + reach, side="right") - first
    information = np.empty(len(affected))
    for several in np.unique(count):
        same = np.flatnonzero(count == several)
        for batch in batches(len(same), BATCH):
            these = same[batch]
            places = lost[first[these, None] + np.arange(several)]
            c = response[np.abs(places - affected[these, None])]
            R = response[np.abs(places[:, :, None] - places[:, None, :])] + REGULAR * np.eye(several)
            taken = c * np.linalg.solve(R, c[:, :, None])[:, :, 0]
            information[these] = 1.0 - taken.sum(axis=1)
    return np.asarray(affected), information


def high_passed(y: Array, rate: float, edge: float) -> Array:
    """Part of uniform samples above a frequency, with a soft edge that reaches 30 % higher."""
    f = scipy.fft.rfftfreq(scipy.fft.next_fast_len(len(y), real=True), 1.0 / rate)
    gain = soft_high_pass(f, edge)
    del f
    y = y - np.mean(y)  # what was given goes
    return filtered(y, gain)


def filtered(y: Array, gain: Array) -> Array:
    """A series (n,) behind a zero-phase filter, given by its gain at the frequencies of the transform."""
    n = scipy.fft.next_fast_len(len(y), real=True)
    spectrum = scipy.fft.rfft(y, n)
    spectrum *= gain
    series = np.asarray(scipy.fft.irfft(spectrum, n, overwrite_x=True)[: len(y)])
    if n > LONG_TRANSFORM:
        forget_plans()
    return series


def soft_high_pass(f: Array, edge: float) -> Array:
    """Gain that rises from 0 at a frequency to 1 at 30 % more.

    Examples
    --------
    >>> soft_high_pass(np.array([0.0, 9.0, 11.5, 14.0]), 10.0)
    array([0. , 0. , 0.5, 1. ])
    """
    weight = np.clip((f - edge) / (0.3 * edge), 0.0, 1.0)
    return np.asarray(0.5 - 0.5 * np.cos(np.pi * weight))


MOTION_FREE = 0.09
"""Share of the sampling rate above which motion is negligible: a stage that starts with a jump in snap leaves f^-3."""
SUBTRACTED = 1.2
"""Frequency, over the bandwidth of the smoothed motion, above which less than 6 % of the output is subtracted with it.
"""
FORGOTTEN_AFTER = 4.0
"""Time constants after which the filter has forgotten an outlier."""
TAIL = (0.1, 0.2)
"""Band, in sampling rates, where a motion that sampling does not resolve is stronger than above."""
LEAST_CHECK = 1e-4
"""Share of the reading noise in the variance of an innovation below which a reading is not checked by others."""
REPAIRS = 2
"""Rounds of filling in outlying samples; the noise spectrum that fills them in is more accurate without them."""


class Residuals:
    """Residuals of both channels beyond the fitted model, on uniform times."""

    def __init__(self, state: RunState) -> None:
        self.state, self.run = state, state.run
        self.signals: Signals = state.signals
        run, s = self.run, self.signals
        self.step = run.accel_step
        self.tau = run.tau(state.values)
        self.rate = 1.0 / self.step
        settling = 2.0 / s.cutoff if s.cutoff > 0.0 else 0.0
        settling = min(settling, 0.05 * float(run.t[-1] - run.t[0]))
        t = run.accel.t
        begin = int(np.searchsorted(t, run.t[0] + settling))
        inside = slice(begin, int(np.searchsorted(t, run.t[-1] - settling, side="right")))
        self.t_u, self.u = t[inside], run.accel.y[inside]
        place = self.place
        self.n = int(place[-1]) + 1
        self.sampled = np.zeros(self.n, dtype=np.bool_)
        self.sampled[place] = True
        self.edge = min(max(MOTION_FREE * self.rate, 2.0 * self.reach), 0.25 * self.rate)
        ends = int(4.0 * self.rate / self.edge)  # a spectrum takes the two ends of a record for a jump
        self.sampled[:ends] = self.sampled[self.n - ends :] = False
        self.sampled[widened(self.unresolved | self.holes, REACH)] = False

    @property
    def reads_position(self) -> bool:
        """Whether the reference is a position: of any other the filter over positions has no white innovations."""
        return self.run.order == POSITION_ORDER

    @cached_property
    def innovations(self) -> tuple[Array, float]:
        """What is white if the model is right, (m,), and its spacing, s: whitened innovations, or rows of the weak
        form."""
        if self.reads_position:
            return self.readings, self.run.reading_step
        sums = sums_of(self.state)
        y = sums.whitened
        limit = 5.0 * local_spread(y)
        return np.clip(y, -limit, limit), 1.0 / sums.rate

    @property
    def reach(self) -> float:
        """Frequency above which no motion is left in the output, Hz."""
        return max(self.signals.cutoff, self.signals.reach)

    @property
    def band(self) -> float:
        """Frequency from which on the residual holds the whole output, the tail of the motion included, Hz."""
        return SUBTRACTED * (self.reach if self.unresolved.any() else self.signals.cutoff)

    @property
    def place(self) -> Places:
        """Index of the uniform time of each sample, counted from the first."""
        return np.asarray(np.rint((self.t_u - self.t_u[0]) / self.step).astype(np.intp))

    @property
    def t(self) -> Array:
        """Uniform times, (n,) s."""
        return np.asarray(self.t_u[0] + self.step * np.arange(self.n))

    @property
    def model(self) -> Array:
        """Output that the model predicts at uniform times: smoothed motion through scale, effects, delay and RC."""
        s, values, run = self.signals, self.state.values, self.run
        grid = values.scale * s.a + values.bias
        for term, coefficient in values.additive("output"):
            grid = grid + coefficient * term.column(s)
        at = quintic(s.t + run.origins.t, grid, values.instants(self.t, run.origins.t))
        if self.tau > 0.0:  # exact for straight lines between samples
            x = self.step / self.tau
            d = math.exp(-x)
            b = [1.0 - (1.0 - d) / x, (1.0 - d) / x - d]
            at = recursive_filter(b, [1.0, -d], at, (at[0] * (1.0 - b[0]), 0.0))
        return np.asarray(run.filters.behind_output(at, self.step), dtype=np.float64)

    @cached_property
    def unresolved(self) -> Flags:
        """Uniform times about the jumps of the motion, (n,)."""
        jumps, begin = self.run.jumps, float(self.t_u[0])
        first = np.floor((jumps.t - jumps.before - begin) / self.step).astype(np.intp)
        last = np.ceil((jumps.t + jumps.after - begin) / self.step).astype(np.intp)
        return within_spans(np.clip(np.column_stack([first, last + 1]), 0, self.n), self.n)

    @property
    def holes(self) -> Flags:
        """Uniform times in gaps so long that the motion beside them is known to the position alone, (n,)."""
        length = np.diff(self.place, prepend=0)
        return np.concatenate([[False], np.repeat(length[1:] > HOLE, length[1:])])

    @cached_property
    def resolved_output(self) -> Array:
        """Output at uniform times without the jumps of the motion, the samples next to each bridged, (n,) m/s².

        A bridge over a jump would leave a fast slope, which no filter could tell from noise.
        """
        output = np.interp(np.arange(self.n), self.place, self.u)
        output -= output_of(self.run.jumps, float(self.t_u[0]), self.step, self.n)
        return bridged(output, self.unresolved)

    @cached_property
    def residual(self) -> Array:
        """Output minus model at uniform times, lost samples bridged by straight lines, (n,) m/s².

        Where the motion jumps, output and smoothed motion differ by more than noise: the jumps are bridged, and what
        is left is the output beyond the bandwidth of the motion.
        """
        if self.unresolved.any():
            return self.resolved_output - low_pass(self.resolved_output, self.rate, self.reach)
        place = self.place
        model = self.model
        slope = np.gradient(model, self.step)[place]
        r = self.u - model[place] - slope * (self.t_u - self.t_u[0] - self.step * place)
        return np.asarray(np.interp(np.arange(self.n), place, r))

    @cached_property
    def background(self) -> Array:
        """Residual above the band of any motion, (n,) m/s².

        Lost and outlying single samples are filled in from their neighbours, so that none rings in its block.
        """
        return self.above_motion(OUTLIER_SIGMA)

    def above_motion(self, limit: float) -> Array:
        """Residual above the band of any motion, samples beyond a limit in local deviations filled in, (n,) m/s².

        Without outliers the limit is infinite: short bursts of noise exceed what is usual about them, and are noise.
        """
        lost, correction = self.lost, np.zeros(self.n)
        for _ in range(REPAIRS):
            before = lost
            correction, lost = self.refilled(correction, before, limit)
            if lost is before:
                break
        return high_passed(self.residual - correction, self.rate, self.edge)

    def release(self) -> None:
        """Free what is as long as the record once its spectra are computed; reading it computes it again."""
        for name in ("background", "resolved_output", "motion", *("residual",) * (self.n > LONG)):
            vars(self).pop(name, None)

    def refilled(self, correction: Array, lost: Places, limit: float) -> tuple[Array, Places]:
        """Corrections (n,) of lost samples, from the noise left after earlier corrections; samples beyond a limit in
        local standard deviations count as lost."""
        whole = high_passed(self.residual - correction, self.rate, self.edge)
        interpolation = self.interpolation_filter(BlockSpectra.of(whole, self.sampled, self.rate, 1.3 * self.edge))
        del whole
        errors = interpolation(self.residual - np.mean(self.residual))
        correction = interpolation.correction(errors, lost)
        y = interpolation.corrected(errors, correction, lost)
        sampled = np.flatnonzero(self.sampled & np.isfinite(y))
        y = y[sampled]
        spread, _ = spread_of(y)
        np.hypot(spread, math.sqrt(self.white_floor * float(np.mean(interpolation.gain**2))), out=spread)
        score = np.abs(y)
        score /= np.maximum(spread, 1e-300)
        outlying = isolated_peaks(score, np.flatnonzero(score > limit))
        if len(outlying) == 0:
            return correction, lost
        outlying = sampled[outlying]
        lost = np.union1d(lost, np.clip(outlying[:, None] + np.arange(-1, 2), 0, self.n - 1))
        return interpolation.correction(errors, lost), lost

    def interpolation_filter(self, spectra: BlockSpectra) -> InterpolationError:
        """Filter that gives interpolation errors, for noise with these spectra."""
        return InterpolationError.of(spectra, self.n, self.rate, self.edge, self.least_power)

    @property
    def least_power(self) -> float:
        """Power of a sample below which declared filters leave none of the sensor's noise, (m/s²)²; 0 without any.

        What is seen there enters behind the filters: rounding, and errors of the model's own output.
        """
        return self.least_gain**2 * self.state.noise.usual.q * self.state.values.scale**2 * self.rate

    @property
    def lost(self) -> Places:
        """Indices of uniform times without a sample."""
        return np.delete(np.arange(self.n), self.place)

    @cached_property
    def spectra(self) -> BlockSpectra:
        """Power of `background` in blocks."""
        return BlockSpectra.of(self.background, self.sampled, self.rate, 1.3 * self.edge)

    @cached_property
    def short_spectra(self) -> BlockSpectra:
        """Power of `background` in blocks as short as the peaks of a move's speed, where declared filters pass it."""
        return self.passed(BlockSpectra.of(self.background, self.sampled, self.rate, 1.3 * self.edge, SHORT_BLOCKS))

    def passed(self, spectra: BlockSpectra, highest: float = math.inf) -> BlockSpectra:
        """Some spectra at the frequencies that the declared filters pass, below the highest asked for, Hz."""
        passed = (spectra.f < highest) & (np.abs(self.gain(spectra.f)) >= self.least_gain)
        return replace(spectra, f=spectra.f[passed], power=spectra.power[:, passed])

    @property
    def interpolation_errors(self) -> tuple[Array, InterpolationError]:
        """Interpolation error of each sample of the residual given its neighbours, (n,) m/s², NaN where too few of them
        are left; the filter."""
        interpolation, lost = self.interpolation_filter(self.spectra), self.lost
        errors = interpolation(self.residual - np.mean(self.residual))
        return interpolation.corrected(errors, interpolation.correction(errors, lost), lost), interpolation

    @cached_property
    def motion(self) -> tuple[Array, Array]:
        """Velocity and jerk at the uniform times."""
        t = self.signals.t + self.run.origins.t
        return np.interp(self.t, t, self.signals.v), np.interp(self.t, t, self.signals.jerk)

    def motion_blocks(self, spectra: BlockSpectra) -> tuple[Array, Array, Array]:
        """Means of v², v⁴ and jerk² over the blocks of some spectra, (K,) each."""
        v, jerk = self.motion
        v2 = v**2
        return spectra.means(v2), spectra.means(v2**2), spectra.means(jerk**2)

    def tail_blocks(self, spectra: BlockSpectra) -> Array:
        """Power of the output over the blocks of some spectra in the band `TAIL`, below that of the tests, (K,)."""
        low, high = (share * self.rate for share in TAIL)
        output = self.resolved_output - low_pass(self.resolved_output, self.rate, 0.5 * low)
        tail = BlockSpectra.of(high_passed(output, self.rate, 0.8 * low), self.sampled, self.rate, low, spectra.window)
        return np.asarray(tail.power[:, tail.f < high].mean(axis=1))

    @cached_property
    def lsb(self) -> float:
        """Step of the grid on which the output lies, m/s²; 0 if it lies on none."""
        return grid_step(self.u)

    @property
    def white_floor(self) -> float:
        """Variance of a sample that enters behind every filter, (m/s²)²: rounding, and what the model's output errs by
        where declared filters leave nothing."""
        return self.lsb**2 / 12.0 + self.least_power

    @cached_property
    def smooth_position(self) -> Array:
        """RTS-smoothed position at the readings, m."""
        return self.state.smoothed()[0]

    @property
    def at_jumps(self) -> Flags:
        """Settled readings so close to a jump of the motion that the integral of the output is uncertain there."""
        jumps, t = self.run.jumps, self.run.t[self.state.counts]
        begin, end = jumps.t - jumps.before - self.step, jumps.t + jumps.after + self.step
        open_ = np.searchsorted(np.sort(begin), t, side="right") - np.searchsorted(np.sort(end), t, side="left")
        return np.asarray(open_ > 0)

    @cached_property
    def reading_outliers(self) -> Outliers:
        """Outliers among the settled readings, against the smoothed position; see `outliers`.

        None where the readings alone determine the position: no other measurement checks them.
        """
        if self.state.noise.r < LEAST_CHECK * float(np.median(self.state.series("S"))):
            return Outliers(0.0, 0.0, np.empty(0, dtype=np.intp), 0.0, 1.0)
        z = (self.state.drive.z - self.smooth_position)[self.state.counts]
        if self.n > LONG:
            del self.smooth_position
        middle, certain = np.median(z), ~self.at_jumps
        z = z[certain]
        z -= middle
        spread, dof = spread_of(z, self.run.least_step)
        flagged = outliers(z, spread, len(z), dof)
        return replace(flagged, peaks=np.flatnonzero(certain)[flagged.peaks])

    @cached_property
    def readings(self) -> Array:
        """Whitened innovations of settled readings, (m,); zero from an outlier on until the filter has forgotten it."""
        y = self.state.whitened[self.state.counts]
        limit = 5.0 * local_spread(y)
        y = np.clip(y, -limit, limit)
        peaks = self.reading_outliers.peaks
        if self.reading_outliers.p_value < NOISE_TEST_ALPHA:
            memory = FORGOTTEN_AFTER / (2.0 * math.pi * self.run.crossover(self.state.noise)) / self.run.reading_step
            y[within_spans(np.column_stack([peaks, peaks + int(memory) + 1]), len(y))] = 0.0
        return y

    def lowpass_gain(self, frequency: float) -> float:
        """Gain of the declared filters of the output at a frequency, Hz."""
        return max(float(np.abs(self.gain(np.array([frequency]))[0])), self.least_gain)

    @property
    def least_gain(self) -> float:
        """Gain below which declared filters leave none of the sensor's noise; 0 for one RC alone."""
        return LEAST_GAIN if self.run.rig.output_filters else 0.0

    def gain(self, f: Array) -> Spectrum:
        """Complex gain of everything between sensing element and sample at frequencies (n,) Hz."""
        return np.asarray(self.run.filters.of_output(f) / (1.0 + 2j * math.pi * f * self.tau))


def is_coarse(residuals: Residuals) -> bool:
    """Whether the step of the converter exceeds the noise, so that the noise itself depends on the motion."""
    return residuals.lsb > 0.8 * sample_noise(residuals)


def sample_noise(residuals: Residuals) -> float:
    """Standard deviation of one sample: that of the fitted density with quantisation subtracted, m/s².

    Coarse steps leave nothing after subtraction; then the declared density counts, if there is one.
    """
    run, noise = residuals.run, residuals.state.noise
    bandwidth = 1.0 / (2.0 * residuals.tau) if residuals.tau > 0.0 else residuals.rate
    if run.rig.output_filters:
        bandwidth = noise_bandwidth(residuals.gain, residuals.rate)
    variance = noise.usual.q * residuals.state.values.scale**2 * bandwidth
    declared = 0.5 * (run.rig.sensor.noise or 0.0) ** 2 * bandwidth
    return math.sqrt(max(variance - residuals.lsb**2 / 12.0, 0.05 * variance, min(declared, variance)))
