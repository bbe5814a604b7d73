"""Diagnosis of static dwells: effects of the sensor at constant arguments, and the scatter that is left."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import immutable
from accelcal.data import Dwells
from accelcal.diagnosis.findings import with_next_step
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA
from accelcal.diagnosis.search.confounding import credible_set
from accelcal.effects import BUILT_IN, Effect, find, is_local, users_own
from accelcal.estimation.dwell_fit import DwellFit, solve_dwells
from accelcal.estimation.dwell_rows import acts_at_rest, dwell_rows, remainder, shown
from accelcal.estimation.estimate import Fit
from accelcal.estimation.remarks import Remark
from accelcal.estimation.run_to_run import over_all
from accelcal.estimation.triad import LEFT
from accelcal.model import Model, terms_of


@dataclass(frozen=True, slots=True)
class DwellCandidate:
    """Effect of the sensor with what it explains beside the model."""

    effect: str
    unit: str
    estimate: float
    std: float
    sigma: float
    """Equivalent standard deviations."""
    p_value: float
    """Of all candidates together."""


@immutable
@dataclass(frozen=True, slots=True)
class DwellDiagnosis(Result):
    """Answer to what a model lacks on dwells."""

    verdict: str
    """adequate, named, tied or unexplained."""
    sentence: str
    candidates: tuple[DwellCandidate, ...]
    """The most significant first."""
    members: tuple[str, ...]
    """Effects that explain what is missing about as well as the first."""
    fit: DwellFit
    remarks: tuple[Remark, ...]

    def __repr__(self) -> str:
        return f"DwellDiagnosis({self.verdict}: {self.sentence})"


@checked
def diagnose_dwells(fit: Fit, dwells: Dwells, *, alpha: float = FAMILYWISE_ALPHA) -> DwellDiagnosis:
    """Say which effect a model lacks on dwells, all its coefficients estimated on them.

    Parameters
    ----------
    fit : its model is used.
    dwells : means at known attitudes.
    alpha : family-wise false-alarm rate.

    Notes
    -----
    Each candidate is one column beside the model and the angle zeros. Where what is declared explains the scatter, its
    gain is chi-square; where it does not, the scatter is unknown and the gain an F ratio with what the candidate
    leaves.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> angle = np.arange(8) * np.pi / 4.0
    >>> mean = 9.80665 * np.sin(angle) + 0.05
    >>> many = np.ones(8)
    >>> dwells = ac.Dwells(angle, mean, 1e-3 * many, 60.0 * many, 6000.0 * many, ("0",) * 8, ac.Rig())
    >>> fit = ac.fit(dwells)
    >>> ac.diagnose(fit, dwells).verdict
    'adequate'
    """
    solution = solve_dwells(fit.model, dwells, fit.origins)
    model, result = solution.model, solution.fit
    rows = dwell_rows(dwells, model.free, solution.values, fit.origins, solution.nuisances)
    squares, freedom = remainder(rows)
    names = {term.name for term in model.terms}
    able = [
        effect
        for effect in (*BUILT_IN, *users_own())
        if effect.name not in names and tests(effect) and shown(dwells, effect)
    ]
    terms = [term for effect in able for term in terms_of(effect)]
    extra = dwell_rows(dwells, terms, solution.values, fit.origins, solution.nuisances).columns
    basis = scipy.linalg.orth(rows.columns / np.maximum(np.linalg.norm(rows.columns, axis=0), 1e-300))
    left = rows.y - basis @ (basis.T @ rows.y)
    exact = result.scatter == 0.0
    detected: list[tuple[float, float, float, int]] = []
    for k in range(len(terms)):
        column = extra[:, k]
        beyond = column - basis @ (basis.T @ column)
        power = float(beyond @ beyond)
        if freedom < 2 or power <= LEFT * float(column @ column):
            continue
        gain = float(beyond @ left) ** 2 / power
        left_each = 1.0 if exact else max(squares - gain, 1e-300) / (freedom - 1)
        p = scipy.special.chdtrc(1, gain) if exact else scipy.special.fdtrc(1, freedom - 1, gain / left_each)
        detected.append((float(p), float(beyond @ left) / power, math.sqrt(left_each / power), k))
    count = max(len(detected), 1)
    candidates = tuple(
        DwellCandidate(
            terms[k].name,
            terms[k].unit,
            estimate,
            std,
            float(-scipy.special.ndtri(max(0.5 * p, 1e-300))),
            over_all(p, count),
        )
        for p, estimate, std, k in sorted(detected)
    )
    return judged(candidates, result, dwells, alpha)


def tests(effect: Effect) -> bool:
    """Whether an effect can be a candidate on dwells: it acts at rest, at once, with one size and no shape."""
    return (
        acts_at_rest(effect)
        and is_local(effect)
        and effect.width == 1
        and all(shape.usual is not None for shape in effect.shapes.values())
    )


def entered(model: Model, names: Sequence[str]) -> Model:
    """The model with further effects that dwells can show, their shapes the usual ones.

    Raises
    ------
    AccelcalError
        Naming the first that they cannot.
    """
    effects = [find(name) for name in names]
    for effect in effects:
        if not tests(effect):
            raise AccelcalError(
                f"{effect.name!r} cannot be added: dwells show what acts at rest, at once and with one size; fit "
                "it to a recording of a motion, the dwells beside it"
            )
    usual = {e.name: {name: float(shape.usual or 0.0) for name, shape in e.shapes.items()} for e in effects if e.shapes}
    return model.add(*(effect.name for effect in effects), shapes=usual)


def judged(candidates: tuple[DwellCandidate, ...], result: DwellFit, dwells: Dwells, alpha: float) -> DwellDiagnosis:
    """The verdict on what candidates explain and what is left."""
    best = candidates[0] if candidates and candidates[0].p_value < alpha else None
    members: tuple[str, ...] = ()
    declared = dwells.rig.sensor.bias_instability is not None or dwells.rig.sensor.random_walk is not None
    if any(note.forbids_names for note in result.remarks):
        verdict, sentence = "unexplained", "No effect is named: the scale factor is that of no working sensor."
    elif best is not None:
        members = tuple(credible_set({candidate.effect: candidate.sigma**2 / 2.0 for candidate in candidates}))
        verdict = "named" if len(members) == 1 else "tied"
        sentence = f"{best.effect} is missing ({best.sigma:.1f} sigma; {len(candidates)} candidates examined)."
        if len(members) > 1:
            sentence += (
                f" It is confounded with {', '.join(members[1:])} on these dwells; more elevations separate them."
            )
    elif declared and result.p_value < alpha:
        verdict = "unexplained"
        sentence = with_next_step(
            f"The dwells scatter by {result.scatter:.2g} m/s² more than noise, instability and angles explain, and "
            f"none of {len(candidates)} candidates explains it.",
            ["dwells"],
        )
    else:
        verdict = "adequate"
        largest = f", the largest at {candidates[0].sigma:.1f} sigma" if candidates else ""
        sentence = f"Nothing is missing ({len(candidates)} candidates examined{largest})."
    return DwellDiagnosis(verdict, sentence, candidates, members, result, result.remarks)
