"""Stepwise selection: from the base model to one whose residual explains nothing further, effect by effect."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from types import MappingProxyType

from accelcal.diagnosis.clean_fit import CHANNEL_OF, CleanFit, clean_fit
from accelcal.diagnosis.evidence import DELAY_CLASS, DELAY_EXPERIMENT, Evidence, delay_is_significant
from accelcal.diagnosis.faults import TimeSpan
from accelcal.diagnosis.findings import Confounded, explained_gain, with_findings, with_next_step
from accelcal.diagnosis.noise.fitted import noise_shown, with_noise_effects
from accelcal.diagnosis.policy import (
    NAMED_ALTERNATIVES,
    SEARCH_MODELS,
    VERDICT_LEAST_BLOCKS,
)
from accelcal.diagnosis.search.confounding import DetectedEffect, with_members
from accelcal.diagnosis.search.scan import Candidate, scan
from accelcal.diagnosis.select.collinearity import (
    Replacement,
    confounding_families,
    families_with_remainder,
    family_replacing,
    family_replacing_sum,
    implausible,
    log_significance,
    random_process_replacing,
    sum_families,
    unconfirmed,
    undetermined,
)
from accelcal.diagnosis.select.cross_validation import cross_validate, refusing
from accelcal.diagnosis.verdict import Diagnosis, leading_wave, verdict_on
from accelcal.effects import Effect, SizePrior, find, stem_of
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.gauss_newton import Solution
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run import PreparedRun
from accelcal.model import Model, Term
from accelcal.validation.systematic import evaluated


@dataclass(slots=True)
class SearchBudget:
    """Models that a search may fit and judge, and those that it has: a count, so that every machine ends at the same
    one."""

    most: int = SEARCH_MODELS
    models: int = 1
    """The base model included."""
    stopped: bool = False
    """Whether a model was not begun."""

    def allows_another(self) -> bool:
        """Whether one more model may be begun; it is then counted."""
        self.stopped = self.models >= self.most
        self.models += not self.stopped
        return not self.stopped


@dataclass(slots=True)
class SelectionHistory:
    """Effects that have entered a model, in order, each with its confounding class and what it explained."""

    classes: list[Confounded] = field(default_factory=list)
    gains: dict[str, float] = field(default_factory=dict)
    """Twice the log-likelihood that each explained when it entered."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names, in the order of entry."""
        return tuple(group.effect for group in self.classes)

    def copy(self) -> SelectionHistory:
        """The history so far, which what enters later leaves as it is."""
        return SelectionHistory([*self.classes], dict(self.gains))

    @property
    def entered(self) -> int:
        """Number of effects; several waves of one count once."""
        return len({stem_of(find(name)) for name in self.effects})

    def full(self, most: int) -> str:
        """Why nothing more enters where at most so many effects are to; empty where there is room."""
        if self.entered >= most:
            return f"at most {most} effects are added"
        return f"at most {2 * most} effects and waves are added" if len(self.classes) >= 2 * most else ""

    def enter(self, finding: DetectedEffect, gain: float, replaced: Sequence[str] = ()) -> None:
        """Add an effect; a nonparametric curve replaces the effects that it covers."""
        leaving = dict.fromkeys((*replaced, finding.effect))  # itself where it was coarse
        self.gains[finding.effect] = gain + sum(self.leave(name) for name in leaving)
        self.classes.append(
            Confounded(finding.effect, finding.members, finding.experiment, finding.parts, finding.weights)
        )

    def leave(self, name: str) -> float:
        """Remove an effect if it is present; return what it explained."""
        self.classes = [group for group in self.classes if group.effect != name]
        return self.gains.pop(name, 0.0)

    def final_classes(self, remaining: Sequence[Candidate], last: Fit | None = None) -> list[Confounded]:
        """Confounding class of every effect once nothing more enters.

        `last` is the last fit, `remaining` what it leaves unexplained.
        """
        gains_given_others = {name: explained_gain(last, name)[0] for name in self.gains} if last else {}
        gains = {name: min(gain, gains_given_others.get(name, gain)) for name, gain in self.gains.items()}
        return [
            group.with_members(
                (
                    *sum_families(
                        group.effect,
                        [group.effect, *(name for o in self.classes if o is not group for name in o.members)],
                    ),
                    *confounding_families(group.effect, gains),
                    *families_with_remainder(group.effect, remaining),
                )
            )
            for group in self.classes
        ]


@dataclass(frozen=True, slots=True)
class JudgedModel:
    """A model fitted without outliers, and the verdict on it."""

    fitted: CleanFit
    verdict: Diagnosis

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.fitted.solution.model


