"""Process and reading noise (q, R) by innovation likelihood, at rest and in motion, and spectra of the noise."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
import scipy

from accelcal import _core
from accelcal.data import GRAVITY_NOISE, Array, Flags, Reference, Rig
from accelcal.data.orientation import scatter
from accelcal.effects import Effect
from accelcal.effects.registry import Owner
from accelcal.estimation.drive import DriveIntegrals
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise
from accelcal.signals.processing import LONG_TRANSFORM, forget_plans
from accelcal.signals.signals import Signals

BLOCKS = 16
"""Number of blocks over which the likelihood is taken, spread over the whole record."""
BLOCK_READINGS = 2048
"""Least number of readings in a block."""
BLOCK_SPAN = 50.0
"""Least length of a block in time constants of the filter."""


class Likelihood:
    """Innovation log-likelihood over blocks spread over a record, as a function of log q and log R."""

    def __init__(self, run: PreparedRun, integrals: DriveIntegrals, near: Noise, counts: Flags | None) -> None:
        self.run = run
        parts = [(integrals.part(rows), count) for rows, count in counted_blocks(run, integrals, near, counts)]
        self.count = int(sum(count.sum() for _, count in parts))
        self.parts = _core.Parts([(part.arrays, count) for part, count in parts])

    def __call__(self, log_q: float, log_r: float) -> float:
        q, r = math.exp(log_q), math.exp(log_r)
        return self.parts.log_likelihood(q=q, r=r, prior=self.run.prior(r))

    def spread(self, at: Noise) -> tuple[float, float]:
        """Standard deviations of log q and log R from the curvature of the likelihood."""
        x, h = np.log([at.q, at.r]), 0.05
        f = {(i, j): self(x[0] + i * h, x[1] + j * h) for i in (-1, 0, 1) for j in (-1, 0, 1)}
        qq = -(f[1, 0] - 2 * f[0, 0] + f[-1, 0]) / h**2
        rr = -(f[0, 1] - 2 * f[0, 0] + f[0, -1]) / h**2
        qr = -(f[1, 1] - f[1, -1] - f[-1, 1] + f[-1, -1]) / (4 * h**2)
        det = qq * rr - qr**2
        if not (qq > 0.0 and rr > 0.0 and det > 0.0):  # where no r matters, that of q is known
            return math.sqrt(1.0 / qq) if qq > 0.0 and abs(rr) < 1e-2 * qq else math.inf, math.inf
        return math.sqrt(rr / det), math.sqrt(qq / det)


def blocks(n: int, length: int) -> list[slice]:
    """At most 16 blocks of equal length, evenly spread; one block when the record is short."""
    if n <= BLOCKS * length:
        return [slice(0, n)]
    starts = np.linspace(0, n - length, BLOCKS).astype(int)
    return [slice(int(s), int(s) + length) for s in starts]


def counted_blocks(
    run: PreparedRun, integrals: DriveIntegrals, near: Noise, counts: Flags | None = None
) -> list[tuple[slice, Flags]]:
    """Blocks of readings, and which of each count: those that have settled at a noise, among `counts` (n,) if given."""
    span = BLOCK_SPAN / (2.0 * np.pi * run.crossover(near)) / run.reading_step
    counted = []
    for rows in blocks(len(run.t), int(max(BLOCK_READINGS, span))):
        settled = integrals.part(rows).settled(run.wait(near))
        if counts is not None:
            settled = settled & counts[rows]
        if settled.any():
            counted.append((rows, np.ascontiguousarray(settled)))
    return counted


@dataclass(frozen=True, slots=True, eq=False)
class NoiseSpectrum:
    """Power of the noise of the output in blocks, at each frequency: floor + sum of growth times variance function.

    White noise has its variance as power, (m/s²)².
    """

    f: Array
    """(F,) Hz"""
    floor: Array
    """(F,) (m/s²)²"""
    growth: Mapping[str, Array] = field(default_factory=dict)
    """Of each effect, (F,) (m/s²)² per unit of its variance function."""


@dataclass(frozen=True, slots=True, eq=False)
class NoiseEffect:
    """Estimate of one effect that acts on noise."""

    name: str
    symbol: str
    unit: str
    value: float
    """Factor of the effect's variance function."""
    std: float
    owner: Owner
    p_value: float
    """Probability of such a value, or a larger one, by chance where there is none."""
    sentence: str
    particulars: Mapping[str, float] = field(default_factory=dict)
    """In SI: share and size of outliers, step of a converter, standard deviation of the noise otherwise, ..."""
    spectrum: NoiseSpectrum | None = None
    """With all effects of the model that make the noise of the output grow; None where it is not one of them."""
    without: NoiseSpectrum | None = None
    """The same without this one."""


