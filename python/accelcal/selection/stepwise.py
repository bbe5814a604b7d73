"""The walk of `improve`: the model as it stands, and every step that may bring it to one that leaves nothing."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace

from accelcal.data.recording import Recording
from accelcal.diagnosis.outlier_rejection import CHANNEL_OF, CleanFit, clean_fit
from accelcal.diagnosis.policy import NAMED_ALTERNATIVES
from accelcal.diagnosis.search.confounding import DetectedEffect
from accelcal.diagnosis.search.scan import Candidate, scan
from accelcal.diagnosis.verdict import (
    DELAY_CLASS,
    DELAY_EXPERIMENT,
    Confounded,
    Diagnosis,
    TimeSpan,
    delayed,
    verdict_on,
)
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit, result, solve_runs
from accelcal.estimation.gauss_newton import NotIdentifiable, Solution
from accelcal.model import Model
from accelcal.selection.collinearity import (
    Replacement,
    confounding_families,
    explained,
    family_replacing,
    family_replacing_sum,
    not_the_whole,
    random_bias_replacing,
    significance,
    sum_families,
)


@dataclass(slots=True)
class SelectionHistory:
    """What has entered a model so far, in order, each with its class and what it explained."""

    ties: list[Confounded] = field(default_factory=list)
    gains: dict[str, float] = field(default_factory=dict)
    """Twice the log-likelihood that each explained when it entered."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names, in the order of entry."""
        return tuple(tie.effect for tie in self.ties)

    def enter(self, finding: DetectedEffect, gain: float, worn: Sequence[str] = ()) -> None:
        """One effect more; a shape without a name stands in the place of the names that it wears out."""
        gone = dict.fromkeys((*worn, finding.effect))  # itself where it was coarse
        self.gains[finding.effect] = gain + sum(self.leave(name) for name in gone)
        self.ties.append(Confounded(finding.effect, finding.members, finding.experiment))

    def leave(self, name: str) -> float:
        """One effect less, if it is there; what it explained."""
        self.ties = [tie for tie in self.ties if tie.effect != name]
        return self.gains.pop(name, 0.0)

    def told(self, left: Sequence[Candidate], last: Fit | None = None) -> list[Confounded]:
        """Every effect with its class, once nothing more enters, the model is fitted a last time, and `left` is what it
        leaves over."""
        beside = {name: explained(last, name)[0] for name in self.gains} if last else {}
        gains = {name: min(gain, beside.get(name, gain)) for name, gain in self.gains.items()}
        return [
            tie.beside(
                (
                    *sum_families(
                        tie.effect, [tie.effect, *(name for o in self.ties if o is not tie for name in o.members)]
                    ),
                    *confounding_families(tie.effect, gains),
                    *not_the_whole(tie.effect, left),
                )
            )
            for tie in self.ties
        ]


@dataclass(frozen=True, slots=True)
class JudgedModel:
    """Where a walk stands: a model fitted without wild readings, and the verdict on it."""

    state: CleanFit
    verdict: Diagnosis

    @property
    def model(self) -> Model:
        """The fitted model."""
        return self.state.solution.model


