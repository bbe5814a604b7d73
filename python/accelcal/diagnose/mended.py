"""Names that mend each other: two functions of one variable that look alike are one shape without a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from accelcal.diagnose.scan import Candidate
from accelcal.effects import HOUSE, Effect, find
from accelcal.fit import Fit

ALIKE = 0.9
"""Correlation of two coefficients from which one does little but bend the other's function."""
REMAINDER = 0.15
"""Share of what a shape explains below which a later effect may be what the shape is too coarse for."""
BESIDE = 0.01
"""Chance below which a shape that explains something beside a name of its variable makes the name unsure."""


def shape_behind(fit: Fit, entering: str) -> tuple[Effect, tuple[str, ...]] | None:
    """What a function of one variable is when the effect that came last shows that its name was wrong.

    Parameters
    ----------
    fit : with the effect that came last.
    entering : its name.

    Returns
    -------
    The family without a name, and the named effects of the model in whose place it may stand; None where nothing
    says that a name is wrong.
    """
    for family in HOUSE:
        worn = [name for name in fit.model.effects if name in family.covers]
        if entering in worn and family.name not in fit.model.effects:
            same = {name for bend in family.bends if entering in bend for name in bend}
            worn = [n for n in worn if n == entering or n in same or alike(fit, n, entering) > ALIKE]
            if len(worn) > 1:
                return family, tuple(worn)
        if entering == family.name and worn:
            return family, tuple(worn)
    return None


def alike(fit: Fit, one: str, other: str) -> float:
    """Largest correlation between a coefficient of one effect and one of another, beside all that is in the model."""
    owners = {term.name: term.effect.name for term in fit.model.terms}
    own, theirs = ([k for k, e in enumerate(fit.free) if owners.get(e.name) == name] for name in (one, other))
    std = np.sqrt(np.diag(fit.covariance))
    rho = fit.covariance[np.ix_(own, theirs)] / np.outer(std[own], std[theirs])
    return float(np.max(np.abs(rho), initial=0.0))


def rest_of(entering: str, gain: float, shapes: Mapping[str, float]) -> tuple[str, ...]:
    """Shapes of the model that an effect may be the rest of: of their variable, or small beside what they explain.

    Parameters
    ----------
    entering : the effect that came after them.
    gain : twice the log-likelihood that it explains.
    shapes : the same for each shape without a name that the model holds.
    """
    return tuple(name for name, told in shapes.items() if entering in find(name).covers or gain < REMAINDER * told)


def not_the_whole(name: str, left: Sequence[Candidate]) -> tuple[str, ...]:
    """Shapes that explain something beside a named effect of their variable, among what a model leaves over."""
    return tuple(one.effect for one in left if name in find(one.effect).covers and one.p_raw < BESIDE)