@dataclass(frozen=True, slots=True)
class NoiseScore:
    """What one effect that acts on noise gains on a recording: log predictive density with it less that without it."""

    effect: str
    channel: str
    """accel or position: whose samples are scored."""
    gain: float
    """Natural logarithm, summed over the record."""
    std: float
    """Of the paired difference, from its scatter between parts of the record."""
    count: int
    """Samples or block frequencies that are scored."""
    ratio: float
    """Mean square where the effect is strongest, over what the model with the effect expects there; 1 when calibrated.
    For rare events: events that were found over events expected."""
    ratio_without: float
    """The same for the model without it."""
    what: str = "noise where it is strongest"
    """What the ratios are of."""

    @property
    def gained(self) -> bool:
        """Whether the gain exceeds two of its standard deviations."""
        return self.gain > 2.0 * self.std

    @property
    def sentence(self) -> str:
        """For people."""
        return (
            f"{self.effect}: log score of {self.channel} {self.gain:+.3g} ± {self.std:.2g} over {self.count} values; "
            f"{self.what} {self.ratio:.3g} times what is expected, {self.ratio_without:.3g} times without it"
        )


LEAST_SHARE, FIRST_SHARE, MOST_SHARE = 1e-4, 0.1, 1e8
"""Growth of a noise, averaged over the readings, over the noise itself: limits and start of its search."""
NONE_BELOW = 1.5
"""A share below this many times the least one is none."""
CONSTANT = 1e-3
"""Largest change over the mean of a variance function that is the same all along: it is the noise itself."""
DIFFERENCE, MOST_STEPS = 1e-4, 60
"""Step of the numerical gradient in logarithms, and steps of the search."""


@dataclass(frozen=True, slots=True)
class VarianceFunction:
    """The variance function of an effect at the readings of a run."""

    effect: Effect
    before: Array
    """Mean over the interval before each reading, in the unit of the function, (n,)."""
    at: Array
    """At each reading, (n,)."""

    def part(self, rows: slice) -> VarianceFunction:
        """The readings in `rows`."""
        return VarianceFunction(self.effect, self.before[rows], self.at[rows])


def variance_functions(run: PreparedRun, noise: Noise, signals: Signals | None) -> list[VarianceFunction]:
    """Variance functions of the effects that act on the noise of a run and change along it; none without a motion."""
    functions = []
    for part in noise.growth if signals is not None else ():
        assert signals is not None
        at = np.interp(run.t, signals.t + run.origins.t, part.effect.column(signals))
        if np.ptp(at) > CONSTANT * float(np.mean(np.abs(at))):
            before = 0.5 * (at + np.concatenate([at[:1], at[:-1]]))
            functions.append(VarianceFunction(part.effect, before, at))
    return functions


def with_growth(integrals: DriveIntegrals, noise: Noise, functions: Sequence[VarianceFunction]) -> DriveIntegrals:
    """The integrals with what the effects add to the noise of each interval and each reading."""
    if not functions:
        return integrals
    of = {part_growth.effect.name: part_growth for part_growth in noise.growth}
    extra_q, extra_r = integrals.extra_q.copy(), np.zeros(len(integrals.t))
    for function in functions:
        extra_q += of[function.effect.name].q * function.before
        extra_r += of[function.effect.name].r * function.at
    return replace(integrals, extra_q=extra_q, extra_r=extra_r)


