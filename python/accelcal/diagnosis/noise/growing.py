"""Noise of the output that grows with the motion: its spectrum, the coefficients of its causes, its log score.

Derivations 7.10. The power of short blocks of the residual above the motion is exponential about its mean, and the mean
is linear in the coefficients: Whittle's likelihood, solved by iterated weighted least squares. The information of these
coefficients is block-diagonal to that of the mean: their Gram matrix is their own.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Array, Places
from accelcal.data.arrays import stretch_about
from accelcal.diagnosis.noise.residuals import BlockSpectra, Residuals
from accelcal.diagnosis.policy import NOISE_TEST_LEAST_BLOCKS
from accelcal.diagnosis.search.homogeneity import different
from accelcal.effects import Effect
from accelcal.estimation.noise import NoiseEffect, NoiseScore, NoiseSpectrum
from accelcal.signals.processing import cosine_window

BLOCK: Array = cosine_window(128)
"""Window of a block: lines leak little, and blocks that overlap by half are nearly independent."""
ITERATIONS = 8
"""Of the weighted least squares."""
LEAST_MEAN = 1e-3
"""Least mean of a block over the median, in the weights."""
NEIGHBOURS = 3
"""Frequencies on either side that share the growth which weights are taken from."""
IN_BAND = 2.0
"""Standard deviations by which a frequency belongs to the band of a coloured noise, next to its strongest."""
LEAST_SHOWN = 5.0
"""Smallest coefficient that a record surely shows, in standard deviations."""
PARTS = 32
"""Parts of a record whose scatter gives the uncertainty of a score."""
STRONGEST = 0.9
"""Quantile of a variance function from which on it is strong."""
SAME_RATE = 0.01
"""Relative difference of rates up to which a spectrum applies to another record."""


Grown = dict[str, tuple[Array, Array]]
"""Of each effect the growth at each frequency and its standard deviation, (F,) each, (m/s²)² per unit."""


@dataclass(frozen=True, slots=True)
class BlockPowers:
    """Powers of the blocks of a record and the variance functions over them."""

    f: Array
    """(F,) Hz"""
    power: Array
    """(K, F) (m/s²)²"""
    functions: Mapping[str, Array]
    """By effect, (K,), in the unit of its variance function."""

    @classmethod
    def of(cls, residuals: Residuals, effects: Sequence[Effect]) -> BlockPowers:
        """Of one record."""
        low = 1.3 * residuals.edge
        spectra = BlockSpectra.of(residuals.above_motion(math.inf), residuals.sampled, residuals.rate, low, BLOCK)
        s, t = residuals.signals, residuals.t
        means = {e.name: spectra.means(np.interp(t, s.t + residuals.run.origins.t, e.column(s))) for e in effects}
        return cls(spectra.f, spectra.power, means)

    @classmethod
    def joined(cls, several: Sequence[BlockPowers]) -> BlockPowers:
        """Blocks of all records that share frequencies with the first, at those that all of them have."""
        first = several[0]
        like = [block for block in several if len(shared_frequencies(first.f, block.f)[0])]
        f = first.f
        for powers in like:
            f = f[shared_frequencies(f, powers.f)[0]]
        like = [block.at(f) for block in like]
        functions = {name: np.concatenate([block.functions[name] for block in like]) for name in first.functions}
        return cls(f, np.concatenate([block.power for block in like]), functions)

    def at(self, f: Array) -> BlockPowers:
        """The same at frequencies that it has."""
        return BlockPowers(f, self.power[:, shared_frequencies(f, self.f)[1]], self.functions)

    def mean(self, spectrum: NoiseSpectrum) -> Array:
        """Expected powers, (K, F)."""
        expected = np.tile(spectrum.floor, (len(self.power), 1))
        for name, growth in spectrum.growth.items():
            expected += np.outer(self.functions[name], growth)
        return expected


def shared_frequencies(f: Array, other: Array) -> tuple[Places, Places]:
    """Places in both of the frequencies that two records of one rate share; the lowest depends on the motion."""
    if len(f) == 0 or len(other) == 0 or abs(f[-1] - other[-1]) > SAME_RATE * other[-1]:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    count = min(len(f), len(other))
    return np.arange(len(f) - count, len(f)), np.arange(len(other) - count, len(other))


def at_frequencies(spectrum: NoiseSpectrum, places: Places) -> NoiseSpectrum:
    """A spectrum at some of its frequencies."""
    growth = {name: values[places] for name, values in spectrum.growth.items()}
    return NoiseSpectrum(spectrum.f[places], spectrum.floor[places], growth)


def grown_spectrum(blocks: BlockPowers, effects: Sequence[Effect]) -> tuple[NoiseSpectrum, Grown]:
    """Most likely spectrum with the growth that each effect gives it, and the growth as it was estimated, negative too.

    Noise of the clocks is white, so that its growth is the same at all frequencies. Weights are those of growth that
    neighbouring frequencies share: by its own estimate a frequency that happens to be low would weigh more.
    """
    functions = [blocks.functions[e.name] for e in effects]
    size = [max(float(np.max(h)), 1e-300) for h in functions]
    columns = np.column_stack(
        [np.ones(len(blocks.power)), *(h / most for h, most in zip(functions, size, strict=True))]
    )
    least = LEAST_MEAN * np.median(blocks.power, axis=0) + 1e-300
    mean = np.tile(np.mean(blocks.power, axis=0) + 1e-300, (len(columns), 1))
    for _ in range(ITERATIONS):
        c, information = weighted_fits(blocks.power, columns, mean)
        shared = c.copy()
        for k, e in enumerate(effects, start=1):
            shared[:, k] = common(c[:, k], information[:, k]) if is_white(e) else neighbours(c[:, k])
        explained = columns[:, 1:] @ np.maximum(shared[:, 1:], 0.0).T
        mean = np.maximum(floor_beside(blocks.power, explained) + explained, least)
    c, information = weighted_fits(blocks.power, columns, mean)
    scatter = float(np.mean((blocks.power / mean - 1.0) ** 2))
    estimated, growth = {}, {}
    for k, (e, most) in enumerate(zip(effects, size, strict=True), start=1):
        estimated[e.name] = c[:, k] / most, np.sqrt(scatter / information[:, k]) / most
        level = common(c[:, k], information[:, k]) if is_white(e) else c[:, k]
        growth[e.name] = np.maximum(level, 0.0) / most
    explained = sum(
        (np.outer(blocks.functions[name], size) for name, size in growth.items()), np.zeros_like(blocks.power)
    )
    return NoiseSpectrum(blocks.f, floor_beside(blocks.power, explained), growth), estimated


def weighted_fits(power: Array, columns: Array, mean: Array) -> tuple[Array, Array]:
    """Coefficients (F, m) of powers (K, F) = columns (K, m) c by weights of their means (K, F), and the information on
    each when the others are free, (F, m), for powers that scatter by their mean."""
    weights = mean**-2.0
    gram = np.einsum("ki,kf,kj->fij", columns, weights, columns, optimize=True)
    score = np.einsum("ki,kf->fi", columns, weights * power, optimize=True)
    inverse = np.linalg.pinv(gram, rcond=1e-10, hermitian=True)
    variance = np.einsum("fii->fi", inverse)
    return np.einsum("fij,fj->fi", inverse, score), 1.0 / np.maximum(variance, 1e-300)


def common(values: Array, information: Array) -> Array:
    """The mean of values (F,) by their information, at every frequency."""
    return np.full(len(values), float(np.average(values, weights=information)))


def neighbours(values: Array) -> Array:
    """Mean of each value (F,) and its neighbours."""
    reach = min(NEIGHBOURS, (len(values) - 1) // 2)
    if reach < 1:
        return values
    padded = np.pad(values, reach, mode="edge")
    return np.convolve(padded, np.full(2 * reach + 1, 1.0 / (2 * reach + 1)), mode="valid")


def floor_beside(power: Array, explained: Array) -> Array:
    """Most likely floor (F,) of powers (K, F) beside what is explained of them, (K, F)."""
    floor = np.maximum(np.mean(power - explained, axis=0), 0.05 * np.median(power, axis=0)) + 1e-300
    for _ in range(ITERATIONS):
        weights = (floor + explained) ** -2.0
        spectrum = np.sum(weights * (power - explained), axis=0) / np.sum(weights, axis=0)
        floor = np.maximum(spectrum, 0.05 * np.median(power, axis=0)) + 1e-300
    return np.asarray(floor)


def is_white(effect: Effect) -> bool:
    """Whether the noise that an effect causes is white: an error of the instant of each sample is."""
    return effect.owner == "timing"


SHARED_BINS = float(np.sum((np.abs(np.fft.fft(BLOCK**2)) / float(np.sum(BLOCK**2))) ** 2))
"""Variance of a mean over neighbouring frequencies over that of as many independent ones."""


def band_of(z: Array) -> slice:
    """Frequencies about the most significant one, as far as they and their neighbours are significant."""
    at = int(np.argmax(z))
    low, high = stretch_about((z > IN_BAND) | (np.arange(len(z)) == at), at)
    return slice(max(0, low - NEIGHBOURS), high + NEIGHBOURS + 1)


def growing_noise(several: Sequence[Residuals], effects: Sequence[Effect]) -> list[NoiseEffect]:
    """Coefficients of effects that make the noise of the output grow with the motion, over all records.

    Parameters
    ----------
    several : residuals of each record.
    effects : those of the model of this kind.
    """
    blocks = BlockPowers.joined([BlockPowers.of(residuals, effects) for residuals in several])
    if len(blocks.power) < NOISE_TEST_LEAST_BLOCKS or len(blocks.f) == 0:
        return []
    spectrum, estimated = grown_spectrum(blocks, effects)
    gain = np.maximum(np.abs(several[0].gain(blocks.f)), several[0].least_gain)
    noise_effects = []
    for effect in effects:
        at, spread = estimated[effect.name]
        if is_white(effect):
            weights = spread**-2.0 / float(np.sum(spread**-2.0))
            band = slice(0, len(at))
        else:  # the power of a block is the sum over all its frequencies
            band = band_of(neighbours(at / spread) * math.sqrt(2 * NEIGHBOURS + 1))
            weights = np.zeros(len(at))
            weights[band] = 2.0 / len(BLOCK) / gain[band] ** 2
        value = float(weights @ at)
        std = math.sqrt(SHARED_BINS * float(weights**2 @ spread**2))
        others = [e for e in effects if e is not effect]
        without, _ = grown_spectrum(blocks, others)
        p = float(scipy.special.ndtr(-value / std)) if std > 0.0 else 1.0
        trials = 1 if is_white(effect) else len(at)
        low, high = float(blocks.f[band.start]), float(blocks.f[min(band.stop, len(at)) - 1])
        most = max(float(np.max(effect.column(residuals.signals))) for residuals in several)
        strongest = math.sqrt(max(value, 0.0) * most)
        text = f"noise of the output from {low:.0f} Hz to {high:.0f} Hz grows, to {strongest:.2g} m/s² rms at most"
        of_block = np.mean(blocks.power[:, band] / blocks.mean(spectrum)[:, band], axis=1)
        flat = flatness(of_block, blocks.functions[effect.name])
        particulars = {"lowest": low, "highest": high, "least": LEAST_SHOWN * std, "flat": flat, "strongest": strongest}
        noise_effects.append(
            NoiseEffect(
                effect.name,
                effect.symbol,
                effect.unit,
                value,
                std,
                effect.owner,
                min(1.0, trials * p),
                text,
                particulars,
                spectrum,
                without,
            )
        )
    return noise_effects


def score_of_growth(blocks: BlockPowers, effect: NoiseEffect) -> NoiseScore | None:
    """Gain of Whittle's log-likelihood on a record by an effect; None where the frequencies are not those of the fit.

    The level of either spectrum at each frequency is that of the record: what is scored is how the noise grows.

    Parameters
    ----------
    blocks : of the record, with the variance functions of all effects of the model of this kind.
    effect : the effect, as it was estimated.
    """
    if effect.spectrum is None or effect.without is None or len(blocks.power) == 0:
        return None
    own_places, places = shared_frequencies(blocks.f, effect.spectrum.f)
    if len(own_places) == 0:
        return None
    blocks = BlockPowers(blocks.f[own_places], blocks.power[:, own_places], blocks.functions)
    spectrum = at_frequencies(effect.spectrum, places)
    m1, m0 = blocks.mean(spectrum), blocks.mean(at_frequencies(effect.without, places))
    level1, level0 = (np.mean(blocks.power / m, axis=0) for m in (m1, m0))  # how noise grows, not how much there is
    gain = np.sum(
        np.log(level0 * m0) + blocks.power / (level0 * m0) - np.log(level1 * m1) - blocks.power / (level1 * m1), axis=1
    )
    h = blocks.functions[effect.name]
    strong = h >= np.quantile(h, STRONGEST)
    grown = spectrum.growth[effect.name] / spectrum.floor
    positive = np.where(grown > 0.0, grown, 0.0)
    weights = (
        positive / float(np.sum(positive)) if np.any(positive > 0.0) else np.full(len(positive), 1.0 / len(positive))
    )
    total, std = total_with_std(gain)
    with_it, without = (float(np.mean((blocks.power[strong] / m[strong]) @ weights)) for m in (m1, m0))
    return NoiseScore(effect.name, "accel", total, std, blocks.power.size, with_it, without)


def flatness(power: Array, variable: Array, edges: int = 10) -> float:
    """Probability that normalised powers (n,) of mean 1 differ as much between bins of a variable (n,), by chance.

    Chi-square over bins of equal numbers; the spread is that of the powers themselves.
    """
    limits = np.quantile(variable, np.linspace(0.0, 1.0, edges + 1)[1:-1])
    bins = np.searchsorted(limits, variable)
    count = np.bincount(bins, minlength=edges)
    used = count > 1
    means = np.bincount(bins, weights=power, minlength=edges)[used] / count[used]
    spread = float(np.var(power)) / count[used]
    return float(different(means, 1.0 / np.maximum(spread, 1e-300)))


def total_with_std(gain: Array) -> tuple[float, float]:
    """Sum of a series (n,), and its standard deviation from the sums over parts of it, as they follow each other."""
    if len(gain) < 2 * PARTS:
        return float(np.sum(gain)), float(np.std(gain)) * math.sqrt(len(gain))
    parts = np.array([float(np.sum(part)) for part in np.array_split(gain, PARTS)])
    return float(np.sum(gain)), float(np.std(parts, ddof=1)) * math.sqrt(PARTS)
