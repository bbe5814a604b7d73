"""Older model files in the present form: one function for each step."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from accelcal._core import __version__
from accelcal._support.plain_text import visible
from accelcal.serialization.errors import ModelFileError

NAME = "accelcal/model/"
MODEL_SCHEMA = f"{NAME}2"
"""Of the files that are written."""
PRESENT = int(MODEL_SCHEMA.removeprefix(NAME))
MAKE = "make one with: accelcal fit RUN.csv -o MODEL.json"


def migrated(content: Any) -> dict[str, Any]:
    """Content of a model file of any known schema in that of the present one.

    Raises
    ------
    ModelFileError
        If it is no model file, or a newer version wrote it.
    """
    schema = content.get("schema") if isinstance(content, dict) else None
    number = re.fullmatch(rf"{NAME}([1-9]\d{{0,3}})", schema) if isinstance(schema, str) else None
    if number is None:
        found = "none" if schema is None else f'"{visible(schema[:40])}"' if isinstance(schema, str) else "no text"
        raise ModelFileError(f'expected a model file with the schema "{MODEL_SCHEMA}", found {found}; {MAKE}')
    version = content.get("version")
    written = f"accelcal {visible(version[:20])}" if isinstance(version, str) else "a version that is not named"
    if int(number[1]) > PRESENT or _is_newer(version):
        raise ModelFileError(
            f'{written} wrote this model file with the schema "{schema}"; this is accelcal {__version__}, which reads '
            f'"{MODEL_SCHEMA}" and older ones. Update accelcal, or {MAKE}'
        )
    for step in range(int(number[1]), PRESENT):
        content = STEPS[step](content)
    return dict(content)


def _is_newer(version: object) -> bool:
    """Whether a file of this version may hold what this program does not know: its first two numbers are higher."""
    numbers = re.match(r"(\d{1,6})\.(\d{1,6})\b", version) if isinstance(version, str) else None
    here = re.match(r"(\d+)\.(\d+)", __version__)
    return bool(numbers and here) and tuple(map(int, numbers.groups())) > tuple(map(int, here.groups()))  # type: ignore[union-attr]


YOUNGER_THAN_1: Mapping[str, Any] = {
    "shapes": [],
    "run_to_run": [],
    "noise_effects": [],
    "dwells": None,
    "tilt_deg": 0.0,
    "seed": None,
}
"""Keys that the first files of schema 1 lack."""


def from_1_to_2(content: dict[str, Any]) -> dict[str, Any]:
    """Schema 1 grew key by key, and older files lack the younger ones: each gets the value that it stood for."""
    made: dict[str, Any] = {
        "shapes": [],
        "run_to_run": [],
        "noise_effects": [],
        "dwells": None,
        "tilt_deg": 0.0,
        "seed": None,
    }
    made |= content | {"schema": f"{NAME}2"}
    made["model"] = model = _with({"per_run": []}, content.get("model"))
    if isinstance(model, dict):
        channels = model.get("side_channels")
        if isinstance(channels, dict):
            model["side_channels"] = {name: _with({"of": "output"}, one) for name, one in channels.items()}
    made["rig"] = rig = _with({"output_filters": [], "position_filters": [], "tolerance": None}, content.get("rig"))
    if isinstance(rig, dict):
        rig["sensor"] = _with({"bias_instability": None, "random_walk": None}, rig.get("sensor"))
    made["noise"] = _each({"growth": [], "band_hz": None}, content.get("noise"))
    if isinstance(content.get("electrical"), dict):
        made["electrical"] = {key: _positive_std(one) for key, one in content["electrical"].items()}
    runs = content.get("data")
    if isinstance(runs, list):
        made["data"] = [_with(_session(run), run) for run in runs]
    return made


def _positive_std(quantity: Any) -> Any:
    """A negative electrical scale once gave uncertainties its sign."""
    std = quantity.get("std") if isinstance(quantity, dict) else None
    return {**quantity, "std": abs(std)} if isinstance(std, float) else quantity


def _session(run: Any) -> dict[str, Any]:
    """A recording was always a whole one."""
    return {"session_sha256": run.get("sha256")} if isinstance(run, dict) else {}


STEPS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {1: from_1_to_2}
"""From each older schema to the next."""


def _with(defaults: Mapping[str, Any], part: Any) -> Any:
    """A part with keys that it lacks; what is no object is left to the schema, which refuses it."""
    return {**defaults, **part} if isinstance(part, dict) else part


def _each(defaults: Mapping[str, Any], parts: Any) -> Any:
    return [_with(defaults, part) for part in parts] if isinstance(parts, list) else parts
