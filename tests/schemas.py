"""Outputs against the schemas that `accelcal schema` prints, by a validator that shares no code with the package."""

from __future__ import annotations

from functools import cache
from typing import Any

import jsonschema

from accelcal.results import json as results_json

SHORT = 8
"""Items up to which a list is compared item by item: no list of a fixed length in a schema is longer."""


@cache
def validator(name: str) -> Any:
    """Validator of a schema name such as accelcal/model/5."""
    content = results_json.schema(name.split("/")[1])
    jsonschema.Draft202012Validator.check_schema(content)
    return jsonschema.Draft202012Validator(content)


def thinned(content: Any) -> Any:
    """The content with only the least and the greatest number, of each type, in long lists: no schema tells others."""
    if isinstance(content, dict):
        return {key: thinned(value) for key, value in content.items()}
    if not isinstance(content, list):
        return content
    if len(content) <= SHORT:
        return [thinned(value) for value in content]
    remaining = [thinned(value) for value in content if type(value) not in (int, float)]
    for kind in (int, float):
        numbers = [value for value in content if type(value) is kind]
        remaining += [min(numbers), max(numbers)] if numbers else []
    return remaining


def require_published(content: dict[str, Any]) -> None:
    """Compare a content, as it is written, with the schema that it names."""
    errors = [
        f"{error.json_path}: {error.message[:200]}"
        for error in validator(content["schema"]).iter_errors(thinned(content))
    ]
    assert not errors, "\n".join(errors[:10])
