"""The sidecar of the documentation is read in SI; every mistake in one is named with its key."""

import math
import re
from dataclasses import asdict, replace

import pytest

from accelcal import io
from accelcal.data import units
from accelcal.data.recording import RecordingError
from accelcal.data.rig import LowPass, Rig, Sensor, Uncertainty
from accelcal.effects import BUILT_IN, find
from accelcal.io.sidecar import Clock, Source, read_sidecar

G0 = 9.80665
COMPLETE = """
[sensor]
model = "ADXL105"
serial = "12"
noise = "225 ug/sqrt(Hz)"     # one-sided density
range = "5 g"
scale = "0.25 V/g"            # when the channel is in V or counts
zero  = "2.5 V"
[rig]
axis = "level"                # level | up | down
mount = "normal"              # normal | reversed | rolled
gravity_along_axis = "0 m/s^2"
[clock]
offset_tolerance = "0 us"
trusted = "position"
[channels]
time        = { column = "t", unit = "s" }            # or rate = "1667 Hz" when there is no time column
accel       = { column = "accel", unit = "m/s^2", lowpass = { kind = "RC", fc = "159 Hz", tolerance = 0.0 } }
position    = { column = "position", unit = "m", resolution = "1 um" }   # may name its own time = { column, unit }
temperature = { column = "temperature", unit = "degC" }
a_y         = { column = "a_y", unit = "m/s^2" }       # lateral acceleration; any further key is a side channel
[uncertainty]                 # standard uncertainties, for the budget
encoder_scale = 1e-5
level = "0.05 deg"
misalignment = "0.1 deg"
clock_rate = "50 ppm"
[judge]
tolerance = "1 mg"            # effects that contribute less are listed as below tolerance
"""


def read(tmp_path, text):
    path = tmp_path / "run.toml"
    path.write_text(text, encoding="utf-8")
    return read_sidecar(path)


def test_complete_sidecar_is_read_in_si(tmp_path):
    content = read(tmp_path, COMPLETE)
    assert asdict(content.rig.sensor) == {
        **asdict(Sensor(model="ADXL105", serial="12", scale_unit="V", zero=2.5)),
        "noise": pytest.approx(225e-6 * G0, rel=1e-14),
        "range": pytest.approx(5 * G0, rel=1e-14),
        "scale": pytest.approx(0.25 / G0, rel=1e-14),
    }
    assert asdict(content.rig.uncertainty) == {
        "encoder_scale": 1e-5,
        "reference_zero": None,
        "level": pytest.approx(math.radians(0.05)),
        "misalignment": pytest.approx(math.radians(0.1)),
        "clock_rate": pytest.approx(50e-6),
    }
    assert content.rig.tolerance == pytest.approx(1e-3 * G0, rel=1e-14)
    assert replace(content.rig, sensor=Sensor(), uncertainty=Uncertainty(), tolerance=None) == Rig(
        gravity_along_axis=0.0, trusted_clock="position", lowpass=LowPass(159.0, 0.0), resolution=1e-6
    )
    assert content.time == Clock(column="t", unit="s")
    assert content.channels["a_y"] == Source("a_y", "m/s^2")
    assert list(content.channels) == ["accel", "position", "temperature", "a_y"]


def test_every_key_is_optional_and_what_is_missing_is_said(tmp_path):
    rig = read(tmp_path, "").rig
    assert rig == Rig(assumptions=rig.assumptions)
    assert [sentence.split()[0] for sentence in rig.assumptions] == [
        "axis",
        "mount",
        "no",
        "encoder",
        "sensor",
        "offset_tolerance",
    ]


def test_a_low_pass_without_tolerance_is_stated_to_be_exact(tmp_path):
    text = '[channels]\naccel = {{ column = "a", lowpass = {{ kind = "RC", fc = "159 Hz"{} }} }}\n'
    messages = [read(tmp_path, text.format(more)).rig.assumptions for more in ("", ", tolerance = 0.05")]
    assert [any("its corner as exact" in s for s in remarks) for remarks in messages] == [True, False]


@pytest.mark.parametrize("value", ['"0 mg"', '"-1 mg"', '"1 mm"'])
def test_a_tolerance_that_is_no_acceleration_is_refused(tmp_path, value):
    with pytest.raises(RecordingError, match=r"judge.tolerance.*expected"):
        read(tmp_path, f"[judge]\ntolerance = {value}\n")


