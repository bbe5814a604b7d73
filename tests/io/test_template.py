"""A first sidecar asks for nothing that the file says, and what it asks for is refused until it is given."""

import re

import pytest

from accelcal import io
from accelcal.data import PLACE
from accelcal.data.recording import RecordingError
from accelcal.io.dwells import load_declared

SCALE_LINE = 'scale = "?"                     # FILL IN, like "0.25 V/g" or "1024 count/g"'
ROWS = "0.0,1,0,20\n0.1,2,1,21\n0.2,1,3,21\n"


def write(tmp_path, header, rows=ROWS):
    path = tmp_path / "run.csv"
    path.write_text(f"{header}\n{rows}")
    return path


def test_file_that_says_everything_needs_nothing_filled_in(tmp_path):
    path = write(tmp_path, "t_ms,accel_g,position_mm,temp_degC")
    before = io.load(path)
    text = io.init(path)
    assert "FILL IN;" not in text.split("[sensor]")[1]
    assert io.sidecar_of(path).read_text() == text
    assert "3 rows from 0 s to 0.0002 s, median step 0.0001 s (10000 Hz)" in text
    after = io.load(path)
    assert after.accel.y.tolist() == before.accel.y.tolist()
    assert list(after.side) == ["temperature"]


def test_units_that_cannot_be_read_are_left_for_the_user(tmp_path):
    path = write(tmp_path, "t,accel,position,state")
    text = io.init(path)
    assert (
        'time = { column = "t", unit = "?" }  # FILL IN the unit: s, ms, us; 3 rows from 0 to 0.2, median step 0.1'
        in text
    )
    assert 'accel = { column = "accel", unit = "?" }  # FILL IN the unit: m/s^2, g, mg, V, count' in text
    assert '# state = { column = "state", unit = "?" }' in text
    with pytest.raises(
        RecordingError, match=r"run\.toml, line \d+: channels\.time\.unit: still to be filled in; .*unit = \"s\""
    ):
        io.load(path)
    filled = text.replace('"t", unit = "?"', '"t", unit = "s"').replace('"accel", unit = "?"', '"accel", unit = "g"')
    io.sidecar_of(path).write_text(filled.replace('"position", unit = "?"', '"position", unit = "mm"'))
    assert len(io.load(path).accel) == 3


def test_columns_that_cannot_be_recognised_are_left_for_the_user(tmp_path):
    path = write(tmp_path, "x1,x2,x3,x4")
    text = io.init(path)
    assert (
        'time = { column = "?", unit = "?" }  # FILL IN: one of the columns below, or in its place: rate = "1667 Hz"'
        in text
    )
    assert '# x1 = { column = "x1", unit = "?" }' in text
    with pytest.raises(
        RecordingError, match=r"channels\.accel\.column: still to be filled in; expected the name of a column"
    ):
        io.load(path)


def test_electrical_channel_asks_for_its_scale(tmp_path):
    path = write(tmp_path, "t_s,accel_V,position_mm,temp_degC")
    assert 'scale = "?"                     # FILL IN, like "0.25 V/g"' in io.init(path)
    number = io.sidecar_of(path).read_text().splitlines().index(SCALE_LINE) + 1
    with pytest.raises(
        RecordingError, match=rf"run\.toml, line {number}: sensor\.scale: still .* \"1024 count/g\""
    ) as refused:
        io.load(path)
    assert str(refused.value).endswith(SCALE_LINE)


def test_wrong_value_is_not_called_open(tmp_path):
    path = write(tmp_path, "t_s,accel_V,position_mm,temp_degC")
    io.sidecar_of(path).write_text(io.init(path).replace(SCALE_LINE, 'scale = "0.25"  # like "?"'))
    with pytest.raises(RecordingError, match=r"run\.toml: sensor\.scale: '0\.25' is no electrical scale factor"):
        io.load(path)


@pytest.mark.parametrize("unit", ["Inkr.", "Ink", "Schritte", "Imp", "counts", "Increments"])
def test_counts_of_an_encoder_ask_for_its_resolution(tmp_path, unit):
    path = write(tmp_path, f"t_s,accel_g,position [{unit}],temp_degC")
    with pytest.raises(RecordingError, match=r"resolution of the encoder.*write in") as refused:
        io.load(path)
    assert f'position = {{ column = "position [{unit}]", unit = "{unit}", scale = "200 count/mm" }}' in str(
        refused.value
    )
    text = io.init(path)
    for scale in (f"1000 {unit}/mm", "1 um/count"):
        io.sidecar_of(path).write_text(text.replace('scale = "?"', f'scale = "{scale}"'))
        assert io.load(path).position.y.tolist() == pytest.approx([0.0, 1e-6, 3e-6])


