"""Figures of a diagnosis: candidates by significance, the error each takes away, correlation of signatures."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from accelcal.data import Array
from accelcal.diagnosis.experiment import DriftBandwidth, Power
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find, spelled
from accelcal.estimation.estimate import Fit
from accelcal.plots.figure import (
    CANDIDATES,
    Axis,
    Bars,
    Figure,
    Level,
    Line,
    Panel,
    Points,
    Text,
    Tiles,
    error_reduction_sentence,
    on_rows,
    ruled,
    sentence,
    share_text,
)
from accelcal.results import words as formatting
from accelcal.results.comparisons import quoted
from accelcal.results.diagnoses import candidate_groups
from accelcal.validation import systematic
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison


@dataclass(frozen=True, slots=True)
class SignatureCorrelation:
    """Correlation of the signatures of some effects, each at its most visible shape."""

    names: tuple[str, ...]
    correlation: Array
    """(n, n)"""

    def of(self, names: list[str]) -> SignatureCorrelation:
        """The correlation of some of them, in a given order."""
        rows = [self.names.index(name) for name in names]
        return SignatureCorrelation(tuple(names), self.correlation[np.ix_(rows, rows)])


def signature_correlation(power: Power) -> SignatureCorrelation:
    """Correlate the signatures of all effects with one constant coefficient that a record can show.

    Parameters
    ----------
    power : from `accelcal.power`.
    """
    model = power.of_run
    G = model.evidence.G
    rows: dict[str, int] = {}
    for item, columns in zip(model.items, model.evidence.columns, strict=True):
        name = item.effect.name
        if item.effect.width > 1 or item.effect.port == "process" or not power[name].visible:
            continue
        best = all(item.shape.get(key) == value for key, value in power[name].shape.items())
        if best and G[columns.start, columns.start] > 0.0:
            rows[name] = columns.start
    sets = list(rows.values())
    size = np.sqrt(np.diag(G)[sets])
    return SignatureCorrelation(tuple(rows), G[np.ix_(sets, sets)] / np.outer(size, size))


def ranking(diagnosis: Diagnosis, most: int = CANDIDATES) -> Figure:
    """Draw equivalent standard deviations of each candidate; significant ones filled, confounded ones in brackets.

    Parameters
    ----------
    diagnosis : from `accelcal.diagnose`.
    most : candidates that are drawn.
    """
    groups = candidate_groups(diagnosis, most)
    headline = f"Candidate effects: {diagnosis.scan.examined} examined"
    if not groups:
        return sentence(headline, "No candidate could be tested on this record.")
    flat = [c for group in groups for c in group]
    snr = np.array([c.snr for c in flat])
    top, begin = float(snr.max()), 0
    brackets: list[Line | Text] = []
    for group in groups:
        end = begin + len(group) - 1
        if len(group) > 1:
            x, y = np.array([1.62, 1.65, 1.65, 1.62]) * top, np.repeat([begin - 0.3, end + 0.3], 2)
            brackets += [Line(x, y, role="other", solid=True), Text(1.68 * top, 0.5 * (begin + end), "confounded")]
        begin = end + 1
    bars = Bars(
        snr,
        [c.p_value < diagnosis.alpha for c in flat],
        ("significant", "not significant"),
        across=True,
        text=[f"{c.snr:.1f} σ" for c in flat],
        hover=[f"{c.snr:.1f} σ, family-wise p {c.p_value:.2g}: {_amount(c)}" for c in flat],
    )
    names = Axis(range=(len(flat) - 0.4, -0.6), ticks=(range(len(flat)), on_rows(c.effect for c in flat)), grid=False)
    significance = Axis("significance", "σ", range=(0.0, (2.6 if brackets else 1.25) * top))
    panel = Panel((bars, *brackets), significance, names, height=20.0 + 30.0 * len(flat))
    return Figure((panel,), headline, f"family-wise false-alarm rate {diagnosis.alpha:g}")


def _amount(c: Candidate) -> str:
    if len(c.estimate) == 1:
        return f"{c.estimate[0]:.4g} ± {c.std[0]:.2g} {c.unit}, at most {c.largest:.3g}"
    return f"{len(c.estimate)} coefficients, at most {c.largest:.3g}"


def error_reduction(comparison: Comparison, *, lacking: int = 0) -> Figure:
    """Draw one bar for each model, hatched where the effect is not in the model, and the noise floor.

    Parameters
    ----------
    comparison : from `accelcal.compare`.
    lacking : number of models at the end that have effects which the model itself lacks.
    """
    floor, errors = comparison.floor, np.array(comparison.errors)
    factor, unit = ruled(comparison)
    errors = errors * factor
    ends = [(around.low, around.high) if around else (np.nan, np.nan) for around in comparison.intervals]
    low, high = np.array(ends).T * factor
    top = np.fmax(np.fmax(errors, high), floor.high * factor)
    bars = Bars(
        errors,
        [number < len(comparison) - lacking for number in range(len(comparison))],
        ("in the model", "not in the model yet"),
        low,
        high,
        [
            "\n".join([quoted(comparison.headline, e).split(" (")[0], *share_text(comparison, i).split(", ")]).rstrip()
            for i, e in enumerate(comparison)
        ],
        top,
    )
    title = comparison.headline.alone
    title += ", with 95 % prediction interval" if comparison.headline.band is None else ""
    level = Level(floor.value * factor, floor.low * factor, floor.high * factor, title, "floor")
    names = [spelled(name) for name in comparison.names]
    models = Axis("model", range=(-0.6, len(names) - 0.4), ticks=(range(len(names)), names), grid=False)
    size = Axis("rms error", unit, range=(0.0, 1.3 * float(np.nanmax(top))))
    of_session = "a part of the fitted run, which does not reveal set-up and slow-drift errors"
    unseen = of_session if comparison.same_run else "another recording"
    return Figure((Panel((bars, level), models, size),), error_reduction_sentence(comparison), f"unseen data: {unseen}")


def added_variable(diagnosis: Diagnosis, evaluation: Evaluation | None = None, effect: str = "") -> Figure:
    """Draw what the model leaves of the output against the best candidate, and against its best rival.

    From both all is taken off that the model takes up. A right effect lies on a line through its estimated size; noise
    alone would lie on the abscissa.

    Parameters
    ----------
    diagnosis : from `accelcal.diagnose`.
    evaluation : of the same model on held-out data; by default what the diagnosis was made from.
    effect : the candidate; by default the best one.
    """
    judged = evaluation or diagnosis.heldout or diagnosis.where
    where = "on held-out data" if judged is not diagnosis.where else "on the fitted data"
    lacking = {
        f"{called}{spelled(c.effect)}": (find(c.effect), c.shape, c.estimate)
        for called, c in zip(("", "best rival: "), leading(diagnosis, effect), strict=False)
    }
    return evidence(against(judged, diagnosis.fit, lacking), f"Error of the output {where} against the effect, ± 2 σ")


def added_variables(comparison: Comparison) -> Figure:
    """Draw what each model of a growing series leaves of the output against the effect that the next one adds.

    Parameters
    ----------
    comparison : of a base, then one more effect at a time.
    """
    panels, evaluations = list[Panel](), comparison.evaluations[0]
    for before, fit, better in zip(evaluations, comparison.fits, comparison.fits[1:], strict=False):
        values, lacking = better.values(), dict[str, systematic.Lacking]()
        for name in better.model.effects[len(fit.model.effects) :]:
            terms = [term for term in values.terms if term.effect.name == name]
            if terms:  # an effect on noise has none
                lacking[spelled(name)] = find(name), terms[0].shape, [values.by_name[term.name] for term in terms]
        panels += against(before, fit, lacking)
    return evidence(panels, "Error of the output on unseen data against each effect, before it is added, ± 2 σ")


def evidence(panels: Sequence[Panel], headline: str) -> Figure:
    """A figure of some panels."""
    return (
        Figure(tuple(panels), headline, columns=2)
        if panels
        else sentence(headline, "No effect is a function of the motion.")
    )


def against(evaluation: Evaluation, fit: Fit, lacking: Mapping[str, systematic.Lacking]) -> list[Panel]:
    """Panels of the error of a model against effects that it lacks, by their titles; none of one that is no function of
    the motion."""
    panels = []
    for name, drawn in zip(lacking, systematic.added_variables(evaluation, fit, [*lacking.values()]), strict=True):
        if drawn is None:
            continue
        factor, unit = formatting.prefixed("m/s²", drawn.x, drawn.y)
        ends = np.array([drawn.x[0], drawn.x[-1]]) * factor
        marks = (
            Level(0.0),
            Line(ends, ends * drawn.slope, "line through all samples", "model", solid=True),
            Points(
                drawn.x * factor, drawn.y * factor, "mean error of the output", "measured", 2.0 * drawn.std * factor
            ),
        )
        text = f"{100.0 * drawn.explained:.0f} % of the systematic error"
        if lacking[name][0].port == "position":  # most of it lies above the band of the output
            text = f"slope {drawn.slope:.2f} ± {drawn.slope_std:.2f} (1: as fitted)"
        title = f"{name}: {text}"
        panels.append(Panel(marks, Axis("contribution, rest taken off", unit, few=True), Axis("error", unit), title))
    return panels


def leading(diagnosis: Diagnosis, effect: str = "") -> list[Candidate]:
    """A candidate, by default the best, and the best other one that is no curve, which would hold both."""
    candidates = diagnosis.scan.candidates
    first = next((c for c in candidates if c.effect == (effect or c.effect)), None)
    if first is None:
        return []
    rival = next((c for c in candidates if c is not first and not find(c.effect).family), None)
    return [first] if rival is None else [first, rival]


MOST_SIZES, MOST_SIGNATURES = 50, 20
"""Effects that are drawn at each port, and on the map of signatures."""
PERIODS = 10.0
"""Half periods over which the limit of a tumble test is drawn, its slowest change over the fastest."""


def detectable_sizes(power: Power) -> Figure:
    """Draw the size of each effect that is found with 95 % probability, as its largest contribution.

    Parameters
    ----------
    power : from `accelcal.power`.
    """
    panels = []
    for unit, title in (("m/s²", "at the sensor"), ("m", "at the encoder")):
        there = [s for s in power.detectabilities if s.visible and (find(s.effect).port == "position") == (unit == "m")]
        several = sorted(there, key=lambda s: s.largest)[:MOST_SIZES]
        if several:
            largest, rows = np.array([s.largest for s in several]), np.arange(float(len(several)))
            names = [spelled(s.effect) for s in several]
            remarks = [
                f"{name}: {min(s.smallest):.3g} {s.unit}, at most {s.largest:.3g} {unit}"
                for name, s in zip(names, several, strict=True)
            ]
            sizes = Axis(
                "largest contribution at the smallest detectable size",
                unit,
                "log",
                (0.7 * float(largest[0]), 1.4 * float(largest[-1])),
            )
            effects = Axis(range=(len(several) - 0.5, -0.5), ticks=(rows.tolist(), names))
            points = Points(largest, rows, hover=remarks)
            panels.append(Panel((points,), sizes, effects, title, 20.0 * (len(several) + 1)))
    if not panels:
        return sentence("Detection limits", "No effect is detectable on this record.")
    undetectable = [spelled(s.effect) for s in power.detectabilities if not s.visible]
    return Figure(
        tuple(panels),
        f"Detection limits of this record: 95 % probability, {power.examined} alternatives",
        f"not detectable: {', '.join(undetectable)}" if undetectable else "",
    )


def drift_limits(bandwidth: DriftBandwidth) -> Figure:
    """Draw the smallest sinusoidal change that a record shows at 5 standard deviations, and that of a tumble test.

    Parameters
    ----------
    bandwidth : from `accelcal.power(...).drift`.
    """
    tumble, panels = bandwidth.tumble, []
    slow = np.array([tumble.frequency / PERIODS, tumble.frequency])
    for name, smallest, limit, unit in (
        ("bias", bandwidth.bias, tumble.bias, "m/s²"),
        ("scale factor", bandwidth.scale_factor, tumble.scale_factor, "1"),
    ):
        shown = np.isfinite(smallest)
        marks = (
            Line(bandwidth.frequency[shown], smallest[shown], "this record"),
            Line(slow, np.full(2, limit), f"tumble test of {tumble.seconds / 60.0:.0f} min", "other"),
        )
        every = np.append(smallest[shown], limit)
        frequency = Axis("frequency of the change", "Hz", "log", (float(slow[0]), 1.2 * float(bandwidth.frequency[-1])))
        size = Axis(f"amplitude of the {name}", unit, "log", (0.6 * float(every.min()), 1.6 * float(every.max())))
        panels.append(Panel(marks, frequency, size))
    best = int(np.argmin(bandwidth.scale_factor))
    least = float(bandwidth.scale_factor[best])
    headline = "This record shows no change of the scale factor"
    if np.isfinite(least):
        blind = np.flatnonzero(bandwidth.scale_factor > 2.0 * least)
        first = int(np.max(blind[blind < best], initial=-1)) + 1
        last = int(np.min(blind[blind > best], initial=len(bandwidth.frequency))) - 1
        low, high = (formatting.number(float(bandwidth.frequency[i]), 2) for i in (first, last))
        size_text = formatting.number(2.0 * least, 2)
        headline = f"Changes of the scale factor by {size_text} are shown at 5 sigma from {low} to {high} Hz"
    note = (
        "smallest amplitude that is shown, whatever its phase; the tumble has 24 dwells, the noise of this "
        "record and angles to 0.001 degrees"
    )
    return Figure(tuple(panels), headline, note, columns=2)


def chosen(power: Power, first: Sequence[str] = (), most: int = MOST_SIGNATURES) -> SignatureCorrelation:
    """Effects in `first`, then confounded ones, then the best detectable; correlated ones next to each other.

    Parameters
    ----------
    power : of the record.
    first : effects that must be on the map, if they have one column.
    most : effects on the map.
    """
    whole = signature_correlation(power)
    tied = [name for group in power.ties for name in group.members]
    rest = sorted(whole.names, key=lambda name: power[name].largest)
    wanted = [n for n in dict.fromkeys([*first, *tied, *rest]) if n in whole.names][:most]
    return whole.of(_chain(whole.of(wanted)))


def signatures(power: Power, first: Sequence[str] = ()) -> Figure:
    """Draw the correlation of the signatures of effects on a record.

    Parameters
    ----------
    power : from `accelcal.power`.
    first : effects that must be on the map.
    """
    shown = chosen(power, first)
    if len(shown.names) < 2:
        return sentence("Signatures", "Fewer than two effects are detectable on this record.")
    names, rho = [spelled(n) for n in shown.names], shown.correlation
    text = [[f"{100 * v:.0f}" if abs(v) >= 0.5 else "" for v in row] for row in rho]
    hover = [
        [f"{a} and {b}: ρ = {v:.3f}" for b, v in zip(names, row, strict=True)]
        for a, row in zip(names, rho, strict=True)
    ]
    tiles = Tiles(rho, names, names, text, hover, 1.0, slanted=True)
    panel = Panel((tiles,), Axis("effect (ρ has unit 1)"), Axis(), height=24.0 * len(names))
    return Figure(
        (panel,),
        "Correlation of the signatures of effects on this record, base parameters projected out",
        "ρ in percent where |ρ| is 50 or more, orange where it is positive; beyond 95 % two effects are confounded",
        legend=False,
    )


def _chain(correlations: SignatureCorrelation) -> list[str]:
    """An order in which each effect follows the one that it correlates with most."""
    order = list(range(min(1, len(correlations.names))))
    while len(order) < len(correlations.names):
        left = [i for i in range(len(correlations.names)) if i not in order]
        order.append(max(left, key=lambda i: abs(float(correlations.correlation[order[-1], i]))))
    return [correlations.names[i] for i in order]
