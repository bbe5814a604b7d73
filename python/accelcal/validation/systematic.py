"""The systematic error of an accelerometer under a model: what is left of its corrected output that noise is not.

The residual at the accelerometer is projected on what a record resolves: functions of time and of the motion, effects
without memory, the differences of the models at hand. Equations: docs/derivations.md, "The systematic error".
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
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
from accelcal.validation.comparison import Evaluation, NoiseFloor, Resolved, SensorNoise
from accelcal.validation.evaluation import predicted_density, thinned
from accelcal.validation.noise_floor import Ruler
from accelcal.validation.regions import variables_of

KNOTS, COARSE = 8, 5
"""Knots of a function of one variable, and of the coefficient of acceleration or velocity as a function of one."""
BLOCK = 1 << 15
"""Samples that are projected together."""
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
    motion, reference = first.motion, first.reference_noise
    same = all(len(evaluation.accel_residual[0]) == len(first.accel_residual[0]) for evaluation in evaluations)
    if motion is None or reference is None or not same:
        return tuple(evaluations)
    t, scales = first.accel_residual[0], [abs(fit.values().scale) for fit in fits]
    step = float(np.min(np.diff(t)))
    rows = thinned(t, step, first.band)
    errors = np.array([e.accel_residual[1][rows] / scale for e, scale in zip(evaluations, scales, strict=True)])
    place = np.rint((t[rows] - t[rows[0]]) / step).astype(np.intp)
    every = max(1, int(np.gcd.reduce(place)))

    def density(f: Array, noise: Noise) -> Array:
        return predicted_density(f, noise, 1.0, reference, first.band)

    sensor = None if floor.sensor.is_limit else floor.sensor
    parts = resolve(errors, place // every, motion, step * every, partial(density, noise=ruler.noise), sensor)
    return tuple(replace(e, resolved=(part,)) for e, part in zip(evaluations, parts, strict=True))


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
    t, residual = evaluation.accel_residual
    step, band = float(np.min(np.diff(t))), evaluation.band
    rows = thinned(t, step, band)
    step, scale = float(np.min(np.diff(t[rows]))), abs(fit.values().scale)

    def inside(y: Array) -> Array:
        return low_pass(np.nan_to_num(y), 1.0 / step, band)

    # of a curve in its coarse form the leading coefficients are estimated
    column = effect.column(motion, **shape).reshape(len(rows), -1)[:, : len(sizes)] @ np.asarray(sizes)
    if effect.port == "position":
        column = -scale * motion.rig.polarity * np.gradient(np.gradient(column, step), step)
    terms = [np.ones(len(rows)), motion.a, motion.jerk]
    terms += [term.column(motion) for term in fit.values().terms if term.effect.port == "output"]
    base = np.stack([inside(term) for term in terms], axis=1)
    base /= np.maximum(np.linalg.norm(base, axis=0), np.finfo(float).tiny)
    both = np.stack([residual[rows] / scale, inside(column) / scale], axis=1)
    y, x = (both - base @ np.linalg.lstsq(base, both, rcond=NEGLIGIBLE)[0]).T
    density = partial(predicted_density, noise=fit.noise(), scale=1.0, reference=reference, band=band)
    (part,) = resolve(y[None], np.rint((t[rows] - t[0]) / step).astype(np.intp), motion, step, density, None)
    power, white = float(x @ x), float(density(np.zeros(1))[0]) / (2.0 * step)
    slope = float(x @ y) / power
    above = float(part.coordinates @ part.coordinates) - float(np.trace(part.covariance))
    place = np.argsort(np.argsort(x, kind="stable")) * PLACES // len(x)
    count = np.bincount(place, minlength=PLACES)
    middle, mean = (np.bincount(place, values, PLACES) / count for values in (x, y))
    explained = max(0.0, slope**2 * power - white) / above if above > 0.0 else 0.0
    return AddedVariable(middle, mean, np.sqrt(white / count), slope, math.sqrt(white / power), min(1.0, explained))


def resolve(
    errors: Array,
    place: NDArray[np.intp],
    motion: Signals,
    step: float,
    density: Callable[[Array], Array],
    sensor: SensorNoise | None,
) -> tuple[Resolved, ...]:
    """Errors of several models in the directions that a record resolves.

    Parameters
    ----------
    errors : of the corrected output, (models, n) m/s².
    place : of each sample on a uniform grid, rising, (n,).
    motion : at the samples.
    step : of the grid, s.
    density : one-sided noise density of the errors at frequencies (k,) Hz, (k,) (m/s²)²/Hz, but for its level: that is
        what is measured in no direction.
    sensor : noise of the sensor where it is known otherwise, for the bound on what no direction resolves.
    """
    columns_at, n = dictionary(motion), errors.shape[1]
    size = 1 + len(columns_at(slice(0, 1))) + len(errors) - 1
    gram, noise, products = np.zeros((size, size)), np.zeros((size, size)), np.zeros((size, len(errors)))
    for begin in range(0, n, BLOCK):
        rows = slice(begin, min(n, begin + BLOCK))
        # the set-up, which stands beside, comes first; the differences of the models are the effects at hand
        columns = np.concatenate(
            [np.ones((1, rows.stop - begin)), columns_at(rows), errors[1:, rows] - errors[0, rows]]
        )
        at = place[rows] - place[begin]
        padded = np.zeros((size, scipy.fft.next_fast_len(2 * (int(at[-1]) + 1), real=True)))
        padded[:, at] = columns
        power = density(scipy.fft.rfftfreq(padded.shape[1], step)) / (2.0 * step)
        coloured = scipy.fft.irfft(np.sqrt(power) * scipy.fft.rfft(padded), padded.shape[1])
        gram += columns @ columns.T
        noise += coloured @ coloured.T
        products += columns @ errors[:, rows].T
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


def dictionary(motion: Signals) -> Callable[[slice], Array]:
    """Functions of time and of the motion at a stretch of samples, (m, n)."""
    variables = [y for name, (y, _) in variables_of(motion).items() if name != "time"]
    spans = [(y, *np.nanquantile(y, [0.001, 0.999])) for y in variables if np.isfinite(y).any()]
    single = [(y, low, high, KNOTS) for y, low, high in spans if high > low]
    single.append((motion.t, motion.t[0], motion.t[-1], KNOTS))
    carried = [motion.t, motion.p, motion.v, *motion.side.values()]
    effects = [
        effect
        for effect in BUILT_IN
        if effect.port == "output" and not effect.shapes and effect.width == 1 and is_local(effect)
        if all(name in motion.side for name in effect.needs)
    ]

    def columns(rows: slice) -> Array:
        every = [hats(y[rows], low, high, knots) for y, low, high, knots in single]
        for y in carried:
            low, high = np.nanquantile(y, [0.001, 0.999])
            if high > low:
                functions = hats(y[rows], low, high, COARSE)
                every += [motion.a[rows] * functions, motion.v[rows] * functions]
        stretch = motion.part(rows)
        every += [effect.column(stretch)[None] for effect in effects]
        return np.nan_to_num(np.concatenate(every))

    return columns


def hats(y: Array, low: float, high: float, knots: int) -> Array:
    """Piecewise linear functions of a variable (n,), one for each of several equidistant knots, (knots, n)."""
    place = np.clip((y - low) / (high - low), 0.0, 1.0) * (knots - 1)
    return np.maximum(0.0, 1.0 - np.abs(place - np.arange(knots)[:, None]))