def test_position_with_its_own_clock(tmp_path):
    content = read(tmp_path, '[channels]\nposition = { column = "p", time = { column = "pt", unit = "ms" } }')
    assert content.channels["position"] == Source("p", None, Clock("pt", "ms"))


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[sensr]", 'sensr: unknown table; did you mean "sensor"?'),
        ("[zzz]", "zzz: unknown table; known keys here: sensor, rig, clock, channels, uncertainty"),
        ("sensor = 3", "sensor: found 3, expected a table"),
        ("channels = 3", "channels: found 3, expected a table"),
        ('[sensor]\nnoize = "1 ug/sqrt(Hz)"', 'sensor.noize: unknown key; did you mean "noise"?'),
        ("[sensor]\nnoise = 225", "sensor.noise: 225 has no unit; expected an acceleration noise density"),
        ('[sensor]\nnoise = "225"', 'sensor.noise: "225" has no unit; expected an acceleration noise density'),
        ('[sensor]\nnoise = "225 ug"', 'sensor.noise: "ug" does not measure an acceleration noise density'),
        ('[sensor]\nrange = "5 parsec"', 'sensor.range: unknown unit "parsec"'),
        ('[sensor]\nrange = "0 g"', "sensor.range: found '0 g', expected an acceleration that is positive"),
        (
            '[sensor]\nscale = "0 V/g"',
            "sensor.scale: '0 V/g' is no electrical scale factor; expected one that is not zero",
        ),
        ('[sensor]\nscale = "0 count/g"', "sensor.scale: '0 count/g' is no electrical scale factor"),
        (
            '[sensor]\nscale = "0.25 V/g"\nzero = "3 count"',
            "sensor.zero: found a value in count, but scale counts in V",
        ),
        ("[sensor]\nmodel = 105", "sensor.model: found 105, expected a text in quotes"),
        ('[rig]\naxis = "sideways"', 'rig.axis: found \'sideways\', expected "level" or "up" or "down"'),
        ("[rig]\nmount = 1", "rig.mount: found 1, expected"),
        ('[clock]\noffset_tolerance = "-1 us"', "expected a time that is not negative"),
        ('[channels]\naccel = "a"', "channels.accel: found 'a', expected a table"),
        ('[channels]\naccel = { unit = "g" }', "channels.accel: column is missing; expected e.g. { column"),
        (
            '[channels]\naccel = { column = "a", units = "g" }',
            'channels.accel.units: unknown key; did you mean "unit"?',
        ),
        ('[channels]\na_y = { column = "a", lowpass = {} }', "channels.a_y.lowpass: unknown key"),
        (
            '[channels]\naccel = { column = "a", unit = "V", scale = "1 V/g" }',
            "channels.accel.scale: unknown key; it stands in [sensor]; known keys here: column, unit",
        ),
        (
            '[channels]\naccel = { column = "a", lowpass = { kind = "FIR" } }',
            "channels.accel.lowpass.kind: found 'FIR'",
        ),
        ('[channels]\naccel = { column = "a", lowpass = { kind = "RC" } }', "a low-pass needs its corner frequency"),
        ('[channels]\naccel = { column = "a", lowpass = { fc = 159 } }', "channels.accel.lowpass.fc: 159 has no unit"),
        ('[channels]\ntime = { unit = "s" }', 'channels.time: expected either column = "..."'),
        ('[channels]\ntime = { column = "t", rate = "1 Hz" }', 'channels.time: expected either column = "..."'),
        ('[channels]\nrate = "1 Hz"\ntime = { column = "t" }', "channels.rate: there is a time as well"),
        ('[channels]\nrate = "0 Hz"', "channels.rate: found '0 Hz', expected a frequency that is positive"),
        ("[uncertainty]\nlevel = 0.05", 'uncertainty.level: 0.05 has no unit; expected an angle such as "0.05 deg"'),
        ("[prior]\ncubic = true", "prior.cubic: found True, expected a positive number with its unit"),
        ('[prior]\ncubic = "0 ug/g^3"', "prior.cubic: found '0 ug/g^3', expected a positive number with its unit"),
        ('[prior]\ncubic = "-1 ug/g^3"', "prior.cubic: found '-1 ug/g^3', expected a positive number with its unit"),
        ('[prior]\ncubic = "1 parsec"', 'prior.cubic: unknown unit "parsec"'),
        ("[prior]\ncubic = [1]", "prior.cubic: found [1], expected a positive number with its unit"),
        ("[rig]\naxis = up", "not valid TOML: Invalid value (at line 2, column 8); correct that line"),
    ],
)
def test_mistake_is_named_with_file_key_and_what_was_expected(tmp_path, text, message):
    with pytest.raises(RecordingError, match=re.escape(str(tmp_path / "run.toml"))) as error:
        read(tmp_path, text)
    assert message in str(error.value)


def test_sizes_of_effects_are_read_as_they_are_written(tmp_path):
    declared = read(tmp_path, '[prior]\ncubic = "100 ug/g^3"\ncross_axis = 1e-3\n')
    assert declared.prior_sizes == {"cubic": "100 ug/g^3", "cross_axis": "0.001"}
    assert units.coefficient("100 ug/g^3", find("cubic").unit) == pytest.approx(1e-4 / G0**2, rel=1e-14)
    assert units.coefficient("1 mg/degC", find("temperature_bias").unit) == pytest.approx(1e-3 * G0, rel=1e-14)


def test_every_effect_takes_its_size_in_the_unit_that_a_mistake_names():
    """But for the one whose coefficients are of two units."""
    refused = {e.name for e in BUILT_IN if not units.is_unit(e.unit)}
    assert refused == {"encoder_nonlinearity"}
    for effect in (e for e in BUILT_IN if e.name not in refused):
        name, size = units.usual_unit(effect.unit)
        assert units.coefficient(f"2 {name}", effect.unit) == pytest.approx(2.0 * size, rel=1e-12)  # pint rounds


def test_sidecar_that_cannot_be_opened_is_named(tmp_path, monkeypatch):
    with pytest.raises(RecordingError, match="there is no such sidecar"):
        read_sidecar(tmp_path / "none.toml")
    with pytest.raises(RecordingError, match="this is a directory"):
        read_sidecar(tmp_path)
    (tmp_path / "latin.toml").write_bytes(b'[sensor]\nmodel = "\xe9"\n')
    with pytest.raises(RecordingError, match="not UTF-8 at byte 18"):
        read_sidecar(tmp_path / "latin.toml")

    def denied(*_, **__):
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.open", denied)
    with pytest.raises(RecordingError, match=r"cannot be read \(Permission denied\)"):
        read_sidecar(tmp_path / "latin.toml")


def test_sidecar_named_by_load_is_the_one_beside_the_file(tmp_path):
    assert io.sidecar_of(tmp_path / "run.csv") == tmp_path / "run.toml"
