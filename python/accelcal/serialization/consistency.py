"""What leaves of a model file must hold together, beyond the range of each: the fit that they make is possible."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from accelcal.effects.user_file import probe
from accelcal.estimation.estimate import Fit
from accelcal.model import Term
from accelcal.serialization.errors import ModelFileError

ROUNDING = 1e-6
"""Relative difference that rounding may leave between a covariance and what follows from it."""
LEAST_SCALE = 1e-6
"""Least magnitude of 1 + scale_factor: an output that hardly follows the acceleration cannot be inverted."""
MOST_TYPICAL = 1e12
"""Largest coefficient, in typical sizes of its effect."""


def require_consistent(fit: Fit, content: Mapping[str, Any]) -> None:
    """Compare a fit, made from a file whose leaves are each within their range, with itself.

    Raises
    ------
    ModelFileError
        Naming the path to the leaf that contradicts the others, and what they demand.
    """
    for check in (
        _once,
        _runs,
        _parameters,
        _fixed,
        _shapes,
        _covariance_names,
        _spans,
        _spreads,
        _noise,
        _rig,
        _dwells,
    ):
        for where, sentence in check(fit, content):
            raise ModelFileError(f"{where}: {sentence}")
    _require_covariance(fit)


Found = Iterator[tuple[str, str]]


def _once(fit: Fit, content: Mapping[str, Any]) -> Found:
    lists = {
        "model.per_run": fit.model.per_run,
        "shapes": [e.name for e in fit.shapes],
        "run_to_run": [spread.name for spread in fit.spreads],
        "noise_effects": [one.name for one in fit.noise_effects],
        **{f"noise[{i}].growth": [g.effect.name for g in run.noise.noise.growth] for i, run in enumerate(fit.runs)},
    }
    for where, names in lists.items():
        if len(set(names)) < len(names):
            yield where, f"found {', '.join(names)}, expected each name once"


def _runs(fit: Fit, content: Mapping[str, Any]) -> Found:
    if len(content["noise"]) != len(content["data"]):
        yield "noise", f"found {len(content['noise'])} entries, expected one for each of {len(content['data'])} in data"


def _parameters(fit: Fit, content: Mapping[str, Any]) -> Found:
    terms = {term.name: term for term in fit.model.terms}
    by_name: dict[str, list[int | None]] = {}
    for i, e in enumerate(fit.estimates):
        term = terms[e.name]
        if e.unit != term.unit:
            yield f"parameters[{i}].unit", f"found {e.unit!r}, expected {term.unit!r}, the unit of {e.name}"
        if abs(e.value) > MOST_TYPICAL * term.effect.scale:
            yield (
                f"parameters[{i}].value",
                (
                    f"found {e.value:.4g}, expected at most {MOST_TYPICAL * term.effect.scale:.4g}: {e.name} is "
                    f"typically {term.effect.scale:.2g} {term.unit}"
                ),
            )
        by_name.setdefault(e.name, []).append(e.run)
    for name, runs in by_name.items():
        if runs not in ([None], list(range(len(fit.runs)))):
            listed = ", ".join("all" if run is None else str(run) for run in runs)
            yield "parameters", f"found {name} of the runs {listed}, expected it once for all runs, or once for each"
    scale = fit.values().scale
    if not abs(scale) >= LEAST_SCALE:
        yield "parameters", f"1 + scale_factor is {scale:.4g}, expected at least {LEAST_SCALE:g} in magnitude"


def _fixed(fit: Fit, content: Mapping[str, Any]) -> Found:
    for i, e in enumerate(fit.estimates):
        held = fit.model.fixed.get(e.name)
        if held is not None and (e.value != held or e.std != 0.0):
            yield f"parameters[{i}]", f"found {e.value:.10g} with std {e.std:.4g}, expected {held:.10g}, held exactly"


def _shapes(fit: Fit, content: Mapping[str, Any]) -> Found:
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


def _covariance_names(fit: Fit, content: Mapping[str, Any]) -> Found:
    names, expected = content["covariance"]["names"], [e.name for e in fit.free]
    if fit.covariance.shape != (len(expected),) * 2:
        yield (
            "covariance.matrix",
            (f"it has the shape {fit.covariance.shape}, expected a row and a column for each of {', '.join(expected)}"),
        )
    if names != [e.name if e.run is None else f"{e.name}[{e.run}]" for e in fit.free]:
        yield "covariance.names", f"expected those of the free parameters in their order: {', '.join(expected)}"


def _spans(fit: Fit, content: Mapping[str, Any]) -> Found:
    spans = [(f"validity.{key}", span) for key, span in fit.validity.items()]
    spans += [(f"data[{i}].used_s", (run.start, run.end)) for i, run in enumerate(fit.runs)]
    for where, (low, high) in spans:
        if low > high:
            yield where, f"found {low:.10g} to {high:.10g}, expected the smaller number first"
    for key in ("a", "v", "p", "frequency") if fit.runs else ():
        if key not in fit.validity:
            yield f"validity.{key}", "it is missing; expected the range of the fit"
    if fit.runs and not fit.validity["frequency"][1] > 0.0:
        yield "validity.frequency", f"found an upper end of {fit.validity['frequency'][1]:.4g} Hz, expected more than 0"


def _spreads(fit: Fit, content: Mapping[str, Any]) -> Found:
    for i, spread in enumerate(fit.spreads):
        if spread.name not in fit.model.per_run:
            yield f"run_to_run[{i}].name", f"found {spread.name!r}, expected a coefficient of model.per_run"
        if len(spread.runs) != len(fit.runs):
            yield f"run_to_run[{i}].runs", f"found {len(spread.runs)} values, expected one for each of {len(fit.runs)}"


def _noise(fit: Fit, content: Mapping[str, Any]) -> Found:
    known = {effect.name: effect for effect in fit.model.noise_effects}
    for i, run in enumerate(fit.runs):
        for k, grown in enumerate(run.noise.noise.growth):
            if grown.effect.name not in known:
                yield f"noise[{i}].growth[{k}].effect", f"found {grown.effect.name!r}, which acts on no noise here"
    for i, one in enumerate(fit.noise_effects):
        if one.name not in known:
            yield f"noise_effects[{i}].name", f"found {one.name!r}, expected an effect of the model that acts on noise"
        elif one.unit != known[one.name].unit:
            yield f"noise_effects[{i}].unit", f"found {one.unit!r}, expected {known[one.name].unit!r}"
        for key, spectrum in (("spectrum", one.spectrum), ("without", one.without)):
            where = f"noise_effects[{i}].{key}"
            if spectrum is None:
                continue
            if any(len(y) != len(spectrum.f) for y in (spectrum.floor, *spectrum.growth.values())):
                yield where, f"expected {len(spectrum.f)} values each, as there are frequencies"
            if any(not low < high for low, high in pairwise(spectrum.f.tolist())):
                yield f"{where}.frequency_hz", "expected frequencies that grow"


def _rig(fit: Fit, content: Mapping[str, Any]) -> Found:
    if fit.rig.sensor.scale is not None and not abs(fit.rig.sensor.scale) > 1e-12:
        yield "rig.sensor.scale", f"found {fit.rig.sensor.scale:.4g}, expected a scale factor that is not zero"


def _dwells(fit: Fit, content: Mapping[str, Any]) -> Found:
    if fit.dwells is not None:
        counts = {len(fit.dwells.angle), len(fit.dwells.residual), len(fit.dwells.std)}
        if len(counts) > 1:
            yield "dwells", "angle, residual and std have different lengths, expected one value for each dwell"


def _require_covariance(fit: Fit) -> None:
    """Symmetric, correlations within 1, positive semi-definite within rounding, in agreement with the stds."""
    P, names = fit.covariance, [e.name for e in fit.free]
    variance = np.diag(P)
    for i, e in enumerate(fit.free):
        if not math.isclose(math.sqrt(max(0.0, float(variance[i]))), e.std, rel_tol=ROUNDING, abs_tol=1e-300):
            raise ModelFileError(
                f"covariance.matrix[{i}][{i}]: found {variance[i]:.10g}, expected {e.std**2:.10g}, the square of the "
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
            f"covariance.matrix: its correlations have the eigenvalue {least:.4g}, expected a positive semi-definite "
            "matrix"
        )


def _refuse(wrong: np.ndarray[Any, np.dtype[np.bool_]], P: Any, names: Sequence[str], expected: str) -> None:
    if np.any(wrong):
        i, k = (int(index[0]) for index in np.nonzero(wrong))
        raise ModelFileError(
            f"covariance.matrix[{i}][{k}]: found {P[i, k]:.10g} between {names[i]} and {names[k]}, {expected}"
        )
