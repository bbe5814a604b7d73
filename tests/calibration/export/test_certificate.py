"""The draft certificate: its structure by hand, what it lacks, and the schema where one is at hand."""

import os
from pathlib import Path
from xml.etree import ElementTree as ET

import numpy as np
import pytest

import accelcal as ac
from accelcal.calibration.characteristic import budget
from accelcal.calibration.export import LaboratoryError, SchemaError, calibrate, draft, read_laboratory, require_valid
from accelcal.calibration.export.certificate import ENTRIES, UNITS, Laboratory, quantities
from accelcal.data.rig import Sensor, Uncertainty
from accelcal.effects import BUILT_IN

from .models import VOLTS, fit_of
from .order import require_order

DCC, SI = "{https://ptb.de/dcc}", "{https://ptb.de/si}"
VALUES = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-5, "temperature_bias": 1e-3, "temperature_scale": 1e-4}
DECLARED = Uncertainty(encoder_scale=1e-5, level=1e-3, misalignment=2e-3)
LAB = """
[certificate]
identifier = "2026-0042"
country = "DE"
begin = 2026-11-20
end = 2026-11-21
place = "laboratory"
traceability = "Length by an interferometer that PTB calibrated"
[laboratory]
name = "Acceleration laboratory"
city = "Braunschweig"
[responsible]
name = "A. Metrologist"
[customer]
name = "Customer Ltd"
city = "Oslo"
[[equipment]]
name = "Linear encoder"
model = "LIC 411"
serial = "73"
certificate = "PTB 5.12-4099"
[[equipment]]
name = "Air-bearing stage"
"""


def certificate(laboratory=Laboratory(), uncertainty=DECLARED, sensor=VOLTS):  # noqa: B008  (frozen)
    calibration = calibrate(fit_of(VALUES, temperature=(15.0, 40.0), uncertainty=uncertainty, sensor=sensor))
    return calibration, draft(calibration, laboratory)


def filled(tmp_path, text=LAB):
    path = tmp_path / "lab.toml"
    path.write_text(text)
    return read_laboratory(path)


def schema():
    given = os.environ.get("ACCELCAL_DCC_SCHEMA")
    if not given:
        reason = (
            "ACCELCAL_DCC_SCHEMA is not set: name dcc.xsd 3.2.1 with SI_Format.xsd and xmldsig-core-schema.xsd beside"
        )
        print(reason)
        pytest.skip(reason)
    return Path(given)


def test_elements_stand_in_the_order_of_the_schema():
    text = certificate()[1].text
    require_order(text)
    with pytest.raises(AssertionError, match="identification"):
        require_order(text.replace("dcc:issuer", "dcc:isuer"))


def test_values_and_expanded_uncertainties_are_those_of_the_budget():
    calibration, result = certificate()
    root = ET.fromstring(result.text)
    stated = {}
    for quantity in root.iter(f"{DCC}quantity"):
        real = quantity.find(f"{SI}real")
        expanded = real.find(f"{SI}expandedUnc")
        name = quantity.findtext(f"{DCC}name/{DCC}content")
        stated[name] = (
            float(real.findtext(f"{SI}value")),
            real.findtext(f"{SI}unit"),
            None if expanded is None else float(expanded.findtext(f"{SI}uncertainty")),
        )
        if expanded is not None:
            assert expanded.findtext(f"{SI}coverageFactor") == "2"
            assert [str(c.tag).removeprefix(SI) for c in expanded] == [
                "uncertainty",
                "coverageFactor",
                "coverageProbability",
            ]
    lines = {line.estimate.name: line for line in budget(calibration.fit).lines}
    bias, k, thermal = (lines[name] for name in ("bias", "scale_factor", "temperature_scale"))
    assert stated["bias (K0)"] == (0.05, r"\metre\second\tothe{-2}", bias.expanded)
    assert stated["scale_factor (k)"] == (0.01, r"\one", k.expanded)
    assert stated["temperature_scale (kT)"] == (1e-4, r"\kelvin\tothe{-1}", thermal.expanded)
    sensitivity = stated["sensitivity"]
    assert sensitivity[0] == pytest.approx(0.0255 * 1.01, rel=1e-15)
    assert sensitivity[1] == r"\volt\metre\tothe{-1}\second\tothe{2}"
    assert sensitivity[2] == pytest.approx(0.0255 * k.expanded, rel=1e-15)
    assert stated["zero-g output"][0] == pytest.approx(2.5 + 0.0255 * 0.05, rel=1e-15)
    assert stated["largest temperature"] == (40.0, r"\degreecelsius", None)
    assert "the thermometer is taken as exact" in result.text
    assert "time_offset belongs to timing" in result.text
    assert "time_offset (" not in result.text


