"""Noise tests that report something of their own: which significant ones no other test explains."""

from __future__ import annotations

import math
from collections.abc import Sequence

from accelcal.diagnosis.noise_tests.noise_test import LINE, POSITION_WAVE, STEPS, VIBRATION, NoiseTest
from accelcal.diagnosis.outlier_rejection import CleanFit
from accelcal.diagnosis.policy import (
    NOISE_TEST_ALPHA,
    VIBRATION_LINE_SHARE,
)
from accelcal.effects import BUILT_IN, find
from accelcal.model import Term, terms_of

ALSO_RAISED = {e.name: e.traits.noise.raises for e in BUILT_IN if e.traits.noise}
"""Tests that a coarse converter or outliers make significant besides their own."""


def separate_lines(cleaned: CleanFit) -> list[Term]:
    """Spectral lines that the motion does not make: noise tests report them, and no effect is credited for explaining
    them."""
    if LINE in cleaned.solution.model.effects:
        return []
    fastest = 0.4 / max(state.signals.step for state in cleaned.solution.states)
    lines = [test.parts for test in cleaned.tests if test.effect == LINE and test.p_value < NOISE_TEST_ALPHA]
    return [
        term
        for parts in lines
        if not parts["made_by_motion"] and parts["frequency"] < fastest
        for term in terms_of(find(LINE), {"frequency": parts["frequency"]})
    ]


def independent_tests(significant: Sequence[NoiseTest], *, no_effect_found: bool) -> tuple[NoiseTest, ...]:
    """Significant tests that no other test explains.

    A line near a vibration, or in its band, belongs to it. A line inside the band of the motion may be a harmonic of a
    missing nonlinearity, which the search finds: it counts only with `no_effect_found`, when no effect of the motion
    was found, and where the motion makes no lines. A line above that band where the motion makes lines counts when no
    effect was found, and then no wave over position does: both are harmonics of the motion. No converter step makes a
    line larger than the step.
    """
    vibrations = [test.parts for test in significant if test.effect == VIBRATION and "frequency" in test.parts]
    raised_by_others = {
        other for test in significant if test.parts.get("coarse", 1.0) for other in ALSO_RAISED.get(test.effect, ())
    }
    step = max((test.parts["step"] for test in significant if test.effect == STEPS), default=math.inf)

    harmonic = any(test.effect == LINE and test.parts.get("made_by_motion") for test in significant)

    def own(test: NoiseTest) -> bool:
        if test.effect == POSITION_WAVE and harmonic:
            return False
        if test.effect in raised_by_others and not (test.effect == LINE and test.estimate > step):
            return False
        if test.effect != LINE:
            return True
        f = test.parts["frequency"]
        in_vibration = any(
            abs(f - vibration["frequency"]) < VIBRATION_LINE_SHARE * vibration["frequency"]
            or vibration["lowest"] < f < vibration["highest"]
            for vibration in vibrations
        )
        free = not (test.parts.get("within_motion") or test.parts.get("made_by_motion"))
        one_cause = bool(test.parts.get("within_motion")) != bool(test.parts.get("made_by_motion"))
        return (free or (no_effect_found and one_cause)) and not in_vibration

    return tuple(test for test in significant if own(test))