def test_unknown_unit_is_no_count(tmp_path):
    with pytest.raises(RecordingError, match='unknown unit "Skt"'):
        io.load(write(tmp_path, "t_s,accel_g,position [Skt],temp_degC"))


def test_counts_are_the_position_where_another_column_is_an_acceleration(tmp_path):
    text = io.init(write(tmp_path, "t_s,Beschl [m/s^2],Weg [Inkr.],x"))
    assert 'accel = { column = "Beschl [m/s^2]"' in text
    assert 'position = { column = "Weg [Inkr.]"' in text


@pytest.mark.parametrize(("columns", "proposed"), [("enc_counts", True), ("enc_counts,aux_counts", False)])
def test_the_only_column_in_counts_is_the_position_where_none_is_a_length(tmp_path, columns, proposed):
    rows = "".join(f"{0.01 * k:.2f},{k % 7},{k % 9},{k % 5}"[: 8 + 2 * columns.count(",")] + "\n" for k in range(10))
    text = io.init(write(tmp_path, f"t_s,accel_g,{columns}", rows))
    assert ('position = { column = "enc_counts", unit = "counts", scale = "?" }' in text) == proposed
    assert ('\nenc = { column = "enc_counts"' in text) != proposed


@pytest.mark.parametrize(
    ("rows", "note"), [("0.0,1,0,20\n", "# 1 rows"), ("1,1,0,20\n1,1,0,20\n1,1,0,20\n", "step 0 s\n")]
)
def test_clock_without_a_rate_is_described_all_the_same(tmp_path, rows, note):
    assert note in io.template(write(tmp_path, "t_s,accel_g,position_mm,temp_degC", rows))


def test_sidecar_that_exists_is_not_overwritten(tmp_path):
    path = write(tmp_path, "t,accel,position,state")
    io.sidecar_of(path).write_text("# mine")
    with pytest.raises(RecordingError, match="there is a sidecar already; edit it, or remove it first"):
        io.init(path)
    assert io.sidecar_of(path).read_text() == "# mine"


@pytest.mark.parametrize("several", [False, True])
def test_the_only_column_in_degrees_is_the_temperature(tmp_path, several):
    path = tmp_path / "run.csv"
    heads = ["t (s)", "a (m/s^2)", "p (mm)", "Halter (°C)", *(["Tisch (°C)"] if several else [])]
    rows = [f"{0.001 * k:.3f};{k % 7};{k % 5};{23 + k % 3}" + f";{21 + k % 4}" * several for k in range(50)]
    path.write_text("\n".join([";".join(heads), *rows]) + "\n")
    assert ('\ntemperature = { column = "Halter (°C)"' in io.init(path)) != several


@pytest.mark.parametrize("column", ["encoder_deg", "angle_rad", "Theta [deg]", "deg", "angle_count"])
def test_an_angle_takes_the_place_of_a_position_and_asks_for_its_arm(tmp_path, column):
    path = write(tmp_path, f"t_s,accel_g,{column}", "".join(f"{0.1 * k:.1f},1,{0.4 * k:.1f}\n" for k in range(12)))
    text = io.init(path)
    assert f'angle = {{ column = "{column}"' in text
    assert "position = {" not in text
    for key, wanted in (("arm", '"200 mm"'), ("axle", '"vertical"'), ("input_axis", '"radial"')):
        with pytest.raises(RecordingError, match=rf"line \d+: rig.{key}: still to be filled in; "):
            io.load(path)
        text = text.replace(f'\n{key} = "?"', f"\n{key} = {wanted}")
        io.sidecar_of(path).write_text(text)
    if column == "angle_count":
        with pytest.raises(RecordingError, match="scale"):
            io.load(path)
        io.sidecar_of(path).write_text(text.replace('scale = "?"', 'scale = "100 count/rev"'))
    assert io.load(path).rig.arm == 0.2


def test_an_angle_beside_a_length_is_none_of_an_arm(tmp_path):
    text = io.init(write(tmp_path, "t_s,accel_g,encoder_mm,angle_deg"))
    assert 'position = { column = "encoder_mm", unit = "mm" }' in text
    assert '# angle = { column = "angle_deg", unit = "deg" }' in text
    assert "encoder_count" in io.template(write(tmp_path, "t_s,accel_g,encoder_count,state"))
    assert "\narm" not in text


