"""Detection thresholds: the distribution of an effect's gain against the gain that the search requires.

The gain of an effect with `dof` coefficients at a distance of d standard deviations from zero is noncentral chi-square
with noncentrality d² (derivations D3.5). The effect enters when its gain is significant over all alternatives and
exceeds its price.
"""

from __future__ import annotations

import math

from scipy import special

from accelcal.diagnosis.policy import DETECTION_PROBABILITY


def entry_gains(
    examined: int,
    blocks: int,
    alpha: float,
    *,
    dof: int = 1,
    comparisons: int = 1,
    share: float = 1.0,
    further: int = 0,
) -> tuple[float, float]:
    """Gain that is significant over all alternatives, and gain that equals its price; an effect needs both.

    Parameters
    ----------
    examined : number of alternatives.
    blocks : effective blocks of the record, which set the price of a coefficient.
    alpha : family-wise false-alarm rate.
    dof : coefficients of the effect.
    comparisons : alternatives among which the effect was selected before it was tried.
    share : of its gain that the effect may claim, below 1 for a nonparametric curve.
    further : shape parameters that cost as much as a coefficient.
    """
    tail = alpha / (max(1, examined) * comparisons)
    significant = 2.0 * float(special.gammainccinv(dof / 2.0, tail))
    price = (dof + further) * math.log(max(blocks, 2)) + 2.0 * math.log(max(examined, 2) * comparisons)
    return significant, price / share


def predicted_detection(
    d: float,
    examined: int,
    alpha: float,
    *,
    dof: int = 1,
    blocks: int = 2,
    comparisons: int = 1,
    share: float = 1.0,
) -> float:
    """Probability that an effect enters on its own, at a distance of `d` standard deviations from zero.

    The other parameters are those of :func:`entry_gains`.

    Examples
    --------
    >>> [round(predicted_detection(d, examined=96, alpha=0.005), 2) for d in (0.0, 3.0, 4.05, 10.0)]
    [0.0, 0.15, 0.5, 1.0]
    """
    required = max(entry_gains(examined, blocks, alpha, dof=dof, comparisons=comparisons, share=share))
    return 1.0 - float(special.chndtr(required, dof, d**2))


def least_distance(
    examined: int, blocks: int, alpha: float, *, dof: int = 1, comparisons: int = 1, share: float = 1.0
) -> float:
    """Distance from zero, in standard deviations, at which an effect enters on its own with probability
    `DETECTION_PROBABILITY`.

    Examples
    --------
    >>> d = least_distance(96, 240, 0.005)
    >>> round(predicted_detection(d, 96, 0.005, blocks=240), 6)
    0.95
    """
    return distance_for_gain(
        max(entry_gains(examined, blocks, alpha, dof=dof, comparisons=comparisons, share=share)), dof
    )


def distance_for_gain(gain: float, dof: int) -> float:
    """Distance from zero, in standard deviations, at which an effect of `dof` coefficients gains `gain` or more with
    probability `DETECTION_PROBABILITY`."""
    return math.sqrt(float(special.chndtrinc(gain, dof, 1.0 - DETECTION_PROBABILITY)))
