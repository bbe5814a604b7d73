"""The model file: a fit as JSON, out and in again, with where it came from."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from accelcal._core import __version__
from accelcal._support.arguments import checked
from accelcal._support.errors import OBEYED_IN_NAMES, visible
from accelcal._support.values import face, leaves, listing
from accelcal.effects import CATALOGUE, Effect, find, side_channel
from accelcal.effects.guard import LONGEST
from accelcal.effects.mechanisms import unit_of_channel
from accelcal.effects.own import ExpressionError, from_written, probe
from accelcal.estimation.drive import LEAST_SCALE
from accelcal.estimation.estimate import Fit
from accelcal.estimation.gauss_newton import Layout, outputs_of
from accelcal.estimation.remarks import KINDS
from accelcal.io import atomic_write
from accelcal.model import OwnEffect, SideChannel, Term
from accelcal.results.json_text import AGAIN, LONGEST_TEXT, ModelFileError, dumps, plain, read_json

NAME = "accelcal/model/"
MODEL_SCHEMA = f"{NAME}5"
"""Of the files that are written."""
PRESENT = int(MODEL_SCHEMA.removeprefix(NAME))
MAKE = "make one with: accelcal fit RUN.csv -o MODEL.json"


def migrated(content: Any) -> dict[str, Any]:
    """Content of a model file of any known schema in that of the present one.

    Raises
    ------
    ModelFileError
        If it is no model file, an earlier program than 0.1.0 or a newer version wrote it.
    """
    schema = content.get("schema") if isinstance(content, dict) else None
    number = re.fullmatch(rf"{NAME}([1-9]\d{{0,3}})", schema) if isinstance(schema, str) else None
    if number is None:
        described = "none" if schema is None else f'"{visible(schema[:40])}"' if isinstance(schema, str) else "no text"
        raise ModelFileError(f'expected a model file with the schema "{MODEL_SCHEMA}", found {described}; {MAKE}')
    version = content.get("version")
    written = f"accelcal {visible(version[:20])}" if isinstance(version, str) else "a version that is not named"
    if int(number[1]) > PRESENT or _is_newer(version):
        raise ModelFileError(
            f'{written} wrote this model file with the schema "{schema}"; this is accelcal {__version__}, which reads '
            f'"{MODEL_SCHEMA}" and older ones. Update accelcal, or {MAKE}'
        )
    if not isinstance(version, str) or not re.fullmatch(r"\d{1,4}\.\d{1,4}\.\d{1,4}[0-9A-Za-z.+-]{0,20}", version):
        raise ModelFileError(f'version: {written} is not one, expected such as "{__version__}"')
    if int(number[1]) < min(STEPS):
        raise ModelFileError(f'found the schema "{schema}", which is no longer read; {MAKE}')
    for step in range(int(number[1]), PRESENT):
        content = STEPS[step](content)
    if isinstance(rig := content.get("rig"), dict):  # schema 5 began without an arm, axes, and without what follows
        content = {**content, "rig": {"arm": None, "arm_std": None, "axle": None, **rig}}
    rest = {key: value for key, value in content.items() if key not in ("schema", "version")}
    filled: dict[str, Any] = {"at_mean": [], "at_shapes": [], **rest}
    parts = {name: filled.get(name) for name in ("estimates", "shapes", "at_mean", "runs")}
    return filled | {
        name: [{"axis": "", **part} if isinstance(part, dict) else part for part in several]
        for name, several in parts.items()
        if isinstance(several, list)
    }


def _is_newer(version: object) -> bool:
    """Whether a file of this version may hold what this program does not know: its first two numbers are higher."""
    numbers = re.match(r"(\d{1,6})\.(\d{1,6})\b", version) if isinstance(version, str) else None
    here = re.match(r"(\d+)\.(\d+)", __version__)
    return bool(numbers and here) and tuple(map(int, numbers.groups())) > tuple(map(int, here.groups()))  # type: ignore[union-attr]


def from_2_to_3(content: dict[str, Any]) -> dict[str, Any]:
    """Schema 3 has the names of the fields for keys, and words for numbers that are not finite.

    Raises
    ------
    ModelFileError
        If the content lacks a part that schema 2 has.
    """
    try:
        model, dwells = content["model"], content["dwells"]
        own_effects = [
            {"name": effect["name"], "digest": effect["sha256"], "source": effect["source"]} for effect in model["own"]
        ]
        return {
            **{key: content[key] for key in ("method", "validity", "remarks", "rig", "shapes")},
            **{"schema": f"{NAME}3", "version": content["version"], "model": {**model, "own": own_effects}},
            **{"covariance": content["covariance"]["matrix"], "origins": {"side": {}, **content["origins"]}},
            **{"seen_by_runs": [], "goes_with": [], "tilt": content["tilt_deg"]},
            "estimates": [
                {key: value for key, value in e.items() if key != "stands_for"} for e in content["parameters"]
            ],
            "runs": [_run(run, noise) for run, noise in zip(content["data"], content["noise"], strict=True)],
            "spreads": [_filled("Infinity", spread) for spread in content["run_to_run"]],
            "dwells": dwells and _filled("NaN", dwells),
            "noise_effects": [
                {
                    **_filled("Infinity", effect, "std"),
                    "spectrum": _spectrum(effect["spectrum"]),
                    "without": _spectrum(effect["without"]),
                }
                for effect in content["noise_effects"]
            ],
        }
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelFileError(
            f"a part that a model file of schema 2 has is missing or of another kind ({error})"
        ) from None


def from_3_to_4(content: dict[str, Any]) -> dict[str, Any]:
    """Schema 4 has a code with each remark; before, that on a slow residual came first.

    Raises
    ------
    ModelFileError
        If the content lacks a part that schema 3 has.
    """
    try:
        slow, dwells = float(content["tilt"]) > 0.0, content["dwells"]
        fit = [
            _noted(text, "slow_residual" if slow and not k else "noted") for k, text in enumerate(content["remarks"])
        ]
        still = dwells and {**dwells, "remarks": [_noted(text) for text in dwells["remarks"]]}
    except (AttributeError, KeyError, TypeError, ValueError) as error:
        raise ModelFileError(
            f"a part that a model file of schema 3 has is missing or of another kind ({error})"
        ) from None
    return {**content, "schema": f"{NAME}4", "remarks": fit, "dwells": still}


def _noted(text: str, code: str = "noted") -> dict[str, Any]:
    """Remark of schema 4."""
    return {"code": code, "sentence": text.rstrip("."), "values": {}}


def _run(run: Mapping[str, Any], noise: Mapping[str, Any]) -> dict[str, Any]:
    """Run of schema 3, with its noise."""
    labels = {"date": None, "mounting": "", "operator": "", **run.get("labels", {})}
    start, end = run["used_s"]
    report = {
        "noise": {key: noise[key] for key in ("q", "r", "growth")},
        **{key: _level(noise[key]) for key in ("all", "rest", "motion")},
        **{"declared": noise["declared_m_per_s2_rthz"], "crossover": noise["crossover_hz"], "band": noise["band_hz"]},
        "reference": noise.get("reference", "position"),
    }
    return {
        **{"name": run["file"], "digest": run["sha256"], "session": run["session_sha256"], "start": start, "end": end},
        **{key: run[key] for key in ("readings", "samples", "log_likelihood", "nis")},
        **{"noise": report, "labels": labels},
    }


def _level(level: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Noise of a part of a record."""
    if level is None:
        return None
    filled = _filled("NaN", level)
    names = {"density_m_per_s2_rthz": "density", "reading_m": "reading"}
    return {names.get(key, key): value for key, value in filled.items()}