def most_likely(
    run: PreparedRun, integrals: DriveIntegrals, start: Noise, functions: Sequence[VarianceFunction]
) -> Noise:
    """Most likely q, R and growth of both, none of it negative, near `start` (derivations 6.14).

    Parameters
    ----------
    run, integrals : a record and the acceleration between its readings.
    start : where to begin.
    functions : of the effects whose growth is estimated; that of others stays.
    """
    rows_counted = counted_blocks(run, integrals, start)
    parts = [(integrals.part(rows), counts, [f.part(rows) for f in functions]) for rows, counts in rows_counted]
    usual = np.array([[np.mean(f.before), np.mean(f.at)] for f in functions])
    names, held = [f.effect.name for f in functions], {part.effect.name: part for part in start.growth}

    def noise_at(x: Array) -> Noise:
        q = math.exp(x[0])
        r = max(math.exp(x[1]), run.reading_variance_floor(q))
        share = np.exp(x[2:].reshape(-1, 2))
        shares = np.where(share > NONE_BELOW * LEAST_SHARE, share, 0.0) * (q, r) / usual
        grown = {
            name: replace(held[name], q=float(a), r=float(b), mean=float(mean))
            for name, (a, b), mean in zip(names, shares, usual[:, 0], strict=True)
        }
        return Noise(q, r, tuple(grown.get(part.effect.name, part) for part in start.growth))

    def cost(x: Array) -> float:
        noise = noise_at(x)
        grown = _core.Parts(
            [(with_growth(part, noise, functions_of).arrays, counts) for part, counts, functions_of in parts]
        )
        return -grown.log_likelihood(q=noise.q, r=noise.r, prior=run.prior(noise.r))

    r = max(start.r, 1.01 * run.reading_variance_floor(start.q))
    before = np.array([[held[name].q / start.q, held[name].r / r] for name in names]) * usual
    shares = np.log(np.where(before > 0.0, np.clip(before, 2.0 * LEAST_SHARE, MOST_SHARE), FIRST_SHARE))
    limits = [(None, None)] * 2 + [(math.log(LEAST_SHARE), math.log(MOST_SHARE))] * (2 * len(functions))
    best = scipy.optimize.minimize(
        cost,
        np.concatenate([np.log([start.q, r]), shares.ravel()]),
        method="L-BFGS-B",
        bounds=limits,
        options={"eps": DIFFERENCE, "ftol": 1e-9, "maxiter": MOST_STEPS},
    )
    return noise_at(best.x)


NEAR, GROWN = 0.05, 0.3
"""First steps of a search in log q and log R: the least, and that of a model to which effects were added."""
LEAST_COUNT = 256
"""Fewer settled readings than this do not determine the noise."""
REMARKED_BEYOND = 1.5
"""Ratio of two measures of one noise, such as the fitted and the declared density, beyond which it is remarked on."""


@dataclass(frozen=True, slots=True)
class Level:
    """Noise of both channels over a part of a record, with standard deviations."""

    density: float
    """One-sided noise density of the sensor, (m/s²)/sqrt(Hz)."""
    density_std: float
    reading: float
    """Standard deviation of one reading of the reference, in its unit: m of a position."""
    reading_std: float
    count: int
    """Readings that were used."""