@dataclass(slots=True)
class StepwiseSelection:
    """From the base model to one that leaves nothing, effect by effect."""

    original: Sequence[Recording]
    stretch: TimeSpan
    split: float
    """End of what is fitted, s."""
    extra: Sequence[Effect]
    alpha: float
    at: JudgedModel
    examined: int
    """Alternatives that were looked at on the way."""
    fits: list[tuple[tuple[str, ...], Fit]]
    """Every model on the way, by the effects that it has."""
    story: SelectionHistory = field(default_factory=SelectionHistory)

    @classmethod
    def begin(
        cls, original: Sequence[Recording], stretch: TimeSpan, split: float, extra: Sequence[Effect], alpha: float
    ) -> StepwiseSelection:
        """At the base model, fitted and judged."""
        state = clean_fit(original, lambda these: solve(Model.linear(), these, stretch.start, split))
        at = JudgedModel(state, verdict_on(state, stretch, extra, alpha))
        return cls(original, stretch, split, extra, alpha, at, at.verdict.scan.examined, [((), at.verdict.fit)])

    def step(self) -> bool:
        """One effect enters, and what it shows to be wrong or idle leaves; False where nothing is to enter, or can."""
        known = self.at.verdict.scan.candidates
        step = self.entered() if self.at.verdict.scan.found else None
        if step is None:
            return False
        entering, to = step
        self.go(to)
        explained = next((one.gain for one in known if one.effect == entering.effect), 0.0)
        worn: tuple[str, ...] = ()
        for mend in (
            family_replacing(self.at.verdict.fit, entering.effect, entering.members),
            random_bias_replacing([tie.members for tie in self.story.ties], entering.effect, entering.members),
        ):
            step = self.instead(mend) if mend and not worn else None
            if mend and step:
                (entering, to), worn = step, mend.worn
                self.go(to)
        self.story.enter(entering, explained, worn)
        earlier = () if find(entering.effect).family else self.story.effects[:-1]
        for name in (name for name in earlier if self.doubtful(name)):
            lean = self.leaner(name)
            if lean:
                self.go(lean)
                self.story.leave(name)
        self.fits.append((self.story.effects, self.at.verdict.fit))
        return True

    def mend(self) -> bool:
        """A sum of names that is not the whole gives way to the shape of its variable; False where none is, or can."""
        mend = family_replacing_sum(self.story.effects, self.at.verdict.scan.candidates)
        step = self.instead(mend) if mend else None
        if mend is None or step is None:
            return False
        entering, to = step
        self.go(to)
        self.story.enter(entering, 0.0, mend.worn)
        self.fits.append((self.story.effects, self.at.verdict.fit))
        return True

    def finish(self) -> None:
        """Nothing more enters: every effect gets its class."""
        verdict = self.at.verdict
        self.story.ties = self.story.told(verdict.scan.candidates, verdict.fit)
        if delayed(self.fits[-1][1], verdict.scan, self.alpha):
            held = result(solve(undelayed(self.original), self.at.state.recordings, self.stretch.start, self.split))
            self.story.ties.insert(0, Confounded("time_offset", DELAY_CLASS, DELAY_EXPERIMENT))
            self.fits = [((), held), *((("time_offset", *names), one) for names, one in self.fits)]
        heard_of = {test.effect for test in verdict.channels} - set(self.story.effects)
        self.story.ties += [tie for tie in verdict.classes if tie.effect in heard_of]
        self.fits[-1] = (self.story.effects, self.fits[-1][1])

    def go(self, to: JudgedModel) -> None:
        """Stand elsewhere."""
        self.at = to
        self.examined += to.verdict.scan.examined

    def refitted(self, model: Model, *, anew: bool = False) -> CleanFit:
        """A model fitted to the readings that are kept, or that are chosen `anew` among all."""
        told = [] if anew else [test for test in self.at.state.tests if test.effect in CHANNEL_OF and test.at]
        kept = self.original if anew else self.at.state.recordings
        return clean_fit(kept, lambda these: solve(model, these, self.stretch.start, self.split), told)

    def judged(self, state: CleanFit) -> JudgedModel:
        """A fitted model with the verdict on it."""
        return JudgedModel(state, verdict_on(state, self.stretch, self.extra, self.alpha))

    def entered(self) -> tuple[DetectedEffect, JudgedModel] | None:
        """The fit with the effect that comes first, judged; None where no fit is possible.

        A shape without a name gives way to a named effect of its class whose fit leaves nothing for it, nor for
        anything that cannot be told from it.
        """
        found = self.at.verdict.scan
        first = found.found[0]
        for finding in (*found.named[:NAMED_ALTERNATIVES], first):
            try:
                # readings beside a jump that is not in the model look wild: they are judged anew once it is
                grown = self.judged(self.refitted(finding.enter(self.at.model), anew="instant" in finding.shape))
            except (NotIdentifiable, ValueError):
                continue
            if finding is first or not any(first.effect in left.members for left in grown.verdict.scan.found):
                return finding, grown
        return None

    def instead(self, mend: Replacement) -> tuple[DetectedEffect, JudgedModel] | None:
        """The fit with an effect in the place of others, judged; None where no fit is possible, or where it leaves
        something to explain: to one of them or, if it is a shape, to a name of its variable; if it wanders, to any."""
        gone = dict.fromkeys((*mend.worn, mend.effect.name))
        try:
            model = self.at.model.drop(*(name for name in gone if name in self.at.model.effects))
            alone = scan(self.refitted(model).solution.passes, model, extra=self.extra, only=(mend.effect,))
            if not alone.entered:
                return None
            grown = self.judged(self.refitted(alone.entered[0].enter(model)))
        except (NotIdentifiable, ValueError):
            return None
        left = {one.effect for one in grown.verdict.scan.found}
        if left & {*mend.effect.covers, *mend.worn} or (left and mend.effect.port == "process"):
            return None
        return replace(alone.entered[0], members=mend.members), grown

    def leaner(self, name: str) -> JudgedModel | None:
        """The fit without an effect that entered before others, judged; None where it is still asked for."""
        try:
            left = self.judged(self.refitted(self.at.model.drop(name)))
        except (NotIdentifiable, ValueError):
            return None
        return None if any(name in one.members for one in left.verdict.scan.found) else left

    def doubtful(self, name: str) -> bool:
        """Whether an effect may have stood for those that entered after it: a shape may, a name if it lost its size."""
        effect = find(name)
        if effect.family or effect.port == "process":
            return effect.family is not None
        verdict = self.at.verdict
        return significance(verdict.fit, name) > math.log(self.alpha / verdict.scan.examined)


def solve(model: Model, recordings: Sequence[Recording], start: float, end: float) -> Solution:
    """A model fitted up to where held-out data begin; a single recording from where it is used."""
    return solve_runs(model, recordings, start=start if len(recordings) == 1 else None, end=end)


def undelayed(recordings: Sequence[Recording]) -> Model:
    """The base model without any freedom to be late: neither an offset of the clocks nor a slower low-pass."""
    if any(r.rig.lowpass_prior > 0.0 for r in recordings):
        return Model.linear().add("lowpass_error").freeze(time_offset=0.0, lowpass_error=0.0)
    return Model.linear().freeze(time_offset=0.0)
