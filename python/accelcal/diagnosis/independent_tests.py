"""Noise tests that report something of their own: which significant ones no other test explains."""

from __future__ import annotations

import math
from collections.abc import Sequence

from accelcal.diagnosis.noise_tests.noise_test import LINE, POSITION_WAVE, STEPS, VIBRATION, NoiseTest
from accelcal.diagnosis.noise_tests.run_all import run_noise_tests
from accelcal.diagnosis.outlier_rejection import CleanFit
from accelcal.diagnosis.policy import (
    NOISE_TEST_ALPHA,
    VIBRATION_LINE_SHARE,
)
from accelcal.effects import BUILT_IN, Effect, find, stem_of
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term, terms_of

ALSO_RAISED = {e.name: e.traits.noise.raises for e in BUILT_IN if e.traits.noise}
"""Tests that a coarse converter or outliers make significant besides their own."""


def separate_lines(cleaned: CleanFit) -> list[Term]:
    """Spectral lines that the motion does not make: noise tests report them, and no effect is credited for explaining
    them."""
    model, states = cleaned.solution.model, cleaned.solution.states
    fastest = 0.4 / max(state.signals.step for state in states)
    significant = [test for test in cleaned.tests if test.effect == LINE and test.p_value < NOISE_TEST_ALPHA]
    lines = [test.parts for test in significant if not test.in_model(model, states[0].signals)]
    return [
        term
        for parts in lines
        if not parts["made_by_motion"] and parts["frequency"] < fastest
        for term in terms_of(find(LINE), {"frequency": parts["frequency"]})
    ]


def own_tests(significant: Sequence[NoiseTest]) -> list[NoiseTest]:
    """Significant tests that no other of them raises.

    A line near a vibration, or in its band, belongs to it. No converter step makes a line larger than the step.
    """
    vibrations = [test.parts for test in significant if test.effect == VIBRATION and "frequency" in test.parts]
    raised_by_others = {
        other for test in significant if test.parts.get("coarse", 1.0) for other in ALSO_RAISED.get(test.effect, ())
    }
    step = max((test.parts["step"] for test in significant if test.effect == STEPS), default=math.inf)

    def own(test: NoiseTest) -> bool:
        if test.effect in raised_by_others and not (test.effect == LINE and test.estimate > step):
            return False
        return test.effect != LINE or not any(
            abs(test.parts["frequency"] - vibration["frequency"]) < VIBRATION_LINE_SHARE * vibration["frequency"]
            or vibration["lowest"] < test.parts["frequency"] < vibration["highest"]
            for vibration in vibrations
        )

    return [test for test in significant if own(test)]


def independent_tests(significant: Sequence[NoiseTest], *, no_effect_found: bool) -> tuple[NoiseTest, ...]:
    """Tests among `own_tests` that name their effect.

    A line below thrice the band of the motion may be a harmonic of a missing nonlinearity, which the search finds: it
    counts only with `no_effect_found`, when no effect of the motion was found, and where the motion makes no lines. A
    line above that band where the motion makes lines counts when no effect was found, and then no wave over position
    does: both are harmonics of the motion.
    """
    harmonic = any(test.effect == LINE and test.parts.get("made_by_motion") for test in significant)

    def names(test: NoiseTest) -> bool:
        if test.effect != LINE:
            return not (test.effect == POSITION_WAVE and harmonic)
        within, made = bool(test.parts.get("within_motion")), bool(test.parts.get("made_by_motion"))
        return not (within or made) or (no_effect_found and within != made)

    return tuple(test for test in significant if names(test))


def largest_first(tests: Sequence[NoiseTest]) -> list[NoiseTest]:
    """Tests in their order, but of several waves of one effect the largest comes first."""
    order = [test.effect for test in tests]
    return sorted(tests, key=lambda test: (order.index(test.effect), -test.estimate if test.shape else 0.0))


def largest_wave(effect: Effect, model: Model, states: Sequence[RunState]) -> NoiseTest | None:
    """The largest line or wave that noise tests find for an effect and a model lacks; None where there is none.

    Parameters
    ----------
    effect : one that is a wave; for any other no test is run.
    model, states : the model, and the runs that were fitted with it.
    """
    if not any(shape.width for shape in effect.shapes.values()):
        return None
    of_runs = [[test for test in run_noise_tests(state) if test.p_value < NOISE_TEST_ALPHA] for state in states]
    lacking = [
        test
        for tests, state in zip(of_runs, states, strict=True)
        for test in own_tests(tests)
        if test.effect == stem_of(effect) and not test.in_model(model, state.signals)
    ]
    found = largest_first(independent_tests(lacking, no_effect_found=True) or lacking)
    return found[0] if found else None
