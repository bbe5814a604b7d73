"""Findings: each effect of a model, or of its noise, with size, evidence and confounding class."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy import special

from accelcal.data import NORMAL_95, in_usual_unit
from accelcal.diagnosis.noise.noise_test import NoiseTest
from accelcal.diagnosis.search.beam import size_given_choice
from accelcal.diagnosis.search.confounding import DetectedEffect, Weights
from accelcal.diagnosis.search.homogeneity import PartSizes
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.search.scores import log_survival
from accelcal.effects import CATALOGUE, HARMONICS, find
from accelcal.estimation.estimate import Fit
from accelcal.estimation.remarks import Remark, remark
from accelcal.estimation.run_state import RunState
from accelcal.model import Model, evaluate

NAMED_SURELY = 6.0
"""Standard deviations from which the choice of an effect makes no difference to its size."""


@dataclass(frozen=True, slots=True)
class Size:
    """Largest contribution of one effect over the used range."""

    value: float
    at_encoder: bool = False
    """In m, added to the reading; otherwise in m/s², added to the output."""


@dataclass(frozen=True, slots=True)
class Importance:
    """Named effects, divided by their largest contribution over the used range."""

    tolerance: float
    """Declared, m/s²."""
    matters: tuple[str, ...]
    below: tuple[str, ...]
    not_comparable: tuple[str, ...]
    """Effects on the encoder's reading: metres have no tolerance in m/s²."""


def split(names: Iterable[str], sizes: Mapping[str, Size], tolerance: float | None) -> Importance | None:
    """Which of some effects exceed a declared tolerance; None where none is declared."""
    if tolerance is None:
        return None
    groups: dict[str, list[str]] = {"matters": [], "below": [], "not_comparable": []}
    for name in names:
        size = sizes.get(name)
        if size is None or size.at_encoder:
            groups["not_comparable"].append(name)
        else:
            groups["matters" if size.value >= tolerance else "below"].append(name)
    return Importance(tolerance, *(tuple(group) for group in groups.values()))


def sizes_of(
    fit: Fit, states: Sequence[RunState], effects: Sequence[Candidate | DetectedEffect], tests: Sequence[NoiseTest]
) -> dict[str, Size]:
    """Largest contribution over all runs of every effect of the model, of others, and of what noise tests found.

    The contribution of an effect of several columns is their sum.
    """
    sizes = {e.effect: Size(e.largest, find(e.effect).port == "position") for e in reversed(effects)}
    for test in tests:
        size = contribution_of_test(test, states)
        if size is not None:
            sizes[test.effect] = max(size, sizes.get(test.effect, size), key=lambda state: state.value)
    in_model: dict[str, Size] = {}
    for number, state in enumerate(states):
        values = fit.values(number)
        total: dict[str, np.ndarray] = {}
        for term, column in zip(values.terms, evaluate(values.terms, state.signals), strict=True):
            contribution = values.by_name[term.name] * column
            total[term.effect.name] = total.get(term.effect.name, 0.0) + contribution
        for name, y in total.items():
            largest = max(float(np.max(np.abs(y))), in_model[name].value if name in in_model else 0.0)
            in_model[name] = Size(largest, find(name).port == "position")
    return {**sizes, **in_model}


def contribution_of_test(test: NoiseTest, states: Sequence[RunState]) -> Size | None:
    """Largest contribution of an effect that a noise test found; None where it has no size."""
    effect = CATALOGUE.get(test.effect)
    if effect is None or effect.traits.noise is None:
        return None
    value = effect.traits.noise.size_of(test.estimate, test.parts, [state.signals for state in states])
    return None if value is None else Size(value, at_encoder=effect.owner == "encoder")


NOTHING_MISSING = "Nothing is missing"
"""Beginning of the sentence on an adequate model."""
TO_GO_ON = "To go on:"
"""Beginning of what to do about a residual that nothing explains."""
USUAL_STEP = (
    "look in the report for lines and bands in the spectrum of the residual and for where it is largest, then repeat "
    "the motion at another speed: what the motion makes changes with it, what the set-up adds does not"
)
RESPONSE_STEP = (
    "run accelcal response, which shows over frequency what a lag, a high-pass or a resonance of either channel does, "
    "and how to declare it"
)
NEXT_STEPS = {
    "implausible_scale": "correct that and diagnose again",
    "undeclared_lowpass": "declare it, fit again, and see what is left",
    "undeclared_resonance": "declare it, fit again, and see what is left",
    "motion_beyond_sampling": "record the same motion again that way",
    "turning_sensor": "record the orientation, or mount the sensor so that it cannot turn, and repeat the run",
    "engines_disagree": "check the stamps and the reference where the residual is largest in the report, or repeat the "
    "run with another reference",
    "changes_with_band": RESPONSE_STEP,
    "depends_on_frequency": RESPONSE_STEP,
    "no_single_size": "fit the parts apart with --from and --to, and look for what changed between them",
    "recurs": "look for what happens at those instants: a knock, a lost count, a switch",
    "not_added": "record a longer run, or the same motion at another speed, and diagnose both together",
    "dwells": "measure the angles again, record the temperature, and declare angle_std if the table is no better",
}
"""Next step for a residual that nothing explains, by the code of the remark that it rests on; of dwells `dwells`."""
FILTER_KEYS = {
    "sensor_lag": ("accel", "lowpass"),
    "encoder_lag": ("position", "lowpass"),
    "ac_coupling": ("accel", "highpass"),
}
"""Channel and key of the sidecar that declare the filter which an effect stands for."""
LEAST_LOG_P = -650.0
"""Logarithm of the smallest probability that is given as standard deviations: 36 of them."""


