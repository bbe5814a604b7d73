"""Model files of several kinds, what a person or a damaged disk may do to them, and every command that reads one."""

from __future__ import annotations

import copy
import json
import math
import re
import traceback
from collections.abc import Callable, Iterator, Sequence
from contextlib import redirect_stderr, redirect_stdout
from functools import cache
from io import StringIO
from pathlib import Path
from typing import Any

import numpy as np

import accelcal as ac
from accelcal import report, verbs
from accelcal._support.errors import OBEYED
from accelcal.calibration import export
from accelcal.calibration.characteristic import apply, characteristic
from accelcal.cli.printing import show, show_comparison, show_export, show_fit, show_formulas
from accelcal.effects import from_expression
from accelcal.results import json as results_json, model_file
from accelcal.simulation import ADXL105_RIG

PACKAGE = str(Path(ac.__file__).parent)
FOREIGN = (np.linalg.LinAlgError, UnicodeError, json.JSONDecodeError)
"""Kinds of ValueError that nobody raised on purpose."""
NO_NUMBER = re.compile(r"(?<![A-Za-z0-9_\"-])[-+]?(?:nan|inf|infinity)(?![A-Za-z0-9_])", re.IGNORECASE)
"""NaN or infinity as any of the outputs would write it; INFINITY of math.h aside, which no header uses, and the
words of JSON in quotes."""


def recording(seconds: float = 3.0, seed: int = 1, temperature: bool = False) -> ac.Recording:
    """A short record of an ordinary sensor."""
    simulation = ac.simulate(
        "tones",
        seconds=seconds,
        rig=ADXL105_RIG,
        parameters={"bias": 0.05, "cubic": 1e-3},
        rng=np.random.default_rng(seed),
    )
    return simulation.recording


@cache
def record() -> ac.Recording:
    """The record that every command is run on."""
    return recording()


def enter_own_effect() -> None:
    """Enter the effect that one of the bases takes from a user."""
    from_expression("own_drag", "v*abs(v)", unit="m⁻¹")


@cache
def bases() -> tuple[dict[str, Any], ...]:
    """Contents of model files: a cubic model; a joint fit with a bias of each run; effects with shapes and noise."""
    enter_own_effect()
    cubic = verbs.fit(record(), ac.Model.cubic())
    joint = verbs.fit([record(), recording(seed=2), recording(seed=3)], ac.Model.linear().vary("bias"))
    grown = verbs.add(cubic, record(), "own_drag", "hysteresis")
    contents = [json.loads(model_file.dumps(model_file.to_dict(fit))) for fit in (cubic, joint, grown)]
    contents[2]["model"]["effects"].append("vibration")
    contents[2]["runs"][0]["noise"]["noise"]["growth"] = [{"effect": "vibration", "q": 1e-9, "r": 0.0, "mean": 1.0}]
    f = np.geomspace(1.0, 100.0, 5).tolist()
    spectrum = {"f": f, "floor": [1e-4] * 5, "growth": {"vibration": [1e-5] * 5}}
    contents[2]["noise_effects"] = [
        {
            **{"name": "vibration", "symbol": "c²", "unit": "m⁻²", "value": 0.1, "std": 0.01, "owner": "rig"},
            **{"p_value": 1e-6, "sentence": "noise grows with speed", "particulars": {"level": 0.01}},
            **{"spectrum": spectrum, "without": {**spectrum, "growth": {}}},
        }
    ]
    return tuple(contents)


# Leaves and what replaces them.

NUMBERS: tuple[Any, ...] = (
    *(0.0, -0.0, 1.0, -1.0, 0, 1e-9, -1e-9, 1e-30, 1e-160, 5e-324, 1e9, -1e9, 1e14, 1e15, -1e15, 1e16, 1e30),
    *(1e150, 1.7e308, -1.7e308, math.nan, math.inf, -math.inf, 10**17, 10**30, 10**400, 0.5, -0.999999, 1e-3, 77.7),
)
TEXTS: tuple[Any, ...] = (
    *("", "x", "level", "\x1b[2J\x1b]0;owned\x07", "\u202egnp.exe", "\ud800", "a\nb", "\x9b31m", "[/bold]", "[bold]x"),
    *("[link=file:///etc/passwd]x", "</script><script>alert(1)</script>", "*/ int main(void) { /*", "x" * 300),
    *("x" * 5000, "1e400", "../../etc/passwd", "%s%n{0}{x!r}", "K³", "bias", "cubic", "m/s²", '"', "\\", "\0"),
)
OTHERS: tuple[Any, ...] = (None, True, False, [], {}, [[]], [None], {"": None}, [1, 2, 3], {"a": 1.0}, "1.0", 3)


