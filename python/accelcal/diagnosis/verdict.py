"""The verdict on a fitted model: what it lacks, what that is confounded with, and where the model fails."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, ClassVar, Literal

import numpy as np

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.process import parts_of
from accelcal._support.result import Result
from accelcal._support.values import face, immutable
from accelcal.data import LEVERS, Recording
from accelcal.data.orientation import MOTIONS_THAT_TELL, TURNS_THAT_TELL
from accelcal.diagnosis.checks import CHECKS, FOLLOW_TIME, beside_tilt
from accelcal.diagnosis.clean_fit import RejectedReadings
from accelcal.diagnosis.evidence import DELAY_CLASS, DELAY_EXPERIMENT, Evidence, noise_ratio
from accelcal.diagnosis.findings import (
    NOTHING_MISSING,
    Confounded,
    Finding,
    Importance,
    Size,
    declared_as,
    in_model,
    present,
    split,
    varies,
    with_findings,
    with_next_step,
)
from accelcal.diagnosis.noise.noise_test import WHITENESS, NoiseTest
from accelcal.diagnosis.noise.spectra import harmonic_effects
from accelcal.diagnosis.policy import (
    DATA_SHEET_NOISE_RATIO,
    FAMILYWISE_ALPHA,
    VERDICT_LEAST_BLOCKS,
)
from accelcal.diagnosis.runs import FurtherRun
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.diagnosis.search.scan import Scan, Verdict
from accelcal.effects import BUILT_IN, find
from accelcal.effects.mechanisms import CARRIERS
from accelcal.effects.registry import on_axis
from accelcal.estimation.estimate import Fit
from accelcal.estimation.remarks import KINDS, Remark
from accelcal.estimation.run_to_run import REMARK_ALPHA
from accelcal.validation.comparison import Evaluation

if TYPE_CHECKING:
    from matplotlib.figure import Figure

UNSTEADY = ("depends_on_frequency", "no_single_size", "recurs")
"""Codes of an effect that has not one size."""
SEEN_EXPERIMENT = "a further run with the axis in another direction, or the sensor turned on its mount"


@immutable
@dataclass(frozen=True, slots=True)
class Diagnosis(Result):
    """Answer to what a model lacks on a recording.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> diagnosis = ac.diagnose(fit, simulated.recording)
    >>> diagnosis.scan.candidates[0].effect
    'cubic'
    """

    derived: ClassVar[tuple[str, ...]] = ("suspect", "importance")

    verdict: Verdict
    """On what the model lacks."""
    sentence: str
    """Sentence on the effects that the model lacks, then on what is left."""
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
    """Remarks that must be read with the verdict."""
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

    @checked
    def plot(
        self, figure: Literal["ranking", "added_variable"] = "ranking", *, theme: Literal["light", "dark"] = "light"
    ) -> Figure:
        """Draw the candidates with what each explains, or the error against the best of them and its rival.

        Parameters
        ----------
        figure : a function of `accelcal.plots`.
        theme : "light" or "dark".

        Raises
        ------
        MissingExtra
            If matplotlib is not installed.
        ValueError
            If there is no such figure.
        """
        drawn: Figure = getattr(face("plots"), figure)(self, theme=theme)
        return drawn

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


def verdict_on(e: Evidence) -> Diagnosis:
    """Verdict on a model that has just been fitted: the checks find their remarks, the rules judge what they leave."""
    for check in CHECKS:
        e.remarks += check(e)
    scan, tests, unnamed = nameable(e)
    groups = classes_of(e, scan, tests)
    verdict, left = judgement(Case(e.fit, scan, tests, unnamed, groups, e.remarks))
    inside = confirmed(e, groups)
    vetoes = (f"{note.sentence}." for note in e.remarks if note.vetoes_adequate and note.sentence not in left)
    tilt = next((float(note.values["tilt_deg"]) for note in e.remarks if "tilt_deg" in note.values), 0.0)
    return Diagnosis(
        verdict=verdict,
        sentence=" ".join((*vetoes, with_findings(inside, left, e.fit.rig.tolerance))),
        effects=tuple(group.effect for group in groups),
        classes=tuple(groups),
        inseparable=inseparable_groups(e),
        scan=scan,
        fit=replace(e.fit, tilt=tilt),
        used=tuple((run.start, run.end) for run in e.fit.runs),
        channels=tests,
        unnamed=unnamed,
        **{key: getattr(e, key) for key in ("where", "largest", "sizes", "alpha", "breaks")},
        remarks=tuple(e.remarks),
        present=inside,
        left=left,
    )


def confirmed(e: Evidence, groups: Sequence[Confounded]) -> tuple[Finding, ...]:
    """Effects of the model that the record confirms, and a significant delay before them."""
    delays = (in_model(e.fit, effect, e.sizes) for effect in groups if effect.effect == "time_offset")
    inside = present(e.fit, e.alpha / e.scan.examined, e.sizes) if e.scan.enough and not e.forbidden else ()
    return (*delays, *inside)


def nameable(e: Evidence) -> tuple[Scan, tuple[NoiseTest, ...], tuple[NoiseTest, ...]]:
    """Effects of the search, noise tests that name one, and others, as far as the remarks let them be named.

    What follows a tilt would pass for an effect of place, time, bias or scale; what follows any function of time leaves
    no noise to test.
    """
    if e.forbidden:
        return replace(e.scan, detected=(), rivals=(), changing=()), (), ()
    scan, tested = e.scan, e.scan.enough
    if any(note.code == "tilt_or_drift" for note in e.remarks):
        scan = replace(scan, detected=beside_tilt(scan.detected), rivals=beside_tilt(scan.rivals))
        tested = tested and not FOLLOW_TIME.intersection(
            (*e.model.effects, *(effect.effect for effect in scan.detected))
        )
    return (scan, e.tests, e.unnamed) if tested else (scan, (), ())


def classes_of(e: Evidence, scan: Scan, tests: Sequence[NoiseTest]) -> list[Confounded]:
    """Effects that would enter, each with its confounding class; a significant delay comes first."""
    groups = [Confounded("time_offset", DELAY_CLASS, DELAY_EXPERIMENT)] if e.delayed and not e.forbidden else []
    searched_for = [
        Confounded(effect.effect, effect.members, effect.experiment, effect.parts, effect.weights)
        for effect in scan.detected
    ]
    p_values: dict[str, float] = {}
    for test in tests:
        p_values[test.effect] = min(test.p_value, p_values.get(test.effect, 1.0))
    harmonics = {
        test.effect: harmonic_effects(e.signals, test.parts["frequency"])
        for test in tests
        if test.parts.get("made_by_motion")
    }
    searched = {WHITENESS, *(group.effect for group in (*groups, *searched_for))}
    tested = []
    for name, p in p_values.items():
        if name not in searched:
            uncertain = p > e.level * FAMILYWISE_ALPHA
            members = (name, *(find(name).confused if uncertain else harmonics.get(name, ())))
            tested.append(Confounded(name, members, find(name).experiment.rstrip(".")))
    wave = leading_wave(scan, tests)
    first = [group for group in tested if group.effect == wave]
    groups += [*first, *searched_for, *(group for group in tested if group.effect != wave)]
    for choice, telling in zip(e.by_runs[:1], e.telling, strict=True):
        members = (*(effect.effect for effect in e.fit.seen_by_runs), choice.instead)
        groups.append(Confounded(choice.effect, members, with_further(SEEN_EXPERIMENT, [choice.effect], telling)))
    return groups


def leading_wave(scan: Scan, tests: Sequence[NoiseTest]) -> str:
    """The wave of noise tests that explains more than the first effect of the search; empty where none does."""
    if not scan.detected:
        return ""
    gains = {candidate.effect: candidate.gain for candidate in scan.candidates}
    waves = [test for test in tests if test.shape and test.evidence > gains.get(scan.detected[0].effect, 0.0)]
    return max(waves, key=lambda test: test.evidence).effect if waves else ""


def with_further(experiment: str, members: Sequence[str], further: Sequence[FurtherRun]) -> str:
    """An experiment, with the one further run that would separate each member, and how well."""
    sentences = [run.sentence for run in further if run.effect in members]
    return "; ".join((experiment, *sentences))


def inseparable_groups(e: Evidence) -> tuple[Confounded, ...]:
    """Effects that no motion of this rig separates, as long as the model holds one of each group; on a body that turns,
    what this turning does not separate."""
    if LEVERS[0] in e.recording.side:
        return inseparable_by_turning(e.fit, e.recording)
    groups = [(base.name, base.traits.lumped) for base in BUILT_IN if base.traits.lumped]
    return tuple(
        Confounded(name, members, with_further(group.experiment, members, e.further))
        for name, group in groups
        if not any(find(member).traits.visible or member in e.model.effects for member in group.members)
        for members in [(name, *group.members)]
    )


def inseparable_by_turning(fit: Fit, recording: Recording) -> tuple[Confounded, ...]:
    """Coefficients of a turning body that the fit has as a sum alone, and the turning that separates them."""
    remedies = {name: remedy for name, (*_, remedy) in MOTIONS_THAT_TELL.items()}
    remedies = TURNS_THAT_TELL if recording.rig.arm is not None else remedies
    names, std = [e.name for e in fit.free], np.sqrt(np.diag(fit.covariance))
    tied = np.abs(fit.covariance) > AS_A_SUM * np.outer(std, std)
    return tuple(
        Confounded(name, (name, *(names[j] for j in np.flatnonzero(tied[i]) if j != i)), remedies[name])
        for i, name in enumerate(names)
        if name in remedies and np.count_nonzero(tied[i]) > 1
    )


AS_A_SUM = 0.99
"""Correlation of two estimates of a turning body from which they are told as a sum."""
Judgement = tuple[Verdict, str]
"""A verdict, and the sentence on what the model lacks."""


@dataclass(frozen=True, slots=True)
class Case:
    """Evidence of one judgement: effects that may be named, and the remarks beside them."""

    fit: Fit
    scan: Scan
    tests: Sequence[NoiseTest]
    """Significant, their effect named."""
    unnamed: Sequence[NoiseTest] = ()
    groups: Sequence[Confounded] = ()
    remarks: Sequence[Remark] = ()

    @property
    def examined(self) -> str:
        """How many candidates the search had, in words."""
        return f"{self.scan.examined} candidates examined"

    @property
    def cause(self) -> Remark | None:
        """The remark that explains the residual, the weightiest of them: those that forbid names come first."""
        causes = [note for note in self.remarks if note.place == "verdict" and not note.vetoes_adequate]
        return min(causes, key=lambda note: list(KINDS).index(note.code), default=None)

    def with_rivals(self, effect: str, text: str) -> Judgement:
        """The judgement on an effect that is present, with the effects that it is confounded with."""
        group = next(group for group in self.groups if group.effect == effect)
        others = [name for name in group.members if name != effect]
        if not others:
            return "named", f"{text}{self.scan.nearest_rival(effect)}"
        tie = f"It is confounded with {', '.join(others)} on this record; to separate them: {group.experiment}."
        return "tied", " ".join(filter(None, (text, tie, group.posterior)))


def judgement(case: Case) -> Judgement:
    """Judge what a model lacks: the first rule that applies, and nothing is adequate beside a remark that vetoes it.

    What nothing explains ends in what to do about it.
    """
    verdict, text = next(judged for rule in RULES if (judged := rule(case)) is not None)
    vetoes = [note for note in case.remarks if note.vetoes_adequate]
    codes = [note.code for note in case.remarks if note.place == "verdict" or note.code in UNSTEADY]
    codes += [note.code for note in case.fit.remarks]
    if verdict == "adequate" and vetoes:
        verdict = "unexplained"
        text = f"{'. '.join(note.sentence for note in vetoes)}. No effect explains that ({case.examined})."
    return verdict, with_next_step(text, codes) if verdict == "unexplained" else text


def too_short(case: Case) -> Judgement | None:
    """Judge a record whose blocks do not determine the scatter of scores."""
    scan, runs = case.scan, len(case.fit.runs)
    if scan.enough:
        return None
    trials = math.ceil(VERDICT_LEAST_BLOCKS * runs / scan.blocks) if scan.blocks else 0
    pooled = f"{trials}" if trials else f"more than {VERDICT_LEAST_BLOCKS * runs}"
    return (
        "too_short",
        f"The record is too short for a verdict: {scan.blocks} blocks, {VERDICT_LEAST_BLOCKS} are needed, so the "
        "search for missing effects is withheld. Trials that are fitted together add up their blocks: "
        f"{pooled} of this length are enough.",
    )


def forbidden(case: Case) -> Judgement | None:
    """Judge a record in which no effect is certain."""
    if case.cause is None or not case.cause.forbids_names:
        return None
    return "unexplained", (
        f"{case.cause.sentence}. No effect of position, time, bias or scale factor is certain beside it, so none is "
        f"named ({case.examined})."
    )


def found_by_search(case: Case) -> Judgement | None:
    """Name the effect that explains most, or the nonparametric curve that does; a wave may explain more."""
    if not case.scan.detected or leading_wave(case.scan, case.tests):
        return None
    name = case.scan.detected[0].effect
    sigmas = [f"{candidate.snr:.0f} sigma; " for candidate in case.scan.candidates if candidate.effect == name]
    evidence, effect = f"({''.join(sigmas[:1])}{case.examined})", find(name)
    if not effect.family:
        text = f"{name} explains what the model lacks {evidence}.{random_variation(case.scan.detected[0])}"
        verdict, text = case.with_rivals(name, text)
        return verdict, text + declared_as(name)
    return (
        "shape",
        f"No named effect explains what the model lacks; a nonparametric curve does: {effect.summary} {evidence}.",
    )


def random_variation(process: DetectedEffect) -> str:
    """The sentence on how a random process varies and what it may follow; empty for other effects."""
    effect = find(process.effect)
    if effect.port != "process" or process.prior_std is None:
        return ""
    followed = [name for name in process.members if find(name).mechanism or find(name).needs]
    unexplained = "; no recorded quantity explains it" if effect.traits.changes in CARRIERS else ""
    why = f"; {' or '.join(followed)} may be why" if followed else unexplained
    return f" That is no cause: {varies(effect.traits.changes, process.prior_std, process.shape)}{why}."


def found_by_tests(case: Case) -> Judgement | None:
    """Name the wave that explains more than the search, or the effect of the first significant noise test."""
    wave = leading_wave(case.scan, case.tests)
    named = [test for test in case.tests if test.effect == wave or (not wave and test.effect != WHITENESS)]
    if not named:
        return None
    text = named[0].sentence
    return case.with_rivals(named[0].effect, f"{text[0].upper()}{text[1:]} ({case.examined}).")


def no_one_size(case: Case) -> Judgement | None:
    """Judge a residual that only an effect without one size would explain."""
    unsteady = [note.sentence for note in case.remarks if note.code in UNSTEADY]
    return ("unexplained", f"{unsteady[0]} ({case.examined}).") if unsteady else None


def made_by_motion(case: Case) -> Judgement | None:
    """Judge noise that a missing effect of the motion may be behind."""
    if not case.unnamed:
        return None
    text = case.unnamed[0].sentence
    why = f"where the motion may make one, and no candidate explains it ({case.examined})"
    return "unexplained", f"{text[0].upper()}{text[1:]}, {why}."


def unlike_runs(case: Case) -> Judgement | None:
    """Judge what differs between runs that are adequate in themselves."""
    fit = case.fit
    if fit.seen_by_runs:
        text = fit.seen_by_runs[0].sentence
        return "tied", f"{text[0].upper()}{text[1:]} ({case.examined})."
    unlike = [spread.sentence(fit[spread.name].value) for spread in fit.spreads if spread.p_value < REMARK_ALPHA]
    within_runs = f"Within each run the model lacks no effect ({case.examined})."
    return ("adequate", f"{'; '.join(unlike)}. {within_runs}") if unlike else None


def explained(case: Case) -> Judgement | None:
    """Judge a residual that a remark explains without an effect of the sensor."""
    if case.cause is None:
        return None
    text = f"{NOTHING_MISSING} in the sensor ({case.examined}). {case.cause.sentence}."
    return unlike_runs(case) or ("adequate", text)


def too_noisy(case: Case) -> Judgement | None:
    """Judge a residual above the data sheet, or one that is not white."""
    ratio = noise_ratio(case.fit)
    if ratio > DATA_SHEET_NOISE_RATIO:
        noise = f"{ratio:.2g} times the sensor noise of the data sheet"
        return "unexplained", f"The residual is {noise} and no candidate explains it ({case.examined})."
    if case.tests or any(run.noise.band is not None for run in case.fit.runs):
        return "unexplained", f"The residual is not white and no candidate explains it ({case.examined})."
    return None


def adequate(case: Case) -> Judgement:
    """Judge a model that lacks nothing."""
    limits = "the detection limits say how small an effect would have been found"
    return "adequate", f"{NOTHING_MISSING} ({case.examined}); {limits}."


RULES: tuple[Callable[[Case], Judgement | None], ...] = (
    too_short,
    forbidden,
    found_by_search,
    found_by_tests,
    no_one_size,
    made_by_motion,
    explained,
    too_noisy,
    unlike_runs,
    adequate,
)
"""Rules in the order in which they are tried; the last applies to every case."""


@immutable
@dataclass(frozen=True, slots=True)
class AxesDiagnosis(Result):
    """Diagnoses of the three outputs of a sensor, examined together at one false-alarm rate."""

    derived: ClassVar[tuple[str, ...]] = ("verdict", "sentence", "effects")

    axes: tuple[str, ...]
    by_axis: tuple[Diagnosis, ...]
    """One for each axis, in the same order."""

    def __getitem__(self, axis: str) -> Diagnosis:
        """Return the diagnosis of one axis."""
        return self.by_axis[self.axes.index(axis)]

    def __repr__(self) -> str:
        return f"AxesDiagnosis({self.verdict}: {self.sentence})"

    @property
    def verdict(self) -> str:
        """Verdict of the axis that lacks most; "adequate" where none lacks anything."""
        lacking = [judged for judged in self.by_axis if judged.verdict != "adequate"]
        return max(lacking, key=strength).verdict if lacking else "adequate"

    @property
    def sentence(self) -> str:
        """Sentence on the axes that were examined, and on what each lacks."""
        examined = " and ".join((", ".join(self.axes[:-1]), self.axes[-1]))
        sentences = [f"{a}: {judged.sentence}" for a, judged in zip(self.axes, self.by_axis, strict=True)]
        return f"Axes {examined} examined together. " + " ".join(sentences)

    @property
    def effects(self) -> tuple[str, ...]:
        """Effects that would enter, those of the sensor with their axis (cubic_on_y), what lacks most first; one that
        all axes lack stands without."""
        pairs = sorted(zip(self.axes, self.by_axis, strict=True), key=lambda pair: -strength(pair[1]))
        return tuple(dict.fromkeys(self.entering(axis, name) for axis, judged in pairs for name in judged.effects))

    def entering(self, axis: str, name: str) -> str:
        """Name under which an effect that one axis lacks enters the model of all axes."""
        common = set.intersection(*(set(judged.effects) for judged in self.by_axis))
        shared = name in common or find(name).owner not in ("sensor", "mounting")
        return name if shared else on_axis(find(name), axis).name


def strength(judged: Diagnosis) -> float:
    """Equivalent standard deviations of the first candidate of a diagnosis that lacks something; 0 of any other."""
    candidates = judged.scan.candidates
    return candidates[0].snr if judged.verdict != "adequate" and candidates else 0.0


def diagnose_axes(
    fit: Fit,
    recordings: Sequence[Recording],
    diagnose: Callable[..., Diagnosis],
    progress: Callable[[float], None],
    *,
    alpha: float,
    **settings: object,
) -> AxesDiagnosis:
    """Say what a model lacks on each output of a sensor, at one false-alarm rate over all of them.

    Parameters
    ----------
    fit : of all outputs together; what they share is held by it, as far as it is known.
    recordings : of each axis one or several.
    diagnose : examines one axis.
    progress : called with the share of the work that is done, 0 to 1.
    alpha : of all axes together; each has its share.
    settings : of `diagnose`.

    Raises
    ------
    AccelcalError
        If some of the recordings are of a sensor with one output.
    """
    axes = tuple(dict.fromkeys(recording.axis for recording in recordings))
    if "" in axes:
        raise AccelcalError(
            "recordings of one output and of an axis of three in one diagnosis; give the axes of load_axes, or "
            "recordings of one output alone"
        )
    judged = []
    for axis, share in zip(axes, parts_of(progress, len(axes)), strict=True):
        runs = [recording for recording in recordings if recording.axis == axis]
        judged.append(diagnose(fit.of_axis(axis), runs, alpha=alpha / len(axes), progress=share, **settings))
    return AxesDiagnosis(axes, tuple(judged))