@dataclass(slots=True)
class StepwiseSelection:
    """State of a stepwise selection: the current model, its history, and the steps that change it."""

    original: Sequence[PreparedRun]
    stretch: TimeSpan
    split: float
    """End of the data that are fitted, s."""
    extra: Sequence[Effect] | None
    alpha: float
    current: JudgedModel
    examined: int
    """Alternatives examined so far."""
    budget: SearchBudget
    priors: Mapping[str, SizePrior] | None = field(default_factory=dict)
    """Of sizes by effect, as of `scan`."""
    history: SelectionHistory = field(default_factory=SelectionHistory)
    past: list[tuple[JudgedModel, SelectionHistory]] = field(default_factory=list)
    """Every model so far, the base first, with the history that led to it."""
    refused: dict[str, Remark] = field(default_factory=dict)
    """Effects that were kept out of the model or taken out of it, each with the remark that says why."""
    classes: list[Confounded] = field(default_factory=list)
    """Once nothing more enters: confounding class of each effect, those of a delay and of the noise included."""
    steps: list[tuple[tuple[str, ...], Fit]] = field(default_factory=list)
    """Then: every model by the effects that it has, the base first."""

    @classmethod
    def begin(
        cls,
        original: Sequence[PreparedRun],
        stretch: TimeSpan,
        split: float,
        extra: Sequence[Effect] | None,
        alpha: float,
        budget: SearchBudget,
        priors: Mapping[str, SizePrior] | None = MappingProxyType({}),
    ) -> StepwiseSelection:
        """Start from the base model, fitted and judged."""
        fitted = clean_fit(original, lambda these: solve(Model.linear(), these, stretch, split))
        current = JudgedModel(fitted, verdict_on(Evidence(fitted, stretch, extra, alpha, midway=True, priors=priors)))
        return cls(
            original,
            stretch,
            split,
            extra,
            alpha,
            current,
            current.verdict.scan.examined,
            budget,
            priors,
            past=[(current, SelectionHistory())],
        )

    def grow(self, most: int, on_step: Callable[[Fit], None], progress: Callable[[float], None]) -> None:
        """Add effects, at most so many, or replace them by curves until nothing is to enter; each model is reported."""
        progress(0.0)
        on_step(self.current.verdict.fit)
        for number in range(2 * most):
            room = self.history.entered < most
            if not (room and self.add_next()) and not self.replace_by_family():
                break
            on_step(self.current.verdict.fit)
            progress(min(1.0, (number + 1) / most))
        self.finish()

    def add_next(self) -> bool:
        """Add one effect and remove what it shows to be wrong or redundant; False where nothing is to enter, or can."""
        verdict = self.current.verdict
        gains = {candidate.effect: candidate.gain for candidate in reversed(verdict.scan.candidates)}
        waves = {test.effect: test.evidence for test in reversed(verdict.channels) if test.shape}
        ways = [self.with_next, self.with_wave]
        if leading_wave(verdict.scan, verdict.channels):
            ways.reverse()
        step = next((step for step in (way() for way in ways) if step is not None), None)
        if step is None:
            return False
        entering, judged = step
        self.accept(judged)
        gain = {**waves, **gains}.get(entering.effect, 0.0)
        replaced: tuple[str, ...] = ()
        for replacement in (
            family_replacing(self.current.verdict.fit, entering.effect, entering.members),
            random_process_replacing(
                [group.members for group in self.history.classes], entering.effect, entering.members
            ),
        ):
            step = self.substitute(replacement) if replacement and not replaced else None
            if replacement and step:
                (entering, judged), replaced = step, replacement.replaced
                self.accept(judged)
        self.history.enter(entering, gain, replaced)
        earlier = () if find(entering.effect).family else self.history.effects[:-1]
        for name in (name for name in earlier if self.may_be_redundant(name)):
            smaller = self.without(name)
            if smaller:
                self.accept(smaller)
                self.history.leave(name)
        self.past.append((self.current, self.history.copy()))
        return True

    def replace_by_family(self) -> bool:
        """Replace an incomplete sum of effects by the curve of their variable; False where there is none, or no fit of
        one."""
        replacement = family_replacing_sum(self.history.effects, self.current.verdict.scan.candidates)
        step = self.substitute(replacement) if replacement else None
        if replacement is None or step is None:
            return False
        self.take(step, 0.0, replacement.replaced)
        return True

    def finish(self) -> None:
        """Assign every effect its confounding class, once nothing more enters, and list the models."""
        verdict = self.current.verdict
        fits = [(history.effects, judged.verdict.fit) for judged, history in self.past]
        if not verdict.nameable:
            self.classes, self.steps = [], fits[:1]
            return
        self.classes, self.steps = self.history.final_classes(verdict.scan.candidates, verdict.fit), fits
        if delay_is_significant(verdict.fit, verdict.scan, self.alpha):
            undelayed = result(solve(without_delay(self.original), self.current.fitted.runs, self.stretch, self.split))
            self.classes.insert(0, Confounded("time_offset", DELAY_CLASS, DELAY_EXPERIMENT))
            self.steps = [((), undelayed), *((("time_offset", *names), fitted) for names, fitted in fits)]
        in_noise = {test.effect for test in verdict.channels if not test.shape}  # a wave enters, or is missing
        found_by_tests = in_noise - {group.effect for group in self.classes}
        tested = {group.effect: group for group in verdict.classes if group.effect in found_by_tests}
        if tested:  # a jump is no part of a model: every fit begins anew behind it
            fitted = self.with_noise([name for name in tested if find(name).port == "noise"])
            # one that the search names too has two groups
            shown = [group for name, group in tested.items() if name not in self.refused]
            self.classes += shown
            if shown:
                self.steps.append((tuple(group.effect for group in self.classes), fitted))

    def withdraw(self, note: Remark) -> None:
        """Go back to the model before an effect entered, for which a remark says why; a rival may enter in its place,
        and what entered after it or a rival of that, but nothing else."""
        name = str(note.values["effect"])
        self.refused = {effect: why for effect, why in self.refused.items() if why.code != "noise_not_shown"}
        self.refused[name] = note
        entered = [group.effect for group in self.history.classes]
        anew = [group.members for group in self.history.classes[entered.index(name) :]]
        self.past = [(judged, history) for judged, history in self.past if name not in history.effects]
        self.current, self.history = self.past[-1][0], self.past[-1][1].copy()
        for members in anew:
            gains = {candidate.effect: candidate.gain for candidate in self.current.verdict.scan.candidates}
            step = self.with_next(members)
            if step is not None:
                self.take(step, gains.get(step[0].effect, 0.0))
        self.finish()

    def take(self, step: tuple[DetectedEffect, JudgedModel], gain: float, replaced: Sequence[str] = ()) -> None:
        """Go on with a model that has one effect more, in place of those that it replaces."""
        entering, judged = step
        self.accept(judged)
        self.history.enter(entering, gain, replaced)
        self.past.append((self.current, self.history.copy()))

    def with_noise(self, names: Sequence[str]) -> Fit:
        """The last fit with effects on its noise; those that it does not show are refused."""
        if not names:
            return self.current.verdict.fit
        solution = solve(self.current.model.add(*names), self.current.fitted.runs, self.stretch, self.split)
        fit = with_noise_effects(result(solution), self.original, solution.states)
        shown = [name for name in names if noise_shown(fit, name)]
        self.refused |= {name: remark("noise_not_shown", effect=name) for name in names if name not in shown}
        return fit if len(shown) == len(names) else self.with_noise(shown)

    def judge_with(self, other: PreparedRun) -> None:
        """Judge the last model on a further run as well, which took no part in what entered and in its estimates."""
        last, runs = self.current, [*self.current.fitted.runs, other]
        on_all = self.judge(clean_fit(runs, lambda these: solve(last.model, these, self.stretch, self.split)))
        verdict = self.with_coasting(on_all)
        self.accept(replace(last, verdict=replace(verdict, fit=last.verdict.fit, used=last.verdict.used)))

    def with_coasting(self, judged: JudgedModel) -> Diagnosis:
        """The verdict on a model with its errors of coasting and by region, which no step of the search needs."""
        fit, run = judged.verdict.fit, judged.fitted.runs[0]
        return replace(judged.verdict, where=evaluated(fit, run, self.stretch.start, self.stretch.end))

    def final_verdict(self, reason: str) -> Diagnosis:
        """The verdict on the last model; an effect that it lacks and that was not added is named as such.

        Parameters
        ----------
        reason : why nothing more was added.
        """
        verdict = self.current.verdict
        verdict = verdict if verdict.where.drifts else self.with_coasting(self.current)
        kept_out = tuple(note for name, note in self.refused.items() if name not in self.current.model.effects)
        verdict = replace(verdict, remarks=(*verdict.remarks, *kept_out))
        if self.budget.stopped:
            reason = "the search was stopped"
            stop = remark("search_stopped", models=self.budget.models)
            verdict = replace(verdict, remarks=(*verdict.remarks, stop))
        sigmas = {test.effect: math.sqrt(test.evidence) for test in reversed(verdict.channels) if test.shape}
        sigmas |= {finding.effect: 0.0 for finding in verdict.scan.detected} | {
            c.effect: c.snr for c in verdict.scan.candidates
        }
        lacking = [effect.effect for effect in verdict.scan.detected] or [t.effect for t in verdict.channels if t.shape]
        if not lacking:
            return verdict
        missing = lacking[0]
        sigma = sigmas[missing]
        if missing in self.refused:
            reason = REASONS[self.refused[missing].code]
        note = remark("not_added", effect=missing, sigma=sigma, reason=reason)
        causes = [cause for cause in verdict.remarks if cause.place == "verdict"]
        left = f"{note.sentence} ({verdict.scan.examined} candidates examined)."
        left = " ".join([left, *(f"{cause.sentence}." for cause in causes)])
        left = with_next_step(left, [*(cause.code for cause in causes), note.code])
        return replace(
            verdict,
            verdict="unexplained",
            sentence=with_findings(verdict.present, left, verdict.fit.rig.tolerance),
            left=left,
            remarks=(*verdict.remarks, note),
        )

    def accept(self, model: JudgedModel) -> None:
        """Make a judged model the current one."""
        self.current = model
        self.examined += model.verdict.scan.examined

    def refit(self, model: Model, *, anew: bool = False) -> CleanFit:
        """Fit a model to the readings that are kept, or with outliers of all readings rejected `anew`."""
        earlier_tests = (
            [] if anew else [test for test in self.current.fitted.tests if test.effect in CHANNEL_OF and test.at]
        )
        runs = self.original if anew else self.current.fitted.runs
        return clean_fit(runs, lambda these: solve(model, these, self.stretch, self.split), earlier_tests)

    def judge(self, fitted: CleanFit) -> JudgedModel:
        """A fitted model with the verdict on it."""
        evidence = Evidence(fitted, self.stretch, self.extra, self.alpha, midway=True, priors=self.priors)
        return JudgedModel(fitted, verdict_on(evidence))

    def with_next(self, among: Sequence[str] | None = None) -> tuple[DetectedEffect, JudgedModel] | None:
        """The judged fit with the effect that comes first, or with a rival of it where it is refused, or with the next
        of its set; None where there is none. With `among` only these may enter.

        A nonparametric curve gives way to a named effect of its class. A rival enters if the fit with it leaves nothing
        to explain for what came first and for all that is confounded with that.
        """
        scan = self.current.verdict.scan
        lead, rivals = scan.detected[:1], scan.rivals[:NAMED_ALTERNATIVES]
        first = {finding.effect for finding in lead or scan.changing[:1]}
        curve = any(find(name).family for name in first)
        for finding in (*rivals, *scan.detected) if curve else (*lead, *(rivals if lead else ()), *scan.detected[1:]):
            if finding.effect in self.refused or (among is not None and finding.effect not in among):
                continue
            # readings that an error of the encoder moves pass for outliers: with it they are tested anew
            anew = "instant" in finding.shape or find(finding.effect).port == "position"
            judged = self.tried(finding, anew=anew)
            if judged is not None and (
                finding in scan.detected or not any(first & {*rest.members} for rest in judged.verdict.scan.detected)
            ):
                return finding, judged
        return None

    def with_wave(self) -> tuple[DetectedEffect, JudgedModel] | None:
        """The judged fit with the first wave that noise tests found, from where they found it; None where there is
        none, or no fit with it is possible."""
        verdict = self.current.verdict
        tests = [test for test in verdict.channels if test.shape and test.effect not in self.refused]
        if not tests:
            return None
        test = tests[0]
        group = next(group for group in verdict.classes if group.effect == test.effect)
        entering = DetectedEffect(test.effect, test.shape, with_members({}, group.members), group.experiment)
        judged = self.tried(entering)
        return None if judged is None else (entering, judged)

    def tried(self, entering: DetectedEffect, *, anew: bool = False) -> JudgedModel | None:
        """The judged fit with an effect more; None where no fit is possible, one of its checks refuses it, or the
        budget is used up."""
        with suppress(ValueError):
            if self.budget.allows_another():
                return self.admitted(self.refit(entering.enter(self.current.model), anew=anew), entering.effect)
        return None

    def admitted(self, fitted: CleanFit, name: str, leaving: Sequence[str] = ()) -> JudgedModel | None:
        """The judged fit with an effect that entered; None where cross-validation or plausibility refuses it.

        The held-out data take no part.
        """
        terms = tuple(term for term in self.current.model.free if term.effect.name in leaving)
        note = validation_rises(fitted.solution, name, terms) or undetermined(name, fitted.solution)
        if note is None:
            judged = self.judge(fitted)
            scan = judged.verdict.scan
            note = implausible(name, judged.verdict.sizes.get(name), [run.recording for run in fitted.runs])
            note = note or unconfirmed(name, judged.verdict.fit, self.current.verdict.scan.examined, self.alpha)
            for beside in (beside for beside in judged.verdict.remarks if beside.code == "implausible_scale"):
                note = note or remark("implausible_beside", effect=name, scale=beside.values["scale"])
            if not scan.enough:
                note = remark("too_short_with", effect=name, blocks=scan.blocks, least=VERDICT_LEAST_BLOCKS)
            if note is None:
                return judged
        self.refused[name] = note
        return None

    def substitute(self, replacement: Replacement) -> tuple[DetectedEffect, JudgedModel] | None:
        """The judged fit with an effect in place of others; None where no fit is possible or the fit leaves something
        to explain: to one of them or, for a curve, to an effect of its variable; for a random process, to any
        effect."""
        leaving = dict.fromkeys((*replacement.replaced, replacement.effect.name))
        if not self.budget.allows_another():
            return None
        try:
            model = self.current.model.drop(*(name for name in leaving if name in self.current.model.effects))
            requested = scan(self.refit(model).solution.states, model, extra=self.extra, only=(replacement.effect,))
            if not requested.entered:
                return None
            judged = self.admitted(
                self.refit(requested.entered[0].enter(model)), replacement.effect.name, replacement.replaced
            )
        except ValueError:
            return None
        if judged is None:
            return None
        left = {finding.effect for finding in judged.verdict.scan.detected}
        if left & {*replacement.effect.covers, *replacement.replaced} or (
            left and replacement.effect.port == "process"
        ):
            return None
        return replace(requested.entered[0], weights=with_members({}, replacement.members)), judged

    def without(self, name: str) -> JudgedModel | None:
        """The judged fit without an effect that entered before others; None where that fit asks for it again."""
        with suppress(ValueError):
            if self.budget.allows_another():
                judged = self.judge(self.refit(self.current.model.drop(name)))
                return None if any(name in finding.members for finding in judged.verdict.scan.detected) else judged
        return None

    def may_be_redundant(self, name: str) -> bool:
        """Whether later effects may explain what an effect did: any curve may be, a named effect if it is no longer
        significant."""
        if find(name).family is not None:
            return True
        verdict = self.current.verdict
        return log_significance(verdict.fit, name) > math.log(self.alpha / verdict.scan.examined)


