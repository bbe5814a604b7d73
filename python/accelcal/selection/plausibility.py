"""Whether an effect that is to enter a model can be told from zero there, and is no larger than what it corrects."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np
import scipy

from accelcal.data import Recording
from accelcal.diagnosis.findings import Size, explained_gain
from accelcal.diagnosis.policy import DETERMINED_ALPHA, PLAUSIBLE_ENCODER_SHARE
from accelcal.diagnosis.search.scores import log_survival
from accelcal.effects import find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.rows import normal_equations
from accelcal.estimation.shape_parameters import inverse


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
        most = PLAUSIBLE_ENCODER_SHARE * max(float(np.ptp(each.position.y)) for each in recordings)
        limit, unit = f"{100.0 * PLAUSIBLE_ENCODER_SHARE:.0f} % of the travel", "m"
        possible = size.value <= most or not of_scale
    else:
        spans = [each.rig.sensor.range or float(np.ptp(np.append(each.accel.y, 0.0))) for each in recordings]
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
    own = [i for i, (term, _) in enumerate(solution.layout.slots) if term.effect.name == name]
    if not own or find(name).port == "process" or find(name).search.prior:
        return None
    information = np.diag(solution.layout.prior_information(solution.model))
    for index, state in enumerate(solution.states):
        rows = solution.layout.rows(index)
        information[np.ix_(rows, rows)] += normal_equations(state, solution.model.free).gram
    x, covariance = solution.x[own], inverse(information)[np.ix_(own, own)]
    gain = float(x @ inverse(covariance) @ x)
    if scipy.special.chdtrc(len(own), gain) < DETERMINED_ALPHA:
        return None
    return remark("undetermined", effect=name, gain=gain, coefficients=len(own))


def unconfirmed(name: str, fit: Fit, examined: int, alpha: float) -> Remark | None:
    """Why an effect is no finding: what the fit with it gains is no longer significant over all that were examined.

    The search judges by rows that are linear at the model without the effect, the fit by its own uncertainty, with that
    of the shape parameters and with the scatter of the residual.
    """
    if find(name).port == "process" or find(name).search.prior:
        return None
    gain, coefficients = explained_gain(fit, name)
    if coefficients == 0 or log_survival(gain, coefficients) < math.log(alpha / max(1, examined)):
        return None
    return remark("unconfirmed", effect=name, gain=gain, coefficients=coefficients, examined=examined)