def test_what_is_missing_is_listed_and_marked():
    _, result = certificate(uncertainty=Uncertainty(level=1e-3), sensor=Sensor(scale=-0.02, scale_unit="V"))
    keys = [*(entry.key for entry in ENTRIES), "equipment.name"]
    lacking = ["sensor.model", "sensor.serial", "uncertainty.encoder_scale", "uncertainty.misalignment"]
    assert list(result.missing) == [*keys, *lacking]
    assert f"Missing: {', '.join(result.missing)}" in result.text
    for key in [*keys, "sensor.serial"]:
        assert f"<!-- MISSING: {key} -->" in result.text
    assert "expandedUnc" not in result.text
    assert "withheld until these are declared: uncertainty.encoder_scale, uncertainty.misalignment" in result.text


def test_a_declared_certificate_lacks_nothing(tmp_path):
    _, result = certificate(filled(tmp_path))
    assert result.missing == ()
    assert "MISSING" not in result.text
    for text in ("2026-0042", "2026-11-20", "Braunschweig", "A. Metrologist", "Customer Ltd", "that PTB calibrated"):
        assert text in result.text
    require_order(result.text)
    pieces = ET.fromstring(result.text).findall(f".//{DCC}measuringEquipment")
    assert [piece.findtext(f"{DCC}name/{DCC}content") for piece in pieces] == ["Linear encoder", "Air-bearing stage"]
    marks = pieces[0].findall(f".//{DCC}identification")
    assert [[child.text for child in mark][:2] for mark in marks] == [
        ["manufacturer", "73"],
        ["other", "PTB 5.12-4099"],
    ]
    assert pieces[1].find(f"{DCC}identifications") is None
    assert "DRAFT: not signed, not accredited" in result.text


@pytest.mark.parametrize(
    ("was", "now", "message"),
    [
        ('country = "DE"', 'country = "Germany"', "certificate.country: found 'Germany', expected two capital letters"),
        (
            "begin = 2026-11-20",
            'begin = "20.11.2026"',
            "certificate.begin: found '20.11.2026', expected a date",
        ),
        ("begin = 2026-11-20", "begin = 2026-11-20T10:00:00", "certificate.begin"),
        ("[customer]", "[custommer]", 'custommer.name: unknown key; did you mean "customer.name"?'),
        ('place = "laboratory"', 'place = "home"', "one of laboratory, customer"),
        ("[certificate]", "[certificate", "not valid TOML"),
        ("[certificate]", "name = 1\n[certificate]", "expected a table"),
        ('name = "Linear encoder"\n', "", "equipment: found no name"),
        ('serial = "73"', "serial = 73", "equipment.serial: found 73, expected a text"),
    ],
)
def test_a_mistake_in_the_laboratory_s_file_is_named(tmp_path, was, now, message):
    with pytest.raises(LaboratoryError) as caught:
        filled(tmp_path, LAB.replace(was, now))
    assert message in str(caught.value)
    assert "lab.toml" in str(caught.value)


def test_hostile_names_stay_text():
    hostile = Sensor(model="<a>&--\x01]]>", serial="--><b/>\n2", scale=0.02, scale_unit="V")
    root = ET.fromstring(certificate(sensor=hostile)[1].text)
    assert root.findtext(f".//{DCC}item/{DCC}model") == "<a>&--?]]>"
    assert root.findtext(f".//{DCC}identification/{DCC}value") == "--><b/> 2"


