"""Outputs against the schemas that `accelcal schema` prints, by a validator that shares no code with the package."""

from __future__ import annotations

from functools import cache
from typing import Any

import jsonschema

from accelcal.results import json as results_json


@cache
def validator(name: str) -> Any:
    """Validator of a schema name such as accelcal/model/5."""
    content = results_json.schema(name.split("/")[1])
    jsonschema.Draft202012Validator.check_schema(content)
    return jsonschema.Draft202012Validator(content)


def require_published(content: dict[str, Any]) -> None:
    """Compare a content, as it is written, with the schema that it names."""
    errors = [
        f"{error.json_path}: {error.message[:200]}" for error in validator(content["schema"]).iter_errors(content)
    ]
    assert not errors, "\n".join(errors[:10])
