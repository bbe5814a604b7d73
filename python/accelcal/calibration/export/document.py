"""A draft Digital Calibration Certificate: DCC 3.2.1 with D-SI units, written with the standard library.

It is a draft: unsigned, not accredited. Administrative data of the laboratory are marked as missing.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any
from xml.etree import ElementTree as ET

from accelcal._core import __version__
from accelcal.calibration.budget import COVERAGE_FACTOR
from accelcal.calibration.export.laboratory import Laboratory
from accelcal.calibration.export.words import plain
from accelcal.data.rig import Sensor

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
    missing = list(laboratory.missing)
    missing += [f"sensor.{key}" for key in ("model", "serial") if not getattr(sensor, key)]
    missing += undeclared
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{VERSION}/dcc.xsd")
    root.append(_comment("DRAFT: not signed, not accredited. " + _missing(missing)))
    _administrative(ET.SubElement(root, f"{{{DCC}}}administrativeData"), sensor, laboratory)
    results = ET.SubElement(root, f"{{{DCC}}}measurementResults")
    _measurement(ET.SubElement(results, f"{{{DCC}}}measurementResult"), measurement)
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ET.register_namespace(prefix, space)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return Draft(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', tuple(missing))


def _missing(keys: Sequence[str]) -> str:
    return f"Missing: {', '.join(keys)}." if keys else "Nothing is missing."


def _comment(text: str) -> Any:
    safe = plain(text).replace("--", "- -")
    return ET.Comment(f" {safe} ")


def _add(parent: ET.Element, tag: str, text: str | None = None) -> ET.Element:
    node = ET.SubElement(parent, f"{{{DCC}}}{tag}")
    node.text = None if text is None else NOT_XML.sub("?", text)
    return node


def _named(parent: ET.Element, tag: str, text: str) -> ET.Element:
    """An element with a text in English."""
    node = _add(parent, tag)
    _add(node, "content", text).set("lang", "en")
    return node


def _declared(parent: ET.Element, tag: str, laboratory: Laboratory, key: str, *, named: bool = False) -> None:
    """Administrative data, or a marked placeholder."""
    if key in laboratory.missing:
        parent.append(_comment(f"MISSING: {key}"))
    (_named if named else _add)(parent, tag, laboratory.text(key))


def _administrative(parent: ET.Element, sensor: Sensor, laboratory: Laboratory) -> None:
    software = _add(_add(parent, "dccSoftware"), "software")
    _named(software, "name", "accelcal")
    _add(software, "release", __version__)
    core = _add(parent, "coreData")
    _declared(core, "countryCodeISO3166_1", laboratory, "certificate.country")
    _add(core, "usedLangCodeISO639_1", "en")
    _add(core, "mandatoryLangCodeISO639_1", "en")
    _declared(core, "uniqueIdentifier", laboratory, "certificate.identifier")
    _declared(core, "beginPerformanceDate", laboratory, "certificate.begin")
    _declared(core, "endPerformanceDate", laboratory, "certificate.end")
    _declared(core, "performanceLocation", laboratory, "certificate.place")
    item = _add(_add(parent, "items"), "item")
    _named(item, "name", "accelerometer")
    if sensor.model:
        _add(item, "model", " ".join(sensor.model.split()))
    identification = _add(_add(item, "identifications"), "identification")
    _add(identification, "issuer", "manufacturer")
    if not sensor.serial:
        identification.append(_comment("MISSING: sensor.serial"))
    _add(identification, "value", " ".join(sensor.serial.split()) or "missing")
    _named(identification, "name", "serial number")
    contact = _add(_add(parent, "calibrationLaboratory"), "contact")
    _declared(contact, "name", laboratory, "laboratory.name", named=True)
    _declared(_add(contact, "location"), "city", laboratory, "laboratory.city")
    person = _add(_add(_add(parent, "respPersons"), "respPerson"), "person")
    _declared(person, "name", laboratory, "responsible.name", named=True)
    customer = _add(parent, "customer")
    _declared(customer, "name", laboratory, "customer.name", named=True)
    _declared(_add(customer, "location"), "city", laboratory, "customer.city")
    statement = _add(_add(parent, "statements"), "statement")
    _named(statement, "declaration", "Draft: neither signed nor issued under an accreditation.")


def _measurement(parent: ET.Element, measurement: Measurement) -> None:
    _named(parent, "name", measurement.name)
    method = _add(_add(parent, "usedMethods"), "usedMethod")
    _named(method, "name", measurement.method)
    _named(method, "description", measurement.description)
    software = _add(_add(parent, "usedSoftware"), "software")
    _named(software, "name", "accelcal")
    _add(software, "release", __version__)
    conditions = _add(parent, "influenceConditions")
    for name, (low, high), unit in measurement.conditions:
        condition = _add(conditions, "influenceCondition")
        _named(condition, "name", f"range of {name}")
        data = _add(condition, "data")
        _quantity(data, Quantity(f"least {name}", low, unit))
        _quantity(data, Quantity(f"largest {name}", high, unit))
    results = _add(parent, "results")
    for found in measurement.results:
        result = _add(results, "result")
        _named(result, "name", found.name)
        _named(result, "description", found.description)
        data = _add(result, "data")
        for quantity in found.quantities:
            _quantity(data, quantity)
        if found.table:
            listed = _add(data, "list")
            for column in found.table:
                _column(listed, column)


def _quantity(parent: ET.Element, found: Quantity) -> None:
    quantity = _add(parent, "quantity")
    _named(quantity, "name", found.name)
    real = ET.SubElement(quantity, f"{{{SI}}}real")
    ET.SubElement(real, f"{{{SI}}}value").text = repr(found.value)
    ET.SubElement(real, f"{{{SI}}}unit").text = UNITS[found.unit]
    if found.expanded is not None:
        spread = ET.SubElement(real, f"{{{SI}}}expandedUnc")
        ET.SubElement(spread, f"{{{SI}}}uncertainty").text = repr(found.expanded)
        ET.SubElement(spread, f"{{{SI}}}coverageFactor").text = f"{found.factor or COVERAGE_FACTOR:.4g}"
        probability = PROBABILITY if found.factor is None else PROBABILITY_OF_TWO
        ET.SubElement(spread, f"{{{SI}}}coverageProbability").text = probability


def _column(parent: ET.Element, found: Column) -> None:
    quantity = _add(parent, "quantity")
    _named(quantity, "name", found.name)
    numbers = ET.SubElement(quantity, f"{{{SI}}}realListXMLList")
    ET.SubElement(numbers, f"{{{SI}}}valueXMLList").text = " ".join(map(repr, found.values))
    ET.SubElement(numbers, f"{{{SI}}}unitXMLList").text = UNITS[found.unit]
    if found.expanded is not None:
        spread = ET.SubElement(numbers, f"{{{SI}}}expandedUncXMLList")
        ET.SubElement(spread, f"{{{SI}}}uncertaintyXMLList").text = " ".join(map(repr, found.expanded))
        ET.SubElement(spread, f"{{{SI}}}coverageFactorXMLList").text = " ".join(f"{k:.4g}" for k in found.factors)
        ET.SubElement(spread, f"{{{SI}}}coverageProbabilityXMLList").text = PROBABILITY_OF_TWO