@pytest.mark.parametrize("units", [("", ""), ("_m_per_s2", "_m")])
def test_a_body_that_is_tracked_asks_for_the_sense_of_its_attitude(tmp_path, units):
    header = ["t_s", *(f"accel_{x}{units[0]}" for x in "xyz"), *(f"{x}{units[1]}" for x in ("east", "north", "up"))]
    quaternion = [f"q_{x}" for x in "wxyz"]
    rows = (f"{0.1 * k:.1f},0.1,0.2,9.8,{k % 3},{k % 4},{k % 5},1,0,0,0\n" for k in range(12))
    path = write(tmp_path, ",".join([*header, *quaternion]), "".join(rows))
    with pytest.raises(RecordingError, match="of three outputs map accel_x, accel_y, accel_z, place and attitude"):
        io.load(path)
    text = io.init(path)
    for name, column in zip(("accel_x", "accel_y", "accel_z", *PLACE), header[1:], strict=True):
        assert f'\n{name} = {{ column = "{column}"' in text
    for key, unit in (("accel", "m/s^2"), ("position", "m")):
        text = re.sub(rf'^({key}_.*) unit = "\?" }}.*$', rf'\1 unit = "{unit}" }}', text, flags=re.MULTILINE)
    io.sidecar_of(path).write_text(text)
    with pytest.raises(RecordingError, match=r'channels.attitude.maps: still to be filled in; .* "sensor to ENU" or'):
        io.load(path)
    io.sidecar_of(path).write_text(text.replace('\nmaps = "?"', '\nmaps = "sensor to ENU"'))
    axes = io.load_axes(path)
    assert [axis.accel.y[0] for axis in axes] == [0.1, 0.2, 9.8]


def test_place_and_attitude_alone_are_proposed_for_the_outputs_of_another_file(tmp_path):
    rows = "".join(f"{k / 100},0.1,0.2,{k / 1000},1,0,0,0\n" for k in range(40))
    path = write(tmp_path, "t_s,east_m,north_m,up_m,q_w,q_x,q_y,q_z", rows)
    text = io.init(path)
    assert "\naccel" not in text
    for name, column in zip(PLACE, ("east_m", "north_m", "up_m"), strict=True):
        assert f'\n{name} = {{ column = "{column}"' in text
    io.sidecar_of(path).write_text(text.replace('\nmaps = "?"', '\nmaps = "sensor to ENU"'))
    with pytest.raises(RecordingError, match="give this file as --position beside that of the three outputs"):
        io.load(path)


def test_a_velocity_that_is_alone_stands_in_for_a_position(tmp_path):
    path = write(tmp_path, "Time [s];Speed [mm/s];Out [g]".replace(";", ","), "0.0,1,0\n0.1,2,1\n0.2,1,3\n")
    text = io.init(path)
    assert 'velocity = { column = "Speed [mm/s]", unit = "mm/s" }  # by its unit alone' in text
    assert "position = {" not in text.split("CHANNELS")[0].split("[channels]")[1]
    assert io.load(path).reference is not None


def test_the_file_of_one_of_two_loggers_asks_for_nothing_of_the_other(tmp_path):
    path = write(tmp_path, "t_s,Displacement [mm]", "0.0,1\n0.1,2\n0.2,1\n")
    text = io.init(path)
    assert "FILL IN: one of" not in text
    assert (
        "# accel: no column measures it; where a file of another logger does: accelcal check OUTPUT --position" in text
    )


def test_a_reference_in_volts_is_no_channel_of_another_file(tmp_path):
    """An LVDT or a vibrometer behind a converter was a side channel, and the position was said to be elsewhere."""
    text = io.init(write(tmp_path, "t_s,acc_g,LVDT_V", "0.0,1,0.1\n0.1,2,0.2\n0.2,1,0.4\n"))
    assert '# position = { column = "LVDT_V", unit = "V", scale = "20 V/m", zero = "0 V" }' in text
    assert "velocity" in text
    assert "\nLVDT" not in text


@pytest.mark.parametrize(("mean", "scale"), [("mean [m/s^2]", False), ("Mean [V]", True)])
def test_a_table_of_dwells_gets_a_sidecar_of_dwells(tmp_path, mean, scale):
    rows = "0,0.05,1e-3,60,600\n90,9.85,1e-3,60,600\n180,0.05,1e-3,60,600\n270,-9.75,1e-3,60,600\n"
    path = write(tmp_path, f"attitude_deg,{mean},std,duration_s,samples", rows)
    text = io.init(path)
    assert "[dwell]" in text
    assert "position" not in text
    assert (SCALE_LINE in text) == scale
    io.sidecar_of(path).write_text(text.replace(SCALE_LINE, 'scale = "0.1 V/(m/s^2)"'))
    (dwells,) = load_declared(path)
    assert len(dwells) == 4
