"""JSON of a result, out and in, and its schema, from its dataclass; no other module of results imports pydantic."""

from __future__ import annotations

import json
import math
from collections.abc import Callable, Mapping
from functools import cache, cached_property
from typing import Any, TypeVar, get_type_hints

import numpy as np
from pydantic import BaseModel, TypeAdapter, ValidationError
from pydantic.json_schema import GenerateJsonSchema
from pydantic_core import CoreSchema, PydanticSerializationError, SchemaSerializer, SchemaValidator, core_schema

from accelcal import _core
from accelcal._support.errors import AccelcalError, FieldError, visible
from accelcal._support.result import NotStored
from accelcal._support.values import face
from accelcal.results.json_text import ModelFileError, escaped, finite, strict

T = TypeVar("T")

SCHEMAS: Mapping[str, str] = {
    "model": "estimation.estimate:Fit",
    "evaluation": "validation.comparison:Evaluation",
    "comparison": "validation.differences:Comparison",
    "diagnosis": "diagnosis.verdict:Diagnosis",
    "diagnosis-of-axes": "diagnosis.verdict:AxesDiagnosis",
    "diagnosis-of-dwells": "diagnosis.dwells:DwellDiagnosis",
    "improvement": "diagnosis.select.improvement:Improvement",
    "power": "diagnosis.experiment.detectability:Power",
    "next": "diagnosis.experiment.next_runs:NextExperiments",
    "plan": "diagnosis.experiment.design:Plan",
    "formulas": "diagnosis.select.curve_formulas:FormulaSet",
    "triad": "estimation.triad:TriadFit",
    "rest": "estimation.allan:RestNoise",
    "response": "response.measure:FrequencyResponse",
    "sensor-matrix": "calibration.export.axes:SensorMatrix",
    "export": "calibration.export.calibration:Calibration",
    "fleet": "fleet.summary:Fleet",
    "live": "live.session:LiveEvent",
    "session": "app.state:Content",
}
"""Result of each schema name: module and class."""
WRITTEN_BY: Mapping[str, str] = {
    **{"model": "fit", "evaluation": "compare", "comparison": "compare", "improvement": "improve", "session": "app"},
    **dict.fromkeys(("diagnosis", "diagnosis-of-axes", "diagnosis-of-dwells"), "diagnose"),
    **{"formulas": "formula", "triad": "dwells", "sensor-matrix": "export"},
}
"""Command that writes a result, where it is not called as its schema."""
VERSION = 5
"""Of every schema: keys are the names of fields."""
DIALECT = "https://json-schema.org/draft/2020-12/schema"
WORDS = {"NaN": math.nan, "Infinity": math.inf, "-Infinity": -math.inf}
"""Numbers that are not finite."""
NUMBER: dict[str, Any] = {"anyOf": [{"type": "number"}, {"enum": [*WORDS]}]}
"""Schema of a number."""
DEEPEST = 3
"""Dimensions of an array in a schema."""
SHOWN = 60
"""Characters of a value that a sentence shows."""


def to_json(result: Any) -> str:
    """Text of a result in one line."""
    kind: Any = type(result)
    return escaped(json.dumps(head(kind))[:-1] + ", " + written(codec(kind).writer, result)[1:])


def content(result: Any) -> dict[str, Any]:
    """Plain values of a result as commands write them, without series as long as the recording."""
    kind: Any = type(result)
    values: dict[str, Any] = json.loads(written(codec(kind).short_writer, result))
    return head(kind) | values


def head(kind: Any) -> dict[str, Any]:
    """Schema of a class, and the version that writes it."""
    return {"schema": schema_name(kind), "version": _core.__version__}


def written(writer: SchemaSerializer, result: Any) -> str:
    """Text of the fields of a result, then of the properties derived from them."""
    options: Any = {"warnings": False, "fallback": lambda value: value.item()}
    try:
        return writer.to_json(result, **options).decode()
    except PydanticSerializationError:  # a text that is not Unicode: of a file whose name is not UTF-8
        return json.dumps(finite(writer.to_python(result, mode="json", **options)))


