"""The verdict on a fitted model: what it lacks, what that is confounded with, and where the model fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from accelcal._support.progress import within
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.data.recording import Recording
from accelcal.diagnosis.change_points import usable
from accelcal.diagnosis.contribution import Importance, Size, sizes_of, split
from accelcal.diagnosis.delay import DELAY_CLASS, DELAY_EXPERIMENT, delay_is_significant, with_detected_effects
from accelcal.diagnosis.faults import fault_remarks, faults
from accelcal.diagnosis.findings import (
    NOTHING_MISSING,
    Confounded,
    Finding,
    in_model,
    present,
    with_findings,
)
from accelcal.diagnosis.further_run import FurtherRun, further_runs
from accelcal.diagnosis.independent_estimate import differences, disagreement
from accelcal.diagnosis.independent_tests import independent_tests, largest_first, own_tests, separate_lines
from accelcal.diagnosis.left_out import left_out_remarks
from accelcal.diagnosis.noise_tests.noise_test import WHITENESS, NoiseTest
from accelcal.diagnosis.noise_tests.tones import harmonic_effects
from accelcal.diagnosis.outlier_rejection import CleanFit, RejectedReadings
from accelcal.diagnosis.policy import (
    CLEAR_LOG_EVIDENCE,
    DATA_SHEET_NOISE_RATIO,
    FAMILYWISE_ALPHA,
    VERDICT_LEAST_BLOCKS,
)
from accelcal.diagnosis.position_noise import coloured_position
from accelcal.diagnosis.relation import RelationColumns
from accelcal.diagnosis.remarks import Remark, remark
from accelcal.diagnosis.run_agreement import run_agreement
from accelcal.diagnosis.search.scan import Scan, Verdict, scan
from accelcal.diagnosis.transverse import transverse_coherence
from accelcal.diagnosis.turning import FOLLOW_TIME, FittedSpan, beside_tilt, turning_sensor
from accelcal.diagnosis.unresolved_motion import unresolved_motion
from accelcal.effects import BUILT_IN, Effect, find, next_name
from accelcal.estimation.estimate import Fit, implausible_scale, result
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.run import prepare
from accelcal.estimation.run_to_run import SPREAD_ALPHA
from accelcal.model import Model, evaluate
from accelcal.validation.comparison import Evaluation
from accelcal.validation.evaluation import compare

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SEEN_EXPERIMENT = "a further run with the axis in another direction, or the sensor turned on its mount"


@immutable
@dataclass(frozen=True, slots=True)
class Diagnosis(Result):
    """What a model lacks on a recording.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(made.recording)
    >>> found = ac.diagnose(fit, made.recording)
    >>> found.scan.candidates[0].effect
    'cubic'
    """

    derived: ClassVar[tuple[str, ...]] = ("suspect", "importance")

    verdict: Verdict
    """On what the model lacks."""
    sentence: str
    """What was found, then what is left."""
    effects: tuple[str, ...]
    """Effects that would enter, in order; a significant delay comes first."""
    classes: tuple[Confounded, ...]
    inseparable: tuple[Confounded, ...]
    scan: Scan
    fit: Fit
    """The model, fitted anew on this recording."""
    used: tuple[tuple[float, float], ...]
    """Stretches of the recordings that were used, s."""
    channels: tuple[NoiseTest, ...]
    """Significant noise tests: effects that do not change the mean."""
    where: Evaluation
    """The model against the recording it was judged on: where the residual is large."""
    largest: Mapping[str, float]
    """Largest contribution of each coefficient over the used range, m/s² (m at the encoder)."""
    sizes: Mapping[str, Size]
    """Largest contribution of every effect: of the model, of the candidates, and of what noise tests found."""
    alpha: float = FAMILYWISE_ALPHA
    breaks: tuple[float, ...] = ()
    """Instants at which the relation of the channels breaks for good, s."""
    dropped: tuple[RejectedReadings, ...] = ()
    """Samples rejected as outliers, by recording and channel."""
    remarks: tuple[Remark, ...] = ()
    """What must be read with the verdict."""
    present: tuple[Finding, ...] = ()
    """Effects that were found and that the model contains."""
    unnamed: tuple[NoiseTest, ...] = ()
    """Significant noise tests whose effect is not named, since a missing effect of the motion may be behind them."""
    left: str = ""
    """The part of the sentence on what is left."""
    heldout: Evaluation | None = None
    """The model against a held-out recording; None where there is none."""

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict}: {self.sentence})"

    def plot(self, *, theme: Literal["light", "dark"] = "light") -> Figure:
        """Draw the candidates with what each explains, see `accelcal.plots.ranking`.

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        """
        made: Figure = face("plots").ranking(self, theme=theme)
        return made

    @property
    def suspect(self) -> tuple[str, ...]:
        """Sentences on faults in the data; they are reported first."""
        return tuple(remark.sentence for remark in self.remarks if remark.place == "data")

    @property
    def nameable(self) -> bool:
        """Whether an effect may be named: not beside a sensor that turns."""
        return not any(remark.forbids_names for remark in self.remarks)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences that are read beside the verdict."""
        return tuple(remark.sentence for remark in self.remarks if remark.place == "beside")

    @property
    def importance(self) -> Importance | None:
        """Effects divided by the declared tolerance; None where none is declared."""
        return split(self.effects, self.sizes, self.fit.rig.tolerance)