@dataclass(frozen=True, slots=True)
class NoiseReport:
    """Noise of one recording: as a whole, at rest, in motion, and as declared on the data sheet."""

    noise: Noise
    all: Level
    rest: Level | None
    motion: Level | None
    declared: float | None
    """Declared one-sided density, (m/s²)/sqrt(Hz)."""
    crossover: float
    """Frequency above which the accelerometer determines the acceleration better than the encoder, Hz."""
    band: float | None = None
    """Band that was imposed because the noise is not white, Hz."""
    reference: Reference = "position"
    """What the reference reads; the noise of its readings is in that unit."""

    @property
    def ratio(self) -> float | None:
        """Fitted over declared density."""
        return None if self.declared is None else self.all.density / self.declared

    def remark(self, beside: float) -> str | None:
        """A sentence when fit and data sheet disagree by more than a factor 1.5; noise of an attitude `beside` that of
        the output, (m/s²)/sqrt(Hz), may have taken its place."""
        if self.ratio is None or not (self.ratio > REMARKED_BEYOND or self.ratio < 1.0 / REMARKED_BEYOND):
            return None
        if self.ratio < 1.0 < REMARKED_BEYOND * math.hypot(self.all.density, beside) / (self.declared or math.inf):
            return None
        if self.ratio > 1.0:
            return (
                f"the fitted noise density is {self.ratio:.2g} times the declared one: "
                "something else shakes or disturbs the output, or the model lacks an effect"
            )
        return (
            f"the fitted noise density is {self.ratio:.2g} of the declared one: "
            "check the declared density and whether a low-pass was left undeclared"
        )

    def remark_on_reading(self, rig: Rig) -> str | None:
        """A sentence when readings are noisier than declared by more than a factor 1.5, and surely so; None where only
        the sum of two accelerations is known."""
        declared, least = rig.reading_noise or math.inf, self.all.reading - 3.0 * self.all.reading_std
        if self.reference == "reference_acceleration" or not least > REMARKED_BEYOND * declared:
            return None
        ratio = self.all.reading / declared
        return f"a reading is {ratio:.2g} times as noisy as declared: it is disturbed, or the model lacks an effect"


@dataclass(frozen=True, slots=True)
class NoiseSearch:
    """Most likely noise so far, and the first step of the next search."""

    noise: Noise
    """By likelihood, no band imposed."""
    width: float = 1.0
    """First step of the next search, in log q and log R."""

    def again(
        self, run: PreparedRun, integrals: DriveIntegrals, functions: Sequence[VarianceFunction] = ()
    ) -> NoiseSearch:
        """Search once more, from here; the next width is twice the distance moved.

        `functions` are the variance functions of effects that act on the noise; what they add is not in `integrals`.
        """
        if functions:
            return NoiseSearch(most_likely(run, integrals, self.noise, functions), self.width)
        noise_again = replace(estimate_noise(run, integrals, self.noise, width=self.width), growth=self.noise.growth)
        moved = max(abs(math.log(noise_again.q / self.noise.q)), abs(math.log(noise_again.r / self.noise.r)))
        return NoiseSearch(noise_again, min(max(2.0 * moved, NEAR), 1.0))

    def scaled(self, factor: float) -> NoiseSearch:
        """The same with the process density multiplied by a factor."""
        return NoiseSearch(self.noise.scaled(factor), self.width)

    def within(self, band: float | None, run: PreparedRun) -> Noise:
        """The noise whose crossover lies at `band`, Hz, with the process density kept; without a band the noise."""
        if band is None:
            return self.noise
        return replace(self.noise, r=self.noise.q / ((2.0 * np.pi * band) ** 4 * run.reading_step))


def estimate_noise(
    run: PreparedRun,
    integrals: DriveIntegrals,
    start: Noise,
    *,
    counts: Flags | None = None,
    width: float = 1.0,
    floor: Callable[[float], float] | None = None,
) -> Noise:
    """Most likely q and R given the nominal motion (derivations 6.3).

    Parameters
    ----------
    run, integrals : a record and the acceleration between its readings.
    start : where to begin; ten times off is near enough.
    counts : (n,) optional; readings that are to count.
    width : first steps of the search in log q and log R; it goes further where it must.
    floor : least variance of a reading at a q, m²; by default `run.reading_variance_floor`.

    Returns
    -------
    Noise
        Intensities; `r` is never below the floor.

    Raises
    ------
    ValueError
        From the core, if the record is unusable.
    """
    likelihood = Likelihood(run, integrals, start, counts)
    return most_likely_noise(likelihood, floor or run.reading_variance_floor, start, width, least_density(run))


