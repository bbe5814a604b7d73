"""Leaves of a model file: the range of each, and what they must hold together so that the fit is possible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import fields, is_dataclass
from itertools import pairwise
from typing import Any

import numpy as np

from accelcal._support.plain_text import OBEYED_IN_NAMES
from accelcal.effects import Effect
from accelcal.effects.own import probe
from accelcal.estimation.estimate import Fit
from accelcal.model import Term
from accelcal.results.json_text import LONGEST_TEXT, ModelFileError

ROUNDING = 1e-6
"""Relative difference that rounding may leave between a covariance and what follows from it."""
LEAST_SCALE = 1e-6
"""Least magnitude of 1 + scale_factor: an output that hardly follows the acceleration cannot be inverted."""
MOST_TYPICAL = 1e12
"""Largest coefficient, in typical sizes of its effect."""


LARGEST = 1e15
"""Largest magnitude of any number: products of a few of them stay finite."""
LONGEST_NAME = 200
"""Characters of the name of an effect, a channel or a unit."""
NAMES = ("effect", "channel", "symbol", "unit", "name")
"""Fields that hold one."""
MOST_RUNS = 10_000
"""Recordings of one fit."""
_LEVELS = tuple(f"runs.noise.{part}" for part in ("all", "rest", "motion"))
_FILTERS = ("rig.output_filters", "rig.position_filters")
_SPECTRA = ("noise_effects.spectrum", "noise_effects.without")
_POSITIVE = (
    *("model.priors.std", "runs.noise.noise.q", "runs.noise.noise.r", "runs.noise.declared", "runs.noise.crossover"),
    *(f"{level}.{key}" for level in _LEVELS for key in ("density", "reading")),
    *(f"rig.sensor.{key}" for key in ("noise", "range", "bias_instability", "random_walk")),
    *(f"{one}.{key}" for one in _FILTERS for key in ("cutoff", "rate")),
    *("runs.noise.band", "rig.lowpass.cutoff", "rig.resolution", "rig.tolerance", "dwells.std"),
)
_NOT_NEGATIVE = (
    *("estimates.std", "estimates.run", "shapes.std", "runs.nis", "runs.readings", "runs.samples"),
    *(f"spreads.{key}" for key in ("value", "low", "high", "mean_half", "next_half")),
    *(f"{level}.{key}" for level in _LEVELS for key in ("density_std", "reading_std", "count")),
    *(f"runs.noise.noise.growth.{key}" for key in ("q", "r", "mean")),
    *(f"{spectrum}.{key}" for spectrum in _SPECTRA for key in ("f", "floor")),
    *("rig.uncertainty.encoder_scale", "rig.uncertainty.level", "rig.uncertainty.misalignment", "rig.offset_tolerance"),
    *("noise_effects.std", "dwells.ratio", "dwells.scatter"),
)
RANGES: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(_POSITIVE, (1e-60, LARGEST)),  # the square of its inverse is finite
    **dict.fromkeys(_NOT_NEGATIVE, (0.0, LARGEST)),
    **dict.fromkeys(
        ("spreads.p_value", "noise_effects.p_value", "dwells.p_value", "rig.lowpass.tolerance"), (0.0, 1.0)
    ),
    **dict.fromkeys((f"{one}.order" for one in _FILTERS), (1.0, 10.0)),
    **dict.fromkeys((f"{one}.length" for one in _FILTERS), (0.0, 1e6)),
    **{
        "rig.lowpass.tolerance": (0.0, 1.0),
        "tilt": (0.0, 180.0),
        "rig.gravity_along_axis": (-1e3, 1e3),
        "dwells.freedom": (-1e6, 1e6),
    },
    **dict.fromkeys(("estimates.run", "shapes.run"), (0.0, MOST_RUNS - 1.0)),
}
"""Least and largest value of numbers that may not be any, by path."""
UNKNOWN = {
    *("spreads.high", "spreads.mean_half", "spreads.next_half", "noise_effects.std", "dwells.ratio"),
    *(f"{level}.{key}" for level in _LEVELS for key in ("density_std", "reading_std")),
    *("goes_with.slope", "goes_with.std", "seen_by_runs.std"),
}
"""Numbers that need not be finite."""


def require_consistent(fit: Fit) -> None:
    """Compare the leaves of a fit that was read from a file with their ranges, and with one another.

    Raises
    ------
    ModelFileError
        Naming the path to the leaf that is out of range or contradicts the others, and what is expected.
    """
    for check in (_leaves, _once, _runs, _parameters, _fixed, _shapes, _spans, _spreads, _noise, _rig, _dwells):
        for where, sentence in check(fit):
            raise ModelFileError(f"{where}: {sentence}")
    _require_covariance(fit)


Found = Iterator[tuple[str, str]]


def _leaves(part: Any, where: str = "", rule: str = "") -> Found:
    """Numbers out of their range and texts that a terminal would obey; `rule` is the path without numbers and keys."""
    if isinstance(part, Effect):
        return
    if is_dataclass(part):
        for field in fields(part):
            below = getattr(part, field.name)
            yield from _leaves(below, f"{where}.{field.name}".lstrip("."), f"{rule}.{field.name}".lstrip("."))
    elif isinstance(part, Mapping):
        for key, below in part.items():
            yield from _leaves(key, where, f"{rule}.name")
            yield from _leaves(below, f"{where}.{key}", rule)
    elif isinstance(part, tuple | list):
        for i, below in enumerate(part):
            yield from _leaves(below, f"{where}[{i}]", rule)
    elif isinstance(part, np.ndarray):
        yield from _leaves(part.tolist(), where, rule)
    elif isinstance(part, str):
        most = LONGEST_NAME if rule.rpartition(".")[2] in NAMES else LONGEST_TEXT
        if len(part) > most or OBEYED_IN_NAMES.search(part):
            yield where, f"expected a text of at most {most} characters, without control characters"
    elif isinstance(part, float | int) and not isinstance(part, bool):
        low, high = RANGES.get(rule, (-LARGEST, LARGEST))
        signed = low == 0.0 and math.copysign(1.0, part) < 0.0
        if (math.isfinite(part) or rule not in UNKNOWN) and (signed or not low <= part <= high):
            yield where, f"found {part:.10g}, expected a number from {low:.10g} to {high:.10g}"


def _once(fit: Fit) -> Found:
    lists = {
        "model.per_run": fit.model.per_run,
        "shapes": [e.name for e in fit.shapes],
        "spreads": [spread.name for spread in fit.spreads],
        "noise_effects": [one.name for one in fit.noise_effects],
        **{
            f"runs[{i}].noise.noise.growth": [grown.effect.name for grown in run.noise.noise.growth]
            for i, run in enumerate(fit.runs)
        },
    }
    for where, names in lists.items():
        if len(set(names)) < len(names):
            yield where, f"found {', '.join(names)}, expected each name once"


def _runs(fit: Fit) -> Found:
    if len(fit.runs) > MOST_RUNS:
        yield "runs", f"found {len(fit.runs)}, expected at most {MOST_RUNS}"


def _parameters(fit: Fit) -> Found:
    terms = {term.name: term for term in fit.model.terms}
    by_name: dict[str, list[int | None]] = {}
    for i, e in enumerate(fit.estimates):
        term = terms[e.name]
        if e.unit != term.unit:
            yield f"estimates[{i}].unit", f"found {e.unit!r}, expected {term.unit!r}, the unit of {e.name}"
        if abs(e.value) > MOST_TYPICAL * term.effect.scale:
            yield (
                f"estimates[{i}].value",
                (
                    f"found {e.value:.4g}, expected at most {MOST_TYPICAL * term.effect.scale:.4g}: {e.name} is "
                    f"typically {term.effect.scale:.2g} {term.unit}"
                ),
            )
        by_name.setdefault(e.name, []).append(e.run)
    for name, runs in by_name.items():
        if runs not in ([None], list(range(len(fit.runs)))):
            listed = ", ".join("all" if run is None else str(run) for run in runs)
            yield "estimates", f"found {name} of the runs {listed}, expected it once for all runs, or once for each"
    scale = fit.values().scale
    if not abs(scale) >= LEAST_SCALE:
        yield "estimates", f"1 + scale_factor is {scale:.4g}, expected at least {LEAST_SCALE:g} in magnitude"


def _fixed(fit: Fit) -> Found:
    for i, e in enumerate(fit.estimates):
        held = fit.model.fixed.get(e.name)
        if held is not None and (e.value != held or e.std != 0.0):
            yield f"estimates[{i}]", f"found {e.value:.10g} with std {e.std:.4g}, expected {held:.10g}, held exactly"


def _shapes(fit: Fit) -> Found:
    for i, e in enumerate(fit.shapes):
        effect, _, shape = e.name.partition(".")
        if shape not in fit.model.shapes.get(effect, {}):
            yield f"shapes[{i}].name", f"found {e.name!r}, expected a shape parameter of an effect of the model"
    for name, given in fit.model.shapes.items():
        if name not in fit.model.effects:
            yield f"model.shapes.{name}", "expected shape parameters of effects of the model alone"
            continue
        term = next(term for term in _evaluated(fit) if term.effect.name == name)
        unknown = set(given) - set(term.effect.shapes)
        if unknown:
            yield f"model.shapes.{name}", f"found {', '.join(sorted(unknown))}, which {name} does not have"
        signals = probe(term.effect.needs)
        for key, declared in term.effect.shapes.items():
            if declared.span(signals)[0] > 0.0 and not given[key] > 0.0:
                yield f"model.shapes.{name}.{key}", f"found {given[key]:.10g}, expected more than 0 {declared.unit}"
        with np.errstate(all="ignore"):
            column = term.effect.column(signals, **term.shape)
        if not np.all(np.isfinite(column)):
            yield f"model.shapes.{name}", f"{name} is not finite with these values on an ordinary motion"


def _evaluated(fit: Fit) -> tuple[Term, ...]:
    noise = tuple(Term(effect, 0, fit.model.shapes.get(effect.name, {})) for effect in fit.model.noise_effects)
    return (*fit.model.terms, *noise)


def _spans(fit: Fit) -> Found:
    spans = [(f"validity.{key}", span) for key, span in fit.validity.items()]
    spans += [(f"runs[{i}]", (run.start, run.end)) for i, run in enumerate(fit.runs)]
    for where, (low, high) in spans:
        if low > high:
            yield where, f"found {low:.10g} to {high:.10g}, expected the smaller number first"
    for key in ("a", "v", "p", "frequency") if fit.runs else ():
        if key not in fit.validity:
            yield f"validity.{key}", "it is missing; expected the range of the fit"
    if fit.runs and not fit.validity["frequency"][1] > 0.0:
        yield "validity.frequency", f"found an upper end of {fit.validity['frequency'][1]:.4g} Hz, expected more than 0"


def _spreads(fit: Fit) -> Found:
    for i, spread in enumerate(fit.spreads):
        if spread.name not in fit.model.per_run:
            yield f"spreads[{i}].name", f"found {spread.name!r}, expected a coefficient of model.per_run"
        if len(spread.runs) != len(fit.runs):
            yield f"spreads[{i}].runs", f"found {len(spread.runs)} values, expected one for each of {len(fit.runs)}"


def _noise(fit: Fit) -> Found:
    known = {effect.name: effect for effect in fit.model.noise_effects}
    for i, run in enumerate(fit.runs):
        for k, grown in enumerate(run.noise.noise.growth):
            if grown.effect.name not in known:
                yield (
                    f"runs[{i}].noise.noise.growth[{k}].effect",
                    f"found {grown.effect.name!r}, which acts on no noise here",
                )
    for i, one in enumerate(fit.noise_effects):
        if one.name not in known:
            yield f"noise_effects[{i}].name", f"found {one.name!r}, expected an effect of the model that acts on noise"
        elif one.unit != known[one.name].unit:
            yield f"noise_effects[{i}].unit", f"found {one.unit!r}, expected {known[one.name].unit!r}"
        for key, spectrum in (("spectrum", one.spectrum), ("without", one.without)):
            where = f"noise_effects[{i}].{key}"
            if spectrum is None:
                continue
            if any(y.shape != (spectrum.f.size,) for y in (spectrum.f, spectrum.floor, *spectrum.growth.values())):
                yield where, f"expected {spectrum.f.size} values each, as there are frequencies"
            if any(not low < high for low, high in pairwise(spectrum.f.tolist())):
                yield f"{where}.f", "expected frequencies that grow"


def _rig(fit: Fit) -> Found:
    if fit.rig.sensor.scale is not None and not abs(fit.rig.sensor.scale) > 1e-12:
        yield "rig.sensor.scale", f"found {fit.rig.sensor.scale:.4g}, expected a scale factor that is not zero"


def _dwells(fit: Fit) -> Found:
    if fit.dwells is not None:
        counts = {len(fit.dwells.angle), len(fit.dwells.residual), len(fit.dwells.std)}
        if len(counts) > 1:
            yield "dwells", "angle, residual and std have different lengths, expected one value for each dwell"


def _require_covariance(fit: Fit) -> None:
    """Symmetric, correlations within 1, positive semi-definite within rounding, in agreement with the stds."""
    P, names = fit.covariance, [e.name for e in fit.free]
    if P.shape != (len(names),) * 2:
        raise ModelFileError(
            f"covariance: it has the shape {P.shape}, expected a row and a column for each of {', '.join(names)}"
        )
    variance = np.diag(P)
    for i, e in enumerate(fit.free):
        if not math.isclose(math.sqrt(max(0.0, float(variance[i]))), e.std, rel_tol=ROUNDING, abs_tol=1e-300):
            raise ModelFileError(
                f"covariance[{i}][{i}]: found {variance[i]:.10g}, expected {e.std**2:.10g}, the square of the "
                f"std of {e.name}"
            )
    size = np.sqrt(np.where(variance > 0.0, variance, 1.0))
    C = P / np.outer(size, size)
    _refuse(np.abs(C - C.T) > ROUNDING, P, names, "expected a symmetric matrix")
    _refuse(np.abs(C) > 1.0 + ROUNDING, P, names, "expected a correlation within 1")
    _refuse((variance == 0.0)[:, None] & (P != 0.0), P, names, "expected 0 beside a variance of 0")
    least = float(np.linalg.eigvalsh(0.5 * (C + C.T))[0]) if len(C) else 0.0
    if least < -ROUNDING:
        raise ModelFileError(
            f"covariance: its correlations have the eigenvalue {least:.4g}, expected a positive semi-definite matrix"
        )


def _refuse(wrong: np.ndarray[Any, np.dtype[np.bool_]], P: Any, names: Sequence[str], expected: str) -> None:
    if np.any(wrong):
        i, k = (int(index[0]) for index in np.nonzero(wrong))
        raise ModelFileError(
            f"covariance[{i}][{k}]: found {P[i, k]:.10g} between {names[i]} and {names[k]}, {expected}"
        )
