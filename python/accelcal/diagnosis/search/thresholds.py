"""How far from nothing an effect must stand to be found: the law of its gain against what the search asks for.

The gain of an effect with `dof` coefficients that stands d standard deviations from nothing is noncentral chi-square
with noncentrality d² (derivations D3.5). It enters when that is significant over all alternatives, and worth its price.
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
    looks: int = 1,
    share: float = 1.0,
    further: int = 0,
) -> tuple[float, float]:
    """Gain that is significant over all alternatives, and gain that is worth its price; an effect needs both.

    Parameters
    ----------
    examined : alternatives that are looked at.
    blocks : effective blocks of the record, which set the price of a coefficient.
    alpha : family-wise false-alarm rate.
    dof : coefficients of the effect.
    looks : alternatives that the effect was picked from before it was tried.
    share : of its gain that the effect may claim, below 1 for a shape without a name.
    further : shape parameters that cost as much as a coefficient.
    """
    tail = alpha / (max(1, examined) * looks)
    significant = 2.0 * float(special.gammainccinv(dof / 2.0, tail))
    price = (dof + further) * math.log(max(blocks, 2)) + 2.0 * math.log(max(examined, 2) * looks)
    return significant, price / share


def predicted_detection(
    d: float,
    examined: int,
    alpha: float,
    *,
    dof: int = 1,
    blocks: int = 2,
    looks: int = 1,
    share: float = 1.0,
) -> float:
    """Probability that an effect enters on its own, when it stands `d` standard deviations from nothing.

    The other parameters are those of :func:`entry_gains`.

    Examples
    --------
    >>> [round(predicted_detection(d, examined=96, alpha=0.005), 2) for d in (0.0, 3.0, 4.05, 10.0)]
    [0.0, 0.15, 0.5, 1.0]
    """
    needed = max(entry_gains(examined, blocks, alpha, dof=dof, looks=looks, share=share))
    return 1.0 - float(special.chndtr(needed, dof, d**2))


def least_distance(
    examined: int, blocks: int, alpha: float, *, dof: int = 1, looks: int = 1, share: float = 1.0
) -> float:
    """Standard deviations at which an effect enters on its own with probability `DETECTION_PROBABILITY`.

    Examples
    --------
    >>> d = least_distance(96, 240, 0.005)
    >>> round(predicted_detection(d, 96, 0.005, blocks=240), 6)
    0.95
    """
    return surely_beyond(max(entry_gains(examined, blocks, alpha, dof=dof, looks=looks, share=share)), dof)


def surely_beyond(gain: float, dof: int) -> float:
    """Standard deviations at which an effect of `dof` coefficients gains `gain` or more with
    probability `DETECTION_PROBABILITY`."""
    return math.sqrt(float(special.chndtrinc(gain, dof, 1.0 - DETECTION_PROBABILITY)))
