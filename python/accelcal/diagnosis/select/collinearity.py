"""Collinear effects of one variable replaced by its nonparametric curve, and effects too large to be plausible."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal.data import Recording
from accelcal.diagnosis.findings import Size, explained_gain
from accelcal.diagnosis.policy import (
    COLLINEAR_CORRELATION,
    DETERMINED_ALPHA,
    FAMILY_REMAINDER_ALPHA,
    PLAUSIBLE_ENCODER_SHARE,
)
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.search.scores import log_survival
from accelcal.effects import BUILT_IN, Effect, find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.rows import normal_equations
from accelcal.estimation.shape_parameters import inverse


@dataclass(frozen=True, slots=True)
class Replacement:
    """An effect that replaces collinear effects of a model."""

    effect: Effect
    replaced: tuple[str, ...]
    """Effects of the model that leave."""
    rivals: tuple[str, ...] = ()
    """Further effects that they may be."""

    @property
    def members(self) -> tuple[str, ...]:
        """Confounding class of the effect that enters."""
        return (self.effect.name, *self.rivals, *(name for name in self.replaced if name != self.effect.name))


def family_replacing(fit: Fit, entering: str, members: Sequence[str] = ()) -> Replacement | None:
    """Nonparametric curve of a variable, if the effect that entered last shows that effects of that variable are
    misnamed.

    Parameters
    ----------
    fit : with the effect that entered last.
    entering : its name.
    members : its confounding class.

    Returns
    -------
    The curve with the effects that it replaces; None where nothing shows that an effect is misnamed.
    """
    for family in BUILT_IN:
        replaced = [name for name in fit.model.effects if name in family.covers]
        if entering in replaced and family.name not in fit.model.effects:
            same_group = {name for group in family.groups if entering in group for name in group}
            replaced = [
                n
                for n in replaced
                if n == entering or n in same_group or estimate_correlation(fit, n, entering) > COLLINEAR_CORRELATION
            ]
            if len(replaced) > 1:
                return Replacement(family, tuple(replaced))
        elif entering == family.name and replaced:
            return Replacement(family, tuple(replaced))
        elif family.name in members and replaced and find(entering).port == "process":
            return Replacement(family, (*replaced, entering))
    return None


def family_replacing_sum(model: Sequence[str], remaining: Sequence[Candidate]) -> Replacement | None:
    """Nonparametric curve in place of several effects of its variable, if it still explains something next to their
    sum.

    Parameters
    ----------
    model : names of the effects that entered.
    remaining : what the model leaves unexplained.
    """
    for candidate in remaining:
        family = find(candidate.effect)
        replaced = tuple(name for name in model if name in family.covers)
        if len(replaced) > 1 and candidate.chance < FAMILY_REMAINDER_ALPHA:
            return Replacement(family, replaced)
    return None


def random_process_replacing(
    classes: Sequence[Sequence[str]], entering: str, members: Sequence[str] = ()
) -> Replacement | None:
    """Random process in place of two functions of time: a curve with which it was confounded and that proves
    incomplete, or two named effects with both of which it was confounded.

    Parameters
    ----------
    classes : confounding classes of the effects that entered before, each led by the effect itself.
    entering : the effect that entered last.
    members : its confounding class.
    """
    for name, *rivals in classes:
        random_processes = [r for r in rivals if find(r).port == "process" and (find(name).family or r in members)]
        if random_processes:
            replaced = (name, entering)
            confounded = (r for r in dict.fromkeys((*rivals, *members)) if r not in (random_processes[0], *replaced))
            return Replacement(find(random_processes[0]), replaced, tuple(confounded))
    return None


def log_significance(fit: Fit, name: str) -> float:
    """Log probability of the gain of an effect of a fitted model under the null, given all other effects."""
    return log_survival(*explained_gain(fit, name))


def estimate_correlation(fit: Fit, effect: str, other: str) -> float:
    """Largest correlation of a coefficient of one effect with one of another, the whole model estimated jointly."""
    owners = {term.name: term.effect.name for term in fit.model.terms}
    columns, theirs = ([k for k, e in enumerate(fit.free) if owners.get(e.name) == name] for name in (effect, other))
    std = np.sqrt(np.diag(fit.covariance))
    rho = fit.covariance[np.ix_(columns, theirs)] / np.outer(std[columns], std[theirs])
    return float(np.max(np.abs(rho), initial=0.0))


def confounding_families(name: str, gains: Mapping[str, float]) -> tuple[str, ...]:
    """Nonparametric curves of a model with which a named effect may be confounded, as their part or their remainder.

    A curve, or two effects that describe one curvature, say that a cause is outside the catalogue. Such a cause also
    shows in named effects that explain less than the curve.

    Parameters
    ----------
    name : the named effect.
    gains : twice the log-likelihood that each effect of the model explained when it entered, or explains given all
        others, whichever is less.
    """
    families = {other: gain for other, gain in gains.items() if find(other).family}
    for family in BUILT_IN:
        for group in family.groups:
            parts = [gains[part] for part in group if part in gains]
            if len(parts) > 1:
                families[family.name] = sum(parts)
    return tuple(other for other, gain in families.items() if gains.get(name, 0.0) < gain)


def sum_families(name: str, model: Sequence[str]) -> tuple[str, ...]:
    """Nonparametric curves that an effect and others of the model may sum up to.

    A sum of functions of one variable is a function of that variable.
    """
    return tuple(
        family.name
        for family in BUILT_IN
        if name in effects_of_variable(family, model) and len({*effects_of_variable(family, model), name}) > 1
    )


def effects_of_variable(family: Effect, model: Sequence[str]) -> tuple[str, ...]:
    """Effects of a model that are functions of a family's variable alone, the family included."""
    changed = {find(name).traits.changes for name in family.covers} - {""} if family.function_of == "t" else set()
    processes = {e.name for e in BUILT_IN if e.port == "process" and e.traits.changes in changed}
    return tuple(name for name in model if name == family.name or name in family.covers or name in processes)


