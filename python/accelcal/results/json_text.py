"""JSON out and in: strict in both directions, since a file may come from anyone."""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from accelcal._support.errors import AccelcalError, visible
from accelcal.data import RecordingError
from accelcal.io.files import content_of
from accelcal.io.table import MODEL_BYTES


class ModelFileError(AccelcalError):
    """A file that is not a model file. The text names it, the place in it, and states what was expected."""


LONGEST_TEXT = 4_000
"""Characters of a text in a model file: a sentence, the name of a file or of a sensor."""
MOST_DIGITS = 20
"""Digits of a whole number with its sign: those of 64 bits."""
ESCAPED = re.compile("[\x7f-\x9f\u061c\u200e\u200f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff\ufeff]")
"""Characters that JSON allows in a string and a terminal obeys."""
AGAIN = "take a copy that is whole, or fit again: accelcal fit RUN.csv -o MODEL.json"
"""Next step for who has a damaged model file."""


def dumps(content: Mapping[str, Any], indent: int | None = 2) -> str:
    """Return JSON text; what is not finite becomes null, since JSON has no other word for it.

    Characters that a terminal would obey are written as escapes. Without an indent it is one line.
    """
    return escaped(json.dumps(finite(content), indent=indent, ensure_ascii=False, allow_nan=False)) + "\n"


def escaped(text: str) -> str:
    """Text of JSON with escapes for characters that a terminal would obey."""
    return ESCAPED.sub(lambda match: f"\\u{ord(match[0]):04x}", text)


def read_json(path: Path) -> Any:
    """Content of a JSON file that may be hostile.

    Raises
    ------
    ModelFileError
        If it is no regular file, too large, no UTF-8, or anything but strict JSON: a key that stands twice in one
        object, a number that is not finite or has more digits than any count, and brackets without end are refused.
    """
    text = _text(path)
    try:
        return strict(text)
    except json.JSONDecodeError as error:
        raise ModelFileError(
            f"{path}: line {error.lineno}, column {error.colno}: not JSON ({error.msg}); expected a model file as "
            "written by: accelcal fit RUN.csv -o MODEL.json. The model comes first, the recording second"
        ) from None
    except RecursionError:
        raise ModelFileError(
            f"{path}: brackets stand in brackets without end; expected a model file: {AGAIN}"
        ) from None
    except ModelFileError as error:
        raise ModelFileError(f"{path}: {error}; {AGAIN}") from None


def strict(text: str) -> Any:
    """Plain values of a JSON text.

    Raises
    ------
    ModelFileError
        If a key stands twice in one object, or a number is not finite or has more digits than any count.
    """
    return json.loads(
        text, object_pairs_hook=_object, parse_int=_whole, parse_float=_number, parse_constant=_refuse_constant
    )


def _text(path: Path) -> str:
    """Text of a regular file of limited size."""
    try:
        raw = content_of(path, "a model file, as written by: accelcal fit RUN.csv -o MODEL.json", MODEL_BYTES)
    except FileNotFoundError:
        raise ModelFileError(f"{path}: no such file; make one with: accelcal fit RUN.csv -o {path}") from None
    except RecordingError as error:
        raise ModelFileError(str(error)) from None
    if raw.startswith((b"\xef\xbb\xbf", b"\xff\xfe", b"\xfe\xff")):
        raise ModelFileError(f"{path}: begins with a byte-order mark; save it as UTF-8 without one")
    try:
        return raw.decode("utf-8")
    except UnicodeDecodeError as error:
        raise ModelFileError(
            f"{path}: byte {error.start} is not UTF-8, so it cannot be read as text; expected a model file: {AGAIN}"
        ) from None


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    content = dict(pairs)
    if len(content) != len(pairs):
        keys: set[str] = set()
        twice = next(key for key, _ in pairs if key in keys or keys.add(key))  # type: ignore[func-returns-value]
        raise ModelFileError(f"the key {twice[:40]!r} stands twice in one object, expected each key once")
    return content


def _whole(digits: str) -> int:
    if len(digits) > MOST_DIGITS:
        raise ModelFileError(f"found a whole number of {len(digits)} digits, expected at most {MOST_DIGITS}")
    return int(digits)


def _number(text: str) -> float:
    value = float(text)
    if not math.isfinite(value):
        raise ModelFileError(f"found the number {text[:20]}, which is beyond every range; expected a finite number")
    return value


def _refuse_constant(name: str) -> float:
    raise ModelFileError(f"found {name}, which is no JSON; expected a finite number, or null where it is not known")


def finite(content: Any) -> Any:
    """The same plain values; what is not finite becomes None."""
    if isinstance(content, float):
        return content if math.isfinite(content) else None
    if isinstance(content, Mapping):
        return {key: finite(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [finite(value) for value in content]
    return content


def plain(content: Any) -> Any:
    """The same plain values; no text in it is longer than a reader takes, or holds what a terminal obeys.

    Source text keeps its lines.
    """
    if isinstance(content, str):
        return visible(content, one_line=True)[:LONGEST_TEXT]
    if isinstance(content, Mapping):
        return {key: value if key == "source" else plain(value) for key, value in content.items()}
    if isinstance(content, list | tuple):
        return [plain(value) for value in content]
    return content