REASONS = {
    "validation_rises": "the error on left-out blocks rises with it",
    "validation_not_better": "the error on left-out blocks does not fall with it",
    "implausible": "it would be larger than is physically possible",
    "implausible_beside": "the scale factor beside it would be that of no working sensor",
    "undetermined": "beside the other parameters it explains no more than chance",
    "unconfirmed": "the fit with it does not confirm it",
    "too_short_with": "the record is too short for a verdict on the model with it",
    "noise_not_shown": "the fit with it does not show it",
    "contradicted": "it is contradicted by the held-out record",
}
"""Why an effect was kept out of the model, by the code of its remark."""


def validation_rises(solution: Solution, name: str, leaving: Sequence[Term] = ()) -> Remark | None:
    """The remark on an effect that cross-validation refuses; None where it may enter."""
    worst = refusing(cross_validate(solution, (name,), leaving))
    if worst is None:
        return None
    return remark(
        "validation_rises" if worst.rises else "validation_not_better",
        effect=name,
        measure=worst.measure,
        percent=100.0 * (worst.ratio - 1.0),
        sigma=worst.sigma,
        blocks=worst.blocks,
    )


def solve(model: Model, runs: Sequence[PreparedRun], stretch: TimeSpan, end: float) -> Solution:
    """Fit a model to the usable part of the first recording, up to the held-out data, and to the others as a whole."""
    return solve_runs(model, runs, start=stretch.start, end=end, others_whole=not stretch.chosen)


def without_delay(runs: Sequence[PreparedRun]) -> Model:
    """The base model without any delay: neither an offset of the clocks nor a slower low-pass."""
    if any(run.rig.lowpass_prior > 0.0 for run in runs):
        return Model.linear().add("lowpass_error").freeze(time_offset=0.0, lowpass_error=0.0)
    return Model.linear().freeze(time_offset=0.0)
