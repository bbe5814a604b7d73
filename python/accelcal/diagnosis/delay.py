"""The delay rule: whether the time offset is significant beyond what was declared."""

from __future__ import annotations

import math
from dataclasses import replace

from scipy import special

from accelcal.diagnosis.search.scan import Scan
from accelcal.effects import BUILT_IN
from accelcal.estimation.estimate import Fit, judge
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, Solution, estimated

DELAY_CLASS = tuple(effect.name for effect in BUILT_IN if effect.traits.delay_class)
FREEDOM_OF_BLOCK = 4
"""Independent numbers in a block of two periods: a sine and a cosine of each. They bound the scatter where blocks are
fewer."""
DELAY_EXPERIMENT = "a common trigger on both channels; motion at frequencies above 1/(10 tau), where lag and delay part"


def with_detected_effects(solution: Solution, profiled: Fit, found: Scan) -> Fit:
    """The fit with all detected effects estimated jointly: what a missing effect leaves can pass for a delay.

    The solution is used up; the fit is returned as it was where the larger model cannot be estimated.
    """
    if not found.found:
        return profiled
    model = solution.model
    try:
        for finding in found.found:
            model = finding.enter(model)
        states = [state.grown(model) for state in solution.states]
        solution.states.clear()  # so that each step frees the track before it
        refined = estimated(model, states, least=ROUNDS_OF_GROWN)
        judge(refined.layout, refined.x, refined.covariance, states)
        estimates = refined.layout.estimates(refined.x, refined.covariance, model)
        return replace(profiled, model=model, estimates=estimates, covariance=refined.covariance)
    except ValueError:
        return profiled


def delay_is_significant(fit: Fit, found: Scan, alpha: float) -> bool:
    """Whether the time offset is significant beyond what was declared (the delay rule).

    It is judged for a low-pass exactly as declared: the tolerance of the low-pass is subtracted from the delay, so it
    must not be part of the standard deviation as well. Where the record is too short for a verdict, its few blocks
    determine the scatter of scores to as many degrees of freedom less one, at least the three of one block: Student's
    distribution replaces the normal one, so that a handful of blocks needs tens of standard deviations.
    """
    if found.blocks < 1:
        return False
    tolerance = fit.rig.offset_tolerance + fit.rig.lowpass_tolerance
    chance = alpha / max(1, found.examined) / 2.0
    freedom = max(found.blocks, FREEDOM_OF_BLOCK) - 1
    required = -float(special.ndtri(chance) if found.enough else special.stdtrit(freedom, chance))
    names = [e.name for e in fit.free]
    lowpass = names.index("lowpass_error") if "lowpass_error" in names else None
    for i in (i for i, name in enumerate(names) if name == "time_offset"):
        delay, variance = fit.free[i].value, float(fit.covariance[i, i])
        if lowpass is not None:
            slope = float(fit.covariance[i, lowpass]) / float(fit.covariance[lowpass, lowpass])
            delay -= slope * fit.free[lowpass].value
            variance -= slope * float(fit.covariance[i, lowpass])
        if variance > 0.0 and abs(delay) - tolerance > required * math.sqrt(variance):
            return True
    return False
