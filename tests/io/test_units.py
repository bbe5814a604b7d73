"""Units against the conversion factors of the SI brochure and hand arithmetic."""

import math
import subprocess
import sys

import pytest
from hypothesis import given, strategies as st

from accelcal.data import units
from accelcal.data.units import UnitError, conversion, quantity, same_unit, sensitivity

G0 = 9.80665


@pytest.mark.parametrize(
    ("text", "kind", "si"),
    [
        ("5 g", "acceleration", 5 * G0),
        ("16g", "acceleration", 16 * G0),
        ("250 mg", "acceleration", 0.25 * G0),
        ("980 Gal", "acceleration", 9.8),
        ("1 mm/s**2", "acceleration", 1e-3),
        ("3 m/s²", "acceleration", 3.0),
        ("3 m/s2", "acceleration", 3.0),
        ("3 m s-2", "acceleration", 3.0),  # as xarray has it, by the CF conventions
        ("3 mm s-1", "speed", 3e-3),
        ("3 m·s⁻²", "acceleration", 3.0),
        ("-0.5 m/s^2", "acceleration", -0.5),
        ("250 ug/sqrt(Hz)", "noise density", 250e-6 * G0),
        ("250 µg/√Hz", "noise density", 250e-6 * G0),
        ("250 μg/rtHz", "noise density", 250e-6 * G0),
        ("250 ug/Hz^0.5", "noise density", 250e-6 * G0),
        ("4 mm/s^2/sqrt(Hz)", "noise density", 4e-3),
        ("2.5 V", "voltage", 2.5),
        ("1 um", "length", 1e-6),
        ("1 µm", "length", 1e-6),
        ("1 μm", "length", 1e-6),
        ("1 in", "length", 0.0254),
        ("159 Hz", "frequency", 159.0),
        ("1.667 kHz", "frequency", 1667.0),
        ("0 us", "time", 0.0),
        ("2 h", "time", 7200.0),
        ("0.05 deg", "angle", math.radians(0.05)),
        ("0.05 °", "angle", math.radians(0.05)),
        ("1e-5", "ratio", 1e-5),
        (1e-5, "ratio", 1e-5),
        ("10 ppm", "ratio", 1e-5),
        ("1 %", "ratio", 0.01),
        ("20 °C", "temperature", 20.0),
        ("50 degF", "temperature", 10.0),
        ("-40 degF", "temperature", -40.0),
        ("300 K", "temperature", 26.85),
        ("101.3 kPa", "pressure", 101300.0),
        ("10 dps", "angular rate", math.radians(10)),
    ],
)
def test_quantity_is_read_as_data_sheets_print_it(text, kind, si):
    assert quantity(text, kind) == pytest.approx(si, rel=1e-14, abs=1e-13)  # a few roundings of a double


@pytest.mark.parametrize(
    ("text", "kind", "value", "electrical"),
    [
        ("0.25 V/g", "acceleration", 0.25 / G0, "V"),
        ("100 mV/(m/s^2)", "acceleration", 0.1, "V"),
        ("1024 count/g", "acceleration", 1024 / G0, "count"),
        ("1024 LSB/g", "acceleration", 1024 / G0, "count"),
        ("20 V/m", "length", 20.0, "V"),
        ("50 mm/V", "length", 20.0, "V"),
        ("200 count/mm", "length", 2e5, "count"),
        ("4 um/count", "length", 2.5e5, "count"),
        ("20 V/(m/s)", "speed", 20.0, "V"),
        ("-28.8 V/(m/s)", "speed", -28.8, "V"),
        ("10 mV/degC", "temperature", 0.01, "V"),
        ("5 V/MPa", None, 5e-6, "V"),
    ],
)
def test_an_electrical_scale_is_read_either_way_up(text, kind, value, electrical):
    assert sensitivity(text, kind)[:2] == (pytest.approx(value, rel=1e-14), electrical)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        ("0 V/g", "acceleration", 'expected one that is not zero such as "0.25 V/g"'),
        ("20 V", "length", 'no electrical scale factor; expected one that is not zero such as "20 V/m"'),
        ("20 V/s", "length", '"s" does not measure a length'),
        ("?", None, "no electrical scale factor"),
        (20.0, "length", "20.0 is no electrical scale factor"),
        ("1e999 V/m", "length", "no electrical scale factor"),
        ("0 mm/V", "length", "no electrical scale factor"),
    ],
)
def test_what_is_no_electrical_scale_is_refused(text, kind, message):
    with pytest.raises(UnitError) as error:
        sensitivity(text, kind)
    assert message in str(error.value)


