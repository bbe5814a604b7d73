"""Older model files in the present form: one function for each step."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from typing import Any

from accelcal._core import __version__
from accelcal._support.plain_text import visible
from accelcal.results.json_text import ModelFileError

NAME = "accelcal/model/"
MODEL_SCHEMA = f"{NAME}4"
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
        found = "none" if schema is None else f'"{visible(schema[:40])}"' if isinstance(schema, str) else "no text"
        raise ModelFileError(f'expected a model file with the schema "{MODEL_SCHEMA}", found {found}; {MAKE}')
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
    return _without("version", _without("schema", content))


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
        own = [{"name": one["name"], "digest": one["sha256"], "source": one["source"]} for one in model["own"]]
        return {
            **{key: content[key] for key in ("method", "validity", "remarks", "rig", "shapes")},
            **{"schema": f"{NAME}3", "version": content["version"], "model": {**model, "own": own}},
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
                    **_filled("Infinity", one, "std"),
                    "spectrum": _spectrum(one["spectrum"]),
                    "without": _spectrum(one["without"]),
                }
                for one in content["noise_effects"]
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


def _without(key: str, part: Mapping[str, Any]) -> dict[str, Any]:
    """Part without one key."""
    return {name: value for name, value in part.items() if name != key}


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


STEPS: Mapping[int, Callable[[dict[str, Any]], dict[str, Any]]] = {2: from_2_to_3, 3: from_3_to_4}
"""From each older schema to the next."""