def families_with_remainder(name: str, remaining: Sequence[Candidate]) -> tuple[str, ...]:
    """Nonparametric curves that still explain something next to a named effect of their variable."""
    return tuple(
        candidate.effect
        for candidate in remaining
        if name in find(candidate.effect).covers and candidate.chance < FAMILY_REMAINDER_ALPHA
    )


def implausible(name: str, size: Size | None, recordings: Sequence[Recording]) -> Remark | None:
    """Why an effect is no finding: a contribution beyond full scale, or beyond a tenth of the travel at the encoder.

    Parameters
    ----------
    name : the effect.
    size : its largest contribution over the used range; None where it has none.
    recordings : the fitted runs; full scale is the declared range, or the span of zero and the readings where none is.

    Returns
    -------
    The remark; None where the effect is plausible. A step of the encoder's zero and a lag are no error of its scale.
    """
    effect = find(name)
    if size is None:
        return None
    if size.at_encoder:
        of_scale = "instant" not in effect.shapes and "time_offset" not in effect.search.includes
        most = PLAUSIBLE_ENCODER_SHARE * max(float(np.ptp(recording.position.y)) for recording in recordings)
        limit, unit = f"{100.0 * PLAUSIBLE_ENCODER_SHARE:.0f} % of the travel", "m"
        possible = size.value <= most or not of_scale
    else:
        spans = [
            recording.rig.sensor.range or float(np.ptp(np.append(recording.accel.y, 0.0))) for recording in recordings
        ]
        declared = recordings[0].rig.sensor.range is not None
        most, unit = max(spans), "m/s²"
        limit = "declared range" if declared else "span of all readings and zero"
        possible = size.value <= most
    if possible:
        return None
    return remark("implausible", effect=name, size=size.value, unit=unit, limit=limit, most=most)


def undetermined(name: str, solution: Solution) -> Remark | None:
    """Why an effect has no size: what it explains beside all other parameters is no more than chance.

    Parameters
    ----------
    name : the effect.
    solution : fit of the model with it; shape parameters are held at their estimates.

    Returns
    -------
    The remark; None where its size is told from zero, or it has none of its own.
    """
    slots = [i for i, (term, _) in enumerate(solution.layout.slots) if term.effect.name == name]
    if not slots or find(name).port == "process":
        return None
    prior = solution.layout.prior_information(solution.model)
    information = np.diag(prior)
    for index, state in enumerate(solution.states):
        rows = solution.layout.rows(index)
        information[np.ix_(rows, rows)] += normal_equations(state, solution.model.free).gram
    x, covariance = solution.x[slots], inverse(information)[np.ix_(slots, slots)]
    given = prior[slots] if (mean := find(name).prior.mean) else np.zeros(len(slots))
    joint = inverse(covariance)
    by_record = joint @ x - given * mean  # information times size, without what the prior says of a size that has one
    gain = float(by_record @ inverse(joint - np.diag(given)) @ by_record)
    if scipy.special.chdtrc(len(slots), gain) < DETERMINED_ALPHA:
        return None
    return remark("undetermined", effect=name, gain=gain, coefficients=len(slots))


def unconfirmed(name: str, fit: Fit, examined: int, alpha: float) -> Remark | None:
    """Why an effect is no finding: what the fit with it gains is no longer significant over all that were examined.

    The search judges by rows that are linear at the model without the effect, the fit by its own uncertainty, with that
    of the shape parameters and with the scatter of the residual.
    """
    if find(name).prior.mean:
        return None
    gain, coefficients = explained_gain(fit, name)
    if coefficients == 0 or log_survival(gain, coefficients) < math.log(alpha / max(1, examined)):
        return None
    return remark("unconfirmed", effect=name, gain=gain, coefficients=coefficients, examined=examined)
