"""A content against its schema: the first leaf that does not hold is one sentence."""

from __future__ import annotations

from typing import Any

from pydantic import BaseModel, ValidationError

from accelcal._support.plain_text import visible
from accelcal.serialization.errors import ModelFileError

SHOWN = 60
"""Characters of a value that a sentence shows."""


def require(schema: type[BaseModel], content: Any) -> None:
    """Compare a content with a schema.

    Raises
    ------
    ModelFileError
        Naming the path to the first leaf that does not hold, what was found and what is expected.
    """
    try:
        schema.model_validate(content)
    except ValidationError as error:
        raise ModelFileError(_sentence(error)) from None


def path_of(loc: tuple[int | str, ...]) -> str:
    """Path to a leaf, such as parameters[2].std."""
    written = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return visible(written.removeprefix(".")[: 3 * SHOWN], one_line=True)


def shown(value: Any) -> str:
    """A value as a sentence shows it."""
    text = f"{value:.10g}" if isinstance(value, float) else "null" if value is None else repr(value)
    return visible(text if len(text) <= SHOWN else f"{text[:SHOWN]}…", one_line=True)


def _sentence(error: ValidationError) -> str:
    first = error.errors(include_url=False)[0]
    loc = tuple(part for part in first["loc"] if part != "[key]")
    where = path_of(loc) or "the file"
    kind, message = first["type"], str(first["msg"])
    if kind == "missing":
        return f"{where} is missing"
    if kind == "extra_forbidden":
        return f"{where} is no key of a model file"
    expected = message.removeprefix("Value error, ").replace("Input should be", "expected").replace("should", "must")
    if kind == "value_error":
        expected = f"expected {expected}"
    elif not expected.startswith("expected"):
        expected = f"expected otherwise: {expected[:1].lower()}{expected[1:]}"
    return f"{where}: found {shown(first['input'])}, {expected}"
