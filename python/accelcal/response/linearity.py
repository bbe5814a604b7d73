"""Amplitude linearity: harmonics give the quadratic and the cubic term, the mean gives rectification.

Behind f(a) = k a + K2 a² + K3 a³ with a = Re(A exp(i w t)) stand k A + 3/4 K3 A|A|² at w, K2 A²/2 at 2w, K3 A³/4
at 3w and K2|A|²/2 in the mean. Harmonics that the reference shows are motion and are subtracted; what follows the
sensor (a low-pass, a delay) passes them with its gain at their own frequency.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data import Array, Channel, usual_step
from accelcal.response.parametric import Parameter
from accelcal.response.sine import Point, Reference, SineFit, SineStep, fit_sines, student, within
from accelcal.signals.processing import NEARLY_NYQUIST, Spectrum

HARMONICS = (1, 2, 3)
"""Fitted in every step of one sine, as far as they are below the Nyquist frequency."""
NEIGHBOURS = 8
"""Lines on either side whose noise is that of the line."""
VISIBLE = 10.0
"""Amplitude of the reference over that of the noise beside it, below which a line is none."""


@dataclass(frozen=True, slots=True)
class Harmonics:
    """One step of one sine: amplitudes at 1, 2, 3 times its frequency, and the mean."""

    point: Point
    output: Spectrum
    """(h,) amplitudes of the output, m/s²."""
    acceleration: Spectrum
    """(h,) of the reference's acceleration, m/s²."""
    std: Array
    """(h,) standard uncertainty of the real and of the imaginary part of the output against the reference, m/s²."""
    mean: float
    """Of the output, m/s²."""


def measure_step(output: Channel, reference: Reference, step: SineStep) -> list[Harmonics]:
    """Sensitivity at each frequency of a step.

    Parameters
    ----------
    output : of the accelerometer.
    reference : what it is compared with.
    step : steady sines.

    Returns
    -------
    One for each sine that the reference shows; harmonics beside the first where the step has one sine.
    """
    rate = 1.0 / max(usual_step(output.t), usual_step(reference.channel.t))
    alone = len(step.frequencies) == 1
    multiples = HARMONICS if alone else HARMONICS[:1]
    lines = [h * f for f in step.frequencies for h in multiples if h * f < NEARLY_NYQUIST * rate]
    if not lines:
        return []
    parts = within(output, step.start, step.end), within(reference.channel, step.start, step.end)
    if min(map(len, parts)) <= 3 * (3 + 2 * len(lines)):
        return []
    fits = fit_sines(parts[0], lines, step.centre), fit_sines(parts[1], lines, step.centre)
    if alone:
        points = [_harmonics(fits, reference, step, lines, 0, len(lines))]
    else:
        points = [_harmonics(fits, reference, step, lines, i, 1) for i in range(len(lines))]
    return [point for point in points if point is not None]


def _harmonics(
    fits: tuple[SineFit, SineFit], reference: Reference, step: SineStep, lines: Sequence[float], at: int, count: int
) -> Harmonics | None:
    """The line `at` with those behind it, `count` in all; None where the reference does not show the first."""
    chosen = np.asarray(lines[at : at + count], dtype=np.float64)
    y = fits[0].amplitudes[at : at + count]
    a = reference.to_acceleration(chosen) * fits[1].amplitudes[at : at + count]
    value = complex(y[0] / a[0])
    length = step.end - step.start
    scatter, degrees = [], 0
    for i, f in enumerate(chosen):
        near = neighbours(float(f), length, lines)
        if not len(near):
            return None
        if i == 0:
            degrees = 2 * len(near)
            beside = float(np.sqrt(np.mean(np.abs(fits[1].lines(near)) ** 2)))
            if abs(fits[1].amplitudes[at]) < VISIBLE * beside:
                return None
        scatter.append(_noise(fits, reference, value, float(f), near))
    std = np.array(scatter)
    point = Point(
        frequency=float(chosen[0]),
        value=value,
        std=float(std[0] / abs(a[0])),
        degrees=degrees,
        acceleration=complex(a[0]),
        method="sine",
        start=step.start,
        end=step.end,
    )
    return Harmonics(point, y, a, std, fits[0].mean)


def neighbours(frequency: float, length: float, lines: Sequence[float]) -> Array:
    """Frequencies beside a line at multiples of 1/length that hold noise alone, Hz: no drift, no other line."""
    offsets = np.arange(1, 4 * NEIGHBOURS + 1)
    near = frequency + np.concatenate([np.stack([-offsets, offsets], axis=1)]).ravel() / length
    clear = near > 1.9 / length
    for line in lines:
        clear &= np.abs(near - line) > 0.99 / length
    return np.asarray(near[clear][: 2 * NEIGHBOURS])


def _noise(fits: tuple[SineFit, SineFit], reference: Reference, value: complex, frequency: float, near: Array) -> float:
    """Standard deviation of either part of (output - sensitivity times acceleration) at a line, m/s².

    What both channels share beside the line (an amplitude that is not quite steady) cancels. Noise of the reference is
    taken as level in the unit of its channel, that of the output as level in m/s².
    """
    output, moved = fits[0].lines(near), value * reference.to_acceleration(near) * fits[1].lines(near)
    of_output, of_reference = float(np.mean(np.abs(output) ** 2)), float(np.mean(np.abs(moved) ** 2))
    total = of_output + of_reference
    share = of_reference / total if total > 0.0 else 0.0
    level = (frequency / near) ** (reference.order * share)
    return math.sqrt(0.5 * float(np.mean(np.abs(level * (output - moved)) ** 2)))