def paths(content: Any, at: tuple[Any, ...] = ()) -> Iterator[tuple[Any, ...]]:
    """Every place of a content below its root."""
    items = content.items() if isinstance(content, dict) else enumerate(content) if isinstance(content, list) else ()
    for key, value in items:
        yield (*at, key)
        yield from paths(value, (*at, key))


def place(content: Any, at: Sequence[Any]) -> Any:
    """What stands at a path."""
    for key in at:
        content = content[key]
    return content


def mutated(content: dict[str, Any], rng: np.random.Generator) -> str:
    """Text of a model file after one to three changes; at times of its bytes."""
    mutant: Any = copy.deepcopy(content)
    for _ in range(1 + int(rng.integers(3)) * (rng.random() < 0.3)):
        change(mutant, rng)
    text = json.dumps(mutant)
    kind = rng.random()
    if kind < 0.08:
        raw = bytearray(text.encode())
        for _ in range(1 + int(rng.integers(4))):
            raw[int(rng.integers(len(raw)))] = int(rng.integers(256))
        return raw.decode("latin-1")
    if kind < 0.10:
        return text[: int(rng.integers(len(text)))]
    if kind < 0.12:
        at = int(rng.integers(len(text)))
        return text[:at] + "[" * int(10 ** rng.uniform(1, 5)) + text[at:]
    return text


def change(content: dict[str, Any], rng: np.random.Generator) -> None:
    """One change at a random place."""
    places = list(paths(content))
    if not places:
        return
    # Every top-level key is as likely, however many leaves it has: else most changes meet the covariance.
    first = list(content)[int(rng.integers(len(content)))]
    places = [at for at in places if at[0] == first]
    *above, key = places[int(rng.integers(len(places)))]
    parent, value = place(content, above), place(content, [*above, key])
    kind = int(rng.integers(8))
    if kind == 0 and isinstance(parent, dict):
        del parent[key]
    elif kind == 1 and isinstance(parent, dict):
        parent[f"{key}{rng.choice(['_', '', ' ', chr(27)])}"] = parent.pop(key)
    elif kind == 2 and isinstance(value, list) and value:
        del value[int(rng.integers(len(value)))]
    elif kind == 2 and isinstance(value, list | dict):
        value.append(copy.deepcopy(value)) if isinstance(value, list) else value.update(x=1)
    elif kind == 3:
        parent[key] = OTHERS[int(rng.integers(len(OTHERS)))]
    elif isinstance(value, float | int) and not isinstance(value, bool) and kind > 3:
        factors = (-1.0, 0.5, 2.0, 1e3, 1e-3, 1e6, 1e-6, 1e12)
        parent[key] = (
            value * factors[int(rng.integers(len(factors)))] if kind == 7 else NUMBERS[int(rng.integers(len(NUMBERS)))]
        )
    elif isinstance(value, str):
        parent[key] = TEXTS[int(rng.integers(len(TEXTS)))]
    elif isinstance(value, list) and value and kind == 4:
        value.append(copy.deepcopy(value[int(rng.integers(len(value)))]))
    else:
        pool = (*NUMBERS, *TEXTS, *OTHERS)
        parent[key] = pool[int(rng.integers(len(pool)))]


# Commands.


def exported(fit: ac.Fit) -> Iterator[str]:
    """Everything that is exported, and one application."""
    try:
        calibration = export.calibrate(fit)
    except export.NotExportable:
        left = characteristic(fit).left_out
        calibration = export.calibrate(fit, without=[item.effect for item in left if item.needed])
    yield export.header(calibration, "x.h")
    yield export.module(calibration)
    yield export.draft(calibration, export.Laboratory()).text
    show_export(calibration)
    yield model_file.dumps(results_json.content(calibration))


