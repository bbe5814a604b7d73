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
import scipy

from accelcal.data.arrays import Array
from accelcal.response.points import COVERAGE
from accelcal.response.sine_points import Harmonics
from accelcal.signals.transfer import Spectrum


@dataclass(frozen=True, slots=True)
class Term:
    """One coefficient of the sensor's curve, by one way of measuring it."""

    name: str
    """K2 or K3."""
    source: str
    """harmonic 2, harmonic 3, rectification, or fundamental."""
    unit: str
    value: float
    std: float
    expanded: float
    """k = 2"""
    count: int
    """Steps that it was taken from."""


def linearity(steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum]) -> tuple[Term, ...]:
    """Coefficients from steps of one sine each.

    Parameters
    ----------
    steps : with their harmonics.
    gain : sensitivity (n,) at frequencies (n,) Hz, from a fit to the fundamentals.

    Returns
    -------
    K2 and K3 from the harmonics; K2 from the mean and K3 from the fundamental where amplitudes differ at a frequency.
    """
    sized = float(np.real(gain(np.array([1e-3]))[0]))
    found = [
        _of_harmonic(steps, gain, sized, 2, "K2", "(m/s²)⁻¹"),
        _of_harmonic(steps, gain, sized, 3, "K3", "(m/s²)⁻²"),
    ]
    found += [_rectification(steps), _compression(steps, gain, sized)]
    return tuple(term for term in found if term is not None)


def _of_harmonic(
    steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum], sized: float, h: int, name: str, unit: str
) -> Term | None:
    """Weighted mean of 2^(h-1) (output - gain times acceleration) at h w over A^h."""
    values, weights, degrees = [], [], 0.0
    for step in steps:
        if len(step.output) < h:
            continue
        there = complex(gain(np.array([h * step.point.frequency]))[0])
        produced = step.output[h - 1] - there * step.acceleration[h - 1]
        unit_response = there / sized * step.acceleration[0] ** h / 2.0 ** (h - 1)
        values.append(float(np.real(produced / unit_response)))
        weights.append(float(abs(unit_response) / step.std[h - 1]) ** 2)
        degrees += step.point.degrees
    return _mean(name, f"harmonic {h}", unit, values, weights, degrees)


def _mean(name: str, source: str, unit: str, values: list[float], weights: list[float], degrees: float) -> Term | None:
    if not values or not np.all(np.isfinite(weights)) or sum(weights) == 0.0:
        return None
    value = float(np.average(values, weights=weights))
    std = 1.0 / math.sqrt(sum(weights))
    if len(values) > 1:
        excess = float(np.sum(np.array(weights) * (np.array(values) - value) ** 2)) / (len(values) - 1)
        if excess > 1.0:
            std, degrees = std * math.sqrt(excess), float(len(values) - 1)
    factor = float(scipy.special.stdtrit(max(degrees, 1.0), 0.5 + 0.5 * COVERAGE))
    return Term(name, source, unit, value, std, factor * std, len(values))


def _rectification(steps: Sequence[Harmonics]) -> Term | None:
    """Slope of the mean against |A|²/2; its uncertainty from the scatter about the line."""
    x = np.array([0.5 * abs(s.acceleration[0]) ** 2 for s in steps])
    y = np.array([s.mean for s in steps])
    return _line("K2", "rectification", "(m/s²)⁻¹", x, y)


def _compression(steps: Sequence[Harmonics], gain: Callable[[Array], Spectrum], sized: float) -> Term | None:
    """Growth of the sensitivity with 3/4 |A|², within steps of one frequency."""
    groups: dict[float, list[Harmonics]] = {}
    for step in steps:
        near = next((f for f in groups if abs(f - step.point.frequency) < 1e-3 * f), step.point.frequency)
        groups.setdefault(near, []).append(step)
    x: list[float] = []
    y: list[float] = []
    weights: list[float] = []
    kept, degrees = 0, 0.0
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
        kept += len(members)
        degrees += sum(s.point.degrees for s in members)
    w, xs, ys = np.array(weights), np.array(x), np.array(y)
    information = float(np.sum(w * xs**2)) if kept else 0.0
    if information <= 0.0:
        return None
    value, std = float(np.sum(w * xs * ys)) / information, 1.0 / math.sqrt(information)
    factor = float(scipy.special.stdtrit(degrees, 0.5 + 0.5 * COVERAGE))
    return Term("K3", "fundamental", "(m/s²)⁻²", value, std, factor * std, kept)


def _line(name: str, source: str, unit: str, x: Array, y: Array) -> Term | None:
    if len(x) < 4 or float(np.ptp(x)) < 0.3 * float(np.max(x)):
        return None
    columns = np.column_stack([np.ones(len(x)), x])
    found, *_ = np.linalg.lstsq(columns, y, rcond=None)
    degrees = len(x) - 2
    variance = float(np.sum((y - columns @ found) ** 2)) / degrees
    std = math.sqrt(variance * float(np.linalg.inv(columns.T @ columns)[1, 1]))
    factor = float(scipy.special.stdtrit(degrees, 0.5 + 0.5 * COVERAGE))
    return Term(name, source, unit, float(found[1]), std, factor * std, len(x))