def least_density(run: PreparedRun) -> float:
    """Least density of process noise beside that of an attitude, (m/s²)²/Hz: that of the output at its highest
    frequencies, at most as much as that of the attitude, which hides it and may itself fall with frequency."""
    of_attitude = run.recording.side.get(GRAVITY_NOISE)
    if of_attitude is None:
        return 0.0
    fastest = run.unchanged("fastest", (run.accel_step,), lambda: scatter(run.accel.y[:, None]) ** 2 * run.accel_step)
    return min(fastest, float(np.median(of_attitude.y)))


LARGEST_LOG = 60.0
"""Logarithm of a density or variance beyond which none is tried: after a gap of an hour without readings the product of
eight innovation variances, of which the likelihood takes the logarithm, is still within double precision."""


def most_likely_noise(
    log_likelihood: Callable[[float, float], float],
    floor: Callable[[float], float],
    start: Noise,
    width: float,
    least_q: float = 0.0,
) -> Noise:
    """Most likely q and R, by the simplex method.

    Parameters
    ----------
    log_likelihood : of log q and log R.
    floor : least R, m², at a q.
    start, width : where to begin, and the first steps in log q and log R.
    least_q : least q, (m/s²)²/Hz.
    """
    lowest = math.log(least_q) if least_q > 0.0 else -math.inf

    def cost(x: Array) -> float:
        if max(x) > LARGEST_LOG:
            return math.inf
        log_q, log_r = max(float(x[0]), lowest), float(x[1])
        least = math.log(floor(math.exp(log_q)))
        beyond = max(0.0, lowest - float(x[0])) + max(0.0, least - log_r)
        return -log_likelihood(log_q, max(log_r, least)) + 1e3 * beyond

    x0 = np.log([start.q, max(start.r, floor(start.q) * 1.01)])
    simplex = x0 + width * np.array([[0.0, 0.0], [1.0, 0.0], [0.0, 1.0]])
    best = scipy.optimize.minimize(
        cost,
        x0,
        method="Nelder-Mead",
        options={"initial_simplex": simplex, "xatol": 3e-3, "fatol": 0.02, "maxfev": 120},
    )
    log_q, log_r = max(float(best.x[0]), lowest), float(best.x[1])
    return Noise(float(np.exp(log_q)), float(np.exp(max(log_r, math.log(floor(math.exp(log_q)))))))


def level_of(
    run: PreparedRun,
    integrals: DriveIntegrals,
    noise: Noise,
    counts: Flags,
    sensor_scale: float,
    floor: Callable[[float], float] | None = None,
) -> Level | None:
    """Noise level of the readings that count, estimated anew; None when they are too few."""
    if int(counts.sum()) < LEAST_COUNT:
        return None
    return level(
        run, integrals, estimate_noise(run, integrals, noise, counts=counts, floor=floor), sensor_scale, counts
    )


def level(
    run: PreparedRun, integrals: DriveIntegrals, fitted: Noise, sensor_scale: float, counts: Flags | None = None
) -> Level:
    """Fitted noise in the user's units, with uncertainty from the curvature of the likelihood."""
    likelihood = Likelihood(run, integrals, fitted, counts)
    log_q, log_r = likelihood.spread(fitted)
    density = abs(sensor_scale) * math.sqrt(2.0 * fitted.q)
    reading = math.sqrt(fitted.r)
    return Level(density, 0.5 * log_q * density, reading, 0.5 * log_r * reading, likelihood.count)


BANDS_PER_OCTAVE = 3
"""Bands in which the level or the power of a residual is measured."""
LEAST_LINES = 16
"""Lines in a band, on average over segments, below which its level is not known."""
FREE_SHARE = 0.5
"""Share of a line that fitted columns may take and leave it one of noise."""
MEDIAN_OF_SQUARE = float(scipy.special.chdtri(1, 0.5))
"""Median of the square of a standard normal variable."""
MEDIAN_VARIANCE = 2.33**2
"""Variance of the logarithm of such a median times the number of lines: (2 m p(m))^-2 at the median m of density p."""
WHITE_ALPHA = 1e-6
"""Probability of the measured levels under white noise below which they are a spectrum."""
WHITE_FACTOR = 2.0
"""Factor from the mean level up to which no level matters."""

