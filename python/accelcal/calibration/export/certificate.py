"""A draft Digital Calibration Certificate: DCC 3.2.1 with D-SI units, written with the standard library.

It is a draft: unsigned, not accredited. Administrative data of the laboratory are marked as missing.
"""

from __future__ import annotations

import datetime
import difflib
import re
import tomllib
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType
from typing import Any
from xml.etree import ElementTree as ET

from accelcal._core import __version__
from accelcal._support.errors import AccelcalError
from accelcal.calibration.characteristic import COVERAGE_FACTOR, budget
from accelcal.calibration.export.calibration import Calibration, equation, left_out, plain, reading
from accelcal.data import Sensor
from accelcal.estimation.estimate import DWELLS_ALONE

PLACES = ("laboratory", "customer", "laboratoryBranch", "customerBranch", "other")
"""Where a calibration may take place, in the words of the DCC."""
NO_DATE = "0001-01-01"
NO_COUNTRY = "ZZ"


class LaboratoryError(AccelcalError):
    """A file of administrative data cannot be used. The text names file and key and states what was expected."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One piece of administrative data."""

    key: str
    """table.key of the file."""
    what: str
    check: Callable[[object], str | None]
    """Its text, or None where the value is not of the kind."""
    stand_in: str
    """What the schema accepts in its place while it is missing."""


def _text(value: object) -> str | None:
    return " ".join(value.split()) or None if isinstance(value, str) else None


def _date(value: object) -> str | None:
    return value.isoformat() if type(value) is datetime.date else None


def _code(pattern: str) -> Callable[[object], str | None]:
    return lambda value: value if isinstance(value, str) and re.fullmatch(pattern, value) else None


ENTRIES = (
    Entry("certificate.identifier", "a text that no other certificate has", _text, "missing"),
    Entry("certificate.country", 'two capital letters of ISO 3166-1, such as "DE"', _code("[A-Z]{2}"), NO_COUNTRY),
    Entry("certificate.begin", "a date without quotes, such as 2026-11-20", _date, NO_DATE),
    Entry("certificate.end", "a date without quotes, such as 2026-11-21", _date, NO_DATE),
    Entry("certificate.place", "one of " + ", ".join(PLACES), _code("|".join(PLACES)), "other"),
    Entry("certificate.traceability", "a text, such as by which institute's standards", _text, "missing"),
    Entry("laboratory.name", "a text", _text, "missing"),
    Entry("laboratory.city", "a text", _text, "missing"),
    Entry("responsible.name", "a text", _text, "missing"),
    Entry("customer.name", "a text", _text, "missing"),
    Entry("customer.city", "a text", _text, "missing"),
)
"""Administrative data that a DCC or ISO/IEC 17025 requires and no recording has."""
EQUIPMENT = tuple(
    Entry(f"equipment.{key}", "a text", _text, "missing") for key in ("name", "model", "serial", "certificate")
)
"""What is said of each piece of measuring equipment; its certificate by number."""


@dataclass(frozen=True, slots=True)
class Laboratory:
    """Administrative data as far as they are declared."""

    declared: Mapping[str, str] = field(default_factory=lambda: MappingProxyType({}))
    """Texts by key."""
    equipment: tuple[Mapping[str, str], ...] = ()
    """Texts by key, of each piece of measuring equipment."""

    @property
    def missing(self) -> tuple[str, ...]:
        """Keys that are not declared."""
        lacking = tuple(entry.key for entry in ENTRIES if entry.key not in self.declared)
        return lacking if self.equipment else (*lacking, "equipment.name")

    def text(self, key: str) -> str:
        """The declared value, or a placeholder."""
        stand_in = next(entry.stand_in for entry in ENTRIES if entry.key == key)
        return self.declared.get(key, stand_in)


