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

from accelcal.data import Array
from accelcal.effects import BUILT_IN, Effect, is_local
from accelcal.estimation.estimate import Fit
from accelcal.estimation.values import Noise
from accelcal.signals.processing import low_pass
from accelcal.signals.signals import Signals
from accelcal.validation.comparison import Evaluation, NoiseFloor, ReferenceNoise, Resolved, SensorNoise
from accelcal.validation.evaluation import PER_PERIOD, predicted_density
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.regions import variables_of

KNOTS, COARSE = 8, 5
"""Knots of a function of one variable, and of the coefficient of acceleration or velocity as a function of one."""
BLOCK = 1 << 15
"""Samples whose noise is projected together."""
NEGLIGIBLE = 1e-7
"""Directions whose share of the power of all is less are none."""
APART = 1e-3
"""Share of the power of a difference of two models from which what no function resolves of it is a direction: less is
the noise of the readings, times the difference of the scale factors."""


def with_resolved(
    evaluations: Sequence[Evaluation], fits: Sequence[Fit], ruler: Ruler, floor: NoiseFloor
) -> tuple[Evaluation, ...]:
    """Evaluations of several models on one recording with the errors that it resolves.

    Parameters
    ----------
    evaluations, fits : of each model.
    ruler : filter that all share.
    floor : noise of the sensor.
    """
    first = evaluations[0]
    lengths = {len(evaluation.accel_residual[0]) for evaluation in evaluations}
    if first.motion is None or first.reference_noise is None or len(lengths) > 1:
        return tuple(evaluations)
    grid = Grid.of(first, fits[0])
    scales = [abs(fit.values().scale) for fit in fits]
    errors = [e.accel_residual[1][grid.rows] / scale for e, scale in zip(evaluations, scales, strict=True)]
    density = partial(density_of, noise=ruler.noise, reference=first.reference_noise, band=first.band)
    columns = np.stack(list(dictionary(first.motion, grid)))
    sensor = None if floor.sensor.is_limit else floor.sensor
    parts = resolve(np.array(errors), grid, columns, density, sensor)
    return tuple(replace(e, resolved=(part,)) for e, part in zip(evaluations, parts, strict=True))


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
        """Some six samples in a period of the band."""
        assert evaluation.motion is not None
        step, (t, _) = evaluation.motion.step, evaluation.accel_residual
        place = (t - fit.origins.t - evaluation.motion.t[0]) / step
        every = max(1, int(1.0 / (PER_PERIOD * evaluation.band * step)))
        rows = np.flatnonzero(np.abs(place / every - np.rint(place / every)) < 0.25 * np.median(np.diff(place)) / every)
        return cls(rows, np.rint(place[rows]).astype(np.intp), every, step, evaluation.band)

    def inside(self, y: Array) -> Array:
        """A function of the motion below the band, at the samples, (n,)."""
        return low_pass(np.nan_to_num(y), 1.0 / self.step, self.band)[self.at]


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


def added_variable(
    evaluation: Evaluation, fit: Fit, effect: Effect, shape: Mapping[str, float], sizes: Sequence[float]
) -> AddedVariable | None:
    """Compare what a model leaves of the output with one effect that it lacks.

    Parameters
    ----------
    evaluation : of the model on a recording.
    fit : the model.
    effect, shape, sizes : what it lacks, with its shape parameters and the estimate of each coefficient.

    Returns
    -------
    None where the effect is no function of the motion, or the record too short.
    """
    motion, reference = evaluation.motion, evaluation.reference_noise
    if motion is None or reference is None or effect.port not in ("output", "position"):
        return None
    grid, scale = Grid.of(evaluation, fit), abs(fit.values().scale)
    # of a curve in its coarse form the leading coefficients are estimated
    column = effect.column(motion, **shape).reshape(len(motion.t), -1)[:, : len(sizes)] @ np.asarray(sizes)
    if effect.port == "position":
        inside = low_pass(column, 1.0 / grid.step, grid.band)
        column = -scale * motion.rig.polarity * np.gradient(np.gradient(inside, grid.step), grid.step)
    terms = [np.ones(len(motion.t)), motion.a, motion.jerk]
    terms += [term.column(motion) for term in fit.values().terms if term.effect.port == "output"]
    base = np.stack([grid.inside(term) for term in terms], axis=1)
    base /= np.maximum(np.linalg.norm(base, axis=0), np.finfo(float).tiny)
    both = np.stack([evaluation.accel_residual[1][grid.rows], grid.inside(column)], axis=1) / scale
    y, x = (both - base @ np.linalg.lstsq(base, both, rcond=NEGLIGIBLE)[0]).T
    density = partial(density_of, noise=fit.noise(), reference=reference, band=evaluation.band)
    (part,) = resolve(y[None], grid, np.stack(list(dictionary(motion, grid))), density, None)
    power, white = float(x @ x), float(density(np.zeros(1))[0]) / (2.0 * grid.every * grid.step)
    slope = float(x @ y) / power
    above = float(part.coordinates @ part.coordinates) - float(np.trace(part.covariance))
    place = np.argsort(np.argsort(x, kind="stable")) * PLACES // len(x)
    count = np.bincount(place, minlength=PLACES)
    middle, mean = (np.bincount(place, values, PLACES) / count for values in (x, y))
    explained = max(0.0, slope**2 * power - white) / above if above > 0.0 else 0.0
    return AddedVariable(middle, mean, np.sqrt(white / count), slope, math.sqrt(white / power), min(1.0, explained))