def _spectrum(spectrum: Mapping[str, Any] | None) -> dict[str, Any] | None:
    """Spectrum of noise."""
    return (
        None if spectrum is None else {"f" if key == "frequency_hz" else key: value for key, value in spectrum.items()}
    )


def _filled(word: str, part: Mapping[str, Any], *keys: str) -> dict[str, Any]:
    """Part with a word for null, by default under every key."""
    return {key: word if value is None and (not keys or key in keys) else value for key, value in part.items()}


def from_4_to_5(content: dict[str, Any]) -> dict[str, Any]:
    """Schema 5 has the noise of a reading, the ratio of a rig, whose clock is trusted, and their uncertainty; what is
    no rig stays for the check to refuse."""
    rig = content.get("rig")
    if isinstance(rig, dict) and isinstance(rig.get("uncertainty"), dict):
        unknown = {"clock_rate": None, "reference_zero": None, **rig["uncertainty"]}
        rig = {"trusted_clock": None, "reading_noise": None, "ratio": None, **rig, "uncertainty": unknown}
    return {**content, "schema": f"{NAME}5", "rig": rig}


STEPS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {2: from_2_to_3, 3: from_3_to_4, 4: from_4_to_5}
"""From each older schema to the next."""


ROUNDING = 1e-6
"""Relative difference that rounding may leave between a covariance and what follows from it."""
MOST_TYPICAL = 1e12
"""Largest coefficient, in typical sizes of its effect."""


