"""Binary containers, each written by its own library."""

import numpy as np
import pyarrow as pa
import pytest
from pyarrow import parquet

from accelcal import io
from accelcal.data.recording import Channel, Recording, RecordingError
from accelcal.data.rig import Rig
from tests.io.installed import leave_numpy_alone

N = 40
T = np.arange(N) / 100
ACCEL = np.sin(T)
POSITION = np.cos(T)
SIDECAR = """
[channels]
time = { column = "TIME", unit = "s" }
accel = { column = "ACCEL", unit = "g" }
position = { column = "POSITION", unit = "mm", time = { column = "PTIME", unit = "ms" } }
"""


def sidecar(path, prefix=""):
    text = SIDECAR
    for name in ("TIME", "ACCEL", "POSITION", "PTIME"):
        text = text.replace(f'"{name}"', f'"{prefix}{name.lower()}"')
    path.with_suffix(".toml").write_text(text)


def check(recording):
    np.testing.assert_allclose(recording.accel.y, 9.80665 * ACCEL, rtol=1e-15)
    np.testing.assert_allclose(recording.position.t, T[::2], rtol=1e-15)
    np.testing.assert_allclose(recording.position.y, 1e-3 * POSITION[::2], rtol=1e-15)


VECTORS = {"time": T, "accel": ACCEL, "ptime": 1e3 * T[::2], "position": POSITION[::2]}


def test_npz_with_vectors_of_different_lengths(tmp_path):
    path = tmp_path / "run.npz"
    np.savez(path, **VECTORS, note="text is passed over", table=np.eye(3), spectrogram=np.ones((200, 1000)))
    sidecar(path)
    check(io.load(path))
    assert "spectrogram" not in io.template(path)


MATRIX = np.column_stack([T, ACCEL, np.where(np.arange(N) % 2, np.nan, POSITION)])
RECORDS = np.rec.fromarrays(MATRIX.T, names="t_s,accel_g,position_mm")


def _saved_mat(path, **content):
    from scipy.io import savemat

    savemat(path, content)


def _saved_h5(path, **content):
    with pytest.importorskip("h5py").File(path, "w") as file:
        for name, values in content.items():
            file[name] = values


@pytest.mark.parametrize(
    ("name", "write", "column"),
    [
        ("run.npz", lambda path: np.savez(path, daq=MATRIX), "daq[{0}]"),
        ("run.npz", lambda path: np.savez(path, daq=MATRIX.T[None]), "daq[{0}]"),
        ("run.npy", lambda path: np.save(path, MATRIX), "column[{0}]"),
        ("run.h5", lambda path: _saved_h5(path, daq=MATRIX), "daq[{0}]"),
        ("run.mat", lambda path: _saved_mat(path, daq=MATRIX), "daq({1})"),
        ("run.mat", lambda path: _saved_mat(path, run={"daq": MATRIX}), "run.daq({1})"),
    ],
)
def test_columns_of_a_matrix_are_columns(tmp_path, name, write, column):
    path = tmp_path / name
    write(path)
    keys = zip(("time", "accel", "position"), ("s", "g", "mm"), strict=True)
    rows = [
        f'{key} = {{ column = "{column.format(k, k + 1)}", unit = "{unit}" }}' for k, (key, unit) in enumerate(keys)
    ]
    path.with_suffix(".toml").write_text("\n".join(["[channels]", *rows]))
    check(io.load(path))


@pytest.mark.parametrize(
    ("name", "write"),
    [
        ("run.npy", lambda path: np.save(path, RECORDS)),
        ("run.h5", lambda path: _saved_h5(path, table=RECORDS)),
        ("run.npz", lambda path: np.savez(path, table=RECORDS)),
    ],
)
def test_fields_of_records_are_columns(tmp_path, name, write):
    path = tmp_path / name
    write(path)
    if name == "run.npy":
        check(io.load(path))
    else:
        with pytest.raises(RecordingError, match=r"columns are: table\.t_s, table\.accel_g, table\.position_mm"):
            io.load(path)


@pytest.mark.parametrize("version", ["4", "5"])
def test_mat_vectors_are_found(tmp_path, version):
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    savemat(path, VECTORS, format=version)
    sidecar(path)
    check(io.load(path))


def test_mat_vectors_are_found_inside_structs(tmp_path):
    from scipy.io import savemat

    path = tmp_path / "run.mat"
    cells = np.empty(2, dtype=object)
    cells[:] = [{"Data": [2.0 * a for a in ACCEL]}, "text"]
    savemat(path, {"run": {"x": VECTORS}, "Y": cells})
    sidecar(path, "run.x.")
    check(io.load(path))
    assert '"Y.1.Data"' in io.template(path)