Spectrum = Callable[[Array], Array]
"""Density over that of white rows of variance 1 at frequencies in Hz, none of them 0."""


@dataclass(frozen=True, slots=True)
class MeasuredSpectrum:
    """Levels in bands, straight lines between them over the logarithm of frequency, level beyond them."""

    log_f: Array
    """Logarithm of the centre of each band, Hz, (bands,)."""
    log_level: Array
    """(bands,)"""
    lines: Array
    """Number of lines in each band, (bands,)."""
    crossover: float
    """Of the filter, Hz."""

    def __call__(self, f: Array) -> Array:
        """Density over that of white rows of variance 1 at frequencies `f`, Hz, (n,).

        Above the crossover it is nowhere less than there: regressors hold noise of the output, which would count.
        """
        log_crossover = math.log(self.crossover)
        least = float(np.interp(log_crossover, self.log_f, self.log_level))
        level = np.interp(np.log(f), self.log_f, self.log_level)
        return np.asarray(np.exp(np.where(np.log(f) > log_crossover, np.maximum(level, least), level)))

    @property
    def white(self) -> bool:
        """Whether the levels are those of white noise: chance, or no factor that matters."""
        departure = self.log_level - float(self.lines @ self.log_level) / float(np.sum(self.lines))
        chi2 = float(self.lines @ departure**2) / MEDIAN_VARIANCE
        chance = float(scipy.special.chdtrc(max(1, len(self.lines) - 1), chi2))
        return chance > WHITE_ALPHA or float(np.max(np.abs(departure))) < math.log(WHITE_FACTOR)


def measured_spectrum(
    r: Array, rate: float, crossover: float, explained: Array | None = None
) -> MeasuredSpectrum | None:
    """Measure the spectrum of a residual by medians; None where it has too few lines.

    Parameters
    ----------
    r : residual of the rows, (n,).
    rate : of the rows, Hz.
    crossover : of the filter, Hz.
    explained : share of each cosine that the fitted columns take, (n,); none by default.

    Notes
    -----
    A median does not follow what a missing effect leaves in less than half of the lines of a band (derivations D3.7).
    """
    n = len(r)
    if n <= LEAST_LINES:
        return None
    power = scipy.fft.dct(r, norm="ortho")[1:] ** 2
    if n > LONG_TRANSFORM:
        forget_plans()
    free = np.ones(n - 1) if explained is None else 1.0 - explained[1:]
    f = np.arange(1.0, n) * rate / (2.0 * n)
    inside = (free > FREE_SHARE) & (power > 0.0)
    power, f = power[inside] / free[inside], f[inside]
    begin, centres, levels, lines = 0, [], [], []
    while len(f) - begin >= LEAST_LINES:
        end = max(begin + LEAST_LINES, int(np.searchsorted(f, f[begin] * 2.0 ** (1.0 / BANDS_PER_OCTAVE))))
        if len(f) - end < LEAST_LINES:
            end = len(f)
        centres.append(float(np.mean(np.log(f[begin:end]))))
        levels.append(math.log(float(np.median(power[begin:end])) / MEDIAN_OF_SQUARE))
        lines.append(float(end - begin))
        begin = end
    return MeasuredSpectrum(np.array(centres), np.array(levels), np.array(lines), crossover) if centres else None


def whitener(spectrum: Spectrum | None, rate: float) -> Callable[[Array], Array]:
    """What divides rows (m, n) by the square root of a spectrum; the rows as they are without one."""
    if spectrum is None:
        return lambda rows: rows

    def whiten(rows: Array) -> Array:
        n = rows.shape[-1]
        f = np.maximum(np.arange(float(n)), 0.5) * rate / (2.0 * n)
        cosines = scipy.fft.dct(rows, norm="ortho", axis=-1)
        return np.asarray(scipy.fft.idct(cosines / np.sqrt(spectrum(f)), norm="ortho", axis=-1))

    return whiten
