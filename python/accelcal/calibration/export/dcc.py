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
from accelcal.calibration.budget import COVERAGE_FACTOR, budget
from accelcal.calibration.export.calibration import Calibration
from accelcal.calibration.export.laboratory import Laboratory
from accelcal.calibration.export.words import equation, left_out, plain, reading

VERSION = "3.2.1"
DCC, SI, XSI = "https://ptb.de/dcc", "https://ptb.de/si", "http://www.w3.org/2001/XMLSchema-instance"
UNITS = {
    "1": r"\one",
    "count": r"\one",
    "V": r"\volt",
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
METHOD = (
    "The accelerometer moves along one axis with an encoder. Output and position are compared through a filter for "
    "position and velocity; parameters are estimated by weighted least squares on its innovations, with the noise of "
    "both channels found by likelihood."
)


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
    """Coverage factor 2; None where none is stated."""


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
    found = budget(c.fit)
    sensor = c.fit.rig.sensor
    missing = list(laboratory.missing)
    missing += [f"sensor.{key}" for key in ("model", "serial") if not getattr(sensor, key)]
    missing += found.missing
    root = ET.Element(f"{{{DCC}}}digitalCalibrationCertificate", schemaVersion=VERSION)
    root.set(f"{{{XSI}}}schemaLocation", f"{DCC} {DCC}/v{VERSION}/dcc.xsd")
    root.append(_comment("DRAFT: not signed, not accredited. " + _missing(missing)))
    _administrative(ET.SubElement(root, f"{{{DCC}}}administrativeData"), c, laboratory)
    results = ET.SubElement(root, f"{{{DCC}}}measurementResults")
    _result(ET.SubElement(results, f"{{{DCC}}}measurementResult"), c, found.missing)
    for prefix, space in (("dcc", DCC), ("si", SI), ("xsi", XSI)):
        ET.register_namespace(prefix, space)
    ET.indent(root)
    text = ET.tostring(root, encoding="unicode")
    return Draft(f'<?xml version="1.0" encoding="UTF-8"?>\n{text}\n', tuple(missing))


def quantities(c: Calibration) -> list[Quantity]:
    """Parameters of the sensor, then sensitivity and zero-g output where an electrical scale is declared."""
    expanded = {line.estimate.name: line.expanded for line in budget(c.fit).lines}
    found = [Quantity(f"{e.name} ({e.symbol})", e.value, e.unit, expanded.get(e.name)) for e in c.estimates]
    sensor = c.fit.rig.sensor
    if sensor.scale is not None:
        zero = (sensor.zero or 0.0) + sensor.scale * c.fit["bias"].value
        size = abs(sensor.scale)
        spread = {name: size * value for name, value in expanded.items()}
        found += [
            Quantity("sensitivity", sensor.scale * c.own.scale, f"{c.unit}/(m/s²)", spread.get("scale_factor")),
            Quantity("zero-g output", zero, c.unit, spread.get("bias")),
        ]
    return found


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


def _administrative(parent: ET.Element, c: Calibration, laboratory: Laboratory) -> None:
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
    sensor = c.fit.rig.sensor
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


def _result(parent: ET.Element, c: Calibration, undeclared: Sequence[str]) -> None:
    _named(parent, "name", "Calibration of an accelerometer against position")
    method = _add(_add(parent, "usedMethods"), "usedMethod")
    _named(method, "name", "Replay of output and position")
    _named(method, "description", METHOD)
    software = _add(_add(parent, "usedSoftware"), "software")
    _named(software, "name", "accelcal")
    _add(software, "release", __version__)
    _conditions(parent, c)
    results = _add(parent, "results")
    result = _add(results, "result")
    _named(result, "name", "Parameters of the sensor")
    notes = [f"Model in forward sense (IEEE 1293): {equation(c)}; {reading(c)}."]
    if c.own.needs_temperature:
        notes.append(f"T counts from {c.own.reference:.6g} degC.")
    notes += [f"{text}." for text in c.remarks]
    notes.append(f"Not certified: {'; '.join(left_out(c))}.")
    if undeclared:
        notes.append(f"Uncertainties are withheld until these are declared: {', '.join(undeclared)}.")
    _named(result, "description", " ".join(notes))
    data = _add(result, "data")
    for quantity in quantities(c):
        _quantity(data, quantity)


def _conditions(parent: ET.Element, c: Calibration) -> None:
    """Ranges that the calibration has seen."""
    conditions = _add(parent, "influenceConditions")
    ranges = [("acceleration", c.domain.acceleration, "m/s²")]
    temperature = c.fit.validity.get("temperature")
    ranges += [("temperature", temperature, "degC")] if temperature else []
    for name, (low, high), unit in ranges:
        condition = _add(conditions, "influenceCondition")
        _named(condition, "name", f"range of {name}")
        data = _add(condition, "data")
        _quantity(data, Quantity(f"least {name}", low, unit))
        _quantity(data, Quantity(f"largest {name}", high, unit))


def _quantity(parent: ET.Element, found: Quantity) -> None:
    quantity = _add(parent, "quantity")
    _named(quantity, "name", found.name)
    real = ET.SubElement(quantity, f"{{{SI}}}real")
    ET.SubElement(real, f"{{{SI}}}value").text = repr(found.value)
    ET.SubElement(real, f"{{{SI}}}unit").text = UNITS[found.unit]
    if found.expanded is not None:
        spread = ET.SubElement(real, f"{{{SI}}}expandedUnc")
        ET.SubElement(spread, f"{{{SI}}}uncertainty").text = repr(found.expanded)
        ET.SubElement(spread, f"{{{SI}}}coverageFactor").text = f"{COVERAGE_FACTOR:g}"
        ET.SubElement(spread, f"{{{SI}}}coverageProbability").text = PROBABILITY
