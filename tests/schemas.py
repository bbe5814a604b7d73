"""Outputs against the published schemas, by a validator that shares no code with the package."""

from __future__ import annotations

import json
from functools import cache
from pathlib import Path
from typing import Any

import jsonschema

SCHEMAS = Path(__file__).parents[1] / "schemas"


@cache
def validator(name: str) -> Any:
    """Validator of a schema name such as accelcal/model/2."""
    path = SCHEMAS / f"{name.removeprefix('accelcal/').replace('/', '-')}.json"
    content = json.loads(path.read_text(encoding="utf-8"))
    jsonschema.Draft202012Validator.check_schema(content)
    return jsonschema.Draft202012Validator(content)


def require_published(content: dict[str, Any]) -> None:
    """Compare a content, as it is written, with the published schema that it names."""
    errors = [
        f"{error.json_path}: {error.message[:200]}" for error in validator(content["schema"]).iter_errors(content)
    ]
    assert not errors, "\n".join(errors[:10])