@dataclass(frozen=True, slots=True)
class Confounded:
    """An effect with its confounding class, and the experiment that separates the class."""

    effect: str
    members: tuple[str, ...]
    experiment: str
    parts: PartSizes = field(default_factory=PartSizes.none)
    """Sizes in the parts of the runs, over the size in all of them."""
    weights: Mapping[str, Weights] = field(default_factory=dict)
    """Posterior weights of the members, where the search has examined them."""

    def with_members(self, others: Sequence[str]) -> Confounded:
        """A copy with further confounded effects."""
        return replace(self, members=tuple(dict.fromkeys((*self.members, *others))))

    @property
    def posterior(self) -> str:
        """The sentence on the weights of the members, by the record and with the data sheets; empty without any."""
        weights = {name: w for name, w in self.weights.items() if math.isfinite(w.by_record)}
        if len(weights) < 2:
            return ""
        by_record, with_sheets = (
            ", ".join(f"{name} {w:.2f}" for name, w in sorted(pairs, key=lambda pair: -pair[1]))
            for pairs in (
                [(name, w.by_record) for name, w in weights.items()],
                [(name, w.with_sheets) for name, w in weights.items()],
            )
        )
        if any(math.isnan(w.with_sheets) for w in weights.values()):
            return f"Weights by this record alone: {by_record}."
        others = ", ".join(f"{name}: {w.source}" for name, w in weights.items() if w.source)
        sizes = f"the sizes of data sheets ({others})" if others else "the sizes of data sheets"
        return f"Weights by this record alone: {by_record}; with {sizes}: {with_sheets}."


@dataclass(frozen=True, slots=True)
class Finding:
    """An effect that was found in a record."""

    group: Confounded
    estimate: tuple[float, ...]
    """One value for each of its columns, in `unit`; for an effect of the noise its one size."""
    std: tuple[float, ...]
    unit: str
    sigma: float | None
    """Equivalent standard deviations, everything else estimated; None where a record gives none."""
    largest: Size | None
    """Largest contribution over the used range."""
    remark: str = ""
    """Sentence of the noise test behind it; of a random process that it is no cause, and how it varies."""
    wave: Mapping[str, float] = field(default_factory=dict)
    """Its frequency or period, or the shape of an effect whose coefficient physics gives, by name, in SI; empty for
    others."""

    @property
    def effect(self) -> str:
        """Its name."""
        return self.group.effect

    @property
    def rivals(self) -> tuple[str, ...]:
        """Effects that it is confounded with."""
        return tuple(name for name in self.group.members if name != self.effect)

    def below(self, tolerance: float) -> bool:
        """Whether its largest contribution to the output is smaller than a tolerance, m/s²."""
        return self.largest is not None and not self.largest.at_encoder and self.largest.value < tolerance

    @property
    def particulars(self) -> str:
        """Size, evidence and rivals, in parentheses; empty where there are none."""
        evidence = [] if self.sigma is None else [f"{self.sigma:.0f} sigma"]
        units = {name: shape.unit for name, shape in find(self.effect).shapes.items()}
        waves = [f"{name} {in_usual_unit(value, units[name], 4)}" for name, value in self.wave.items()]
        parts = (
            ", ".join([*([self.size] if self.size else []), *waves, *evidence]),
            self.remark if find(self.effect).port == "process" else "",
            self.group.parts.text,
            f"confounded with {', '.join(self.rivals)}" if self.rivals else "",
        )
        text = "; ".join(filter(None, parts))
        return f" ({text})" if text else ""

    @property
    def size(self) -> str:
        """Its coefficient, the amplitude of a wave and of its harmonics, or the largest contribution where there are
        several; empty where there is none."""
        if self.wave and len(self.estimate) > 1:
            pairs = zip(self.estimate[::2], self.estimate[1::2], strict=False)
            return " + ".join(in_usual_unit(math.hypot(*pair), self.unit) for pair in pairs)
        if len(self.estimate) == 1 and math.isfinite(self.estimate[0]) and self.estimate[0] != 0.0:
            return in_usual_unit(self.estimate[0], self.unit)
        if self.largest is None:
            return ""
        return f"at most {in_usual_unit(self.largest.value, 'm' if self.largest.at_encoder else 'm/s²')}"


