"""Arrays of other packages: their masks are kept, they are copied, and an output that never changes is refused."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import accelcal as ac
from accelcal import filters
from accelcal.data.recording import Channel, RecordingError
from tests.commands import accelcal

N = 4000
T = np.arange(N) / 500.0
POSITION = 0.05 * np.sin(6.0 * T)
BAD = np.arange(N) % 8 == 0
"""Readings that were not sampled, whatever stands there."""
UNITS = {"accel": "m/s^2", "position": "m"}
RIG = ac.Rig(ac.Sensor(noise=2e-3, range=50.0), resolution=1e-6)


def output() -> np.ndarray:
    """A sensor without bias; 4 m/s² more where it was not sampled."""
    rng = np.random.default_rng(20261125)
    return -1.8 * np.sin(6.0 * T) + 0.03 * rng.standard_normal(N) + 4.0 * BAD


def recorded(t: object, accel: object, position: object) -> ac.Recording:
    return ac.Recording.from_arrays(t, accel, position, units=UNITS, rig=RIG)  # type: ignore[arg-type]


def with_mask(package: str, values: np.ndarray, bad: np.ndarray) -> object:
    """Values as an array of a package, not sampled where they are bad."""
    if package == "numpy":
        return np.ma.masked_array(values, bad)
    if package == "xarray":
        return pytest.importorskip("xarray").DataArray(values, dims="t").where(~bad)
    if package == "arrow":
        return pytest.importorskip("pyarrow").array(values, mask=bad)
    pandas = pytest.importorskip("pandas")
    if package == "pandas integers":
        return pandas.Series(pandas.arrays.IntegerArray(np.round(1e4 * values).astype(np.int64), bad)) / 10**4
    return pandas.Series(pandas.arrays.FloatingArray(values, bad))


PACKAGES = ["numpy", "pandas", "pandas integers", "xarray", "arrow"]


@pytest.mark.parametrize("package", PACKAGES)
def test_what_a_mask_says_was_not_sampled_is_left_out(package: str) -> None:
    run = recorded(T, with_mask(package, output(), BAD), POSITION)
    assert len(run.accel) == N - np.count_nonzero(BAD)
    assert not np.isin(run.accel.t, T[BAD]).any()
    bias = ac.fit(run)["bias"]
    assert abs(bias.value) < 5.0 * bias.std
    hidden = ac.fit(recorded(T, output(), POSITION))["bias"]
    assert hidden.value > 50.0 * hidden.std  # the sister that must fail: the same numbers without their mask


def test_masks_of_position_stamps_and_columns_of_a_frame_are_kept_too() -> None:
    accel = output() - 4.0 * BAD
    run = recorded(T, accel, np.ma.masked_array(np.where(BAD, 9.0, POSITION), BAD))
    assert not np.isin(run.position.t, T[BAD]).any()
    pandas = pytest.importorskip("pandas")
    columns = {"t_s": T, "accel_m_per_s2": with_mask("pandas", output(), BAD), "position_m": POSITION}
    frame = ac.Recording.from_dataframe(pandas.DataFrame(columns))
    assert not np.isin(frame.accel.t, T[BAD]).any()
    channel = Channel("accel", T, np.ma.masked_array(output(), BAD), "m/s^2")  # type: ignore[arg-type]
    np.testing.assert_array_equal(channel.t, T[~BAD])
    np.testing.assert_array_equal(channel.y, output()[~BAD])


@pytest.mark.parametrize("zone", [None, "Europe/Oslo"])
def test_dates_and_time_deltas_in_a_column_are_stamps_without_a_unit(zone: str | None) -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"accel_m_per_s2": output(), "position_m": POSITION})
    elapsed = pandas.to_timedelta(T, unit="s")
    for stamps in (elapsed, pandas.Timestamp("2026-05-12 14:03:27", tz=zone) + elapsed):
        run = ac.Recording.from_dataframe(frame.assign(timestamp=stamps))
        np.testing.assert_allclose(run.accel.t, T - T[0], atol=2e-9)
        dated = ac.Recording.from_dataframe(frame.set_index(stamps), units={"t": "ms"})  # dates have no other unit
        np.testing.assert_array_equal(dated.accel.t, run.accel.t)


BEGAN = np.datetime64("2026-11-03T23:59:58.001", "us")
LATER = np.timedelta64(3, "ms")
"""When the clock of the position was first read, and how much later that of the output."""


def dated(holder: str, folder: Path, began: np.datetime64 = BEGAN) -> ac.Recording:
    """Output and position, each with dates of its own, in a frame, in arrays or in a file."""
    pandas = pytest.importorskip("pandas")
    elapsed = np.round(1e6 * T).astype("timedelta64[us]")
    stamps = {"accel": began + LATER + elapsed, "position": began + elapsed}
    if holder in ("arrays", "objects"):
        t, position_t = (x.tolist() if holder == "objects" else x for x in (stamps["accel"], stamps["position"]))
        return ac.Recording.from_arrays(t, output(), POSITION, position_t=position_t, units=UNITS)
    columns = {"accel_t": stamps["accel"], "accel_m_per_s2": output()}
    frame = pandas.DataFrame({**columns, "position_t": stamps["position"], "position_m": POSITION})
    if holder == "frame":
        return ac.Recording.from_dataframe(frame)
    path = folder / f"run.{holder.partition(' ')[0]}"
    if holder == "parquet":
        frame.to_parquet(path)
    elif holder == "npz":
        np.savez(path, **{name: frame[name].to_numpy() for name in frame})
    elif holder == "tdms":
        tdms = pytest.importorskip("nptdms")
        with tdms.TdmsWriter(path) as writer:
            writer.write_segment([tdms.ChannelObject("log", name, frame[name].to_numpy()) for name in frame])
    else:
        pattern = "%d.%m.%Y %H:%M:%S.%f" if "of the day" in holder else "%Y-%m-%dT%H:%M:%S.%f"
        frame.to_csv(path, index=False, date_format=pattern)
    return ac.load(path)


@pytest.mark.parametrize("holder", ["arrays", "objects", "frame", "parquet", "csv", "csv of the day", "tdms", "npz"])
def test_dates_of_two_clocks_count_from_the_same_instant(holder: str, tmp_path: Path) -> None:
    run = dated(holder, tmp_path)
    midnight = BEGAN.astype("datetime64[D]")
    zero = 0.0 if "of the day" not in holder else (BEGAN - midnight) / np.timedelta64(1, "s")
    np.testing.assert_allclose(run.position.t, T + zero, atol=1e-5)
    np.testing.assert_allclose(run.accel.t, T + zero + 3e-3, atol=1e-5)


@pytest.mark.parametrize("holder", ["arrays", "objects", "parquet", "csv"])
def test_a_clock_that_was_never_set_has_dates_as_well(holder: str, tmp_path: Path) -> None:
    run = dated(holder, tmp_path, np.datetime64("1970-01-01T00:00:00", "us"))
    np.testing.assert_allclose(run.accel.t - run.position.t, 3e-3, atol=1e-9)


def test_dates_of_one_clock_and_seconds_of_another_are_not_paired() -> None:
    stamps = BEGAN + np.round(1e6 * T).astype("timedelta64[us]")
    with pytest.raises(RecordingError, match=r'stamps of "accel" are dates, those of "position" are not'):
        ac.Recording.from_arrays(stamps, output(), POSITION, position_t=T, units=UNITS)


def test_dates_may_be_missing_in_a_list() -> None:
    stamps = [None if k == 3 else x for k, x in enumerate((BEGAN + np.round(1e6 * T).astype("m8[us]")).tolist())]
    read = np.arange(N) != 3
    run = ac.Recording.from_arrays(
        stamps, np.where(read, output(), np.nan), np.where(read, POSITION, np.nan), units=UNITS
    )
    np.testing.assert_allclose(run.accel.t, T[read], atol=1e-6)
    with pytest.raises(RecordingError):
        ac.Recording.from_arrays(np.array([], dtype=object), [], [], units=UNITS)


@pytest.mark.parametrize("package", ["numpy", "pandas", "xarray", "time deltas"])
def test_arrays_of_dates_are_stamps_as_they_are_in_a_frame(package: str) -> None:
    pandas = pytest.importorskip("pandas")
    elapsed = pandas.to_timedelta(T, unit="s")
    zoned = pandas.Series(pandas.Timestamp("2026-03-29 01:59:55", tz="Europe/Berlin") + elapsed)  # summer time begins
    stamps = zoned.to_numpy("datetime64[ns]")
    arrays = {"numpy": stamps, "pandas": zoned, "time deltas": elapsed}
    if package == "xarray":
        arrays["xarray"] = pytest.importorskip("xarray").DataArray(stamps, dims="time")
    np.testing.assert_allclose(recorded(arrays[package], output(), POSITION).accel.t, T, atol=2e-9)


def test_a_list_with_none_was_not_sampled_there() -> None:
    run = recorded(T.tolist(), [None, *output()[1:]], POSITION.tolist())
    np.testing.assert_array_equal(run.accel.t, T[1:])


def test_what_is_asked_for_is_not_left_out_without_a_word() -> None:
    side = {"temperature": np.full(N, 21.0)}
    with pytest.raises(RecordingError, match=r'temperature has no unit.*units=\{"temperature": "degC"\}'):
        ac.Recording.from_arrays(T, output(), POSITION, units=UNITS, side=side)
    with pytest.raises(RecordingError, match='side has "accel", which is given already'):
        ac.Recording.from_arrays(T, output(), POSITION, units=UNITS, side={"accel": output()})
    with pytest.raises(RecordingError, match='"acceleration"; expected "position" or "velocity"'):
        ac.Recording.from_arrays(T, output(), POSITION, units=UNITS, reference="acceleration")  # type: ignore[arg-type]
    speed = {"accel": "m/s^2", "velocity": "m/s"}
    clock = {"reference": "velocity", "position_t": T[1:]}
    run = ac.Recording.from_arrays(T, output(), POSITION[1:], units=speed, **clock)  # type: ignore[arg-type]
    assert run.reference is not None
    np.testing.assert_array_equal(run.reference.t, T[1:])


def test_a_frame_of_several_levels_or_of_another_package_says_how_to_go_on() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"accel_g": output(), "position_m": POSITION}, index=T)
    with pytest.raises(RecordingError, match=r"2 levels of index, expected one\. .*frame\.xs"):
        ac.Recording.from_dataframe(pandas.concat({"run1": frame}))
    with pytest.raises(RecordingError, match=r"2 levels of columns, expected one\. .*frame\.droplevel"):
        ac.Recording.from_dataframe(pandas.concat({"imu": frame}, axis="columns"))
    with pytest.raises(TypeError, match=r"expected a pandas DataFrame\. Its to_pandas\(\) makes one"):
        ac.Recording.from_dataframe(pytest.importorskip("pyarrow").table({"accel_g": output()}))


def test_an_index_that_counts_rows_is_no_clock() -> None:
    pandas = pytest.importorskip("pandas")
    frame = pandas.DataFrame({"accel_m_per_s2": output(), "position_m": POSITION, "remark": "fine"})
    with pytest.raises(ac.RecordingError, match=r"no column for time.*the index counts rows"):
        ac.Recording.from_dataframe(frame)
    counted = ac.Recording.from_dataframe(frame, units={"t": "ms"})
    assert counted.accel.t[-1] == pytest.approx(1e-3 * (N - 1))
    assert "remark" not in counted.side
    twice = pandas.concat([frame, frame[["position_m"]]], axis=1)
    with pytest.raises(ac.RecordingError, match='two columns are called "position_m"'):
        ac.Recording.from_dataframe(twice, units={"t": "ms"})


def test_text_in_a_frame_is_refused_with_what_makes_numbers_of_it() -> None:
    pandas = pytest.importorskip("pandas")
    accel = [f"{y:.3f}".replace(".", ",") for y in output()]
    frame = pandas.DataFrame({"t_s": T, "accel_g": accel, "position_m": POSITION})
    with pytest.raises(ac.RecordingError, match=r"accel_g is an array of .*read_csv\(\.\.\., decimal="):
        ac.Recording.from_dataframe(frame)


def test_a_batch_of_filters_passes_over_masked_positions() -> None:
    settings = {"dt": 2e-3, "q": 1e-6, "r_position": 1e-12, "x0": np.zeros(4), "P0": np.eye(4)}
    choice = filters.FilterChoice("aci", "linear", "inverse")
    wrong = np.where(BAD, 9.0, POSITION)
    masked = filters.run_batch(choice, output(), np.ma.masked_array(wrong, BAD), **settings)  # type: ignore[arg-type]
    absent = filters.run_batch(choice, output(), np.where(BAD, np.nan, POSITION), **settings)  # type: ignore[arg-type]
    assert masked.states.tobytes() == absent.states.tobytes()


def test_arrays_of_the_caller_are_copied() -> None:
    given = {"t": T.copy(), "accel": output(), "position": POSITION.copy()}
    run = recorded(*given.values())
    channel = Channel("accel", given["t"], given["accel"], "m/s^2")
    replaced = replace(channel, y=given["position"], unit="m")
    before = run.sums, float(channel.y.sum()), float(channel.t.sum()), float(replaced.y.sum())
    for values in given.values():
        values[:] = np.nan
    assert (run.sums, float(channel.y.sum()), float(channel.t.sum()), float(replaced.y.sum())) == before


@pytest.mark.parametrize("accel", [0.0, 1.3])
def test_an_output_that_never_changes_is_refused_in_python_as_in_a_file(accel: float, tmp_path: Path) -> None:
    text = f"all {N} samples of accel read {accel:g} m/s²; expected an output that varies with the motion"
    path, model = tmp_path / "run.csv", ac.fit(recorded(T, output() - 4.0 * BAD, POSITION))
    header = "t_s,accel_m_per_s2,position_m"
    np.savetxt(path, np.c_[T, np.full(N, accel), POSITION], delimiter=",", header=header, comments="")
    for run in (recorded(T, np.full(N, accel), POSITION), ac.load(path)):
        for act in (lambda run=run: ac.fit(run), lambda run=run: ac.diagnose(model, run)):
            with pytest.raises(RecordingError, match=text):
                act()
    done = accelcal("check", path)
    assert done.returncode == 3
    assert text in done.stderr


@pytest.mark.parametrize("size", [5e-324, 1e-300, 1e-8])
def test_an_output_that_hardly_changes_is_no_sensor(size: float) -> None:
    run = ac.Recording.from_arrays(T, size * np.sin(6.0 * T), POSITION, units=UNITS, rig=RIG)
    with pytest.raises(RecordingError, match=r"as good as zero beside the acceleration|expected an output that varies"):
        ac.fit(run)


def test_an_output_in_volts_is_read_by_the_scale_of_its_data_sheet(tmp_path: Path) -> None:
    """Arrays and a file without a sidecar give one output; without the scale the sentence says how it is given."""
    t = np.arange(200) * 0.01
    moved, volts = 1e-3 * np.sin(t), 2.5 + 0.1 * np.sin(3.0 * t)
    scale, unit, _ = ac.data.units.sensitivity("0.1 V/g", "acceleration")
    rig = ac.Rig(sensor=ac.Sensor(scale=scale, scale_unit=unit, zero=2.5))
    columns, units = np.column_stack([t, volts, moved]), {"accel": "V", "position": "m"}
    path = tmp_path / "run.csv"
    np.savetxt(path, columns, delimiter=",", header="t_s,accel_V,position_m", comments="")
    for run in (ac.Recording.from_arrays(t, volts, moved, units=units, rig=rig), ac.load(path, rig=rig)):
        np.testing.assert_allclose(run.accel.y, 9.80665 * np.sin(3.0 * t), atol=1e-9)
    for name, phrase in (
        ("accel", r'Sensor\(scale=.*, scale_unit="count".*of 1024 count/g it is 1024 / 9\.80665'),
        ("position", r"of 200 count/mm the array divided by 200, in mm"),
    ):
        with pytest.raises(RecordingError, match=phrase):
            ac.Recording.from_arrays(t, moved, moved, units={"accel": "m/s^2", "position": "m", name: "count"})


@pytest.mark.parametrize(
    ("accel", "advice"),
    [
        (np.ones((5, 1)), r"A column of it is \[:, 0\]"),
        (map(float, range(5)), r"list\(...\) takes what a generator gives"),
        (np.array(["0,1"] * 5), "pandas makes numbers of text"),
    ],
    ids=["column", "generator", "text"],
)
def test_the_message_on_an_unusable_array_says_what_makes_numbers_of_it(accel, advice):
    with pytest.raises(RecordingError, match=advice):
        ac.Recording.from_arrays(t=np.arange(5), accel=accel, position=np.arange(5), units={"accel": "g"})
