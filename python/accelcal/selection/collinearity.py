"""Names that mend each other: two functions of one variable that look alike are one shape without a name."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.diagnosis.policy import COLLINEAR_CORRELATION, FAMILY_REMAINDER_ALPHA
from accelcal.diagnosis.search.likelihood_gain import log_survival
from accelcal.diagnosis.search.scan import Candidate
from accelcal.effects import HOUSE, Effect, find
from accelcal.estimation.estimate import Fit


@dataclass(frozen=True, slots=True)
class Replacement:
    """What may stand in the place of names that mend each other."""

    effect: Effect
    worn: tuple[str, ...]
    """Effects of the model that leave."""
    rivals: tuple[str, ...] = ()
    """What else they could be, beside themselves."""

    @property
    def members(self) -> tuple[str, ...]:
        """The class of the effect that stands there now."""
        return (self.effect.name, *self.rivals, *(name for name in self.worn if name != self.effect.name))


def family_replacing(fit: Fit, entering: str, members: Sequence[str] = ()) -> Replacement | None:
    """What a function of one variable is when the effect that came last shows that its name was wrong.

    Parameters
    ----------
    fit : with the effect that came last.
    entering : its name.
    members : what it cannot be told from.

    Returns
    -------
    The family without a name in the place of effects of the model; None where nothing says that a name is wrong.
    """
    for family in HOUSE:
        worn = [name for name in fit.model.effects if name in family.covers]
        if entering in worn and family.name not in fit.model.effects:
            same = {name for bend in family.groups if entering in bend for name in bend}
            worn = [
                n for n in worn if n == entering or n in same or correlated(fit, n, entering) > COLLINEAR_CORRELATION
            ]
            if len(worn) > 1:
                return Replacement(family, tuple(worn))
        elif entering == family.name and worn:
            return Replacement(family, tuple(worn))
        elif family.name in members and worn and find(entering).port == "process":
            return Replacement(family, (*worn, entering))
    return None


def family_replacing_sum(model: Sequence[str], left: Sequence[Candidate]) -> Replacement | None:
    """A shape without a name in the place of several functions of its variable whose sum is not the whole.

    Parameters
    ----------
    model : names that entered.
    left : what the model leaves over.
    """
    for one in left:
        family = find(one.effect)
        worn = tuple(name for name in model if name in family.covers)
        if len(worn) > 1 and one.chance < FAMILY_REMAINDER_ALPHA:
            return Replacement(family, worn)
    return None


def random_bias_replacing(
    classes: Sequence[Sequence[str]], entering: str, members: Sequence[str] = ()
) -> Replacement | None:
    """A bias that wanders, in the place of two courses of time: a shape that it could not be told from and that turns
    out not to be all, or two names of which it could be told from neither.

    Parameters
    ----------
    classes : of the effects that entered before, each led by the effect itself.
    entering : what came last.
    members : what it cannot be told from.
    """
    for name, *rivals in classes:
        courses = [r for r in rivals if find(r).port == "process" and (find(name).family or r in members)]
        if courses:
            worn = (name, entering)
            correlated = (r for r in dict.fromkeys((*rivals, *members)) if r not in (courses[0], *worn))
            return Replacement(find(courses[0]), worn, tuple(correlated))
    return None


def significance(fit: Fit, name: str) -> float:
    """Log of the probability that an effect of a fitted model is where it is by chance, beside all others."""
    return log_survival(*explained(fit, name))


def explained(fit: Fit, name: str) -> tuple[float, int]:
    """Twice the log-likelihood that an effect of a fitted model explains beside all others, and its freedom.

    What is believed of a coefficient before any record explains nothing.
    """
    owners = {term.name: term.effect.name for term in fit.model.terms}
    own = [k for k, e in enumerate(fit.free) if owners.get(e.name) == name]
    x = np.array([fit.free[k].value for k in own])
    information = np.linalg.inv(fit.covariance[np.ix_(own, own)])
    if find(name).search.prior:
        information -= np.diag([fit.model.priors[name].std ** -2 if name in fit.model.priors else 0.0])
    return max(0.0, float(x @ information @ x)), len(own)


def correlated(fit: Fit, one: str, other: str) -> float:
    """Largest correlation between a coefficient of one effect and one of another, beside all that is in the model."""
    owners = {term.name: term.effect.name for term in fit.model.terms}
    own, theirs = ([k for k, e in enumerate(fit.free) if owners.get(e.name) == name] for name in (one, other))
    std = np.sqrt(np.diag(fit.covariance))
    rho = fit.covariance[np.ix_(own, theirs)] / np.outer(std[own], std[theirs])
    return float(np.max(np.abs(rho), initial=0.0))


def confounding_families(name: str, told: Mapping[str, float]) -> tuple[str, ...]:
    """Shapes of a model that a named effect may be a part of, or the rest of.

    A shape without a name says that a cause is missing from the catalogue, and so do two names that describe one bend:
    what they are too coarse for, or no function of, poses as a name that explains less.

    Parameters
    ----------
    name : the named effect.
    told : twice the log-likelihood that each effect of the model explained when it entered, or explains beside all
        others, whichever is less.
    """
    shapes = {other: gain for other, gain in told.items() if find(other).family}
    for family in HOUSE:
        for bend in family.groups:
            parts = [told[one] for one in bend if one in told]
            if len(parts) > 1:
                shapes[family.name] = sum(parts)
    return tuple(other for other, gain in shapes.items() if told.get(name, 0.0) < gain)


def sum_families(name: str, model: Sequence[str]) -> tuple[str, ...]:
    """Shapes without a name that stand for an effect together with others that a model may hold: the sum of functions
    of one variable is a function of that variable."""
    return tuple(
        family.name
        for family in HOUSE
        if name in of_variable(family, model) and len({*of_variable(family, model), name}) > 1
    )


def of_variable(family: Effect, model: Sequence[str]) -> tuple[str, ...]:
    """Effects of a model that are functions of a family's variable alone, itself included."""
    course_of_time = {e.name for e in HOUSE if e.port == "process"} if family.function_of == "t" else set()
    return tuple(name for name in model if name == family.name or name in family.covers or name in course_of_time)


def not_the_whole(name: str, left: Sequence[Candidate]) -> tuple[str, ...]:
    """Shapes that explain something beside a named effect of their variable, among what a model leaves over."""
    return tuple(one.effect for one in left if name in find(one.effect).covers and one.chance < FAMILY_REMAINDER_ALPHA)
