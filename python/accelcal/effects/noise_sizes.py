"""Largest contribution of an effect that acts on noise, from what its noise test found."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from accelcal.signals.signals import Signals


def amplitude(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """The estimate itself, where that is an amplitude."""
    return estimate


def largest(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """The largest of the outliers."""
    return parts["largest"]


def half_a_step(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float | None:
    """Half the converter's step, by which rounding errs at most; None where no step was found."""
    return 0.5 * estimate if estimate > 0.0 else None


def jitter_at_top_jerk(estimate: float, parts: Mapping[str, float], signals: Sequence[Signals]) -> float:
    """Standard deviation of the time stamps, s, times the largest jerk of the output."""
    return estimate * max(s.scale * float(np.max(np.abs(s.jerk))) for s in signals)
