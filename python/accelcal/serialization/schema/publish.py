"""The schemas as files: JSON Schema 2020-12, one for each schema name that the product writes."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any, get_args

from pydantic import BaseModel

from accelcal.serialization.schema import results
from accelcal.serialization.schema.model import ModelFile
from accelcal.serialization.schema.session import Content, ContentOfOne

FILES: tuple[type[BaseModel], ...] = (
    ModelFile,
    results.ComparisonFile,
    results.PairedFile,
    results.DiagnosisFile,
    results.DwellsFile,
    results.ImprovementFile,
    results.ExportFile,
    results.PowerFile,
    results.PlanFile,
    results.FormulaFile,
    results.FleetFile,
    results.TriadFile,
    results.LiveFile,
    results.PaperFile,
    results.ResponseFile,
    Content,
    ContentOfOne,
)
"""Of every kind of JSON that a command or the workbench writes, and of session files of earlier versions."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"


def name_of(schema: type[BaseModel]) -> str:
    """Schema name that a file carries, such as accelcal/model/2."""
    return str(get_args(schema.model_fields["schema_"].annotation)[0])


def file_name(schema: type[BaseModel]) -> str:
    """Name of the published file, such as model-2.json."""
    return f"{name_of(schema).removeprefix('accelcal/').replace('/', '-')}.json"


def published(schema: type[BaseModel]) -> str:
    """Text of the published file."""
    content: dict[str, Any] = _without_titles(schema.model_json_schema(by_alias=True))
    return json.dumps({"$schema": DIALECT, **content, "title": name_of(schema)}, indent=1, ensure_ascii=False) + "\n"


def _without_titles(part: Any) -> Any:
    """Without the titles that repeat the keys; a property that is called title is an object, and stays."""
    if isinstance(part, dict):
        kept = part.items()
        return {key: _without_titles(value) for key, value in kept if key != "title" or not isinstance(value, str)}
    return [_without_titles(value) for value in part] if isinstance(part, list) else part


def publish(folder: Path) -> tuple[Path, ...]:
    """Write every schema into a folder.

    Returns
    -------
    The files that were written.
    """
    folder.mkdir(parents=True, exist_ok=True)
    paths = tuple(folder / file_name(schema) for schema in FILES)
    for path, schema in zip(paths, FILES, strict=True):
        path.write_text(published(schema), encoding="utf-8")
    return paths
