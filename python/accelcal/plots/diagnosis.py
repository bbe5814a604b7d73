"""Figures of a diagnosis: candidates by significance, and the error that each effect takes away."""

from __future__ import annotations

import numpy as np

from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.plots.figure import Axis, Bars, Figure, Level, Line, Panel, Text, sentence
from accelcal.plots.numbers import candidate_groups, error_reduction_sentence, model_names, share_text
from accelcal.results import words as formatting
from accelcal.selection.nested_models import NestedModels


def ranking(diagnosis: Diagnosis) -> Figure:
    """Draw equivalent standard deviations of each candidate; significant ones filled, confounded ones in brackets.

    Parameters
    ----------
    diagnosis : from `accelcal.diagnose`.
    """
    groups = candidate_groups(diagnosis)
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
            x, y = np.array([1.18, 1.2, 1.2, 1.18]) * top, np.repeat([begin - 0.3, end + 0.3], 2)
            brackets += [Line(x, y, role="other", solid=True), Text(1.22 * top, 0.5 * (begin + end), "confounded")]
        begin = end + 1
    bars = Bars(
        snr,
        [c.p_value < diagnosis.alpha for c in flat],
        ("significant", "not significant"),
        across=True,
        text=[f"{c.snr:.1f} σ" for c in flat],
        hover=[f"{c.snr:.1f} σ, family-wise p {c.p_value:.2g}: {_amount(c)}" for c in flat],
    )
    names = Axis(range=(len(flat) - 0.4, -0.6), ticks=(range(len(flat)), [spelled(c.effect) for c in flat]), grid=False)
    significance = Axis("significance", "equivalent standard deviations", range=(0.0, 1.45 * top))
    panel = Panel((bars, *brackets), significance, names, height=20.0 + 30.0 * len(flat))
    return Figure((panel,), headline, f"family-wise false-alarm rate {diagnosis.alpha:g}")


def _amount(c: Candidate) -> str:
    if len(c.estimate) == 1:
        return f"{c.estimate[0]:.4g} ± {c.std[0]:.2g} {c.unit}, at most {c.largest:.3g}"
    return f"{len(c.estimate)} coefficients, at most {c.largest:.3g}"


def error_reduction(nested: NestedModels) -> Figure:
    """Draw one bar for each model on unseen data, hatched where the effect is not in the model, and the noise floor.

    Parameters
    ----------
    nested : from `accelcal.selection.nested_models.nested_models`.
    """
    floor, errors = nested.floor, np.array(nested.errors)
    factor, unit = formatting.prefixed("m", errors, floor.value)
    errors = errors * factor
    ends = [(around.low, around.high) if around else (np.nan, np.nan) for around in nested.intervals]
    low, high = np.array(ends).T * factor
    top = np.fmax(np.fmax(errors, high), floor.high * factor)
    bars = Bars(
        errors,
        [member.in_model for member in nested.models],
        ("in the model", "not in the model yet"),
        low,
        high,
        [
            "\n".join([f"{e:.3g} {unit}", *share_text(nested, i).split(", ")]).rstrip()
            for i, e in enumerate(errors.tolist())
        ],
        top,
    )
    said = "noise alone, with 95 % prediction interval"
    level = Level(floor.value * factor, floor.low * factor, floor.high * factor, said, "floor")
    names = model_names(nested)
    models = Axis("model", range=(-0.6, len(names) - 0.4), ticks=(range(len(names)), names), grid=False)
    size = Axis("rms error", unit, range=(0.0, 1.3 * float(np.nanmax(top))))
    of_session = "a part of the fitted run, which does not reveal set-up and slow-drift errors"
    unseen = of_session if nested.same_run else "another recording"
    return Figure((Panel((bars, level), models, size),), error_reduction_sentence(nested), f"unseen data: {unseen}")