@dataclass(frozen=True, slots=True)
class TimeSpan:
    """The part of a recording on which one model can hold, and the faults in it."""

    start: float
    end: float
    breaks: tuple[float, ...]
    remarks: tuple[Remark, ...]
    """Faults, several of one kind as one."""
    chosen: bool = False
    """Whether the user chose it, for all recordings; else it is that of the first."""

    @classmethod
    def of(
        cls, recording: Recording, start: float | None, end: float | None, every: RelationColumns | None = None
    ) -> TimeSpan:
        """Look for faults and for the first instant at which the relation of the channels breaks for good.

        A stretch that the user chose is taken as it is. `every` holds columns of all readings, if available.
        """
        breaks: tuple[float, ...] = ()
        columns = None
        chosen = start is not None or end is not None
        if not chosen:
            found = usable(recording, every)
            start, end, breaks = found.start, found.end, found.breaks
            columns = None if breaks else found.columns
        run = prepare(recording, start=start, end=end) if columns is None else columns.run
        start, end = float(run.t[0]), float(run.t[-1])
        broken = [remark("break", recording=recording.name or "recording", time=at) for at in breaks]
        told = (
            *left_out_remarks([recording], "", start, end),
            *fault_remarks(faults(recording, run, columns), end - start),
        )
        return cls(start, end, breaks, (*broken, *told), chosen)