def test_every_unit_of_the_sensor_s_static_effects_has_a_si_notation():
    calibration, _ = certificate()
    assert {quantity.unit for quantity in quantities(calibration)} <= set(UNITS)
    static = {"bias", "scale_factor", "scale_asymmetry", "quadratic", "odd_quadratic", "cubic"}
    assert {e.unit for e in BUILT_IN if e.name in static or e.name in ("temperature_bias", "temperature_scale")} <= set(
        UNITS
    )


def test_counts_are_certified_too():
    calibration, result = certificate(sensor=Sensor(scale=104.4, scale_unit="count", zero=2048.0))
    assert "sensitivity" in [quantity.name for quantity in quantities(calibration)]
    assert r"\metre\tothe{-1}\second\tothe{2}" in result.text


@pytest.mark.parametrize("declared", [True, False])
def test_it_follows_the_schema_of_the_dcc(tmp_path, declared):
    path = schema()
    laboratory = filled(tmp_path) if declared else Laboratory()
    for sensor in (VOLTS, Sensor(), Sensor(scale=104.4, scale_unit="count", zero=2048.0)):
        require_valid(certificate(laboratory, sensor=sensor)[1].text, path)


def test_the_schema_notices_a_wrong_certificate():
    path = schema()
    text = certificate()[1].text
    for was, now in (
        ("Factor>2<", "Factor>0.5<"),
        ("<dcc:release>0", "<dcc:relase>0"),
        (">ZZ<", ">zz<"),
        ("si:value", "si:valeu"),
    ):
        with pytest.raises((SchemaError, ET.ParseError)):
            require_valid(text.replace(was, now), path)


TINY = """<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/dcc">
<xs:import namespace="https://ptb.de/si" schemaLocation="https://ptb.de/si/v2.1.0/SI_Format.xsd"/>
<xs:element name="digitalCalibrationCertificate"><xs:complexType><xs:sequence>
<xs:any namespace="##any" processContents="skip" maxOccurs="{most}"/></xs:sequence>
<xs:anyAttribute processContents="skip"/></xs:complexType></xs:element></xs:schema>
"""


def test_a_schema_is_read_from_its_folder_alone(tmp_path):
    pytest.importorskip("xmlschema")
    text = certificate()[1].text
    path = tmp_path / "dcc.xsd"
    with pytest.raises(SchemaError, match="there is no such file"):
        require_valid(text, path)
    path.write_text("<not a schema")
    with pytest.raises(SchemaError, match="cannot be used as a schema"):
        require_valid(text, path)
    path.write_text(TINY.format(most=2))
    (tmp_path / "SI_Format.xsd").write_text(
        '<xs:schema xmlns:xs="http://www.w3.org/2001/XMLSchema" targetNamespace="https://ptb.de/si"/>'
    )
    require_valid(text, path)
    path.write_text(TINY.format(most=1))
    with pytest.raises(SchemaError, match=r"does not follow .*dcc\.xsd"):
        require_valid(text, path)


def test_a_tumble_is_certified_as_one():
    """Its reference is gravity: no encoder is in the method, and none has to be declared."""
    rng, angle = np.random.default_rng(3), np.radians(np.arange(0.0, 360.0, 15.0))
    a = 9.81 * np.sin(angle)
    mean = 0.05 + 1.002 * a + 1e-4 * a**2 + 2e-5 * rng.standard_normal(len(angle))
    count = np.ones(len(angle))
    dwells = ac.Dwells(
        angle=angle,
        mean=mean,
        std=2e-3 * count,
        duration=60.0 * count,
        samples=6000.0 * count,
        group=("1",) * len(angle),
        rig=ac.Rig(uncertainty=Uncertainty(misalignment=1e-4)),
        gravity=9.81,
    )
    fit = ac.fit(dwells, ac.Model.linear().add("quadratic"))
    lines = budget(fit).lines
    assert [line.estimate.name for line in lines] == ["bias", "scale_factor", "quadratic"]
    for line in lines:
        assert line.combined == pytest.approx(line.estimate.std, rel=1e-3)
    text = draft(calibrate(fit), Laboratory()).text
    assert "Tumble test" in text
    assert "encoder" not in text
