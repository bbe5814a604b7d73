"""The order in which DCC 3.2.1 asks for elements: what can be checked of a certificate without its schema."""

from xml.etree import ElementTree as ET

DCC = "{https://ptb.de/dcc}"
ORDER = {
    "administrativeData": ["dccSoftware", "coreData", "items", "calibrationLaboratory", "respPersons", "customer"],
    "coreData": [
        "countryCodeISO3166_1",
        "usedLangCodeISO639_1",
        "mandatoryLangCodeISO639_1",
        "uniqueIdentifier",
        "beginPerformanceDate",
        "endPerformanceDate",
        "performanceLocation",
    ],
    "item": ["name", "model", "identifications"],
    "identification": ["issuer", "value", "name"],
    "contact": ["name", "location"],
    "customer": ["name", "location"],
    "measurementResult": [
        "name",
        "usedMethods",
        "usedSoftware",
        "measuringEquipments",
        "influenceConditions",
        "results",
    ],
    "measuringEquipment": ["name", "model", "identifications"],
    "influenceCondition": ["name", "data"],
    "result": ["name", "description", "data"],
    "software": ["name", "release"],
    "usedMethod": ["name", "description"],
}
"""Children in the order in which DCC 3.2.1 asks for them."""
OPTIONAL = {
    "item": ["model"],
    "measuringEquipment": ["model", "identifications"],
    "measurementResult": ["measuringEquipments"],
}
"""Children that may be missing."""


def require_order(text):
    """Every element has its children in this order, and every kind of element is there; equipment may be missing."""
    root = ET.fromstring(text)
    assert root.get("schemaVersion") == "3.2.1"
    names = set()
    for node in root.iter():
        name = str(node.tag).removeprefix(DCC)
        if name in ORDER:
            names.add(name)
            children = [str(child.tag).removeprefix(DCC) for child in node if isinstance(child.tag, str)]
            expected = [c for c in ORDER[name] if c in children or c not in OPTIONAL.get(name, ())]
            assert [c for c in children if c in ORDER[name]] == expected, name
    assert names | {"measuringEquipment"} == set(ORDER)