@pytest.mark.parametrize(
    ("text", "kind", "message"),
    [
        (5, "acceleration", '5 has no unit; expected an acceleration such as "5 g"'),
        ("5", "acceleration", '"5" has no unit; expected an acceleration such as "5 g"'),
        ("5 m/", "length", 'unknown unit "m/"'),
        ("fast", "acceleration", "'fast' is not a quantity; expected an acceleration"),
        (None, "length", "None is not a quantity; expected a length"),
        (True, "ratio", "True is not a quantity"),
        ("nan g", "acceleration", "not a quantity"),
        ("1e999 g", "acceleration", "not finite"),
        ("5 kg", "acceleration", '"kg" does not measure an acceleration; expected a unit as in "5 g"'),
        ("5 g**", "acceleration", 'unknown unit "g**" (nearest known: "g")'),
        ("5 furlong", "length", 'unknown unit "furlong"'),
        ("20 C", "temperature", 'unknown unit "C"'),
        ("10 rad/s", "frequency", '"rad/s" does not measure a frequency'),
        ("225 ug/Hz", "noise density", '"ug/Hz" does not measure an acceleration noise density'),
        ("1 degC", "length", '"degC" does not measure a length'),
        ("1 " + "m*" * 400 + "m", "length", "unknown unit"),
        ("1 __import__('os')", "length", "unknown unit"),
    ],
)
def test_error_says_what_was_expected(text, kind, message):
    with pytest.raises(UnitError) as error:
        quantity(text, kind)
    assert message in str(error.value)


def test_g_is_gravity_and_kilogram_stays_a_mass():
    assert conversion("g").si == "m/s^2"
    assert conversion("kg").si == "kg"


def test_side_channel_of_any_dimension_converts_to_si_base_units():
    assert conversion("hPa") == units.Conversion(100.0, 0.0, "Pa")
    assert conversion("mT").si == "kg/A/s^2"
    assert conversion(conversion("mT").si).factor == 1.0


@pytest.mark.parametrize(
    ("a", "b", "same"), [("m/s²", "m_per_s2", True), ("g", "m/s^2", False), ("m", "furlong", False)]
)
def test_same_unit_compares_meaning_and_not_spelling(a, b, same):
    assert same_unit(a, b) is same


@given(
    st.floats(-1e6, 1e6).filter(lambda x: x == 0.0 or abs(x) > 1e-90),
    st.sampled_from(["um", "mm", "cm", "m", "inch", "ft"]),
)
def test_quantity_equals_number_times_conversion(number, unit):
    assert quantity(f"{number!r} {unit}", "length") == number * conversion(unit, "length").factor


@given(st.text(max_size=80))
def test_any_text_is_either_a_quantity_or_a_unit_error(text):
    try:
        value, message = quantity(text, "acceleration"), ""
    except UnitError as error:
        value, message = 0.0, str(error)
    assert math.isfinite(value)
    assert not message or "expected" in message or "unknown unit" in message


@pytest.mark.parametrize("unit", ["ms⁻²", "ms-2", "ms^-2", "m s^-2"])
def test_acceleration_is_read_as_charts_of_vibration_sensors_print_it(unit):
    assert units.sensitivity(f"10 mV/{unit}" if unit[1] == "s" else f"10 mV/({unit})", "acceleration")[0] == 0.01
    assert units.sensitivity(f"10 mV/({unit})", "acceleration")[0] == 0.01
    assert units.conversion(unit).si == "m/s^2"
    assert units.conversion("1/ms^2").si == "1/s^2"


def test_angles_of_a_dividing_head_are_read():
    for unit, degrees in (("arcsec", 1.0 / 3600.0), ("arcminutes", 1.0 / 60.0), ("degree", 1.0)):
        assert units.conversion(unit).factor == pytest.approx(math.radians(degrees))
    assert units.quantity("0.5 arcsec", "angle") == pytest.approx(math.radians(0.5 / 3600.0))


def test_every_kind_reads_its_own_example():
    for name, kind in units.KINDS.items():
        assert math.isfinite(quantity(kind.example, name))


def test_usual_units_are_converted_as_pint_does(monkeypatch):
    usual = {unit: (conversion(unit), conversion(unit, kind)) for kind, row in units.USUAL.items() for unit in row}
    monkeypatch.setattr(units, "_FACTORS", {})
    for unit, conversions in usual.items():
        assert units.normalise(unit) == unit
        assert set(conversions) == {conversion.__wrapped__(unit)}, unit  # to the bit


def test_pint_is_not_imported_for_si_units_and_usual_ones():
    script = (
        "import sys; from accelcal.data import units; "
        "units.conversion('m/s²'); units.conversion('s'); units.quantity('1e-5', 'ratio'); units.quantity('5 g', "
        "'acceleration'); units.quantity('225 ug/sqrt(Hz)', 'noise density'); print('pint' in sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", script], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "False"
