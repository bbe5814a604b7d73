"""The systematic error of an accelerometer under a model: what is left of its corrected output that noise is not.

The residual at the accelerometer is projected on what a record resolves: functions of time and of the motion, effects
without memory, the differences of the models at hand. Equations: docs/derivations.md, "The systematic error".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from accelcal.data import Array, Recording, batches, median_step, within_spans
from accelcal.effects import BUILT_IN, Effect, is_local
from accelcal.estimation.estimate import Fit
from accelcal.estimation.run import Source, recording_of
from accelcal.estimation.values import Noise
from accelcal.signals.processing import low_pass
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import Bins, Evaluation, NoiseFloor, ReferenceNoise, Resolved, SensorNoise
from accelcal.validation.evaluation import EDGE, PER_PERIOD, compare, predicted_density, spectrum
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.regions import bin_residual, largest_of, spans, variables_of, worst_regions, worst_sentence

Density = Callable[[Array], Array]
"""One-sided density of noise, (k,) (m/s²)²/Hz, at frequencies (k,) Hz."""
KNOTS, COARSE = 8, 5
"""Knots of a function of one variable, and of the coefficient of acceleration or velocity as a function of one."""
BLOCK, BLOCKS = 1 << 14, 8
"""Samples that are projected together, and stretches of as many into which a long record is cut."""
LEAST_SAMPLES = 500
"""Fewer do not tell an error in a hundred directions from noise."""
KINDS = (0.0, 1.0, 1.5, 2.0)
"""Exponents of noise that falls with frequency: white, flicker, random walk (IEEE 952), and between the two."""
COST = 4.0
"""Twice the log likelihood that a kind beside white noise must bring to count as much as white noise alone."""
OCTAVES, LEAST_IN_OCTAVE = 12, 30.0
"""Octaves in which noise is measured, the last one beyond half the band, and values in no direction in one at least."""
NEGLIGIBLE = 1e-7
"""Directions whose share of the power of all is less are none."""
APART = 1e-3
"""Share of the power of a difference of two models from which what no function resolves of it is a direction: less is
the noise of the readings, times the difference of the scale factors."""


def with_resolved(
    evaluations: Sequence[Evaluation],
    fits: Sequence[Fit],
    recording: Recording,
    ruler: Ruler,
    floor: NoiseFloor | None = None,
) -> tuple[Evaluation, ...]:
    """Evaluations of several models on one recording with the regions where they fail, and the errors it resolves.

    Parameters
    ----------
    evaluations, fits, recording : of each model, and what they are compared with.
    ruler : filter that all share.
    floor : noise of the sensor; without it the regions alone.
    """
    first = evaluations[0]
    if first.motion is None or first.reference_noise is None:
        return tuple(evaluations)
    if len({len(evaluation.accel_residual[0]) for evaluation in evaluations}) > 1:
        alone = (with_resolved([e], [fit], recording, ruler) for e, fit in zip(evaluations, fits, strict=True))
        return tuple(evaluation for (evaluation,) in alone)
    grid, scales = Grid.of(first, fits[0]), np.abs([fit.values().scale for fit in fits])
    if not len(grid.rows):  # all lie beside a hole
        return tuple(evaluations)
    residuals = np.array([evaluation.accel_residual[1][grid.rows] for evaluation in evaluations])
    expected: Density = partial(density_of, noise=ruler.noise, reference=first.reference_noise, band=first.band)
    density, parts = expected, [evaluation.resolved for evaluation in evaluations]
    if len(grid.rows) >= LEAST_SAMPLES:
        sensor = None if floor is None or floor.sensor.is_limit else floor.sensor
        errors, functions = residuals / scales[:, None], dictionary(first.motion, grid)
        resolved, noise = resolve(errors, grid, functions, expected, sensor)
        density, parts = noise.density, parts if floor is None else [(part,) for part in resolved]
    t, variables = first.accel_residual[0][grid.rows], placed(first.motion, fits[0], recording, grid.at)
    least = 1.0 / (grid.band * grid.every * grid.step)
    regions = bin_residual(t, residuals, scales, variables, least, partial(variances, grid=grid, density=density))
    return tuple(
        replace(failing(e, (*bins, spectrum(e, scale, expected)), scale), resolved=part)
        for e, bins, scale, part in zip(evaluations, regions, scales, parts, strict=True)
    )


def failing(evaluation: Evaluation, bins: tuple[Bins, ...], scale: float) -> Evaluation:
    """An evaluation with its mean errors by region and frequency, and the worst of them."""
    worst, number = worst_regions(bins, evaluation.accel_rms_centred), sum(int(np.count_nonzero(b.std)) for b in bins)
    sentence, largest = worst_sentence(worst, number), largest_of(bins, scale)
    return replace(evaluation, bins=bins, worst=sentence, worst_regions=worst, largest=largest)


def evaluated(fit: Fit, source: Source, start: float | None = None, end: float | None = None) -> Evaluation:
    """One model against a recording from `start` to `end`, s, and where it fails."""
    alone = compare(fit, source, start=start, end=end)
    return with_resolved([alone], [fit], recording_of(source), Ruler.of([fit]))[0]


def placed(motion: Signals, fit: Fit, recording: Recording, at: NDArray[np.intp]) -> dict[str, tuple[Array, str]]:
    """What an error may depend on, at some samples of a motion (n,), in the coordinates of its recording; units."""
    origins = {"time": fit.origins.t, "position": fit.origins.p, **{name: fit.origins.of(name) for name in motion.side}}
    units, several = {name: channel.unit for name, channel in recording.side.items()}, variables_of(motion)
    return {name: (y[at] + origins.get(name, 0.0), units.get(name, unit)) for name, (y, unit) in several.items()}


def density_of(f: Array, noise: Noise, reference: ReferenceNoise, band: float) -> Array:
    """One-sided noise density of a corrected output at frequencies (n,) Hz, (n,) (m/s²)²/Hz."""
    return predicted_density(f, noise, 1.0, reference, band)


@dataclass(frozen=True, slots=True)
class Grid:
    """Samples of a residual that are projected, on every so many-th time of the grid of its motion."""

    rows: NDArray[np.intp]
    """Of the residual, rising, (n,)."""
    at: NDArray[np.intp]
    """Of the motion, at the same times, (n,)."""
    every: int
    """Greatest spacing of the times, in those of the motion."""
    step: float
    """Spacing of the motion, s."""
    band: float
    """Hz."""

    @classmethod
    def of(cls, evaluation: Evaluation, fit: Fit) -> Grid:
        """Some six samples in a period of the band, none beside a hole; of a long record stretches spread over it."""
        assert evaluation.motion is not None
        step, band, (t, _) = evaluation.motion.step, evaluation.band, evaluation.accel_residual
        place = (t - fit.origins.t - evaluation.motion.t[0]) / step
        apart = median_step(place)
        every = max(1, int(1.0 / (PER_PERIOD * band * step)))
        used = np.abs(place / every - np.rint(place / every)) < 0.25 * apart / every
        holes = np.flatnonzero(np.diff(place) > 1.5 * apart)
        beside = np.column_stack([t[holes] - EDGE / band, t[holes + 1] + EDGE / band])
        used &= ~within_spans(np.searchsorted(t, beside), len(t))
        rows = np.flatnonzero(used)
        if len(rows) > BLOCKS * BLOCK:
            begins = np.linspace(0, len(rows) - BLOCK, BLOCKS).astype(np.intp)
            rows = rows[(begins[:, None] + np.arange(BLOCK)).ravel()]
        return cls(rows, np.rint(place[rows]).astype(np.intp), every, step, band)

    def inside(self, y: Array) -> Array:
        """A function of the motion below the band, at the samples, (n,)."""
        return low_pass(np.nan_to_num(y), 1.0 / self.step, self.band)[self.at]

    def blocks(self, length: int) -> Iterator[tuple[slice, Grid]]:
        """Stretches of a motion of so many samples, and the samples in each on the grid of that stretch."""
        margin = math.ceil(2.0 * EDGE / (self.band * self.step))
        for rows in batches(len(self.at), BLOCK):
            at = self.at[rows]
            first = max(0, int(at[0]) - margin)
            yield slice(first, min(length, int(at[-1]) + margin + 1)), replace(self, at=at - first)


@dataclass(frozen=True, slots=True)
class AddedVariable:
    """What is left of an output against an effect, both without what the model takes up (added-variable plot)."""

    x: Array
    """Mean contribution of the effect at its estimated size in each bin, (bins,) m/s²."""
    y: Array
    """Mean error of the output in each bin, (bins,) m/s²."""
    std: Array
    """Of `y` under noise alone, (bins,) m/s²."""
    slope: float
    """Of all samples; 1 where the effect has the estimated size here too."""
    slope_std: float
    explained: float
    """Share of the mean square of the systematic error."""


PLACES = 24
"""Bins of an added-variable plot."""


Lacking = tuple[Effect, Mapping[str, float], Sequence[float]]
"""An effect that a model lacks, its shape parameters, and the estimate of each coefficient."""


def added_variables(evaluation: Evaluation, fit: Fit, lacking: Sequence[Lacking]) -> list[AddedVariable | None]:
    """Compare what a model leaves of the output with each of some effects that it lacks.

    Parameters
    ----------
    evaluation : of the model on a recording.
    fit : the model.
    lacking : what it lacks.

    Returns
    -------
    None where an effect is no function of the motion, or the record too short.
    """
    motion, reference = evaluation.motion, evaluation.reference_noise
    acting = [effect.port in ("output", "position") for effect, _, _ in lacking]
    if motion is None or reference is None or not any(acting):
        return [None] * len(lacking)
    grid, scale = Grid.of(evaluation, fit), abs(fit.values().scale)
    if len(grid.rows) < LEAST_SAMPLES:
        return [None] * len(lacking)
    terms = [np.ones(len(motion.t)), motion.a, motion.jerk]
    terms += [term.column(motion) for term in fit.values().terms if term.effect.port == "output"]
    base = np.stack([grid.inside(term) for term in terms], axis=1)
    base /= np.maximum(np.linalg.norm(base, axis=0), np.finfo(float).tiny)

    def rest(column: Array) -> Array:
        """What the model does not take up of a column (n,) at the output, over its scale."""
        return np.asarray((column - base @ np.linalg.lstsq(base, column, rcond=NEGLIGIBLE)[0]) / scale)

    y = rest(evaluation.accel_residual[1][grid.rows])
    density = partial(density_of, noise=fit.noise(), reference=reference, band=evaluation.band)
    (part,), noise = resolve(y[None], grid, dictionary(motion, grid), density, None)
    above = float(part.coordinates @ part.coordinates) - float(np.trace(part.covariance))

    def drawn(effect: Effect, shape: Mapping[str, float], sizes: Sequence[float]) -> AddedVariable:
        # of a curve in its coarse form the leading coefficients are estimated
        column = effect.column(motion, **shape).reshape(len(motion.t), -1)[:, : len(sizes)] @ np.asarray(sizes)
        if effect.port == "position":
            inside = low_pass(column, 1.0 / grid.step, grid.band)
            column = -scale * motion.rig.polarity * np.gradient(np.gradient(inside, grid.step), grid.step)
        x = rest(grid.inside(column))
        power = float(x @ x)
        slope = float(x @ y) / power
        place = np.argsort(np.argsort(x, kind="stable")) * PLACES // len(x)
        bins = (place == np.arange(PLACES)[:, None]).astype(float)
        bins /= np.sum(bins, axis=1, keepdims=True)
        *spread, along = variances(np.vstack([bins, x / power]), grid, noise.density)
        explained = max(0.0, (slope**2 - along) * power) / above if above > 0.0 else 0.0
        return AddedVariable(bins @ x, bins @ y, np.sqrt(spread), slope, math.sqrt(along), min(1.0, explained))

    return [drawn(*effect) if acts else None for effect, acts in zip(lacking, acting, strict=True)]


def resolve(
    errors: Array, grid: Grid, functions: Array, density: Density, sensor: SensorNoise | None
) -> tuple[tuple[Resolved, ...], MeasuredNoise]:
    """Errors of several models in the directions that a record resolves, and the noise that was measured.

    Parameters
    ----------
    errors : of the corrected output, (models, n) m/s².
    grid : of the samples.
    functions : of time and motion, below the band, (m, n).
    density : assumed of the noise of the errors, but for its levels: these are measured in no direction.
    sensor : noise of the sensor where it is known otherwise, for the bound on what no direction resolves.
    """
    # the set-up, which stands beside, comes first; the differences of the models are the effects at hand
    columns = np.concatenate([np.ones((1, errors.shape[1])), functions, errors[1:] - errors[0]])
    size, n, step = len(columns), errors.shape[1], grid.every * grid.step
    gram = columns @ columns.T
    centre = np.eye(size)
    centre[:, 0] -= gram[0] / gram[0, 0]
    centred = centre @ gram @ centre.T
    varying = np.diag(centred)
    some = varying > NEGLIGIBLE * np.diag(gram)
    scale = np.where(some, 1.0 / np.sqrt(np.where(some, varying, 1.0)), 0.0)
    scale[size - len(errors) + 1 :] = 0.0
    values, vectors = np.linalg.eigh(scale[:, None] * centred * scale)
    some = values > NEGLIGIBLE * values[-1]
    within = (vectors[:, some] / np.sqrt(values[some])).T * scale
    for model in range(size - len(errors) + 1, size):
        beyond = np.eye(size)[model] - centred[model] @ within.T @ within
        power_beyond = beyond @ centred @ beyond
        if power_beyond > APART * varying[model]:
            within = np.concatenate([within, beyond[None] / np.sqrt(power_beyond)])
    directions = np.concatenate([np.eye(size)[:1] / math.sqrt(gram[0, 0]), within @ centre]) @ columns
    del columns, functions
    coordinates = errors @ directions.T
    rests = np.sum(errors**2, axis=1) - np.sum(coordinates**2, axis=1)
    best = int(np.argmin(rests))
    noise = MeasuredNoise.of(errors[best] - coordinates[best] @ directions, directions, grid, density)
    covariance = noise_in(directions[1:], grid, noise.density)
    power = density(scipy.fft.rfftfreq(2 * BLOCK, step)) / (2.0 * step)
    # the mean over frequencies, the two at the ends counted once
    beside, std = 0.0, math.sqrt(2.0 * n * float(np.mean(np.r_[power, power[1:-1]] ** 2)))
    if sensor is not None:
        beside = noise.expected * sensor.density**2 / density(np.zeros(1))[0]
        std = beside * math.hypot(std / noise.expected, 2.0 * sensor.std / sensor.density)
    return tuple(
        Resolved(c[1:].copy(), covariance, noise.trace_std, float(rest), beside, std, n)
        for c, rest in zip(coordinates, rests, strict=True)
    ), noise


@dataclass(frozen=True, slots=True)
class MeasuredNoise:
    """Noise of the errors as the best model leaves it in no direction: white and one that rises below what is measured,
    times a level for each octave."""

    assumed: Density
    edges: Array
    """Upper ends of the octaves but the last one, (k - 1,) Hz."""
    levels: Array
    """Power in each octave over that of the three kinds, (k,); 1 where less than one value is in no direction."""
    kinds: Array
    """Power of each kind over the assumed one, at the end of the band, (4,)."""
    least: float
    """Frequency below which no kind rises, Hz."""
    band: float
    trace_std: float
    """Of the sum of squares in the directions, by the levels, (m/s²)²."""
    expected: float
    """Sum of squares in no direction under the assumed density, (m/s²)²."""

    @classmethod
    def of(cls, rest: Array, directions: Array, grid: Grid, assumed: Density) -> MeasuredNoise:
        """Compare what no direction explains (n,) with its expectation; directions (m, n) are orthonormal."""
        edges = grid.band * 0.5 ** np.arange(OCTAVES - 1.0, 0.0, -1.0)
        least = 0.5 / (len(rest) * grid.every * grid.step)
        # of each octave: power that is left, values in no direction; expectation and power in the directions by kind
        left, values = np.zeros((2, OCTAVES))
        expected, taken = np.zeros((2, OCTAVES, len(KINDS)))
        for n, f, weights, transforms in spectra(np.vstack([directions, rest]), grid):
            squares = weights * (transforms.real**2 + transforms.imag**2)
            within = np.sum(squares[:-1], axis=0)
            free, octave = np.maximum(0.0, n * weights - within), np.searchsorted(edges, f)
            left += np.bincount(octave, squares[-1], OCTAVES)
            values += np.bincount(octave, free * (f <= grid.band), OCTAVES)
            power = assumed(f) / (2.0 * grid.every * grid.step)
            for k, rise in enumerate(rising(f, least, grid.band)):
                expected[:, k] += np.bincount(octave, power * rise * free, OCTAVES)
                taken[:, k] += np.bincount(octave, power * rise * within, OCTAVES)
        kinds = likely_kinds(left, values, expected)
        counts, starts = np.cumsum(values), [0]
        for k in range(OCTAVES - 1):
            if counts[k] - (counts[starts[-1] - 1] if starts[-1] else 0.0) >= LEAST_IN_OCTAVE:
                starts.append(k + 1)
        left, values, expected, taken = (np.add.reduceat(y, starts) for y in (left, values, expected, taken))
        sizes = expected @ kinds
        levels = np.where(values < 1.0, 1.0, left / sizes)
        trace_std = float(np.sqrt(np.sum(2.0 * (levels * (taken @ kinds)) ** 2 / values)))
        edges = edges[np.array(starts[1:], dtype=np.intp) - 1]
        return cls(assumed, edges, levels, kinds, least, grid.band, trace_std, float(expected[:, 0].sum()))

    def density(self, f: Array) -> Array:
        """One-sided density at frequencies (n,) Hz, (n,) (m/s²)²/Hz."""
        level = self.levels[np.searchsorted(self.edges, f)]
        return np.asarray(self.assumed(f) * level * (self.kinds @ rising(f, self.least, self.band)))


def likely_kinds(left: Array, values: Array, expected: Array) -> Array:
    """Power of each kind over the assumed one, (4,): white alone and with each other kind, by their likelihoods.

    A kind that the record does not show surely is in it nevertheless: far below what is measured it may be all. Where
    no octave holds a value in no direction the noise is the assumed one.

    Parameters
    ----------
    left, values : power in no direction, (octaves,) (m/s²)², and in how many values.
    expected : its expectation by kind, (octaves, 4) (m/s²)².
    """
    some = values >= 1.0
    if not some.any():  # the directions hold all of the band
        return np.asarray(np.eye(len(KINDS))[0])
    left, values, expected = left[some], values[some], expected[some]
    tried, costs = np.zeros((len(KINDS), len(KINDS))), np.zeros(len(KINDS))
    for k, powers in enumerate(tried):
        several, like = [0, k][: k + 1], left
        for _ in range(3):
            certain = np.sqrt(0.5 * values) / like
            powers[several] = scipy.optimize.nnls(certain[:, None] * expected[:, several], certain * left)[0]
            like = expected @ powers
        costs[k] = np.sum(values * (left / like - 1.0 - np.log(left / like))) + COST * len(several)
    weights = np.exp(0.5 * (np.min(costs) - costs))
    return np.asarray(weights @ tried / np.sum(weights))


def rising(f: Array, least: float, band: float) -> Array:
    """Density of each kind over that at the end of a band, (4, n), at f (n,) Hz."""
    return np.asarray((band / np.maximum(f, least)) ** np.array(KINDS)[:, None])


def spectra(columns: Array, grid: Grid) -> Iterator[tuple[int, Array, Array, NDArray[np.complex128]]]:
    """Transforms of columns (m, n) by stretch: its samples, frequencies (k,) Hz, weights (k,), transforms (m, k).

    The weighted sum of the squares of a transform is the sum of the squares of the samples.
    """
    for rows in batches(columns.shape[1], BLOCK):
        at = (grid.at[rows] - grid.at[rows.start]) // grid.every
        size = scipy.fft.next_fast_len(2 * (int(at[-1]) + 1), real=True)
        padded = np.zeros((len(columns), size))
        padded[:, at] = columns[:, rows]
        f = scipy.fft.rfftfreq(size, grid.every * grid.step)
        weights = np.where((f == 0.0) | (2 * np.arange(len(f)) == size), 1.0, 2.0) / size
        yield len(at), f, weights, scipy.fft.rfft(padded)


def noise_in(columns: Array, grid: Grid, density: Density) -> Array:
    """Covariance of the sums of noise along some columns (m, n), (m, m)."""
    total = np.zeros((len(columns), len(columns)))
    for _, f, weights, transforms in spectra(columns, grid):
        transforms *= np.sqrt(weights * density(f) / (2.0 * grid.every * grid.step))
        parts = transforms.view(np.float64)
        total += parts @ parts.T
    return total


def variances(columns: Array, grid: Grid, density: Density) -> Array:
    """Variances of the sums of noise along some columns (m, n), (m,)."""
    return np.diag(noise_in(columns, grid, density))


def dictionary(motion: Signals, grid: Grid) -> Array:
    """Functions of time and of the motion at the samples of a grid, (m, n)."""
    single = spans(y for y, _ in variables_of(motion).values())
    carried = spans((motion.t, motion.p, motion.v, *motion.side.values()))
    effects = [
        effect
        for effect in BUILT_IN
        if effect.port == "output" and not effect.shapes and effect.width == 1 and is_local(effect)
        if all(name in motion.side for name in effect.needs)
    ]

    def within(rows: slice, part: Grid) -> Iterator[Array]:
        for y, low, high in single:
            yield from map(part.inside, hats(y[rows], low, high, KNOTS))
        for y, low, high in carried:
            for hat in hats(y[rows], low, high, COARSE):
                yield from (part.inside(y[rows] * hat) for y in (motion.a, motion.v))
        stretch = motion.part(rows)
        yield from (part.inside(effect.column(stretch)) for effect in effects)

    return np.concatenate([np.stack(list(within(*block))) for block in grid.blocks(len(motion.t))], axis=1)


def hats(y: Array, low: float, high: float, knots: int) -> Iterator[Array]:
    """Piecewise linear functions of a variable (n,), one for each of some equidistant knots."""
    place = np.clip((y - low) / (high - low), 0.0, 1.0) * (knots - 1)
    yield from (np.maximum(0.0, 1.0 - np.abs(place - knot)) for knot in range(knots))
