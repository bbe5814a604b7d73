"""The table as one result of a Digital Calibration Certificate (DCC 3.2.1): lists of real numbers in D-SI units."""

from __future__ import annotations

import math
from collections.abc import Sequence
from xml.etree import ElementTree as ET

from accelcal._core import __version__
from accelcal.calibration.export.dcc import DCC, PROBABILITY, SI
from accelcal.response.measure import FrequencyResponse

METHOD = (
    "Output and reference are fitted by least squares to sines over the steady part of each step (sine "
    "approximation of ISO 16063-11 and -41), or compared segment by segment for other motions. Type A uncertainty from "
    "the noise beside each line; no contribution of the reference's own calibration is contained."
)


def dcc_table(found: FrequencyResponse) -> str:
    """An XML document with one dcc:result: frequency, magnitude, phase, with expanded uncertainties (k = 2).

    It is a part of a certificate, to be put below dcc:results; administrative data are those of the certificate.
    """
    for prefix, space in (("dcc", DCC), ("si", SI)):
        ET.register_namespace(prefix, space)
    root = ET.Element(f"{{{DCC}}}result")
    root.append(ET.Comment(f" accelcal {__version__}: draft, not signed "))
    _named(root, "name", "Frequency response of the sensitivity")
    _named(root, "description", METHOD)
    table = ET.SubElement(ET.SubElement(root, f"{{{DCC}}}data"), f"{{{DCC}}}list")
    points = found.points
    _quantity(table, "frequency", [p.frequency for p in points], r"\hertz")
    _quantity(table, "magnitude", [p.magnitude for p in points], r"\one", [p.expanded for p in points])
    phase, spread = [math.degrees(p.phase) for p in points], [math.degrees(p.expanded_phase) for p in points]
    _quantity(table, "phase", phase, r"\degree", spread)
    ET.indent(root)
    return f'<?xml version="1.0" encoding="UTF-8"?>\n{ET.tostring(root, encoding="unicode")}\n'


def _named(parent: ET.Element, tag: str, text: str) -> None:
    node = ET.SubElement(ET.SubElement(parent, f"{{{DCC}}}{tag}"), f"{{{DCC}}}content", lang="en")
    node.text = text


def _quantity(
    parent: ET.Element, name: str, values: Sequence[float], unit: str, expanded: Sequence[float] | None = None
) -> None:
    quantity = ET.SubElement(parent, f"{{{DCC}}}quantity")
    _named(quantity, "name", name)
    numbers = ET.SubElement(quantity, f"{{{SI}}}realListXMLList")
    ET.SubElement(numbers, f"{{{SI}}}valueXMLList").text = " ".join(map(repr, values))
    ET.SubElement(numbers, f"{{{SI}}}unitXMLList").text = unit
    if expanded is not None:
        spread = ET.SubElement(numbers, f"{{{SI}}}expandedUncXMLList")
        ET.SubElement(spread, f"{{{SI}}}uncertaintyXMLList").text = " ".join(map(repr, expanded))
        ET.SubElement(spread, f"{{{SI}}}coverageFactorXMLList").text = "2"
        ET.SubElement(spread, f"{{{SI}}}coverageProbabilityXMLList").text = PROBABILITY
