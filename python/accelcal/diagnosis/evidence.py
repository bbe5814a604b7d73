"""Evidence: what a verdict on a fitted model rests on, made once and handed to every check; the second engine."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cached_property
from types import MappingProxyType

import numpy as np
from scipy import special

from accelcal._support.process import within
from accelcal.data import Recording
from accelcal.diagnosis.clean_fit import CleanFit, run_noise_tests
from accelcal.diagnosis.faults import TimeSpan
from accelcal.diagnosis.findings import sizes_of
from accelcal.diagnosis.independent_estimate import differences
from accelcal.diagnosis.noise.noise_test import LINE, POSITION_WAVE, READING_OUTLIERS, STEPS, VIBRATION, NoiseTest
from accelcal.diagnosis.policy import FAMILYWISE_ALPHA, NOISE_TEST_ALPHA, VIBRATION_LINE_SHARE
from accelcal.diagnosis.runs import further_runs, values_by_run
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.diagnosis.search.scan import Scan, scan
from accelcal.effects import BUILT_IN, Effect, SizePrior, find, next_name, stem_of
from accelcal.estimation.estimate import Fit, judge, result
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, Solution, estimated
from accelcal.estimation.remarks import Remark
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, Term, evaluate, terms_of
from accelcal.validation.comparison import Evaluation
from accelcal.validation.evaluation import compare
from accelcal.validation.systematic import evaluated

DELAY_CLASS = tuple(effect.name for effect in BUILT_IN if effect.traits.delay_class)
FREEDOM_OF_BLOCK = 4
"""Independent numbers in a block of two periods: a sine and a cosine of each. They bound the scatter where blocks are
fewer."""
DELAY_EXPERIMENT = "a common trigger on both channels; motion at frequencies above 1/(10 tau), where lag and delay part"


def with_detected_effects(solution: Solution, profiled: Fit, scan: Scan) -> Fit:
    """The fit with all detected effects estimated jointly: what a missing effect leaves can pass for a delay.

    The solution is used up; the fit is returned as it was where the larger model cannot be estimated.
    """
    if not scan.detected:
        return profiled
    model = solution.model
    try:
        for finding in scan.detected:
            model = finding.enter(model)
        states = [state.grown(model) for state in solution.states]
        solution.states.clear()  # so that each step frees the track before it
        refined = estimated(model, states, least=ROUNDS_OF_GROWN)
        judge(refined.layout, refined.x, refined.covariance, states)
        estimates = refined.layout.estimates(refined.x, refined.covariance, model)
        return replace(profiled, model=model, estimates=estimates, covariance=refined.covariance, at_shapes=())
    except ValueError:
        return profiled


def delay_is_significant(fit: Fit, scan: Scan, alpha: float) -> bool:
    """Whether the time offset is significant beyond what was declared (the delay rule).

    It is judged for a low-pass exactly as declared: the tolerance of the low-pass is subtracted from the delay, so it
    must not be part of the standard deviation as well. Where the record is too short for a verdict, its few blocks
    determine the scatter of scores to as many degrees of freedom less one, at least the three of one block: Student's
    distribution replaces the normal one, so that a handful of blocks needs tens of standard deviations.
    """
    if scan.blocks < 1:
        return False
    tolerance = fit.rig.offset_tolerance + fit.rig.lowpass_tolerance
    chance = alpha / max(1, scan.examined) / 2.0
    freedom = max(scan.blocks, FREEDOM_OF_BLOCK) - 1
    required = -float(special.ndtri(chance) if scan.enough else special.stdtrit(freedom, chance))
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

    def alone(test: NoiseTest) -> bool:
        if test.effect in raised_by_others and not (test.effect == LINE and test.estimate > step):
            return False
        return test.effect != LINE or not any(
            abs(test.parts["frequency"] - vibration["frequency"]) < VIBRATION_LINE_SHARE * vibration["frequency"]
            or vibration["lowest"] < test.parts["frequency"] < vibration["highest"]
            for vibration in vibrations
        )

    return [test for test in significant if alone(test)]


def independent_tests(
    significant: Sequence[NoiseTest], effects: Sequence[str] = (), *, changing: bool = False
) -> tuple[NoiseTest, ...]:
    """Tests among `own_tests` that name their effect, beside effects that the search found.

    A line below thrice the band of the motion may be a harmonic of a missing nonlinearity, which the search finds: it
    counts only when no effect was found, nor one without one size (`changing`), and where the motion makes no lines. A
    line above that band where the motion makes lines counts under the same condition, and then no wave over position
    does: both are harmonics of the motion. Readings that an error of the encoder moves pass for outliers, and where
    none stands out, so does the scatter that any missing effect leaves: with one that was found in the model they are
    tested anew.
    """
    at_encoder = any(find(name).port == "position" for name in effects)
    harmonic = any(test.effect == LINE and test.parts.get("made_by_motion") for test in significant)

    def names(test: NoiseTest) -> bool:
        if test.effect != LINE:
            stands_out = bool(test.at) or test.parts.get("left_out", 0.0) > 0.0
            moved = test.effect == READING_OUTLIERS and (at_encoder or bool(effects and not stands_out))
            return not (moved or (test.effect == POSITION_WAVE and harmonic))
        within, by_motion = bool(test.parts.get("within_motion")), bool(test.parts.get("made_by_motion"))
        return not (within or by_motion) or (not (effects or changing) and within != by_motion)

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
    waves = largest_first(independent_tests(lacking) or lacking)
    return waves[0] if waves else None


class Evidence:
    """Basis of the verdict on one fitted model; the filters of the solution are used up.

    Parameters
    ----------
    cleaned : the fit without outliers, and the noise tests on it.
    stretch : usable part of the first recording, with its faults.
    extra : effects of the user's own; by default all that are registered.
    alpha : family-wise false-alarm rate.
    progress : called with the share of the work that is done, 0 to 1.
    midway : whether a search goes on; no verdict rests on what is coasted or on regions, and `where` is without.
    priors : of sizes by effect, as of `scan`.
    """

    def __init__(
        self,
        cleaned: CleanFit,
        stretch: TimeSpan,
        extra: Sequence[Effect] | None = None,
        alpha: float = FAMILYWISE_ALPHA,
        progress: Callable[[float], None] = lambda share: None,
        midway: bool = False,
        priors: Mapping[str, SizePrior] | None = MappingProxyType({}),
    ) -> None:
        solution = cleaned.solution
        states, model = solution.states, solution.model
        self.stretch, self.breaks, self.alpha, self.midway = stretch, stretch.breaks, alpha, midway
        self.model, self.fit = model, result(solution)
        self.sources, self.runs = cleaned.runs, tuple(state.run for state in states)
        """Runs as prepared before the fit, and as they were fitted."""
        self.signals = states[0].signals
        lines, searching = separate_lines(cleaned), within(progress, 0.0, 0.8)
        self.scan = scan(states, model, extra=extra, separate=lines, alpha=alpha, priors=priors, progress=searching)
        self.level = alpha / (self.scan.examined + len(cleaned.tests))
        """Probability by chance below which one noise test is significant."""
        significant = own_tests([test for test in cleaned.tests if test.p_value < self.level and not test.single])
        unexplained = [test for test in significant if not test.in_model(model, self.signals)]
        effects = [finding.effect for finding in self.scan.detected]
        named = independent_tests(unexplained, effects, changing=bool(self.scan.changing))
        self.tests = tuple(
            replace(test, effect=find(next_name(test.effect, model.effects)).name) if test.shape else test
            for test in largest_first(named)
        )
        """Significant noise tests that name their effect."""
        self.unnamed = tuple(test for test in unexplained if test not in named)
        self.largest = contributions(self.fit, solution)
        self.sizes = sizes_of(self.fit, states, [*self.scan.candidates, *self.scan.detected], self.tests)
        self.by_runs = solution.seen_by_runs if self.scan.enough and not self.scan.detected else ()
        """Effects that no single run shows, where nothing else is missing."""
        self.by_run = values_by_run(states, model, [choice.instead for choice in self.by_runs[:1]])
        self.further = further_runs(states, model)
        self.telling = [further_runs(states, model, [choice.instead], [choice.effect]) for choice in self.by_runs[:1]]
        delayed = "time_offset" not in model.fixed and delay_is_significant(self.fit, self.scan, alpha)
        self.delayed = delayed and delay_is_significant(
            with_detected_effects(solution, self.fit, self.scan), self.scan, alpha
        )
        self.differences = differences(solution)
        self.remarks: list[Remark] = []
        """Remarks of the checks so far, in their order."""
        states.clear()  # the comparison predicts anew: one set of filters at a time

    @property
    def recording(self) -> Recording:
        """The first recording, without its outliers."""
        return self.runs[0].recording

    @property
    def span(self) -> tuple[float, float]:
        """Begin and end of the part of it that is judged, s."""
        return self.stretch.start, self.stretch.end

    @cached_property
    def where(self) -> Evaluation:
        """The model against the first recording: its residual, and unless a search goes on where that is large."""
        if self.midway:
            return compare(self.fit, self.sources[0], horizons=(), start=self.span[0], end=self.span[1])
        return evaluated(self.fit, self.sources[0], *self.span)

    @property
    def forbidden(self) -> bool:
        """Whether a remark forbids to name an effect."""
        return any(note.forbids_names for note in self.remarks)

    @property
    def detected(self) -> tuple[DetectedEffect, ...]:
        """Effects that the search found and that may be named."""
        return () if self.forbidden else self.scan.detected


def noise_ratio(fit: Fit) -> float:
    """Fitted over declared noise density, the largest of all runs; 0 where none is declared."""
    return max((run.noise.ratio for run in fit.runs if run.noise.ratio is not None), default=0.0)


def contributions(fit: Fit, solution: Solution) -> dict[str, float]:
    """Largest contribution of each coefficient over all runs, m/s² (m at the encoder)."""
    maxima: dict[str, float] = {}
    for number, state in enumerate(solution.states):
        values = fit.values(number)
        for term, column in zip(values.terms, evaluate(values.terms, state.signals), strict=True):
            size = abs(values.by_name[term.name]) * float(np.max(np.abs(column)))
            maxima[term.name] = max(size, maxima.get(term.name, 0.0))
    return maxima