def applied(fit: ac.Fit) -> Iterator[str]:
    """Accelerations of some outputs."""
    for output in (-20.0, 0.0, 1.5):
        result = apply(fit, output)
        yield f"{result.acceleration!r} {result.std!r} {result.rounds!r}"


def printed(fit: ac.Fit) -> Iterator[str]:
    """The table of a fit, its text in a notebook, and itself once more as a file."""
    show_fit(fit)
    yield repr(fit)
    text = model_file.dumps(model_file.to_dict(fit))
    model_file.from_dict(json.loads(text))
    yield text


def compared(fit: ac.Fit) -> Iterator[str]:
    """The comparison with a record."""
    comparison = verbs.compare(fit, record())
    show_comparison(comparison)
    yield model_file.dumps(results_json.content(comparison))


def diagnosed(fit: ac.Fit) -> Iterator[str]:
    """The diagnosis on a record."""
    diagnosis = verbs.diagnose(fit, record())
    show(diagnosis)
    yield model_file.dumps(results_json.content(diagnosis))


def added(fit: ac.Fit) -> Iterator[str]:
    """The model with one more effect."""
    yield from printed(verbs.add(fit, record(), "odd_quadratic"))


def dropped(fit: ac.Fit) -> Iterator[str]:
    """The model without its last effect."""
    yield from printed(verbs.drop(fit, record(), fit.model.effects[-1]))


def frozen(fit: ac.Fit) -> Iterator[str]:
    """The model with a bias that is held."""
    yield from printed(verbs.fit(record(), fit.model.freeze(bias=0.05), origins=fit.origins))


def compared_in_pairs(fit: ac.Fit) -> Iterator[str]:
    """Two models on a record, and their difference."""
    comparison = verbs.compare([fit, fit], record())
    show_comparison(comparison)
    yield model_file.dumps(results_json.content(comparison))


def put_into_formulas(fit: ac.Fit) -> Iterator[str]:
    """Formulas of a curve."""
    formulas = verbs.formulas(fit, record(), "shape_of_velocity")
    show_formulas(formulas)
    yield model_file.dumps(results_json.content(formulas))


def reported(fit: ac.Fit) -> Iterator[str]:
    """What a report shows."""
    yield json.dumps(report.view.view(report.gather(fit, record())), default=str)


CHEAP: dict[str, Callable[[ac.Fit], Iterator[str]]] = {"export": exported, "apply": applied, "print": printed}
"""Commands that need no record."""
DEAR: dict[str, Callable[[ac.Fit], Iterator[str]]] = {
    "compare": compared,
    "diagnose": diagnosed,
    "add": added,
    "drop": dropped,
    "freeze": frozen,
    "paired": compared_in_pairs,
    "formula": put_into_formulas,
    "report": reported,
}
"""Commands on a model and a record."""


def verdict(command: Callable[[ac.Fit], Iterator[str]], fit: ac.Fit) -> str:
    """What is wrong with a command on a fit; empty where it ends in outputs without NaN or in one sentence."""
    out = StringIO()
    try:
        with redirect_stdout(out), redirect_stderr(StringIO()), np.errstate(all="ignore"):
            texts = [*command(fit)]
    except Exception as error:
        return wrong(error)
    texts.append(out.getvalue())
    for text in texts:
        if match := NO_NUMBER.search(text):
            return f"writes {match[0]!r}: …{text[max(0, match.start() - 80) : match.end() + 40]!r}"
    if match := OBEYED.search(texts[-1]):
        return f"prints {match[0]!r}"
    return ""


def wrong(error: Exception) -> str:
    """What is wrong with an error: it is not one that the product raised to say a sentence."""
    frames = traceback.extract_tb(error.__traceback__)
    ours = frames[-1].filename.startswith(PACKAGE) and (frames[-1].line or "").lstrip().startswith("raise ")
    text = str(error)
    if isinstance(error, ValueError) and not isinstance(error, FOREIGN) and ours and " " in text:
        return f"says {text!r}" if OBEYED.search(text) else ""
    where = next((f for f in reversed(frames) if f.filename.startswith(PACKAGE)), frames[-1])
    return f"{type(error).__name__}: {text[:150]} at {where.filename.removeprefix(PACKAGE)}:{where.lineno} {where.line}"