def from_json(kind: type[T], text: str) -> T:
    """Result that a text holds, of the given kind.

    Raises
    ------
    ModelFileError
        If it is not strict JSON, or does not follow the schema of the kind; it says which command writes it anew.
    """
    stored = strict(text)
    expected = schema_name(kind)
    name = expected.split("/")[1]
    command = f"accelcal {WRITTEN_BY.get(name, name)}"
    if not isinstance(stored, dict) or stored.get("schema") != expected:
        named = stored.get("schema") if isinstance(stored, dict) else None
        kind_named, _, number = str(named).rpartition("/")
        age = "an earlier" if number < str(VERSION) else "a later"
        same = f"; {age} version wrote it, {command} of this one writes it anew"
        cause = same if kind_named == f"accelcal/{name}" else ""
        raise ModelFileError(f"schema: found {shown(named)}, expected {expected!r}{cause}")
    try:
        result: T = read(kind, {key: value for key, value in stored.items() if key not in ("schema", "version")})
    except ModelFileError as error:
        version = visible(str(stored.get("version"))[:SHOWN], one_line=True)
        raise ModelFileError(
            f"{error}; accelcal {version} wrote it: {command} of this version ({_core.__version__}) writes it anew"
        ) from None
    return result


def read(kind: Any, stored: Any) -> Any:
    """Value of a type that plain values hold.

    Raises
    ------
    ModelFileError
        Naming the path to the first value that does not follow the schema, what was found and what is expected.
    """
    try:
        return codec(kind).reader.validate_python(stored)
    except ValidationError as error:
        raise ModelFileError(sentence(error)) from None


def schema_name(kind: Any) -> str:
    """Name of the schema of a class, such as accelcal/diagnosis/5."""
    place = f"{kind.__module__.removeprefix('accelcal.')}:{kind.__qualname__}"
    names = {where: name for name, where in SCHEMAS.items()}
    return f"accelcal/{names.get(place, kind.__name__.lower())}/{VERSION}"


def schema(name: str) -> dict[str, Any]:
    """JSON schema, dialect 2020-12, of a schema name such as diagnosis.

    Raises
    ------
    ValueError
        If there is no schema of that name.
    """
    if name not in SCHEMAS:
        raise AccelcalError(f"there is no schema {name!r}; expected one of {', '.join(SCHEMAS)}")
    return schema_of(kind_of(name))


def kind_of(name: str) -> Any:
    """Class of a schema name."""
    module, _, kind = SCHEMAS[name].partition(":")
    return getattr(face(module), kind)


def schema_of(kind: Any) -> dict[str, Any]:
    """JSON schema of a class."""
    if issubclass(kind, BaseModel):  # the session of the workbench, which is a form and no result
        return {"$schema": DIALECT, **plain_schema(kind.model_json_schema())}
    generator = Schema()
    generator.ignored_warning_kinds = {"non-serializable-default"}
    schema: dict[str, Any] = plain_schema(generator.generate(codec(kind).schema, mode="serialization"))
    named = {**schema.pop("$defs", {}), "Number": NUMBER}
    schema = named.pop(schema["$ref"].rpartition("/")[2]) if "$ref" in schema else schema
    head = {"schema": {"const": schema_name(kind)}, "version": {"type": "string"}}
    schema["properties"] = {**head, **schema["properties"]}
    schema["required"] = [*head, *schema["required"]]
    return {"$schema": DIALECT, "title": schema_name(kind), **schema, "$defs": named}


def plain_schema(part: Any) -> Any:
    """Schema without titles that repeat keys, and with the first paragraph of each description."""
    if isinstance(part, list):
        return [plain_schema(value) for value in part]
    if not isinstance(part, dict) or part == NUMBER:
        return {"$ref": "#/$defs/Number"} if part == NUMBER else part
    plain_part = {
        key: plain_schema(value) for key, value in part.items() if key != "title" or not isinstance(value, str)
    }
    if isinstance(plain_part.get("description"), str):
        plain_part["description"] = " ".join(plain_part["description"].partition("\n\n")[0].split())
    return plain_part


class Schema(GenerateJsonSchema):
    """Generator of schemas in which a number that is not finite is a word."""

    def float_schema(self, schema: core_schema.FloatSchema) -> dict[str, Any]:
        """Number, or one of three words."""
        return NUMBER


