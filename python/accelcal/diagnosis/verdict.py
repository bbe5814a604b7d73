"""The verdict on a model that was fitted: what it lacks, with what that cannot be told from, and where it fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy import special

from accelcal._support.notebook_repr import notebook_repr
from accelcal.data.recording import Recording
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.contribution import Importance, Size, sizes_of, split
from accelcal.diagnosis.faults import faults
from accelcal.diagnosis.noise_tests.noise_test import ALARM, NoiseTest
from accelcal.diagnosis.outlier_rejection import CleanFit, RejectedReadings
from accelcal.diagnosis.search.confounding import THIN
from accelcal.diagnosis.search.scan import ALPHA, LEAST_BLOCKS, Scan, Verdict, scan
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit, judge, result
from accelcal.estimation.gauss_newton import ROUNDS_OF_GROWN, Solution, estimated
from accelcal.estimation.run import prepare
from accelcal.model import Model, Term, evaluate, terms_of
from accelcal.validation.comparison import Comparison
from accelcal.validation.evaluation import compare

NOISE_LIMIT = 1.5
"""A fit whose noise density exceeds the declared one by more than this is never adequate."""
GROUPS = (
    (
        ("bias", "tilt", "misalignment"),
        "turn the sensor by 180 degrees about the vertical axis and fit both runs together; roll it for misalignment",
    ),
    (
        ("scale_factor", "encoder_scale", "cross_axis_gravity"),
        "roll the sensor by 180 degrees about its input axis; check the encoder by interferometer or tumble in gravity",
    ),
)
"""What a level, untouched rig can never tell apart, and the experiment that can."""
DELAY_CLASS = ("time_offset", "sensor_lag", "sensor_resonance")
DELAY_EXPERIMENT = "a common trigger on both channels; motion at frequencies above 1/(10 tau), where lag and delay part"


@dataclass(frozen=True, slots=True)
class Confounded:
    """An effect with everything that it cannot be told from, and the experiment that would."""

    effect: str
    members: tuple[str, ...]
    experiment: str

    def beside(self, others: Sequence[str]) -> Confounded:
        """The same with more that it cannot be told from."""
        return replace(self, members=tuple(dict.fromkeys((*self.members, *others))))


@notebook_repr
@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a model lacks on a recording."""

    verdict: Verdict
    sentence: str
    effects: tuple[str, ...]
    """What would enter, in order; a significant delay comes first."""
    classes: tuple[Confounded, ...]
    inseparable: tuple[Confounded, ...]
    scan: Scan
    fit: Fit
    """The model, profiled anew on this recording."""
    used: tuple[tuple[float, float], ...]
    """Stretches that were used, s."""
    channels: tuple[NoiseTest, ...]
    """Effects that the mean cannot see, tested on channels of their own; the significant ones."""
    where: Comparison
    """The model against the recording it was judged on: where the residual is large."""
    largest: Mapping[str, float]
    """Largest contribution of each coefficient over the used range, m/s² (m at the encoder)."""
    sizes: Mapping[str, Size]
    """The same of every effect: of the model, of the candidates, and of what the tests found."""
    alpha: float = ALPHA
    breaks: tuple[float, ...] = ()
    """When the model breaks for good, s."""
    dropped: tuple[RejectedReadings, ...] = ()
    """Readings that were left out as wild, by recording and channel."""
    suspect: tuple[str, ...] = ()
    """Faults in the data, each a sentence; they are said first."""

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict}: {self.sentence})"

    @property
    def importance(self) -> Importance | None:
        """Which of the effects matter under the declared tolerance; None where none is declared."""
        return split(self.effects, self.sizes, self.fit.rig.tolerance)


def within(report: Callable[[float], None], low: float, high: float) -> Callable[[float], None]:
    """Report the shares of one part of the work as those of the whole."""
    return lambda share: report(low + share * (high - low))


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """The part of a recording on which one model can hold, and the faults in it."""

    start: float
    end: float
    breaks: tuple[float, ...]
    suspect: tuple[str, ...]

    @classmethod
    def of(cls, recording: Recording, start: float | None, end: float | None) -> TimeSpan:
        """Look for faults and for the first instant at which the relation of the channels breaks for good.

        A stretch that the user chose is taken as it is.
        """
        breaks: tuple[float, ...] = ()
        columns = None
        if start is None and end is None:
            found = usable(recording)
            start, end, breaks = found.start, found.end, found.breaks
            columns = None if breaks else found.columns
        run = prepare(recording, start=start, end=end) if columns is None else columns.run
        suspect = tuple(fault.sentence for fault in faults(recording, run, columns))
        return cls(float(run.t[0]), float(run.t[-1]), breaks, suspect)


