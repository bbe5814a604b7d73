"""Probability over several tests together."""

from __future__ import annotations

import math


def over_all(p: float, count: int) -> float:
    """Probability that the least of `count` independent probabilities is `p` or less (Sidak)."""
    return -math.expm1(count * math.log1p(-min(p, 1.0 - 1e-16)))