LARGEST = 1e15
"""Largest magnitude of any number: products of a few of them stay finite."""
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
    *(f"{path}.{key}" for path in _FILTERS for key in ("cutoff", "rate")),
    *("runs.noise.band", "rig.lowpass.cutoff", "rig.resolution", "rig.reading_noise", "rig.tolerance", "dwells.std"),
    "rig.arm_std",
)
_NOT_NEGATIVE = (
    *("estimates.std", "estimates.run", "shapes.std", "at_mean.std", "runs.nis", "runs.readings", "runs.samples"),
    *(f"spreads.{key}" for key in ("value", "low", "high", "mean_half", "next_half")),
    *(f"{level}.{key}" for level in _LEVELS for key in ("density_std", "reading_std", "count")),
    *(f"runs.noise.noise.growth.{key}" for key in ("q", "r", "mean")),
    *(f"{spectrum}.{key}" for spectrum in _SPECTRA for key in ("f", "floor")),
    *(f"rig.uncertainty.{key}" for key in ("clock_rate", "encoder_scale", "reference_zero", "level", "misalignment")),
    "rig.offset_tolerance",
    "rig.arm",
    "at_shapes",
    *("noise_effects.std", "dwells.ratio", "dwells.scatter"),
)
RANGES: Mapping[str, tuple[float, float]] = {
    **dict.fromkeys(_POSITIVE, (1e-60, LARGEST)),  # the square of its inverse is finite
    **dict.fromkeys(_NOT_NEGATIVE, (0.0, LARGEST)),
    **dict.fromkeys(
        ("spreads.p_value", "noise_effects.p_value", "dwells.p_value", "rig.lowpass.tolerance"), (0.0, 1.0)
    ),
    **dict.fromkeys((f"{path}.order" for path in _FILTERS), (1.0, 10.0)),
    **dict.fromkeys((f"{path}.length" for path in _FILTERS), (0.0, 1e6)),
    **{
        "rig.lowpass.tolerance": (0.0, 1.0),
        "tilt": (0.0, 180.0),
        "rig.gravity_along_axis": (-1e3, 1e3),
        "rig.axle": (-1.6, 1.6),
        "dwells.freedom": (-1e6, 1e6),
    },
    **dict.fromkeys(("estimates.run", "shapes.run", "at_mean.run"), (0.0, MOST_RUNS - 1.0)),
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
    unknown = [note.code for note in fit.remarks if note.code not in KINDS]
    if unknown:
        raise ModelFileError(f"remarks: code is {unknown[0]!r}; expected one of docs/loop.md")
    for check in (_leaves, _once, _runs, _parameters, _means, _fixed, _shapes, _spans, _spreads, _noise, _rig, _dwells):
        for where, sentence in check(fit):
            raise ModelFileError(f"{where}: {sentence}")
    _require_covariance(fit)


Found = Iterator[tuple[str, str]]


def _leaves(fit: Fit) -> Found:
    """Numbers out of their range and texts that a terminal would obey."""
    for where, rule, leaf in leaves(fit, whole=(Effect,)):
        if isinstance(leaf, str):
            most = LONGEST if rule.rpartition(".")[2] in NAMES else LONGEST_TEXT
            if len(leaf) > most or OBEYED_IN_NAMES.search(leaf):
                yield where, f"expected a text of at most {most} characters, without control characters"
        elif isinstance(leaf, float | int) and not isinstance(leaf, bool):
            low, high = RANGES.get(rule, (-LARGEST, LARGEST))
            signed = low == 0.0 and math.copysign(1.0, leaf) < 0.0
            if (math.isfinite(leaf) or rule not in UNKNOWN) and (signed or not low <= leaf <= high):
                yield where, f"found {leaf:.10g}, expected a number from {low:.10g} to {high:.10g}"


def _once(fit: Fit) -> Found:
    lists = {
        "model.per_run": fit.model.per_run,
        "shapes": [e.name for e in fit.shapes],
        "spreads": [spread.name for spread in fit.spreads],
        "noise_effects": [effect.name for effect in fit.noise_effects],
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
    by_name: dict[str, list[tuple[int | None, str]]] = {}
    for i, e in enumerate(fit.estimates):
        term = terms[e.name]
        if e.unit != term.unit:
            yield f"estimates[{i}].unit", f"found {e.unit!r}, expected {term.unit!r}, the unit of {e.name}"
        typical = term.effect.prior.typical
        if abs(e.value) > MOST_TYPICAL * typical:
            yield (
                f"estimates[{i}].value",
                (
                    f"found {e.value:.4g}, expected at most {MOST_TYPICAL * typical:.4g}: {e.name} is "
                    f"typically {typical:.2g} {term.unit}"
                ),
            )
        by_name.setdefault(e.name, []).append((e.run, e.axis))
    layout = Layout.of(fit.model, outputs_of(fit.runs)) if fit.runs else None
    for name, places in by_name.items():
        slots = [layout.whose(layout.slots[i][1]) for i in layout.rows_of(name)] if layout else []
        if places not in ([(None, "")], slots):
            listed = ", ".join(f"{'all' if run is None else run}{axis and f' ({axis})'}" for run, axis in places)
            yield "estimates", f"found {name} of the runs {listed}, expected it once for all runs, or once for each"
    scale = fit.values().scale
    if not abs(scale) >= LEAST_SCALE:
        yield "estimates", f"1 + scale_factor is {scale:.4g}, expected at least {LEAST_SCALE:g} in magnitude"


def _means(fit: Fit) -> Found:
    moved = {effect.mechanism.carrier for effect in map(find, fit.model.effects) if effect.mechanism is not None}
    listed = [None] if len(fit.runs) == 1 else [*range(len(fit.runs))]
    for i, e in enumerate(fit.at_mean):
        if e.name not in moved or e.run not in listed:
            yield f"at_mean[{i}]", f"found {e.name!r} of the run {e.run}, expected a coefficient that a mechanism moves"
        elif e.unit != find(e.name).unit:
            yield f"at_mean[{i}].unit", f"found {e.unit!r}, expected {find(e.name).unit!r}"


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
    for name, values in fit.model.shapes.items():
        if name not in fit.model.effects:
            yield f"model.shapes.{name}", "expected shape parameters of effects of the model alone"
            continue
        term = next(term for term in _evaluated(fit) if term.effect.name == name)
        unknown = set(values) - set(term.effect.shapes)
        if unknown:
            yield f"model.shapes.{name}", f"found {', '.join(sorted(unknown))}, which {name} does not have"
        signals = probe(term.effect.needs)
        for key, declared in term.effect.shapes.items():
            if declared.span(signals)[0] > 0.0 and not values[key] > 0.0:
                yield f"model.shapes.{name}.{key}", f"found {values[key]:.10g}, expected more than 0 {declared.unit}"
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
    noise_effects = {effect.name: effect for effect in fit.model.noise_effects}
    for i, run in enumerate(fit.runs):
        for k, grown in enumerate(run.noise.noise.growth):
            if grown.effect.name not in noise_effects:
                yield (
                    f"runs[{i}].noise.noise.growth[{k}].effect",
                    f"found {grown.effect.name!r}, which acts on no noise here",
                )
    for i, noise_effect in enumerate(fit.noise_effects):
        if noise_effect.name not in noise_effects:
            yield (
                f"noise_effects[{i}].name",
                f"found {noise_effect.name!r}, expected an effect of the model that acts on noise",
            )
        elif noise_effect.unit != noise_effects[noise_effect.name].unit:
            yield (
                f"noise_effects[{i}].unit",
                f"found {noise_effect.unit!r}, expected {noise_effects[noise_effect.name].unit!r}",
            )
        for key, spectrum in (("spectrum", noise_effect.spectrum), ("without", noise_effect.without)):
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
        angle, residual, std = fit.dwells.angle, fit.dwells.residual, fit.dwells.std
        counts = {len(angle or residual), len(residual), len(std)}
        if len(counts) > 1:
            yield "dwells", "angle, residual and std have different lengths, expected one value for each dwell"


def _require_covariance(fit: Fit) -> None:
    """Symmetric, correlations within 1, positive semi-definite within rounding, in agreement with the stds."""
    P, names = fit.covariance, [e.name for e in fit.free]
    if P.shape != (len(names),) * 2:
        raise ModelFileError(
            f"covariance: it has the shape {P.shape}, expected a row and a column for each of {', '.join(names)}"
        )
    if len(fit.at_shapes) not in (0, len(names)):
        raise ModelFileError(
            f"at_shapes: found {len(fit.at_shapes)} numbers, expected one for each of {', '.join(names)}"
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


__all__ = ["MODEL_SCHEMA", "ModelFileError", "dumps", "from_dict", "load", "save", "to_dict"]


def to_dict(fit: Fit) -> dict[str, Any]:
    """Return a fit as the content of a model file."""
    return dict(plain(face("results.json").content(fit)))


@checked
def save(fit: Fit, path: str | Path) -> None:
    """Write a model file, whole or not at all.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path)["bias"] == fit["bias"]
    True
    """
    atomic_write(path, dumps(to_dict(fit)))


@checked
def load(path: str | Path) -> Fit:
    """Read a model file.

    Raises
    ------
    ModelFileError
        If the file is missing, is no strict JSON, was written by a newer version, or holds a leaf or a combination of
        leaves that no fit has. The text names file and leaf.

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> simulated = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit = ac.fit(simulated.recording)
    >>> import pathlib, tempfile
    >>> path = pathlib.Path(tempfile.mkdtemp(), "m.json")
    >>> fit.save(path)
    >>> ac.load_model(path).model.added
    ()
    """
    path = Path(path)
    content = read_json(path)
    try:
        return from_dict(content)
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}") from None


def from_dict(content: Any) -> Fit:
    """Return the fit that the content of a model file holds; the recordings themselves are not in it.

    Raises
    ------
    ModelFileError
        If it does not follow the schema, or contradicts itself. The text names the path to the leaf.
    """
    catalogue = dict(CATALOGUE)
    try:
        stored = migrated(content)
        enter_effects(stored.get("model"))
        fit: Fit = face("results.json").read(Fit, stored)
        require_coefficients(fit)
        require_consistent(fit)
    except ModelFileError as error:
        for name in set(CATALOGUE) - set(catalogue):  # side channels of a file that is refused
            del CATALOGUE[name]
        sentence = visible(str(error), one_line=True)
        if isinstance(error, MissingEffectError):
            raise ModelFileError(sentence) from None
        raise ModelFileError(f"{sentence}. The model file is damaged or incomplete: {AGAIN}") from None
    return fit


@dataclass(frozen=True)
class Needs:
    """Effects that a model takes from the user, and from recorded channels."""

    own: tuple[OwnEffect, ...]
    side_channels: Mapping[str, SideChannel]


class MissingEffectError(ModelFileError):
    """A model uses an effect of the user that is not loaded; its file is whole."""


LOAD = 'give its file: --effects-file FILE.py, or accelcal.load_effects("FILE.py") in Python'


def enter_effects(model: Any) -> None:
    """Enter side channels and formulas that a stored model uses, and require the user's file where it uses effects of
    one.

    Raises
    ------
    ModelFileError
        If a user's effect is not loaded; the text names the effect, and how to give it.
    """
    if not isinstance(model, dict):
        return  # the schema refuses it
    try:
        needs = face("results.json").read(Needs, {key: model[key] for key in ("own", "side_channels") if key in model})
    except ModelFileError as error:
        raise ModelFileError(f"model.{error}") from None
    for stored in needs.side_channels.values():
        carrier = "bias" if stored.of == "output" else "scale_factor"
        side_channel(stored.channel, unit_of_channel(stored.unit, carrier), carrier)
    for item in needs.own:
        try:
            formula = None if item.name in CATALOGUE else from_written(item.name, item.source)
        except ExpressionError as error:
            raise MissingEffectError(f"{item.name!r}: {error}") from None
        if formula is None and item.name not in CATALOGUE:
            raise MissingEffectError(
                f"the model uses {item.name!r}, an effect of your own that is not loaded; {LOAD} (SHA-256 "
                f"{item.digest[:12]}…). Its source is stored in the model file under model.own"
            )
        if CATALOGUE[item.name].digest != item.digest:
            raise MissingEffectError(
                f"{item.name!r} is not the effect that the model was fitted with: its source has changed (SHA-256 "
                f"{CATALOGUE[item.name].digest[:12]}… instead of {item.digest[:12]}…). Fit again, or load the old file"
            )
    names = model.get("effects")
    missing = (
        [name for name in names if isinstance(name, str) and not is_effect(name)] if isinstance(names, list) else []
    )
    if missing:
        raise MissingEffectError(
            f"the model uses {missing[0]!r}, which is no effect of accelcal; if it is one of your own, {LOAD}, or run "
            "the lines that enter it"
        )


def is_effect(name: str) -> bool:
    """Whether there is an effect of a name, or `find` makes it."""
    try:
        find(name)
    except ValueError:
        return False
    return True


def require_coefficients(fit: Fit) -> None:
    """Compare the names of the estimates with the coefficients of the model.

    Raises
    ------
    ModelFileError
        If one is missing or foreign.
    """
    stored, expected = {e.name for e in fit.estimates}, {term.name for term in fit.model.terms}
    if stored != expected:
        raise ModelFileError(
            f"estimates: its coefficients are not those of its effects: {', '.join(sorted(stored ^ expected))} on one "
            "side only"
        )


__dir__ = listing(globals())