class Codec:
    """Reader, writers and core schema of one type, each made when it is used."""

    def __init__(self, kind: Any) -> None:
        self.core: CoreSchema = TypeAdapter(kind).core_schema

    @cached_property
    def schema(self) -> CoreSchema:
        """Schema that the reader follows."""
        schema: CoreSchema = tight(self.core)
        return schema

    @cached_property
    def reader(self) -> SchemaValidator:
        """Reader of all that a writer writes."""
        return SchemaValidator(self.schema)

    @cached_property
    def writer(self) -> SchemaSerializer:
        """Writer of everything that is stored."""
        return SchemaSerializer(self.schema, WRITTEN)

    @cached_property
    def short_writer(self) -> SchemaSerializer:
        """Writer of commands, which leave series out."""
        return SchemaSerializer(tight(self.core, short=True), WRITTEN)


@cache
def codec(kind: Any) -> Codec:
    """Codec of a type, made once."""
    return Codec(kind)


WRITTEN = core_schema.CoreConfig(ser_json_inf_nan="strings", extra_fields_behavior="forbid")
AS_THEY_ARE = ("metadata", "cls", "default", "function", "serialization", "keys_schema", "expected")


def tight(part: Any, short: bool = False) -> Any:
    """Core schema that converts nothing and expects every key of a dataclass and no other.

    A `short` one is for commands, which leave series out.
    """
    if isinstance(part, list | tuple):
        return type(part)(tight(value, short) for value in part)
    if not isinstance(part, dict):
        return part
    tightened = {key: value if key in AS_THEY_ARE else tight(value, short) for key, value in part.items()}
    match tightened.get("type"):
        case "dataclass":
            tightened["config"], arguments = WRITTEN, tightened["schema"]
            while arguments["type"] != "dataclass-args":
                arguments = arguments["schema"]
            # A writer asks for each of these, and what was read has no field that its JSON left out.
            names = {field["name"] for field in arguments["fields"]}
            tightened["fields"] = [name for name in part["fields"] if name in names]
        case "dataclass-args":
            tightened["fields"] = [tight(field, short) for field in part["fields"] if mark_of(field) is not False]
        case "dataclass-field" if mark_of(tightened):
            tightened["serialization_exclude"] = short
        case "dataclass-field" if tightened["schema"]["type"] == "default":
            tightened["schema"] = tightened["schema"]["schema"]
        case "int" | "bool" | "str":
            tightened["strict"] = True
        case "float":
            return core_schema.no_info_before_validator_function(number, {**tightened, "strict": True})
    return tightened


def mark_of(part: Any) -> bool | None:
    """Whether a field is left out by commands alone; None where it is always stored."""
    schema = part["schema"]
    mark: bool | None = schema.get("metadata", {}).get("by_commands")
    return mark_of(schema) if mark is None and schema["type"] == "default" else mark


def number(value: Any) -> Any:
    """Number that a word stands for; everything else as it is."""
    return WORDS.get(value, value) if isinstance(value, str) else value


def schema_of_result(kind: Any, source: Any, handler: Any) -> CoreSchema:
    """Core schema of a result: its fields, and the properties derived from them."""
    schema: CoreSchema = handler(source)
    dataclass = handler.resolve_ref_schema(schema)
    dataclass["schema"]["computed_fields"] = [
        core_schema.computed_field(
            name, handler.generate_schema(get_type_hints(getattr(kind, name).fget, include_extras=True)["return"])
        )
        for name in kind.derived
    ]

    def without_derived(value: Any) -> Any:
        return (
            {key: item for key, item in value.items() if key not in kind.derived} if isinstance(value, dict) else value
        )

    present = core_schema.no_info_after_validator_function(without_absent, dataclass["schema"])
    dataclass["schema"] = core_schema.no_info_before_validator_function(without_derived, present)
    return schema


def without_absent(values: tuple[dict[str, Any], Any]) -> tuple[dict[str, Any], Any]:
    """Fields of a dataclass, and its arguments that are no fields, without fields that commands have left out."""
    stored, others = values
    return {name: value for name, value in stored.items() if value is not ABSENT}, others


def named(find: Callable[[str], Any]) -> CoreSchema:
    """Core schema of an object that is stored as its name, by which it is found."""
    name = core_schema.plain_serializer_function_ser_schema(lambda value: value.name, return_schema=TEXT)
    return core_schema.no_info_after_validator_function(find, TEXT, serialization=name)


TEXT = core_schema.str_schema()
ABSENT = object()
"""Value of a field that commands have left out, while it is read."""


def marked(mark: NotStored, source: Any, handler: Any) -> CoreSchema:
    """Core schema of a field that JSON leaves out, always or in what commands write."""
    inner = handler(source) if mark.by_commands else core_schema.any_schema()
    return core_schema.with_default_schema(inner, default=ABSENT, metadata={"by_commands": mark.by_commands})