def verdict_on(
    cleaned: CleanFit,
    stretch: TimeSpan,
    extra: Sequence[Effect] | None = None,
    alpha: float = FAMILYWISE_ALPHA,
    progress: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Verdict on a model that has just been fitted; the solution is used up.

    Parameters
    ----------
    cleaned : the fit without outliers, and the noise tests on it.
    stretch : usable part of the recording.
    extra : effects of the user's own; by default all that are registered.
    alpha : family-wise false-alarm rate.
    progress : called with the share of the work that is done, 0 to 1.
    """
    solution, tests = cleaned.solution, cleaned.tests
    model, profiled, recording = solution.model, result(solution), solution.states[0].run.recording
    runs = [state.run for state in solution.states]
    fitted = FittedSpan(tuple(run.recording for run in runs), float(runs[0].t[0]), float(runs[0].t[-1]))
    found = scan(
        solution.states,
        model,
        extra=extra,
        separate=separate_lines(cleaned),
        alpha=alpha,
        progress=within(progress, 0.0, 0.8),
    )
    level = alpha / (found.examined + len(tests))
    signals, origin = solution.states[0].signals, runs[0].origins.t
    unexplained = [
        test
        for test in own_tests([test for test in tests if test.p_value < level])
        if not test.in_model(model, signals)
    ]
    named = independent_tests(unexplained, no_effect_found=not found.found)
    unnamed = tuple(test for test in unexplained if test not in named)
    significant = tuple(
        replace(test, effect=find(next_name(test.effect, model.effects)).name) if test.shape else test
        for test in largest_first(named)
    )
    largest = contributions(profiled, solution)
    sizes = sizes_of(profiled, solution.states, found.candidates, significant)
    harmonics = {
        test.effect: harmonic_effects(signals, test.parts["frequency"])
        for test in significant
        if test.parts.get("made_by_motion")
    }
    seen = solution.seen_by_runs[:1] if found.enough and not found.found else ()
    disagreeing = run_agreement(solution.states, model, [one.instead for one in seen])
    further = further_runs(solution.states, model)
    telling = {one.effect: further_runs(solution.states, model, [one.instead], [one.effect]) for one in seen}
    delay_found = "time_offset" not in model.fixed and delay_is_significant(profiled, found, alpha)
    delay_found = delay_found and delay_is_significant(with_detected_effects(solution, profiled, found), found, alpha)
    unresolved = unresolved_motion(runs)
    apart = disagreement(differences(solution))
    solution.states.clear()  # the comparison predicts anew: one set of filters at a time
    if not found.enough:
        significant = unnamed = ()
    where = compare(profiled, recording, start=stretch.start, end=stretch.end)
    span = (stretch.start, stretch.end)
    wrong_scale = scale_remark(profiled)
    judged = found.enough and wrong_scale is None
    told = any(one.code == "disturbed" for one in stretch.remarks)
    turning = turning_sensor(model, found.found, where, sizes, fitted, span, stretches=not told) if judged else None
    if turning is not None and turning.code == "tilt_or_drift":
        found = replace(found, found=beside_tilt(found.found), named=beside_tilt(found.named))
        if FOLLOW_TIME.intersection((*model.effects, *(one.effect for one in found.found))):
            significant = unnamed = ()  # what follows any function of time leaves no noise to test
    causes = (wrong_scale, unresolved, turning)
    forbidding = next((one for one in causes if one is not None and one.forbids_names), None)
    if forbidding is not None:  # what follows a tilt, say, would pass for an effect of place, time, bias or scale
        found, delay_found = replace(found, found=(), named=(), changing=()), False
        significant = unnamed = ()
    groups = [Confounded(f.effect, f.members, f.experiment, f.parts) for f in found.found]
    p_values: dict[str, float] = {}
    for test in significant:
        p_values[test.effect] = min(test.p_value, p_values.get(test.effect, 1.0))
    p_values.pop(WHITENESS, None)
    uncertain = level * math.exp(-CLEAR_LOG_EVIDENCE)
    groups += [
        Confounded(
            name,
            (name, *(find(name).confused if p > uncertain else harmonics.get(name, ()))),
            find(name).experiment.rstrip("."),
        )
        for name, p in p_values.items()
        if name not in {group.effect for group in groups}
    ]
    groups += [
        Confounded(
            one.effect,
            (*(each.effect for each in solution.seen_by_runs), one.instead),
            with_further(SEEN_EXPERIMENT, [one.effect], telling[one.effect]),
        )
        for one in seen
    ]
    by_position = found.enough and recording.reference is None
    coloured = coloured_position(profiled, recording, span) if by_position and beyond_data_sheet(profiled) else None
    unsteady = unsteady_effects(found)
    known = [one.effect for one in found.found]
    transverse = transverse_coherence(recording, where, signals, origin, known) if found.enough else ()
    verdict, left = verdict_and_sentence(
        profiled, found, significant, groups, forbidding or coloured, unsteady, unnamed
    )
    inside = present(profiled, alpha / found.examined, sizes) if found.enough and forbidding is None else ()
    if delay_found:
        delay = Confounded("time_offset", DELAY_CLASS, DELAY_EXPERIMENT)
        groups.insert(0, delay)
        inside = (in_model(profiled, delay, sizes), *inside)
    if apart is not None and verdict == "adequate":
        verdict, left = "unexplained", f"No effect explains that ({found.examined} candidates examined)."
    sentence = with_findings(inside, left, profiled.rig.tolerance)
    return Diagnosis(
        verdict=verdict,
        sentence=f"{apart.sentence}. {sentence}" if apart else sentence,
        effects=tuple(group.effect for group in groups),
        classes=tuple(groups),
        inseparable=tuple(
            replace(group, experiment=with_further(group.experiment, group.members, further))
            for group in inseparable_groups(model)
        ),
        scan=found,
        fit=profiled if turning is None else replace(profiled, tilt=float(turning.values.get("tilt_deg", 0.0))),
        used=tuple((run.start, run.end) for run in profiled.runs),
        channels=significant,
        unnamed=unnamed,
        where=where,
        largest=largest,
        sizes=sizes,
        alpha=alpha,
        breaks=stretch.breaks,
        remarks=(
            *(one for one in (wrong_scale, apart, turning, coloured, unresolved, disagreeing) if one is not None),
            *run_to_run(profiled),
            *stretch.remarks,
            *unsteady,
            *slow_noise_remark(found),
            *transverse,
        ),
        present=inside,
        left=left,
    )


def scale_remark(fit: Fit) -> Remark | None:
    """The remark on an estimate of 1 + k that no working sensor has: beside it every curve is significant."""
    scale = fit.values().scale
    text = "scale_factor" not in fit.model.fixed and implausible_scale(scale)
    return remark("implausible_scale", text=text[0], scale=scale) if text else None


def with_further(experiment: str, members: Sequence[str], further: Sequence[FurtherRun]) -> str:
    """An experiment, with the one further run that would separate each member, and how well."""
    told = [one.sentence for one in further if one.effect in members]
    return "; ".join((experiment, *told))


def run_to_run(fit: Fit) -> tuple[Remark, ...]:
    """Remarks on coefficients that differ from run to run, and on what they go with."""
    return tuple(
        remark("goes_with", text=one.sentence, parameter=one.parameter, covariate=one.covariate, p=one.p_value)
        for one in fit.goes_with
    ) + tuple(
        remark(
            "run_to_run",
            text=spread.sentence(fit[spread.name].value),
            parameter=spread.name,
            mean=fit[spread.name].value,
            std=spread.value,
            low=spread.low,
            high=spread.high,
            next_half=spread.next_half,
            p=spread.p_value,
        )
        for spread in fit.spreads
    )


def unsteady_effects(found: Scan) -> tuple[Remark, ...]:
    """Remarks on effects that would have entered, had they one size in all parts of the runs and happened once."""
    sigma = {candidate.effect: candidate.snr for candidate in found.candidates}
    return tuple(
        remark("no_single_size", effect=one.effect, sigma=sigma[one.effect], sizes=one.unequal.text)
        if one.unequal
        else remark("recurs", effect=one.effect, sigma=sigma[one.effect])
        for one in found.changing
        if one.effect in sigma  # of those that explain part of what is left at the end
    )


def slow_noise_remark(found: Scan) -> tuple[Remark, ...]:
    """The remark on slow noise that effects were judged against; of several runs the one with the highest knee."""
    worst = max(found.slow_noise, key=lambda noise: noise.knee, default=None)
    if worst is None or not worst.knee:
        return ()
    return (remark("slow_noise", knee=worst.knee, log_evidence=worst.log_evidence),)


def contributions(fit: Fit, solution: Solution) -> dict[str, float]:
    """Largest contribution of each coefficient over all runs, m/s² (m at the encoder)."""
    maxima: dict[str, float] = {}
    for number, state in enumerate(solution.states):
        values = fit.values(number)
        for term, column in zip(values.terms, evaluate(values.terms, state.signals), strict=True):
            size = abs(values.by_name[term.name]) * float(np.max(np.abs(column)))
            maxima[term.name] = max(size, maxima.get(term.name, 0.0))
    return maxima


def verdict_and_sentence(
    profiled: Fit,
    found: Scan,
    significant: Sequence[NoiseTest],
    groups: Sequence[Confounded],
    cause: Remark | None = None,
    unsteady: Sequence[Remark] = (),
    unnamed: Sequence[NoiseTest] = (),
) -> tuple[Verdict, str]:
    """The verdict on what a model lacks, and the sentence on it.

    Parameters
    ----------
    profiled, found, significant, groups : fit, scan, noise tests, and what is named.
    cause : a remark that explains the residual: a sensor that turns, or noise of the position that is not white.
    unsteady : remarks on effects without one size.
    unnamed : significant noise tests whose effect is not named.
    """
    named = [test for test in significant if test.effect != WHITENESS]
    examined = f"{found.examined} candidates examined"
    if not found.enough:
        return (
            "too_short",
            f"The record is too short for a verdict: {found.blocks} blocks, {VERDICT_LEAST_BLOCKS} are needed, so the "
            "search for missing effects is withheld. Trials that are fitted together add up their blocks: "
            f"{pooled(found, len(profiled.runs))} of this length are enough.",
        )
    if cause is not None and cause.forbids_names:
        return "unexplained", (
            f"{cause.sentence}. No effect of position, time, bias or scale factor is certain beside it, so none is "
            f"named ({examined})."
        )
    group_of = {group.effect: group for group in reversed(groups)}
    if found.found:
        first = found.found[0]
        candidate = next((c for c in found.candidates if c.effect == first.effect), None)
        sigma = f"{candidate.snr:.0f} sigma; " if candidate is not None else ""
        effect = find(first.effect)
        if effect.family:
            return (
                "shape",
                "No named effect explains what the model lacks; a nonparametric curve does: "
                f"{effect.summary} ({sigma}{examined}).",
            )
        return sentence_with_rivals(
            group_of[first.effect], f"{first.effect} explains what the model lacks ({sigma}{examined})."
        )
    if named:
        return sentence_with_rivals(group_of[named[0].effect], f"{named[0].sentence} ({examined}).")
    if unsteady:
        return "unexplained", f"{unsteady[0].sentence} ({examined})."
    if unnamed:
        text = unnamed[0].sentence
        return "unexplained", (
            f"{text[0].upper()}{text[1:]}, where the motion may make one, and no candidate explains it ({examined})."
        )
    if cause is not None:
        return unlike_runs(profiled, examined) or (
            "adequate",
            f"{NOTHING_MISSING} in the sensor ({examined}). {cause.sentence}.",
        )
    if beyond_data_sheet(profiled):
        return "unexplained", (
            f"The residual is {noise_ratio(profiled):.2g} times the sensor noise of the data sheet and no candidate "
            f"explains it ({examined})."
        )
    if significant or any(run.noise.band is not None for run in profiled.runs):
        return "unexplained", f"The residual is not white and no candidate explains it ({examined})."
    return unlike_runs(profiled, examined) or (
        "adequate",
        f"{NOTHING_MISSING} ({examined}); the detection limits say how small an effect would have been found.",
    )


def unlike_runs(profiled: Fit, examined: str) -> tuple[Verdict, str] | None:
    """The verdict on what differs between runs that are adequate in themselves; None where they are alike."""
    if profiled.seen_by_runs:
        text = profiled.seen_by_runs[0].sentence
        return "tied", f"{text[0].upper()}{text[1:]} ({examined})."
    unlike = [spread for spread in profiled.spreads if spread.p_value < SPREAD_ALPHA]
    if not unlike:
        return None
    told = "; ".join(spread.sentence(profiled[spread.name].value) for spread in unlike)
    return "adequate", f"{told}. Within each run the model lacks no effect ({examined})."


def pooled(found: Scan, runs: int) -> str:
    """How many trials of this length a verdict needs, in words."""
    if not found.blocks:
        return f"more than {VERDICT_LEAST_BLOCKS * runs}"
    return f"{math.ceil(VERDICT_LEAST_BLOCKS * runs / found.blocks)}"


def noise_ratio(profiled: Fit) -> float:
    """Fitted over declared noise density, the largest of all runs; 0 where none is declared."""
    return max((run.noise.ratio for run in profiled.runs if run.noise.ratio is not None), default=0.0)


def beyond_data_sheet(profiled: Fit) -> bool:
    """Whether the residual exceeds what the data sheet of the sensor allows."""
    return noise_ratio(profiled) > DATA_SHEET_NOISE_RATIO


def sentence_with_rivals(group: Confounded, text: str) -> tuple[Verdict, str]:
    """The verdict on an effect that is present, and the sentence on it with the effects that it is confounded with."""
    others = [name for name in group.members if name != group.effect]
    if not others:
        return "named", text
    return (
        "tied",
        f"{text} It is confounded with {', '.join(others)} on this record; to separate them: {group.experiment}.",
    )


def inseparable_groups(model: Model) -> tuple[Confounded, ...]:
    """Effects that no motion of this rig separates, as long as the model holds one of each group."""
    groups = [(base.name, base.traits.lumped) for base in BUILT_IN if base.traits.lumped]
    return tuple(
        Confounded(name, (name, *group.members), group.experiment)
        for name, group in groups
        if not any(find(member).traits.visible or member in model.effects for member in group.members)
    )