def read_laboratory(path: Path) -> Laboratory:
    """Read and check a file of administrative data.

    Raises
    ------
    LaboratoryError
        Naming file, key, what was found, what was expected.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8"))
    except OSError as error:
        raise LaboratoryError(f"{path}: {(error.strerror or 'cannot be read').lower()}; check the path") from None
    except (UnicodeDecodeError, tomllib.TOMLDecodeError) as error:
        raise LaboratoryError(f"{path}: not valid TOML ({error}); correct that line") from None
    entries = {entry.key: entry for entry in (*ENTRIES, *EQUIPMENT)}
    declared: dict[str, str] = {}
    equipment: list[dict[str, str]] = []
    pieces = content.pop("equipment", [])
    tables = [*content.items(), *(("equipment", piece) for piece in (pieces if isinstance(pieces, list) else [pieces]))]
    for table, keys in tables:
        if not isinstance(keys, dict):
            raise LaboratoryError(f"{path}: {table}: found {keys!r}, expected a table; {_nearest(table, entries)}")
        texts = {}
        for key, value in keys.items():
            name = f"{table}.{key}"
            if name not in entries:
                raise LaboratoryError(f"{path}: {name}: unknown key; {_nearest(name, entries)}")
            text = entries[name].check(value)
            if text is None:
                raise LaboratoryError(f"{path}: {name}: found {value!r}, expected {entries[name].what}")
            texts[name] = text
        if table != "equipment":
            declared.update(texts)
        elif "equipment.name" in texts:
            equipment.append(texts)
        else:
            raise LaboratoryError(f"{path}: equipment: found no name, expected one in each [[equipment]]")
    return Laboratory(declared, tuple(equipment))


def _nearest(key: str, entries: Mapping[str, Entry]) -> str:
    close = difflib.get_close_matches(key, entries, n=1)
    return f'did you mean "{close[0]}"?' if close else "known keys: " + ", ".join(entries)


VERSION = "3.2.1"
DCC, SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
UNITS = {
    "1": r"\one",
    "count": r"\one",
    "V": r"\volt",
    "Hz": r"\hertz",
    "s": r"\second",
    "°": r"\degree",
    "degC": r"\degreecelsius",
    "m/s²": r"\metre\second\tothe{-2}",
    "(m/s²)⁻¹": r"\metre\tothe{-1}\second\tothe{2}",
    "(m/s²)⁻²": r"\metre\tothe{-2}\second\tothe{4}",
    "m/s²/K": r"\metre\second\tothe{-2}\kelvin\tothe{-1}",
    "K⁻¹": r"\kelvin\tothe{-1}",
    "V/(m/s²)": r"\volt\metre\tothe{-1}\second\tothe{2}",
    "count/(m/s²)": r"\metre\tothe{-1}\second\tothe{2}",
}
"""Units of this program in the notation of D-SI."""
NOT_XML = re.compile("[^\t\n\r\x20-\ud7ff\ue000-\ufffd\U00010000-\U0010ffff]")
"""Characters that no XML document may hold."""
PROBABILITY = "0.95"
"""Of the expanded uncertainty, for a normal distribution."""
PROBABILITY_OF_TWO = "0.9545"
"""Of two standard deviations of a normal distribution; a column states the factor that reaches it."""


@dataclass(frozen=True, slots=True)
class Draft:
    """A certificate as text, and what it lacks."""

    text: str
    missing: tuple[str, ...]
    """Keys of the administrative data and of the sidecar."""


@dataclass(frozen=True, slots=True)
class Quantity:
    """One number of the certificate."""

    name: str
    value: float
    unit: str
    expanded: float | None = None
    """None where none is stated."""
    factor: float | None = None
    """Its coverage factor at `PROBABILITY_OF_TWO`; None: coverage factor 2, taken as `PROBABILITY`."""


@dataclass(frozen=True, slots=True)
class Column:
    """Numbers of one kind, a row of a table each."""

    name: str
    values: Sequence[float]
    unit: str
    expanded: Sequence[float] | None = None
    factors: Sequence[float] = ()
    """Coverage factor of each expanded uncertainty, at `PROBABILITY_OF_TWO`."""


@dataclass(frozen=True, slots=True)
class Result:
    """What was found: numbers that stand alone, or a table."""

    name: str
    description: str
    quantities: tuple[Quantity, ...] = ()
    table: tuple[Column, ...] = ()


@dataclass(frozen=True, slots=True)
class Measurement:
    """How it was measured, under which conditions, and what was found."""

    name: str
    method: str
    description: str
    """Of the method."""
    conditions: tuple[tuple[str, tuple[float, float], str], ...]
    """Ranges: quantity, least and largest value, unit."""
    results: tuple[Result, ...]


def certificate(
    measurement: Measurement, sensor: Sensor, laboratory: Laboratory, undeclared: Sequence[str] = ()
) -> Draft:
    """Write a whole certificate.

    Parameters
    ----------
    measurement : what is certified.
    sensor : what was measured.
    laboratory : administrative data; what is missing is marked and listed.
    undeclared : keys of the sidecar that the measurement lacks.
    """
    unnamed = [f"sensor.{key}" for key in ("model", "serial") if not getattr(sensor, key)]
    missing = (*laboratory.missing, *unnamed, *undeclared)
    lacking = f"Missing: {', '.join(missing)}." if missing else "Nothing is missing."
    root = _node(
        "digitalCalibrationCertificate",
        _comment(f"DRAFT: not signed, not accredited. {lacking}"),
        _administrative(sensor, laboratory),
        _node("measurementResults", _measurement(measurement, laboratory)),
    )
    root.set("schemaVersion", VERSION)
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{VERSION}/dcc.xsd")
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ET.register_namespace(prefix, space)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return Draft(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', missing)


def _comment(text: str) -> Any:
    return ET.Comment(f" {plain(text).replace('--', '- -')} ")


def _node(tag: str, *inside: ET.Element | str) -> ET.Element:
    """An element of the schema with its text, or the elements in it."""
    node = ET.Element(f"{{{DCC}}}{tag}", {"lang": "en"} if tag == "content" else {})
    for part in inside:
        if isinstance(part, str):
            node.text = NOT_XML.sub("?", part)
        else:
            node.append(part)
    return node


def _named(tag: str, text: str) -> ET.Element:
    """An element whose text has a language."""
    return _node(tag, _node("content", text))


def _declared(tag: str, laboratory: Laboratory, key: str, *, named: bool = False) -> list[ET.Element]:
    """Administrative data, or a placeholder behind a mark."""
    missing = [_comment(f"MISSING: {key}")] if key in laboratory.missing else []
    return [*missing, (_named if named else _node)(tag, laboratory.text(key))]


def _software(tag: str) -> ET.Element:
    return _node(tag, _node("software", _named("name", "accelcal"), _node("release", __version__)))


CORE = {
    "uniqueIdentifier": "certificate.identifier",
    "beginPerformanceDate": "certificate.begin",
    "endPerformanceDate": "certificate.end",
    "performanceLocation": "certificate.place",
}
"""Elements of the core data behind country and languages, in the order of the schema, with their keys."""


def _administrative(sensor: Sensor, laboratory: Laboratory) -> ET.Element:
    serial = " ".join(sensor.serial.split()) or "missing"
    draft = "Draft: neither signed nor issued under an accreditation."
    return _node(
        "administrativeData",
        _software("dccSoftware"),
        _node(
            "coreData",
            *_declared("countryCodeISO3166_1", laboratory, "certificate.country"),
            _node("usedLangCodeISO639_1", "en"),
            _node("mandatoryLangCodeISO639_1", "en"),
            *(node for tag, key in CORE.items() for node in _declared(tag, laboratory, key)),
        ),
        _node(
            "items",
            _node(
                "item",
                _named("name", "accelerometer"),
                *([_node("model", " ".join(sensor.model.split()))] if sensor.model else []),
                _node(
                    "identifications",
                    *([] if sensor.serial else [_comment("MISSING: sensor.serial")]),
                    _identified("manufacturer", serial, "serial number"),
                ),
            ),
        ),
        _node(
            "calibrationLaboratory",
            _node(
                "contact",
                *_declared("name", laboratory, "laboratory.name", named=True),
                _node("location", *_declared("city", laboratory, "laboratory.city")),
            ),
        ),
        _node(
            "respPersons",
            _node("respPerson", _node("person", *_declared("name", laboratory, "responsible.name", named=True))),
        ),
        _node(
            "customer",
            *_declared("name", laboratory, "customer.name", named=True),
            _node("location", *_declared("city", laboratory, "customer.city")),
        ),
        _node(
            "statements",
            _node("statement", _named("declaration", draft)),
            _node("statement", *_declared("declaration", laboratory, "certificate.traceability", named=True)),
        ),
    )


MARKS = {
    "serial": ("manufacturer", "serial number"),
    "certificate": ("other", "calibration certificate"),
}
"""Keys that identify a piece of equipment, with the issuer and the name of what they hold."""


def _equipment(laboratory: Laboratory) -> list[ET.Element]:
    """What was measured with, or a mark that it is missing."""
    if not laboratory.equipment:
        return [_comment("MISSING: equipment.name")]
    pieces = []
    for piece in laboratory.equipment:
        marks = [
            _identified(issuer, piece[f"equipment.{key}"], name)
            for key, (issuer, name) in MARKS.items()
            if f"equipment.{key}" in piece
        ]
        model = [_node("model", piece["equipment.model"])] if "equipment.model" in piece else []
        identified = [_node("identifications", *marks)] if marks else []
        pieces.append(_node("measuringEquipment", _named("name", piece["equipment.name"]), *model, *identified))
    return [_node("measuringEquipments", *pieces)]


def _identified(issuer: str, value: str, name: str) -> ET.Element:
    return _node("identification", _node("issuer", issuer), _node("value", value), _named("name", name))


def _measurement(measurement: Measurement, laboratory: Laboratory) -> ET.Element:
    conditions = (
        _node(
            "influenceCondition",
            _named("name", f"range of {name}"),
            _node(
                "data",
                _quantity(Quantity(f"least {name}", low, unit)),
                _quantity(Quantity(f"largest {name}", high, unit)),
            ),
        )
        for name, (low, high), unit in measurement.conditions
    )
    results = (
        _node(
            "result",
            _named("name", entry.name),
            _named("description", entry.description),
            _node(
                "data",
                *map(_quantity, entry.quantities),
                *([_node("list", *map(_column, entry.table))] if entry.table else []),
            ),
        )
        for entry in measurement.results
    )
    method = _named("name", measurement.method), _named("description", measurement.description)
    return _node(
        "measurementResult",
        _named("name", measurement.name),
        _node("usedMethods", _node("usedMethod", *method)),
        _software("usedSoftware"),
        *_equipment(laboratory),
        _node("influenceConditions", *conditions),
        _node("results", *results),
    )


def _si(tag: str, **texts: str) -> ET.Element:
    """An element of the schema of units, with texts by name."""
    node = ET.Element(f"{{{SI}}}{tag}")
    for name, text in texts.items():
        ET.SubElement(node, f"{{{SI}}}{name}").text = text
    return node


def _quantity(entry: Quantity) -> ET.Element:
    real = _si("real", value=repr(entry.value), unit=UNITS[entry.unit])
    if entry.expanded is not None:
        expanded = _si(
            "expandedUnc",
            uncertainty=repr(entry.expanded),
            coverageFactor=f"{entry.factor or COVERAGE_FACTOR:.4g}",
            coverageProbability=PROBABILITY if entry.factor is None else PROBABILITY_OF_TWO,
        )
        real.append(expanded)
    return _node("quantity", _named("name", entry.name), real)


def _column(column: Column) -> ET.Element:
    values = " ".join(map(repr, column.values))
    numbers = _si("realListXMLList", valueXMLList=values, unitXMLList=UNITS[column.unit])
    if column.expanded is not None:
        expanded = _si(
            "expandedUncXMLList",
            uncertaintyXMLList=" ".join(map(repr, column.expanded)),
            coverageFactorXMLList=" ".join(f"{k:.4g}" for k in column.factors),
            coverageProbabilityXMLList=PROBABILITY_OF_TWO,
        )
        numbers.append(expanded)
    return _node("quantity", _named("name", column.name), numbers)


MOVED = (
    "Calibration of an accelerometer against a recorded motion",
    "Least squares on output and motion",
    "The accelerometer moves along one axis with a reference that records position, velocity or acceleration. Output "
    "and reference are compared through a filter for position and velocity, or in integrals against smooth functions "
    "of time; parameters are estimated by weighted least squares, with the noise of both channels found by likelihood.",
)
AT_REST = (
    "Calibration of an accelerometer by gravity at rest",
    "Tumble test: least squares on static dwells",
    "The accelerometer rests at known angles to gravity. Means of the output are fitted by generalised least squares, "
    "with the zero of the angles, their declared uncertainty, and the noise within dwells. Coefficients are relative "
    "to the declared local gravity, whose uncertainty is not contained.",
)
"""Name, method and description of what is certified."""


def draft(c: Calibration, laboratory: Laboratory) -> Draft:
    """Write a certificate of the sensor's own parameters.

    Parameters
    ----------
    c : what is certified; only effects that the sensor owns.
    laboratory : administrative data; what is missing is marked and listed.

    Notes
    -----
    Expanded uncertainties are those of the budget. While it is withheld because declarations are missing, values stand
    without uncertainty, and the declarations are listed.
    """
    undeclared = budget(c.fit).missing
    temperature = c.fit.validity.get("temperature")
    ranges = [("acceleration", c.domain.acceleration, "m/s²")]
    ranges += [("temperature", temperature, "degC")] if temperature else []
    notes = [f"Model in forward sense (IEEE 1293): {equation(c)}; {reading(c)}."]
    if c.characteristic.needs_temperature:
        notes.append(f"T counts from {c.characteristic.reference:.6g} degC; the thermometer is taken as exact.")
    notes += [f"{text}." for text in c.remarks]
    notes.append(f"Not certified: {'; '.join(left_out(c))}.")
    if undeclared:
        notes.append(f"Uncertainties are withheld until these are declared: {', '.join(undeclared)}.")
    name, method, description = AT_REST if c.fit.method == DWELLS_ALONE else MOVED
    measurement = Measurement(
        name=name,
        method=method,
        description=description,
        conditions=tuple(ranges),
        results=(Result("Parameters of the sensor", " ".join(notes), tuple(quantities(c))),),
    )
    return certificate(measurement, c.fit.rig.sensor, laboratory, undeclared)


def quantities(c: Calibration) -> list[Quantity]:
    """Parameters of the sensor, then sensitivity and zero-g output where an electrical scale is declared."""
    expanded = {line.estimate.name: line.expanded for line in budget(c.fit).lines}
    rows = [Quantity(f"{e.name} ({e.symbol})", e.value, e.unit, expanded.get(e.name)) for e in c.estimates]
    sensor = c.fit.rig.sensor
    if sensor.scale is not None:
        zero = (sensor.zero or 0.0) + sensor.scale * c.fit["bias"].value
        size = abs(sensor.scale)
        spread = {name: size * value for name, value in expanded.items()}
        rows += [
            Quantity(
                "sensitivity", sensor.scale * c.characteristic.scale, f"{c.unit}/(m/s²)", spread.get("scale_factor")
            ),
            Quantity("zero-g output", zero, c.unit, spread.get("bias")),
        ]
    return rows