def in_model(fit: Fit, group: Confounded, sizes: Mapping[str, Size]) -> Finding:
    """An effect of a fitted model, or the time offset of the base, as a finding."""
    name = group.effect
    owners = {term.name: term.effect.name for term in fit.model.terms}
    random = find(name).port == "process"
    moved = [e for e in fit.free if owners.get(e.name) == name]
    coefficients = [] if random else moved
    gain, dof = explained_gain(fit, name) if moved and not find(name).prior.mean else (0.0, 0)
    prior = next((p.std for term, p in fit.model.priors.items() if owners.get(term) == name), math.nan)
    return Finding(
        group,
        tuple(e.value for e in coefficients),
        tuple(e.std for e in coefficients),
        find(name).unit,
        math.sqrt(gain) if dof == 1 else equivalent_sigma(log_survival(gain, dof)) if dof else None,
        sizes.get(name),
        remark=f"no cause: {varies(find(name).traits.changes, prior, fit.model.shapes[name])}" if random else "",
        wave=wave_of(fit.model, name),
    )


def varies(coefficient: str, std: float, shape: Mapping[str, float]) -> str:
    """The words on how a random process moves a coefficient: within its time constant, or a random walk within 1 s."""
    return f"{coefficient} varies by {in_usual_unit(std, find(coefficient).unit)} over {shape.get('tau', 1.0):.2g} s"


def chosen(fit: Fit, thresholds: Mapping[str, float], chosen_by: Fit | None = None) -> list[Remark]:
    """Remarks on effects of one coefficient that the recordings of a fit named at fewer than `NAMED_SURELY` standard
    deviations: their sizes allowing for that choice.

    Parameters
    ----------
    fit : with the effects.
    thresholds : standard deviations above which its recordings named each effect.
    chosen_by : the fit to the part that named them; by default to all.
    """
    owners = {term.name: term.effect for term in fit.model.terms}
    of_part = chosen_by or fit
    stds = {e.name: std for e, std in zip(of_part.free, of_part.naming_stds, strict=True)}
    notes = []
    for e, at_shapes in zip(fit.free, fit.naming_stds, strict=True):
        effect = owners.get(e.name)
        if effect is None or e.name not in thresholds or effect.port in ("noise", "process") or effect.prior.mean:
            continue
        share = min(1.0, (at_shapes / stds.get(e.name, at_shapes)) ** 2)
        sigma, threshold = abs(e.value) / at_shapes, thresholds[e.name]
        if sigma >= NAMED_SURELY or sigma * math.sqrt(share) < threshold:
            continue
        sizes = (math.copysign(at_shapes, e.value) * x for x in size_given_choice(sigma, threshold, share))
        low, size, high = sorted(sizes)
        of_shapes = NORMAL_95 * math.sqrt(max(0.0, e.std**2 - at_shapes**2))
        low, high = size - math.hypot(size - low, of_shapes), size + math.hypot(high - size, of_shapes)
        std = (high - low) / (2.0 * NORMAL_95)
        notes.append(
            remark(
                "chosen",
                effect=e.name,
                sigma=sigma,
                threshold=threshold,
                size=size,
                std=std,
                low=low,
                high=high,
                interval=f"{in_usual_unit(low, e.unit)} to {in_usual_unit(high, e.unit)}",
                text=in_usual_unit(size, e.unit),
                raw=f"{in_usual_unit(e.value, e.unit)} ± {in_usual_unit(e.std, e.unit, 2)}",
            )
        )
    return notes


def entry_sigmas(before: Fit, fit: Fit) -> dict[str, float]:
    """Standard deviations above which the recordings of an earlier fit named effects, where that matters for their
    sizes; empty where another fit is to other recordings."""
    notes = [note.values for note in before.remarks if note.code == "chosen" and before.sources == fit.sources]
    return {str(values["effect"]): float(values["threshold"]) for values in notes}


def wave_of(model: Model, name: str) -> dict[str, float]:
    """Frequency or period of a wave of a model, and the highest of its harmonics where it has some; the shape of an
    effect whose coefficient physics gives; empty for others."""
    wave = {shape: model.shapes[name][shape] for shape, declared in find(name).shapes.items() if declared.width}
    several = bool(wave) and model.shapes[name][HARMONICS] > 1.0
    if find(name).prior.mean:  # its coefficient is given by physics, and the shape is what the record says
        return {shape: model.shapes[name][shape] for shape in find(name).shapes}
    return {**wave, HARMONICS: model.shapes[name][HARMONICS]} if several else wave