def verdict_on(
    state: CleanFit,
    stretch: TimeSpan,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    report: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Verdict on a model that has just been fitted; the solution is used up."""
    solution, tests = state.solution, state.tests
    model, profiled, recording = solution.model, result(solution), solution.passes[0].run.recording
    found = scan(
        solution.passes, model, extra=extra, apart=lines_apart(state), alpha=alpha, report=within(report, 0.0, 0.8)
    )
    level = alpha / (found.examined + len(tests))
    loud = independent_tests(
        [t for t in tests if t.p_value < level and t.effect not in model.effects], alone=not found.found
    )
    largest, sizes = contributions(profiled, solution), sizes_of(profiled, solution.passes, found.candidates, loud)
    delay = "time_offset" not in model.fixed and delayed(profiled, found, alpha)
    delay = delay and delayed(completed(solution, profiled, found), found, alpha)
    solution.passes.clear()  # the comparison predicts anew: one set of signals at a time
    if found.blocks < LEAST_BLOCKS:
        loud = ()
    ties = [Confounded(f.effect, f.members, f.experiment) for f in found.found if found.blocks >= LEAST_BLOCKS]
    chances: dict[str, float] = {}
    for test in loud:
        chances[test.effect] = min(test.p_value, chances.get(test.effect, 1.0))
    chances.pop("whiteness", None)
    unsure = level * math.exp(-THIN)
    ties += [
        Confounded(name, (name, *(find(name).confused if p > unsure else ())), find(name).experiment.rstrip("."))
        for name, p in chances.items()
    ]
    if delay:
        ties.insert(0, Confounded("time_offset", DELAY_CLASS, DELAY_EXPERIMENT))
    verdict, sentence = conclude(profiled, found, loud, ties)
    return Diagnosis(
        verdict=verdict,
        sentence=sentence,
        effects=tuple(tie.effect for tie in ties),
        classes=tuple(ties),
        inseparable=inseparable(model),
        scan=found,
        fit=profiled,
        used=tuple((run.start, run.end) for run in profiled.runs),
        channels=loud,
        where=compare(profiled, recording, start=stretch.start, end=stretch.end),
        largest=largest,
        sizes=sizes,
        alpha=alpha,
        breaks=stretch.breaks,
        suspect=stretch.suspect,
    )


def lines_apart(state: CleanFit) -> list[Term]:
    """Lines that stand in the spectrum and that the motion does not make: they are told of on their own, and no effect
    of the motion is paid for explaining them."""
    if "tone" in state.solution.model.effects:
        return []
    fastest = 0.4 / max(one.signals.step for one in state.solution.passes)
    lines = [test.parts for test in state.tests if test.effect == "tone" and test.p_value < ALARM]
    return [
        term
        for parts in lines
        if not parts["made_by_motion"] and parts["frequency"] < fastest
        for term in terms_of(find("tone"), {"frequency": parts["frequency"]})
    ]


SAME_LINE = 0.25
"""A line within this share of the frequency of a vibration belongs to it."""


EXPLAINED_BY = {"quantisation": ("tone", "whiteness"), "encoder_outliers": ("whiteness",)}
"""What a coarse converter or wild readings raise besides themselves; no step makes a line larger than it is."""


def independent_tests(loud: Sequence[NoiseTest], *, alone: bool) -> tuple[NoiseTest, ...]:
    """Significant findings that stand on their own feet.

    A line near a vibration, or in its band, belongs to it. A line inside the band of the motion may be a harmonic of a
    missing nonlinearity, which is judged elsewhere: it counts only `alone`, when no effect of the motion was found, and
    where the motion makes no lines.
    """
    shaking = [test.parts for test in loud if test.effect == "vibration" and "frequency" in test.parts]
    raised = {other for test in loud if test.parts.get("coarse", 1.0) for other in EXPLAINED_BY.get(test.effect, ())}
    step = max((test.parts["step"] for test in loud if test.effect == "quantisation"), default=math.inf)

    def own(test: NoiseTest) -> bool:
        if test.effect in raised and not (test.effect == "tone" and test.estimate > step):
            return False
        if test.effect != "tone":
            return True
        f = test.parts["frequency"]
        shaken = any(
            abs(f - part["frequency"]) < SAME_LINE * part["frequency"] or part["lowest"] < f < part["highest"]
            for part in shaking
        )
        free = not test.parts.get("within_motion") or (alone and not test.parts.get("made_by_motion"))
        return free and not shaken

    return tuple(test for test in loud if own(test))


def contributions(fit: Fit, solution: Solution) -> dict[str, float]:
    """Largest contribution of each coefficient over all runs, m/s² (m at the encoder)."""
    found: dict[str, float] = {}
    for number, one in enumerate(solution.passes):
        values = fit.values(number)
        for term, column in zip(values.terms, evaluate(values.terms, one.signals), strict=True):
            size = abs(values.by_name[term.name]) * float(np.max(np.abs(column)))
            found[term.name] = max(size, found.get(term.name, 0.0))
    return found


def conclude(profiled: Fit, found: Scan, loud: Sequence[NoiseTest], ties: Sequence[Confounded]) -> tuple[Verdict, str]:
    """The verdict and the sentence that opens every output."""
    named = [test for test in loud if test.effect != "whiteness"]
    looked = f"{found.examined} candidates examined"
    if found.blocks < LEAST_BLOCKS:
        return "too_short", f"The record is too short for a verdict: {found.blocks} blocks, {LEAST_BLOCKS} are needed."
    ratios = [run.noise.ratio for run in profiled.runs if run.noise.ratio is not None]
    ratio = max(ratios, default=None)
    tie_of = {tie.effect: tie for tie in reversed(ties)}
    if found.found:
        first = found.found[0]
        candidate = next((c for c in found.candidates if c.effect == first.effect), None)
        sigma = f"{candidate.snr:.0f} sigma; " if candidate is not None else ""
        effect = find(first.effect)
        if effect.family:
            return "shape", f"Something is missing that has no name here: {effect.summary} ({sigma}{looked})."
        return sentence_with_rivals(
            tie_of[first.effect], f"{first.effect} explains what the model lacks ({sigma}{looked})."
        )
    if named:
        return sentence_with_rivals(tie_of[named[0].effect], f"{named[0].sentence} ({looked}).")
    if ratio is not None and ratio > NOISE_LIMIT:
        return "unexplained", (
            f"The residual is {ratio:.2g} times the sensor noise of the data sheet and no candidate explains it "
            f"({looked})."
        )
    if loud or any(run.noise.band is not None for run in profiled.runs):
        return "unexplained", f"The residual is not white and no candidate explains it ({looked})."
    return "adequate", f"Nothing is missing ({looked}); see the detection limits for what would have been seen."


def sentence_with_rivals(tie: Confounded, text: str) -> tuple[Verdict, str]:
    """The verdict on an effect that is there, and the sentence on it with what it cannot be told from."""
    others = [name for name in tie.members if name != tie.effect]
    if not others:
        return "named", text
    return "tied", f"{text} {', '.join(others)} cannot be told from it on this record: {tie.experiment}."


def completed(solution: Solution, profiled: Fit, found: Scan) -> Fit:
    """The fit with the estimates beside everything that was found: what a missing effect leaves can pose as a delay.

    The solution is used up.
    """
    if not found.found:
        return profiled
    model = solution.model
    try:
        for finding in found.found:
            model = finding.enter(model)
        grown = [one.grown(model) for one in solution.passes]
        solution.passes.clear()  # so that each step frees the track before it
        again = estimated(model, grown, least=ROUNDS_OF_GROWN)
        judge(again.layout, again.x, again.covariance, [state.run for state in grown])
        estimates = again.layout.estimates(again.x, again.covariance, model)
        return replace(profiled, model=model, estimates=estimates, covariance=again.covariance)
    except ValueError:
        return profiled


def delayed(fit: Fit, found: Scan, alpha: float) -> bool:
    """Whether the time offset is significant beyond what was declared (the delay rule).

    It is judged as it would be were the low-pass exactly as declared: the tolerance of the low-pass is taken off the
    delay, so it must not stand in the standard deviation as well.
    """
    tolerance = fit.rig.offset_tolerance + fit.rig.lowpass_tolerance
    needed = -float(special.ndtri(alpha / max(1, found.examined) / 2.0))
    names = [e.name for e in fit.free]
    lowpass = names.index("lowpass_error") if "lowpass_error" in names else None
    for i in (i for i, name in enumerate(names) if name == "time_offset"):
        delay, variance = fit.free[i].value, float(fit.covariance[i, i])
        if lowpass is not None:
            shared = float(fit.covariance[i, lowpass]) / float(fit.covariance[lowpass, lowpass])
            delay -= shared * fit.free[lowpass].value
            variance -= shared * float(fit.covariance[i, lowpass])
        if variance > 0.0 and abs(delay) - tolerance > needed * math.sqrt(variance):
            return True
    return False


def inseparable(model: Model) -> tuple[Confounded, ...]:
    """Groups that no motion of this rig can separate, as long as the model holds one of each."""
    return tuple(
        Confounded(members[0], members, experiment)
        for members, experiment in GROUPS
        if not any(name in model.effects for name in members[1:])
    )
