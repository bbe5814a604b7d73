"""The loop: fit, diagnose, add, refit, and watch the error fall on data that no fit has seen."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from accelcal.breaks import faults, usable
from accelcal.channels import ALARM, ChannelFinding, channel_findings
from accelcal.compare import Comparison, compare
from accelcal.diagnose import ALPHA, LEAST_BLOCKS, Candidate, Finding, Scan, Verdict, scan
from accelcal.diagnose.mended import (
    not_the_whole,
    rest_of,
    shape_behind,
    significance,
    sum_of,
    wandering_behind,
)
from accelcal.effects import Effect, find
from accelcal.fit import Fit, judge, result, solve_runs, taken_up
from accelcal.fit import fit as fit_all
from accelcal.gating import CHANNEL_OF, Dropped, Gated, gated, wild
from accelcal.gauss_newton import NotIdentifiable, Solution, estimated
from accelcal.importance import Importance, Size, sizes_of, split
from accelcal.model import Model, Term, evaluate, terms_of
from accelcal.recording import Recording
from accelcal.replay import Run
from accelcal.shaping import signals_of
from accelcal.shown import shown
from accelcal.signals import Origins

HELD_OUT = 0.3
"""Share at the end of a recording that is held out when no other recording is."""
MOST_EFFECTS = 3
"""Effects that `improve` adds unless told otherwise."""
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
class Tie:
    """An effect with everything that it cannot be told from, and the experiment that would."""

    effect: str
    members: tuple[str, ...]
    experiment: str

    def beside(self, others: Sequence[str]) -> Tie:
        """The same with more that it cannot be told from."""
        return replace(self, members=tuple(dict.fromkeys((*self.members, *others))))


@shown
@dataclass(frozen=True, slots=True)
class Diagnosis:
    """What a model lacks on a recording."""

    verdict: Verdict
    sentence: str
    effects: tuple[str, ...]
    """What would enter, in order; a significant delay comes first."""
    classes: tuple[Tie, ...]
    inseparable: tuple[Tie, ...]
    scan: Scan
    fit: Fit
    """The model, profiled anew on this recording."""
    used: tuple[tuple[float, float], ...]
    """Stretches that were used, s."""
    channels: tuple[ChannelFinding, ...]
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
    dropped: tuple[Dropped, ...] = ()
    """Readings that were left out as wild, by recording and channel."""
    suspect: tuple[str, ...] = ()
    """Faults in the data, each a sentence; they are said first."""

    def __repr__(self) -> str:
        return f"Diagnosis({self.verdict}: {self.sentence})"

    @property
    def importance(self) -> Importance | None:
        """Which of the effects matter under the declared tolerance; None where none is declared."""
        return split(self.effects, self.sizes, self.fit.rig.tolerance)


@dataclass(frozen=True, slots=True)
class Step:
    """One model on the way, on the data it was fitted to and on held-out data."""

    effects: tuple[str, ...]
    fit: Fit
    train: Comparison
    heldout: Comparison


@shown
@dataclass(frozen=True, slots=True)
class Improvement:
    """The falling error: every step, and what is still missing from the last model."""

    steps: tuple[Step, ...]
    diagnosis: Diagnosis
    """Of the last model."""
    classes: tuple[Tie, ...]
    """One for each effect that was added."""
    examined: int
    same_run: bool
    """Held-out data are the end of the fitted run: set-up and slow-drift errors cannot show."""

    def __repr__(self) -> str:
        return f"Improvement({' + '.join(('base', *self.effects))}; {self.diagnosis.sentence})"

    @property
    def importance(self) -> Importance | None:
        """Which effects matter under the declared tolerance; None where none is declared."""
        return split(self.effects, self.diagnosis.sizes, self.diagnosis.fit.rig.tolerance)

    @property
    def effects(self) -> tuple[str, ...]:
        """Names in the order added."""
        return self.steps[-1].effects


@shown
@dataclass(frozen=True, slots=True)
class History:
    """Models in the order of their story, each compared with the same recording: the falling error."""

    fits: tuple[Fit, ...]
    steps: tuple[Comparison, ...]
    """One for each fit."""

    def __repr__(self) -> str:
        each = (f"{name}: {seen.simulated_rms:.3g} m" for name, seen in zip(self.names, self.steps, strict=True))
        return f"History(rms free-running error of {', '.join(each)})"

    def __len__(self) -> int:
        return len(self.steps)

    def __iter__(self) -> Iterator[Comparison]:
        return iter(self.steps)

    def __getitem__(self, index: int) -> Comparison:
        return self.steps[index]

    @property
    def names(self) -> tuple[str, ...]:
        """What each model holds beyond the base, as in "base + cubic"."""
        return tuple(" + ".join(("base", *fit.model.added)) for fit in self.fits)


def diagnose(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    start: float | None = None,
    end: float | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Say which physical effect a model lacks on a recording, if any.

    Parameters
    ----------
    fit : the model; on another recording than its own all coefficients are profiled anew.
    recordings : one or several runs.
    extra : effects of the user's own, beside the catalogue.
    alpha : family-wise false-alarm rate.
    start, end : s, optional; only this part is used.
    report : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    NotIdentifiable
        If the motion does not excite what the model already contains.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    stretch = Stretch.of(several[0], start, end)
    report(0.1)

    def solve(these: Sequence[Recording]) -> Solution:
        return solve_runs(
            fit.model, these, start=stretch.start, end=stretch.end, origins=fit.origins, report=within(report, 0.1, 0.3)
        )

    state = gated(several, solve)
    judged = judge_model(state, stretch, extra, alpha, within(report, 0.35, 1.0))
    return replace(judged, dropped=state.dropped(several))


def within(report: Callable[[float], None], low: float, high: float) -> Callable[[float], None]:
    """Report the shares of one part of the work as those of the whole."""
    return lambda share: report(low + share * (high - low))


@dataclass(frozen=True, slots=True)
class Stretch:
    """The part of a recording on which one model can hold, and the faults in it."""

    start: float
    end: float
    breaks: tuple[float, ...]
    suspect: tuple[str, ...]

    @classmethod
    def of(cls, recording: Recording, start: float | None, end: float | None) -> Stretch:
        """Look for faults and for the first instant at which the relation of the channels breaks for good.

        A stretch that the user chose is taken as it is.
        """
        breaks: tuple[float, ...] = ()
        columns = None
        if start is None and end is None:
            found = usable(recording)
            start, end, breaks = found.start, found.end, found.breaks
            columns = None if breaks else found.columns
        run = Run(recording, start=start, end=end) if columns is None else columns.run
        suspect = tuple(fault.sentence for fault in faults(recording, run, columns))
        return cls(float(run.t[0]), float(run.t[-1]), breaks, suspect)


def judge_model(
    state: Gated,
    stretch: Stretch,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    report: Callable[[float], None] = lambda share: None,
) -> Diagnosis:
    """Verdict on a model that has just been fitted; the solution is used up."""
    solution, tests = state.solution, state.tests
    model, profiled = solution.model, result(solution)
    found = scan(
        solution.passes, model, extra=extra, apart=lines_apart(state), alpha=alpha, report=within(report, 0.0, 0.8)
    )
    level = alpha / (found.examined + len(tests))
    loud = heard([t for t in tests if t.p_value < level and t.effect not in model.effects], alone=not found.found)
    largest, sizes = contributions(profiled, solution), sizes_of(profiled, solution.passes, found.candidates, loud)
    for one in solution.passes:  # what follows fits and predicts anew: one set of signals at a time
        one.release()
    delay = "time_offset" not in model.fixed and delayed(profiled, found, alpha)
    delay = delay and delayed(completed(solution, profiled, found), found, alpha)
    if found.blocks < LEAST_BLOCKS:
        loud = ()
    ties = [Tie(f.effect, f.members, f.experiment) for f in found.found if found.blocks >= LEAST_BLOCKS]
    named = list(dict.fromkeys(test.effect for test in loud if test.effect != "whiteness"))
    ties += [Tie(name, (name,), find(name).experiment) for name in named]
    if delay:
        ties.insert(0, Tie("time_offset", DELAY_CLASS, DELAY_EXPERIMENT))
    verdict, sentence = conclude(profiled, found, loud)
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
        where=compare(profiled, solution.passes[0].run.recording, start=stretch.start, end=stretch.end),
        largest=largest,
        sizes=sizes,
        alpha=alpha,
        breaks=stretch.breaks,
        suspect=stretch.suspect,
    )


def lines_apart(state: Gated) -> list[Term]:
    """Lines that stand in the spectrum and that the motion does not make: they are told of on their own, and no effect
    of the motion is paid for explaining them."""
    if "tone" in state.solution.model.effects:
        return []
    fastest = 0.4 / max(signals_of(one).step for one in state.solution.passes)
    lines = [test.parts for test in state.tests if test.effect == "tone" and test.p_value < ALARM]
    return [
        term
        for parts in lines
        if not parts["made_by_motion"] and parts["frequency"] < fastest
        for term in terms_of(find("tone"), {"frequency": parts["frequency"]})
    ]


MOST_NAMED = 2
"""Named effects that are tried in the place of a shape without a name."""
SAME_LINE = 0.25
"""A line within this share of the frequency of a vibration belongs to it."""


EXPLAINED_BY = {"quantisation": ("tone", "whiteness"), "encoder_outliers": ("whiteness",)}
"""What a coarse converter or wild readings raise besides themselves; no step makes a line larger than it is."""


def heard(loud: Sequence[ChannelFinding], *, alone: bool) -> tuple[ChannelFinding, ...]:
    """Significant findings that stand on their own feet.

    A line near a vibration, or in its band, belongs to it. A line inside the band of the motion may be a harmonic of a
    missing nonlinearity, which is judged elsewhere: it counts only `alone`, when no effect of the motion was found, and
    where the motion makes no lines.
    """
    shaking = [test.parts for test in loud if test.effect == "vibration" and "frequency" in test.parts]
    raised = {other for test in loud if test.parts.get("coarse", 1.0) for other in EXPLAINED_BY.get(test.effect, ())}
    step = max((test.parts["step"] for test in loud if test.effect == "quantisation"), default=math.inf)

    def own(test: ChannelFinding) -> bool:
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
        assert one.signals is not None
        for term, column in zip(values.terms, evaluate(values.terms, one.signals), strict=True):
            size = abs(values.by_name[term.name]) * float(np.max(np.abs(column)))
            found[term.name] = max(size, found.get(term.name, 0.0))
    return found


def conclude(profiled: Fit, found: Scan, loud: Sequence[ChannelFinding]) -> tuple[Verdict, str]:
    """The verdict and the sentence that opens every output."""
    named = [test for test in loud if test.effect != "whiteness"]
    looked = f"{found.examined} candidates examined"
    if found.blocks < LEAST_BLOCKS:
        return "too_short", f"The record is too short for a verdict: {found.blocks} blocks, {LEAST_BLOCKS} are needed."
    ratios = [run.noise.ratio for run in profiled.runs if run.noise.ratio is not None]
    ratio = max(ratios, default=None)
    if found.found:
        first = found.found[0]
        candidate = next((c for c in found.candidates if c.effect == first.effect), None)
        sigma = f"{candidate.snr:.0f} sigma; " if candidate is not None else ""
        effect = find(first.effect)
        if effect.family:
            return "shape", f"Something is missing that has no name here: {effect.summary} ({sigma}{looked})."
        others = [m for m in first.members if m != first.effect]
        text = f"{first.effect} explains what the model lacks ({sigma}{looked})."
        if others:
            rivals = ", ".join(others)
            text += f" {rivals} cannot be told from it on this record: {first.experiment}."
            return "tied", text
        return "named", text
    if named:
        return "named", f"{named[0].sentence} ({looked})."
    if ratio is not None and ratio > NOISE_LIMIT:
        return "unexplained", (
            f"The residual is {ratio:.2g} times the sensor noise of the data sheet and no candidate explains it "
            f"({looked})."
        )
    if loud or any(run.noise.band is not None for run in profiled.runs):
        return "unexplained", f"The residual is not white and no candidate explains it ({looked})."
    return "adequate", f"Nothing is missing ({looked}); see the detection limits for what would have been seen."


def completed(solution: Solution, profiled: Fit, found: Scan) -> Fit:
    """The fit with the estimates beside everything that was found: what a missing effect leaves can pose as a delay."""
    if not found.found:
        return profiled
    model = solution.model
    try:
        for finding in found.found:
            model = finding.enter(model)
        again = estimated(model, [one.grown(model) for one in solution.passes], least=2)
        judge(again.layout, again.x, again.covariance, [one.run for one in solution.passes])
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


def inseparable(model: Model) -> tuple[Tie, ...]:
    """Groups that no motion of this rig can separate, as long as the model holds one of each."""
    return tuple(
        Tie(members[0], members, experiment)
        for members, experiment in GROUPS
        if not any(name in model.effects for name in members[1:])
    )


def fit(
    model: Model,
    recordings: Recording | Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
    origins: Origins | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Fit a model as `accelcal.fit` does, but without wild readings, which the remarks of the fit count.

    Parameters and errors are those of :func:`accelcal.fit`.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    every = fit_all(model, several, start=start, end=end, band=band, origins=origins, report=within(report, 0.0, 0.8))
    return tidied(every, several, start=start, end=end, band=band)


def tidied(
    fit: Fit,
    recordings: Sequence[Recording],
    *,
    start: float | None = None,
    end: float | None = None,
    band: float | None = None,
) -> Fit:
    """The fit made again without wild readings; the fit itself where there are none."""
    passes = taken_up(fit, recordings)
    if passes is not None and not any(wild(channel_findings(one)) for one in passes):
        return fit

    def solve(these: Sequence[Recording]) -> Solution:
        return solve_runs(fit.model, these, start=start, end=end, band=band, origins=fit.origins)

    state = gated(recordings, solve)
    dropped = state.dropped(recordings)
    if not dropped:
        return fit
    kept = result(state.solution)
    return replace(kept, remarks=(*(f"{one.sentence}." for one in dropped), *kept.remarks))


def add(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *names: str,
    extra: Sequence[Effect] = (),
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit with further effects, without wild readings; shape parameters are found by likelihood.

    Parameters
    ----------
    fit, recordings : the model, and what it is fitted to again.
    names : effects to add, in this order.
    extra : effects of the user's own.
    report : called with the share of the work that is done, 0 to 1.

    Raises
    ------
    ValueError
        If an effect is unknown, already in the model, or cannot be evaluated on the recording.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    model, passes = fit.model, taken_up(fit, several)
    for name in names:
        if name in model.effects:
            raise ValueError(f"{name!r} is already in the model")
        effect = find(name)
        if passes is None or model is not fit.model:
            passes = solve_runs(model, several, origins=fit.origins, report=within(report, 0.0, 0.4)).passes
        alone = scan(passes, model, extra=extra, only=(effect,), report=within(report, 0.4, 0.6))
        if not alone.entered:
            lacking = [n for n in effect.needs if n not in several[0].side]
            why = "this record does not excite it; `accelcal power` says what it can see"
            if lacking:
                why = f"it needs the channel {' and '.join(lacking)}; record it, or name its column in the sidecar"
            if effect.beside and effect.beside not in model.effects:
                why = f"it is sought beside {effect.beside}; add that first"
            raise ValueError(f"{name!r} cannot be added: {why}")
        model = alone.entered[0].enter(model)
    grown = result(solve_runs(model, several, origins=fit.origins, report=within(report, 0.6, 0.9)))
    return tidied(grown, several)


def drop(
    fit: Fit,
    recordings: Recording | Sequence[Recording],
    *names: str,
    report: Callable[[float], None] = lambda share: None,
) -> Fit:
    """Return a new fit without some effects, and without wild readings.

    `report` is called with the share of the work that is done, 0 to 1.
    """
    several = [recordings] if isinstance(recordings, Recording) else list(recordings)
    left = result(solve_runs(fit.model.drop(*names), several, origins=fit.origins, report=within(report, 0.0, 0.9)))
    return tidied(left, several)


def history(fits: Sequence[Fit], recording: Recording) -> History:
    """Compare several models with one recording: the falling error.

    Raises
    ------
    ValueError
        If there is no model.
    """
    if not fits:
        raise ValueError("a history needs at least one model; give the fits in the order of their story")
    return History(tuple(fits), tuple(compare(one, recording) for one in fits))


@dataclass(slots=True)
class Story:
    """What has entered a model so far, in order, each with its class and what it explained."""

    ties: list[Tie] = field(default_factory=list)
    gains: dict[str, float] = field(default_factory=dict)
    """Twice the log-likelihood that each explained when it entered."""

    @property
    def effects(self) -> tuple[str, ...]:
        """Names, in the order of entry."""
        return tuple(tie.effect for tie in self.ties)

    def enter(self, finding: Finding, gain: float, worn: Sequence[str] = ()) -> None:
        """One effect more; a shape without a name stands in the place of the names that it wears out."""
        self.gains[finding.effect] = gain + sum(self.leave(name) for name in worn)
        self.ties.append(Tie(finding.effect, finding.members, finding.experiment))

    def leave(self, name: str) -> float:
        """One effect less, if it is there; what it explained."""
        self.ties = [tie for tie in self.ties if tie.effect != name]
        return self.gains.pop(name, 0.0)

    def told(self, left: Sequence[Candidate]) -> list[Tie]:
        """Every effect with its class, once nothing more enters and `left` is what the model leaves over."""
        return [
            tie.beside(
                (
                    *sum_of(tie.effect, self.effects),
                    *rest_of(tie.effect, self.gains),
                    *not_the_whole(tie.effect, left),
                )
            )
            for tie in self.ties
        ]


def improve(
    recordings: Recording | Sequence[Recording],
    *,
    holdout: Recording | None = None,
    most: int = MOST_EFFECTS,
    extra: Sequence[Effect] = (),
    alpha: float = ALPHA,
    start: float | None = None,
    end: float | None = None,
    report: Callable[[float], None] = lambda share: None,
) -> Improvement:
    """Fit the base model, diagnose, add the effect that is missing, refit, until nothing is missing.

    Parameters
    ----------
    recordings : one or several runs to learn from.
    holdout : a run to show the falling error on; by default the last 30 % of the first run, which then is not fitted.
    most : most effects to add.
    extra : effects of the user's own.
    alpha : family-wise false-alarm rate.
    start, end : s, optional; only this part of the recordings is used.
    report : called with the share of the work that is done.
    """
    original = [recordings] if isinstance(recordings, Recording) else list(recordings)
    same_run = holdout is None
    stretch = Stretch.of(original[0], start, end)
    begin, finish = stretch.start, stretch.end
    split = finish - HELD_OUT * (finish - begin) if same_run else finish

    def solve(model: Model, these: Sequence[Recording]) -> Solution:
        return solve_runs(model, these, start=begin if len(these) == 1 else None, end=split)

    def advance(model: Model, known: Gated | None) -> Gated:
        told = () if known is None else [test for test in known.tests if test.effect in CHANNEL_OF and test.at]
        return gated(original if known is None else known.recordings, lambda these: solve(model, these), told)

    def entered(found: Scan) -> tuple[Finding, Diagnosis, Gated] | None:
        """The fit with the effect that comes first, judged; None where no fit is possible.

        A shape without a name gives way to a named effect of its class whose fit leaves nothing for it, nor for
        anything that cannot be told from it.
        """
        first, model = found.found[0], state.solution.model
        for finding in (*found.named[:MOST_NAMED], first):
            try:
                # readings beside a jump that is not in the model look wild: they are judged anew once it is
                grown = advance(finding.enter(model), None if "instant" in finding.shape else state)
                judged = judge_model(grown, stretch, extra, alpha)
            except (NotIdentifiable, ValueError):
                continue
            if finding is first or not any(first.effect in left.members for left in judged.scan.found):
                return finding, judged, grown
        return None

    def instead(effect: Effect, worn: Sequence[str]) -> tuple[Finding, Diagnosis, Gated] | None:
        """The fit with an effect in the place of others, judged; None where no fit is possible, or where it leaves
        something to explain: to one of them or, if it is a shape, to a name of its variable; if it wanders, to any."""
        try:
            model = state.solution.model.drop(*worn, *({effect.name} & set(state.solution.model.effects)))
            alone = scan(advance(model, state).solution.passes, model, extra=extra, only=(effect,))
            if not alone.entered:
                return None
            grown = advance(alone.entered[0].enter(model), state)
            judged = judge_model(grown, stretch, extra, alpha)
        except (NotIdentifiable, ValueError):
            return None
        left = {one.effect for one in judged.scan.found}
        if left & {*effect.covers, *worn} or (left and effect.port == "process"):
            return None
        return replace(alone.entered[0], members=(effect.name, *worn)), judged, grown

    def leaner(name: str) -> tuple[Diagnosis, Gated] | None:
        """The fit without an effect that entered before others, judged; None where it is still asked for."""
        try:
            left = advance(state.solution.model.drop(name), state)
            judged = judge_model(left, stretch, extra, alpha)
        except (NotIdentifiable, ValueError):
            return None
        return None if any(name in one.members for one in judged.scan.found) else (judged, left)

    def doubtful(name: str) -> bool:
        """Whether an effect may have stood for those that entered after it: a shape may, a name if it lost its size."""
        effect = find(name)
        if effect.family or effect.port == "process":
            return effect.family
        return significance(verdict.fit, name) > math.log(alpha / verdict.scan.examined)

    state = advance(Model.linear(), None)
    verdict = judge_model(state, stretch, extra, alpha)
    report(0.3)
    fits: list[tuple[tuple[str, ...], Fit]] = [((), verdict.fit)]
    story = Story()
    examined = verdict.scan.examined
    for number in range(2 * most):
        if not verdict.scan.found or len(story.effects) >= most:
            break
        step = entered(verdict.scan)
        if step is None:
            break
        explained = {one.effect: one.gain for one in verdict.scan.candidates}
        entering, verdict, state = step
        gain = explained.get(entering.effect, 0.0)
        worn: tuple[str, ...] = ()
        examined += verdict.scan.examined
        for behind in (
            shape_behind(verdict.fit, entering.effect, entering.members),
            wandering_behind([tie.members for tie in story.ties], entering.effect),
        ):
            step = instead(*behind) if behind and not worn else None
            if behind and step:
                (entering, verdict, state), worn = step, behind[1]
                examined += verdict.scan.examined
        story.enter(entering, gain, worn)
        earlier = () if find(entering.effect).family else story.effects[:-1]
        for name in (name for name in earlier if doubtful(name)):
            lean = leaner(name)
            if lean:
                verdict, state = lean
                examined += verdict.scan.examined
                story.leave(name)
        fits.append((story.effects, verdict.fit))
        report(min(0.9, 0.3 + 0.6 * (number + 1) / most))
    story.ties = story.told(verdict.scan.candidates)
    if delayed(fits[-1][1], verdict.scan, alpha):
        held = result(solve(undelayed(original), state.recordings))
        story.ties.insert(0, Tie("time_offset", DELAY_CLASS, DELAY_EXPERIMENT))
        fits = [((), held), *((("time_offset", *names), one) for names, one in fits)]
    heard_of = {test.effect for test in verdict.channels} - set(story.effects)
    story.ties += [tie for tie in verdict.classes if tie.effect in heard_of]
    fits[-1] = (story.effects, fits[-1][1])
    dropped = state.dropped(original)
    test = original[0] if holdout is None else holdout
    test_begin, test_end = (split, finish) if same_run else (None, None)
    if dropped:
        test, lost = gated_holdout(fits[0][1].model, test, test_begin, test_end)
        dropped = (*dropped, *lost)
    steps = [
        Step(
            names,
            one,
            compare(one, state.recordings[0], start=begin, end=split),
            compare(one, test, start=test_begin, end=test_end),
        )
        for names, one in fits
    ]
    return Improvement(tuple(steps), replace(verdict, dropped=dropped), tuple(story.ties), examined, same_run)


def gated_holdout(
    model: Model, recording: Recording, start: float | None, end: float | None
) -> tuple[Recording, tuple[Dropped, ...]]:
    """Held-out data without their own wild readings, the same for every step; as they are where no fit is possible."""
    try:
        state = gated([recording], lambda these: solve_runs(model, these, start=start, end=end))
    except (NotIdentifiable, ValueError):
        return recording, ()
    found = state.dropped([recording])
    return state.recordings[0], tuple(replace(d, recording=f"held out, {d.recording or 'recording'}") for d in found)


def undelayed(recordings: Sequence[Recording]) -> Model:
    """The base model without any freedom to be late: neither an offset of the clocks nor a slower low-pass."""
    if any(r.rig.lowpass_prior > 0.0 for r in recordings):
        return Model.linear().add("lowpass_error").freeze(time_offset=0.0, lowpass_error=0.0)
    return Model.linear().freeze(time_offset=0.0)