def resolve(
    errors: Array, grid: Grid, functions: Array, density: Callable[[Array], Array], sensor: SensorNoise | None
) -> tuple[Resolved, ...]:
    """Errors of several models in the directions that a record resolves.

    Parameters
    ----------
    errors : of the corrected output, (models, n) m/s².
    grid : of the samples.
    functions : of time and motion, below the band, (m, n).
    density : one-sided noise density of the errors at frequencies (k,) Hz, (k,) (m/s²)²/Hz, but for its level: that is
        what is measured in no direction.
    sensor : noise of the sensor where it is known otherwise, for the bound on what no direction resolves.
    """
    # the set-up, which stands beside, comes first; the differences of the models are the effects at hand
    columns = np.concatenate([np.ones((1, errors.shape[1])), functions, errors[1:] - errors[0]])
    size, n, step = len(columns), errors.shape[1], grid.every * grid.step
    gram, products, noise = columns @ columns.T, columns @ errors.T, np.zeros((size, size))
    for begin in range(0, n, BLOCK):
        rows = slice(begin, begin + BLOCK)
        at = (grid.at[rows] - grid.at[begin]) // grid.every
        padded = np.zeros((size, scipy.fft.next_fast_len(2 * (int(at[-1]) + 1), real=True)))
        padded[:, at] = columns[:, rows]
        power = density(scipy.fft.rfftfreq(padded.shape[1], step)) / (2.0 * step)
        coloured = scipy.fft.irfft(np.sqrt(power) * scipy.fft.rfft(padded), padded.shape[1])
        noise += coloured @ coloured.T
    centre = np.eye(size)
    centre[:, 0] -= gram[0] / gram[0, 0]
    centred = centre @ gram @ centre.T
    own, before = np.diag(centred), np.diag(gram)
    scale = np.where(own > NEGLIGIBLE * before, 1.0 / np.sqrt(np.where(own > 0.0, own, 1.0)), 0.0)
    scale[size - len(errors) + 1 :] = 0.0
    values, vectors = np.linalg.eigh(scale[:, None] * centred * scale)
    some = values > NEGLIGIBLE * values[-1]
    within = (vectors[:, some] / np.sqrt(values[some])).T * scale
    for model in range(size - len(errors) + 1, size):
        beyond = np.eye(size)[model] - centred[model] @ within.T @ within
        power_beyond = beyond @ centred @ beyond
        if power_beyond > APART * own[model]:
            within = np.concatenate([within, beyond[None] / np.sqrt(power_beyond)])
    directions = within @ centre
    coordinates, covariance = directions @ products, directions @ noise @ directions.T
    rest = np.sum(errors**2, axis=1) - products[0] ** 2 / gram[0, 0] - np.sum(coordinates**2, axis=0)
    # the mean over frequencies, the two at the ends counted once
    variance, square = (float(np.mean(np.r_[y, y[1:-1]])) for y in (power, power**2))
    expected = n * variance - noise[0, 0] / gram[0, 0] - float(np.trace(covariance))
    level = float(np.min(rest)) / expected
    beside, std = 0.0, math.sqrt(2.0 * n * square)
    if sensor is not None:
        low = density(np.zeros(1))[0]
        beside = expected * sensor.density**2 / low
        std = beside * math.hypot(std / expected, 2.0 * sensor.std / sensor.density)
    return tuple(
        Resolved(coordinates[:, k], level * covariance, float(rest[k]), beside, std, n) for k in range(len(errors))
    )


def dictionary(motion: Signals, grid: Grid) -> Iterator[Array]:
    """Functions of time and of the motion, (n,) each at the samples of a grid."""
    for y, _ in variables_of(motion).values():
        yield from map(grid.inside, hats(y, KNOTS))
    for y in (motion.t, motion.p, motion.v, *motion.side.values()):
        for hat in hats(y, COARSE):
            yield grid.inside(motion.a * hat)
            yield grid.inside(motion.v * hat)
    for effect in BUILT_IN:
        plain = effect.port == "output" and not effect.shapes and effect.width == 1 and is_local(effect)
        if plain and all(name in motion.side for name in effect.needs):
            yield grid.inside(effect.column(motion))


def hats(y: Array, knots: int) -> Iterator[Array]:
    """Piecewise linear functions of a variable (n,), one for each of some equidistant knots; none of a constant."""
    low, high = np.nanquantile(y, [0.001, 0.999]) if np.isfinite(y).any() else (0.0, 0.0)
    if high > low:
        place = np.clip((y - low) / (high - low), 0.0, 1.0) * (knots - 1)
        yield from (np.maximum(0.0, 1.0 - np.abs(place - knot)) for knot in range(knots))