def in_noise(tests: Sequence[NoiseTest], group: Confounded, sizes: Mapping[str, Size]) -> Finding:
    """An effect that noise tests found; the most significant of them counts, and of waves the largest."""
    test = max((t for t in tests if t.effect == group.effect), key=lambda t: t.estimate if t.shape else -t.p_value)
    log_p = math.log(test.p_value) if test.p_value > 0.0 else -math.inf
    return Finding(
        group,
        (test.estimate,),
        (test.std,),
        test.unit,
        equivalent_sigma(log_p),
        sizes.get(group.effect),
        test.sentence,
        test.shape,
    )


def equivalent_sigma(log_p: float) -> float:
    """Standard deviations of a normal error that are as improbable, on both sides together."""
    return -float(special.ndtri_exp(max(log_p, LEAST_LOG_P) - math.log(2.0)))


def explained_gain(fit: Fit, name: str) -> tuple[float, int]:
    """Twice the log-likelihood that an effect of a fitted model explains given all others, and its degrees of freedom.

    The prior information on a coefficient explains nothing and is subtracted. Of a random process it is the likelihood
    ratio of its intensity: the coefficients are integrated out, x' P^-1 x - ln det(K P^-1) with their prior K.
    """
    owners = {term.name: term.effect.name for term in fit.model.terms}
    coefficients = [k for k, e in enumerate(fit.free) if owners.get(e.name) == name]
    x = np.array([fit.free[k].value for k in coefficients])
    information = np.linalg.inv(fit.covariance[np.ix_(coefficients, coefficients)])
    if find(name).port == "process":
        variance = [fit.model.priors[fit.free[k].name].std ** 2 for k in coefficients]
        return max(0.0, float(x @ information @ x - np.linalg.slogdet(np.diag(variance) @ information)[1])), 1
    if find(name).prior.mean:
        information -= np.diag([fit.model.priors[name].std ** -2 if name in fit.model.priors else 0.0])
    return max(0.0, float(x @ information @ x)), len(coefficients)


def present(fit: Fit, alpha: float, sizes: Mapping[str, Size]) -> tuple[Finding, ...]:
    """Effects beyond the base that a fitted model contains and the record confirms."""
    contributions = []
    for name in fit.model.added:
        effect = find(name)
        finding = in_model(fit, Confounded(name, (name,), effect.experiment.rstrip(".")), sizes)
        shown = effect.traits.visible or effect.seen_by_sets
        if not shown or effect.prior.mean or name in fit.model.priors or finding.sigma is None:
            continue
        if log_survival(*explained_gain(fit, name)) < math.log(alpha):
            contributions.append(finding)
    return tuple(contributions)


def declared_as(name: str) -> str:
    """How to declare the filter that an effect stands for, to be appended to a sentence; empty for others.

    Without a number: a search tells a time constant from the time offset only roughly, a fit with both tells it.
    """
    if name not in FILTER_KEYS:
        return ""
    channel, key = FILTER_KEYS[name]
    entry = f'{key} = {{ kind = "RC", tau = ... }}'
    return f" {TO_GO_ON} accelcal add {name} estimates its tau; if {channel} passes such a filter, declare it: {entry}."


def with_next_step(text: str, codes: Sequence[str] = ()) -> str:
    """The sentence on a residual that nothing explains, and what to do about it, by the code that comes first in
    `NEXT_STEPS`."""
    step = next((step for code, step in NEXT_STEPS.items() if code in codes), USUAL_STEP)
    return f"{text} {TO_GO_ON} {step}."


def with_findings(findings: Sequence[Finding], left: str, tolerance: float | None = None) -> str:
    """The sentence of a verdict: what was found, then what is left, then what is below tolerance.

    Parameters
    ----------
    findings : in the order in which they are named.
    left : the sentence on what the last model lacks.
    tolerance : contribution to the output below which an effect does not matter, m/s²; None where none is declared.
    """
    small = [finding for finding in findings if tolerance is not None and finding.below(tolerance)]
    findings = [finding for finding in findings if finding not in small]
    closing = (
        f" Below tolerance: {', '.join(f'{finding.effect}{finding.particulars}' for finding in small)}."
        if small
        else ""
    )
    if not findings:
        return f"{left}{closing}"
    *most, last = findings
    small_names = ", ".join(f"{finding.effect}{finding.particulars}" for finding in most)
    verb = "were found" if most else "was found"
    opening = (
        f"{small_names} and {last.effect}{last.particulars} {verb}"
        if most
        else f"{last.effect} {verb}{last.particulars}"
    )
    if left.startswith(NOTHING_MISSING):
        return f"{opening}; nothing else is missing{left.removeprefix(NOTHING_MISSING)}{closing}"
    return f"{opening}. {left}{closing}"