def test_hdf5_takes_units_from_attributes(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.h5"
    with h5py.File(path, "w") as file:
        for name, values, unit in (("t", T, "s"), ("accel", ACCEL, "g"), ("position", POSITION, "mm")):
            file.create_dataset(name, data=values[:, None]).attrs["unit"] = unit
        file["position"].attrs["unit"] = np.bytes_("mm")
        file.create_dataset("label", data="text")
    recording = io.load(path)
    np.testing.assert_allclose(recording.position.y, 1e-3 * POSITION, rtol=1e-15)


def test_mat_7_3_is_read_as_hdf5(tmp_path):
    h5py = pytest.importorskip("h5py")
    path = tmp_path / "run.mat"
    with h5py.File(path, "w", userblock_size=512) as file:
        for name, values in VECTORS.items():
            file.create_dataset(f"run/{name}", data=values[None, :])
    with path.open("r+b") as file:
        file.write(b"MATLAB 7.3 MAT-file, Platform: GLNXA64")
    sidecar(path, "run/")
    check(io.load(path))


def test_missing_h5py_is_named_with_the_cure(tmp_path, monkeypatch):
    path = tmp_path / "run.h5"
    path.write_bytes(b"\x89HDF\r\n\x1a\n" + bytes(100))
    leave_numpy_alone(tmp_path / "alone", monkeypatch)
    with pytest.raises(RecordingError, match=r"needs h5py; install it with: pip install 'accelcal\[hdf5\]'"):
        io.load(path)


def write_parquet(path, columns, units=None):
    fields = [
        pa.field(name, values.type, metadata={"unit": units[name]} if units and name in units else None)
        for name, values in columns.items()
    ]
    parquet.write_table(pa.table(columns, schema=pa.schema(fields)), path)


def test_parquet_takes_units_from_column_metadata_and_null_as_not_sampled(tmp_path):
    path = tmp_path / "run.parquet"
    missing = np.arange(N) % 2 == 1
    columns = {"t": pa.array(T), "accel": pa.array(ACCEL), "position": pa.array(POSITION, mask=missing)}
    write_parquet(path, columns, {"t": "s", "accel": "g", "position": "mm"})
    check(io.load(path))


@pytest.mark.parametrize("kind", [pa.timestamp("us", tz="UTC"), pa.duration("us")], ids=str)
def test_parquet_stamps_durations_and_integers_are_numbers(tmp_path, kind):
    path = tmp_path / "run.parquet"
    stamps = pa.array(np.arange(N) * 10_000).cast(kind)
    columns = {
        "time": stamps,
        "accel_mg": pa.array(np.arange(N) ** 2 % 7, type=pa.int16()),
        "position_um": pa.array(np.arange(N), type=pa.int32()),
        "position_t": stamps,
    }
    write_parquet(path, columns)
    recording = io.load(path)
    np.testing.assert_allclose(recording.accel.t, T, rtol=1e-15)
    np.testing.assert_allclose(recording.position.t, T, rtol=1e-15)
    np.testing.assert_allclose(recording.position.y, 1e-6 * np.arange(N), rtol=1e-15)


def test_the_nameless_index_of_a_frame_holds_the_stamps_where_it_has_dates(tmp_path):
    pandas = pytest.importorskip("pandas")
    t = np.arange(3000) / 500.0
    columns = {"accel_m_per_s2": np.sin(6.0 * t), "position_m": -np.sin(6.0 * t) / 36.0}
    dates = pandas.Timestamp("2026-01-01") + pandas.to_timedelta(t, unit="s")
    pandas.DataFrame(columns, index=dates).to_parquet(tmp_path / "dates.parquet")
    np.testing.assert_allclose(io.load(tmp_path / "dates.parquet").accel.t, t, atol=1e-9)
    pandas.DataFrame({"t_s": t, **columns}, index=dates[::-1]).to_parquet(tmp_path / "both.parquet")
    np.testing.assert_array_equal(io.load(tmp_path / "both.parquet").accel.t, t)  # a column for time comes first
    pandas.DataFrame(columns, index=2 * np.arange(3000)).to_parquet(tmp_path / "rows.parquet")
    with pytest.raises(RecordingError, match="no column for time"):
        io.load(tmp_path / "rows.parquet")


def test_text_column_in_parquet_is_refused_by_name(tmp_path):
    path = tmp_path / "run.parquet"
    write_parquet(path, {"t_s": pa.array(T), "accel_g": pa.array(["1"] * N), "position_m": pa.array(POSITION)})
    with pytest.raises(RecordingError, match='column "accel_g" holds string, expected numbers'):
        io.load(path)


def test_nan_in_parquet_is_not_a_missing_sample(tmp_path):
    path = tmp_path / "run.parquet"
    write_parquet(
        path, {"t_s": pa.array(T), "accel_g": pa.array(np.where(T == 0.1, np.nan, ACCEL)), "pos_m": pa.array(T)}
    )
    with pytest.raises(RecordingError, match=r"accel: 1 sample is not finite \(first at t = 0.1 s, sample 11\)"):
        io.load(path)


@pytest.mark.parametrize("remaining", [4, 50, 0.5, 0.99])
def test_truncated_parquet_is_said(tmp_path, remaining):
    path = tmp_path / "run.parquet"
    write_parquet(path, {"t_s": pa.array(T), "accel_g": pa.array(ACCEL), "position_m": pa.array(POSITION)})
    whole = path.read_bytes()
    path.write_bytes(whole[: int(remaining * len(whole)) if isinstance(remaining, float) else remaining])
    with pytest.raises(RecordingError, match=r"this Parquet file is truncated or damaged .* copy or export it again"):
        io.load(path)


def test_damaged_page_of_parquet_is_said(tmp_path):
    path = tmp_path / "run.parquet"
    write_parquet(path, {"t_s": pa.array(T), "accel_g": pa.array(ACCEL), "position_m": pa.array(POSITION)})
    whole = bytearray(path.read_bytes())
    whole[4:300] = b"\xff" * 296
    path.write_bytes(whole)
    with pytest.raises(RecordingError, match="truncated or damaged"):
        io.load(path)


@pytest.mark.parametrize(
    ("name", "head"),
    [
        ("run.npz", b"PK\x03\x04"),
        ("run.mat", b"MATLAB 5.0 MAT-file"),
        ("run.mat", b"oops"),
        ("run.h5", b"\x89HDF\r\n\x1a\n"),
    ],
)
def test_damaged_container_is_said(tmp_path, name, head):
    path = tmp_path / name
    path.write_bytes(head + b"\x07" * 300)
    with pytest.raises(RecordingError, match="truncated or damaged"):
        io.load(path)


@pytest.mark.parametrize("suffix", ["parquet", "npz", "mat", "h5"])
def test_flipped_bits_end_in_a_recording_error_or_not_at_all(tmp_path, suffix):
    h5py = pytest.importorskip("h5py")
    from scipy.io import savemat

    vectors = {"t_s": T, "accel_g": ACCEL, "position_m": POSITION}
    path = tmp_path / f"run.{suffix}"
    if suffix == "parquet":
        write_parquet(path, {name: pa.array(values) for name, values in vectors.items()})
    elif suffix == "npz":
        np.savez(path, **vectors)
    elif suffix == "mat":
        savemat(path, vectors, do_compression=True)
    else:
        with h5py.File(path, "w") as file:
            for name, values in vectors.items():
                file[name] = values
    whole = path.read_bytes()
    rng = np.random.default_rng(0)
    refused = 0
    for _ in range(8):  # thousands are tried by tests/hostile/test_readers.py
        damaged = bytearray(whole)
        for place in rng.integers(8, len(whole), 5):
            damaged[place] = int(rng.integers(256))
        path.write_bytes(damaged)
        try:
            io.load(path)
        except RecordingError:
            refused += 1
    assert refused > 1


def test_flipped_bit_in_our_own_parquet_is_noticed(tmp_path):
    path = tmp_path / "run.parquet"
    run = Recording(Channel("accel", T, ACCEL, "m/s^2"), Channel("position", T, POSITION, "m"), Rig())
    io.write_parquet(run, path)
    damaged = bytearray(path.read_bytes())
    damaged[150] ^= 1
    path.write_bytes(damaged)
    with pytest.raises(RecordingError, match="truncated or damaged"):
        io.load(path)


def test_container_without_vectors_is_said(tmp_path):
    path = tmp_path / "run.npz"
    np.savez(path, table=np.eye(3))
    with pytest.raises(RecordingError, match="holds no vector of numbers"):
        io.load(path)


def test_vectors_of_different_length_need_their_own_clock(tmp_path):
    path = tmp_path / "run.npz"
    np.savez(path, t_s=T, accel_g=ACCEL, position_m=POSITION[::2])
    with pytest.raises(RecordingError, match='column "position_m" has 20 values but its time column "t_s" has 40'):
        io.load(path)


def test_nan_in_a_vector_means_not_sampled(tmp_path):
    path = tmp_path / "run.npz"
    position = np.where(np.arange(N) % 2, np.nan, POSITION)
    np.savez(path, t_s=T, accel_g=ACCEL, position_mm=position)
    check(io.load(path))


@pytest.mark.parametrize(
    ("name", "content", "message"),
    [
        ("run.csv", b"PAR1" + bytes(50), "the name ends in .csv but the content is Parquet; rename the file"),
        ("run.parquet", b"t_s,accel_g\n0,1\n", 'the name ends in .parquet but the file begins with "t_s,"'),
        ("run.h5", b"\x00\x01\x02\x03", "the name ends in .h5 but the file begins with"),
        ("run.csv", b"", "the file is empty"),
    ],
)
def test_name_and_content_must_agree(tmp_path, name, content, message):
    path = tmp_path / name
    path.write_bytes(content)
    with pytest.raises(RecordingError, match=message):
        io.load(path)


def test_unknown_suffix_is_judged_by_content(tmp_path):
    path = tmp_path / "run.log"
    write_parquet(path, {"t_s": pa.array(T), "accel_g": pa.array(ACCEL), "position_m": pa.array(POSITION)})
    assert len(io.load(path).accel) == N