@dataclass(frozen=True, slots=True)
class Term(Parameter):
    """One coefficient of the sensor's curve, K2 or K3, by one way of measuring it."""

    source: str
    """harmonic 2, harmonic 3, either also behind the fitted poles, rectification, or fundamental."""
    count: int
    """Steps that it was taken from."""


def linearity(
    steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum], sized: float, *, coupled: bool = True
) -> tuple[Term, ...]:
    """Coefficients from steps of one sine each.

    Parameters
    ----------
    steps : with their harmonics.
    gain : sensitivity (n,) at frequencies (n,) Hz, from a fit to the fundamentals.
    sized : its part that no frequency changes.
    coupled : whether a mean reaches the output; behind a high-pass it tells nothing.

    Returns
    -------
    K2 and K3 from the harmonics; K2 from the mean and K3 from the fundamental where amplitudes differ at a frequency.
    """
    remarks = [
        _of_harmonic(steps, gain, sized, 2, "K2", "(m/s²)⁻¹"),
        _of_harmonic(steps, gain, sized, 3, "K3", "(m/s²)⁻²"),
        _rectification(steps) if coupled else None,
        _compression(steps, gain, sized),
    ]
    return tuple(term for term in remarks if term is not None)


def _of_harmonic(
    steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum], sized: float, h: int, name: str, unit: str
) -> Term | None:
    """Weighted mean of 2^(h-1) (output - gain times acceleration) at h w over A^h: A as it reaches the element, or,
    where the steps agree much better, as it leaves the poles of the sensor, as of a capacitive read-out.
    """
    measured = [step for step in steps if len(step.output) >= h]
    f = np.array([step.point.frequency for step in measured])
    first, there = gain(f) / sized, gain(h * f)
    A = np.array([step.acceleration[0] for step in measured])
    produced = np.array([s.output[h - 1] - g * s.acceleration[h - 1] for s, g in zip(measured, there, strict=True)])
    std, degrees = np.array([step.std[h - 1] for step in measured]), sum(step.point.degrees for step in measured)
    candidates: list[tuple[float, Term | None]] = []
    for where, shape in (("", there / sized * A**h), (", behind the fitted poles", (first * A) ** h)):
        values, weights = np.real(produced * 2.0 ** (h - 1) / shape), np.abs(shape / std / 2.0 ** (h - 1)) ** 2
        misfit = float(np.sum(weights * (values - np.average(values, weights=weights)) ** 2)) if len(f) else 0.0
        candidates.append((misfit, _mean(name, f"harmonic {h}{where}", unit, list(values), list(weights), degrees)))
    return candidates[candidates[0][0] > candidates[1][0] + BEHIND][1]


BEHIND = 16.0
"""Least fall of chi-square by which a term is one behind the poles. The likelihood is then 3000 times as large. [1;
tests/response/test_response.py]"""


def _mean(name: str, source: str, unit: str, values: list[float], weights: list[float], degrees: float) -> Term | None:
    if not values or not np.all(np.isfinite(weights)) or sum(weights) == 0.0:
        return None
    value = float(np.average(values, weights=weights))
    std = 1.0 / math.sqrt(sum(weights))
    if len(values) > 1:
        excess = float(np.sum(np.array(weights) * (np.array(values) - value) ** 2)) / (len(values) - 1)
        if excess > 1.0:
            std, degrees = std * math.sqrt(excess), float(len(values) - 1)
    return Term(name, unit, value, std, student(max(degrees, 1.0)) * std, source, len(values))


def _rectification(steps: Sequence[Harmonics]) -> Term | None:
    """Slope of the mean against |A|²/2; its uncertainty from the scatter about the line."""
    x = np.array([0.5 * abs(s.acceleration[0]) ** 2 for s in steps])
    y = np.array([s.mean for s in steps])
    if len(x) < 4 or float(np.ptp(x)) < 0.3 * float(np.max(x)):
        return None
    columns = np.column_stack([np.ones(len(x)), x])
    coefficients, *_ = np.linalg.lstsq(columns, y, rcond=None)
    degrees = len(x) - 2
    variance = float(np.sum((y - columns @ coefficients) ** 2)) / degrees
    std = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[1, 1]))
    expanded = student(degrees) * std
    return Term("K2", "(m/s²)⁻¹", float(coefficients[1]), std, expanded, "rectification", len(x))


def _compression(steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum], sized: float) -> Term | None:
    """Growth of the sensitivity with 3/4 |A|², within steps of one frequency."""
    groups: dict[float, list[Harmonics]] = {}
    for step in steps:
        near = next((f for f in groups if abs(f - step.point.frequency) < 1e-3 * f), step.point.frequency)
        groups.setdefault(near, []).append(step)
    x: list[float] = []
    y: list[float] = []
    weights: list[float] = []
    degree, degrees = 0, 0.0
    for f, members in groups.items():
        if len(members) < 2:
            continue
        relative = complex(gain(np.array([f]))[0]) / sized
        size = np.array([0.75 * abs(s.acceleration[0]) ** 2 for s in members])
        part = np.array([float(np.real(s.point.value / relative)) for s in members])
        weight = np.array([(abs(relative) / s.point.std) ** 2 for s in members])
        x += list(size - np.average(size, weights=weight))
        y += list(part - np.average(part, weights=weight))
        weights += list(weight)
        degree += len(members)
        degrees += sum(s.point.degrees for s in members)
    w, xs, ys = np.array(weights), np.array(x), np.array(y)
    information = float(np.sum(w * xs**2)) if degree else 0.0
    if information <= 0.0:
        return None
    value, std = float(np.sum(w * xs * ys)) / information, 1.0 / math.sqrt(information)
    return Term("K3", "(m/s²)⁻²", value, std, student(degrees) * std, "fundamental", degree)