def array_schema(kind: type[np.generic]) -> CoreSchema:
    """Core schema of an array: nested lists of numbers; where its shape would be lost, the shape."""
    single = {"type": "boolean"} if kind is np.bool_ else {"type": "integer"} if kind is np.int64 else NUMBER
    nested: dict[str, Any] = single
    for _ in range(DEEPEST):
        nested = {"anyOf": [single, {"type": "array", "items": nested}]}
    counts = {"type": "array", "items": {"type": "integer"}}
    shape = {"type": "object", "properties": {"shape": counts}, "required": ["shape"], "additionalProperties": False}

    def restored(value: Any) -> Any:
        if isinstance(value, dict) and isinstance(extent := value.get("shape"), list) and 0 in extent:
            return np.empty([leaves(count, np.int64) for count in extent], dtype=kind)
        if not isinstance(value, list):
            raise AccelcalError("numbers in lists")
        return np.array(leaves(value, kind), dtype=kind)

    return core_schema.no_info_plain_validator_function(
        restored,
        serialization=core_schema.plain_serializer_function_ser_schema(listed),
        metadata={"pydantic_js_functions": [lambda schema, handler: {"anyOf": [*nested["anyOf"], shape]}]},
    )


def listed(array: Any) -> Any:
    """Array as nested lists, with words for numbers that are not finite."""
    if array.size == 0 and array.ndim > 1:
        return {"shape": list(array.shape)}
    values = array.tolist()
    return values if array.dtype.kind != "f" or np.all(np.isfinite(array)) else spelled(values)


def spelled(value: Any) -> Any:
    """Nested lists with words for numbers that are not finite."""
    if isinstance(value, list):
        return [spelled(inner) for inner in value]
    return value if math.isfinite(value) else "NaN" if math.isnan(value) else "Infinity" if value > 0.0 else "-Infinity"


def leaves(value: Any, kind: type[np.generic], depth: int = 0) -> Any:
    """Nested lists with numbers for words.

    Raises
    ------
    ValueError
        If a leaf is not of the kind, rows differ in length, or lists stand in lists without end.
    """
    if isinstance(value, list):
        inner_leaves = [leaves(inner, kind, depth + 1) for inner in value] if depth < DEEPEST else None
        if inner_leaves is None or len({len(row) if isinstance(row, list) else -1 for row in inner_leaves}) > 1:
            raise AccelcalError(f"rows of equal length, at most {DEEPEST} lists in one another")
        return inner_leaves
    value = number(value) if kind is np.float64 else value
    types = {np.bool_: (bool,), np.int64: (int,)}.get(kind, (float, int))
    if type(value) not in types:
        raise AccelcalError(f"{types[0].__name__}s in lists, not {shown(value)}")
    return value


def sentence(error: ValidationError) -> str:
    """First value that does not follow a schema, in words."""
    first = error.errors(include_url=False)[0]
    where = (
        path_of(tuple(part for part in first["loc"] if part != "[key]" and "function-" not in str(part))) or "the file"
    )
    kind, message = first["type"], str(first["msg"])
    if kind == "missing":
        return f"{where} is missing"
    if kind in ("extra_forbidden", "unexpected_keyword_argument"):
        return f"{where} is no key of this schema"
    expected = message.removeprefix("Value error, ").replace("Input should be", "expected").replace("should", "must")
    if isinstance(cause := first.get("ctx", {}).get("error"), FieldError):
        return f"{where}.{cause.field}: found {cause.value:g}, expected {cause.expected}"
    if kind == "value_error":
        expected = f"expected {expected}"
    elif not expected.startswith("expected"):
        expected = f"expected otherwise: {expected[:1].lower()}{expected[1:]}"
    return f"{where}: found {shown(first['input'])}, {expected}"


def path_of(loc: tuple[int | str, ...]) -> str:
    """Path to a leaf, such as estimates[2].std."""
    written = "".join(f"[{part}]" if isinstance(part, int) else f".{part}" for part in loc)
    return visible(written.removeprefix(".")[: 3 * SHOWN], one_line=True)


def shown(value: Any) -> str:
    """Value as a sentence shows it."""
    text = f"{value:.10g}" if isinstance(value, float) else "null" if value is None else repr(value)
    return visible(text if len(text) <= SHOWN else f"{text[:SHOWN]}…", one_line=True)
