"""Results as DataFrames and Datasets: the numbers of the result, with units, and back again where there is a way."""

from __future__ import annotations

import sys
from typing import Any

import numpy as np
import pandas as pd
import pytest

import accelcal as ac
from accelcal._support.errors import MissingExtra
from accelcal.estimation.engines import ForwardFilter
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.tracks import track
from accelcal.simulation import CXL02_RIG
from accelcal.validation.comparison import Evaluation

TRUTH = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}


def simulated(seed: int) -> Any:
    rng = np.random.default_rng(seed)
    return ac.simulate("interleaved", seconds=15.0, rig=CXL02_RIG, parameters=TRUTH, rng=rng)


@pytest.fixture(scope="module")
def simulation() -> Any:
    return simulated(1)


@pytest.fixture(scope="module")
def run(simulation: Any) -> ac.Recording:
    return simulation.recording


@pytest.fixture(scope="module")
def fit(run: ac.Recording) -> ac.Fit:
    return ac.fit(run)


@pytest.fixture(scope="module")
def evaluation(fit: ac.Fit) -> Evaluation:
    return ac.compare(fit, simulated(2).recording)[0]


def test_a_recording_goes_through_a_frame_and_is_fitted_alike(run: ac.Recording, fit: ac.Fit) -> None:
    frame = run.to_dataframe()
    assert frame.attrs["units"]["position"] == "m"
    assert int(frame["position"].notna().sum()) == len(run.position)
    again = ac.Recording.from_dataframe(frame, rig=run.rig)
    np.testing.assert_array_equal(again.position.y, run.position.y)
    np.testing.assert_array_equal(again.accel.t, run.accel.t)
    for e in ac.fit(again).estimates:
        assert e.value == fit[e.name].value


@pytest.mark.parametrize("clock", ["numbers", "deltas", "dates", "column"])
def test_time_is_an_index_or_a_column(run: ac.Recording, clock: str) -> None:
    frame = pd.DataFrame({"accel_g": run.accel.y / 9.80665, "position_mm": 1e3 * np.sin(run.accel.t)})
    t = run.accel.t
    if clock == "column":
        frame["t_ms"] = 1e3 * t
    else:
        index = {"numbers": t, "deltas": pd.to_timedelta(t, unit="s"), "dates": pd.Timestamp(2026, 1, 1)}[clock]
        frame.index = pd.Index(index + pd.to_timedelta(t, unit="s") if clock == "dates" else index)
    result = ac.Recording.from_dataframe(frame, rig=run.rig)
    np.testing.assert_allclose(result.accel.t, t, atol=2e-9)
    np.testing.assert_allclose(result.accel.y, run.accel.y, rtol=1e-12)
    np.testing.assert_allclose(result.position.y, np.sin(t), rtol=1e-12)


def test_dates_with_a_time_zone_are_instants(run: ac.Recording) -> None:
    t = run.accel.t
    frame = pd.DataFrame({"accel_g": run.accel.y / 9.80665, "position_mm": 1e3 * np.sin(t)})
    began = pd.Timestamp("2026-03-29 01:59:55", tz="Europe/Berlin")  # the clock jumps an hour 5 s later
    frame.index = pd.Index(began + pd.to_timedelta(t, unit="s"))
    np.testing.assert_allclose(ac.Recording.from_dataframe(frame, rig=run.rig).accel.t, t, atol=2e-9)


@pytest.mark.parametrize("index", [pd.RangeIndex(0), pd.DatetimeIndex([]), pd.DatetimeIndex([], tz="UTC")], ids=str)
def test_a_frame_without_rows_is_refused_in_a_sentence(index: pd.Index) -> None:
    frame = pd.DataFrame({"accel_g": np.empty(0), "position_mm": np.empty(0)}, index=index)
    with pytest.raises(ac.RecordingError, match="no sample"):
        ac.Recording.from_dataframe(frame)


def test_arrays_with_two_clocks_and_side_channels(run: ac.Recording) -> None:
    result = ac.Recording.from_arrays(
        1e3 * run.accel.t,
        run.accel.y,
        run.position.y,
        units={"t": "ms", "accel": "m/s^2", "position": "m", "temperature": "degF"},
        position_t=1e3 * run.position.t,
        side={"temperature": np.where(run.accel.t < 1.0, 212.0, np.nan)},
        rig=run.rig,
    )
    np.testing.assert_allclose(result.position.t, run.position.t, atol=1e-12)
    assert result.side["temperature"].t[-1] < 1.0
    np.testing.assert_allclose(result.side["temperature"].y, 100.0)
    assert result.digest


@pytest.mark.parametrize(
    ("units", "text"),
    [
        ({"accel": "g"}, "position has no unit"),
        ({"accel": "g", "position": "kg"}, "does not measure a length"),
        ({"accel": "V", "position": "mm"}, "no scale is declared"),
        ({"accel": "g", "position": "mm", "acell": "g"}, "acell"),
    ],
)
def test_units_are_never_guessed(units: dict[str, str], text: str) -> None:
    t = np.arange(100.0)
    with pytest.raises(ac.RecordingError, match=text):
        ac.Recording.from_arrays(t, t, t, units=units)


@pytest.mark.parametrize(
    ("t", "accel", "text"),
    [
        (np.arange(99.0), np.arange(100.0), "as many of each"),
        (np.arange(100.0)[::-1], np.arange(100.0), r"backward.*Sort the rows by time\."),
        (np.arange(100.0), np.full(100, np.inf), "finite"),
    ],
)
def test_samples_are_checked_as_those_of_a_file(t: Any, accel: Any, text: str) -> None:
    with pytest.raises(ac.RecordingError, match=text):
        ac.Recording.from_arrays(t, accel, np.arange(100.0), units={"accel": "g", "position": "mm"})


def test_a_fit_as_frames(fit: ac.Fit) -> None:
    frame = fit.to_dataframe()
    for e in fit.estimates:
        row = frame.loc[e.name]
        assert (row["value"], row["std"], row["unit"]) == (e.value, e.std, e.unit)
        assert row["low"] < e.value < row["high"]
    correlations = fit.correlations()
    assert list(correlations.index) == list(correlations.columns) == [e.name for e in fit.free]
    np.testing.assert_allclose(np.diag(correlations), 1.0)
    std = fit.to_xarray()["std"].sel(parameter="bias")
    assert float(std) == fit["bias"].std
    assert fit.to_xarray()["covariance"].shape == fit.covariance.shape


def test_a_comparison_as_frames(evaluation: Evaluation) -> None:
    frame = evaluation.to_dataframe()
    assert frame.loc[10.0, "drift"] == evaluation.coast_rms[10.0]
    data = evaluation.to_xarray()
    np.testing.assert_array_equal(data["one_step"].values, evaluation.residual[1])
    assert data["measured"].attrs["units"] == "m"


def test_a_comparison_of_models_is_a_dataset_with_axes(fit: ac.Fit) -> None:
    several = ac.compare(
        [fit, ac.fit(simulated(3).recording, ac.Model.cubic())], [simulated(4).recording, simulated(5).recording]
    )
    data = several.to_xarray()
    assert [*data["model"].values] == [*several.names]
    assert dict(data.sizes)["recording"] == 2
    for number, name in enumerate(several.names):
        mine = data["simulated"].isel(recording=0).sel(model=name).dropna("t")
        np.testing.assert_array_equal(mine.values, several.evaluations[0][number].simulated[2])
        np.testing.assert_array_equal(mine["t"].values, several.evaluations[0][number].simulated[0])
    errors = several.to_dataframe().query("model != 'noise alone'")  # zero is a bound, which its interval says
    assert (errors["systematic_low"] <= errors["systematic"]).all()
    assert (errors["systematic"] < errors["systematic_high"]).all()


def test_a_diagnosis_as_a_frame(fit: ac.Fit, run: ac.Recording) -> None:
    diagnosis = ac.diagnose(fit, run)
    frame = diagnosis.to_dataframe()
    assert frame.attrs["verdict"] == diagnosis.verdict
    assert "cubic" in frame.index
    assert frame["named"].any()
    assert len(frame) == sum(len(c.estimate) for c in diagnosis.scan.candidates)


def test_filters_tracks_and_motions_have_axes(fit: ac.Fit, run: ac.Recording, simulation: Any) -> None:
    state = solve_runs(ac.Model.linear(), [run]).states[0]
    filtered = ForwardFilter(ac.FilterChoice()).over(fit, state)
    data = filtered.to_xarray()
    np.testing.assert_array_equal(data["state"].sel(state_name="k").values, filtered.states[:, 2])
    np.testing.assert_array_equal(filtered.to_dataframe()["K0"], filtered.states[:, 3])
    course_of = track(fit, run)
    np.testing.assert_array_equal(
        course_of.to_xarray()["value"].sel(parameter="bias").values, course_of.to_dataframe()["bias"]
    )
    exact = simulation.to_xarray()
    np.testing.assert_array_equal(exact["a"].values, simulation.truth.motion.acceleration(run.accel.t))


def test_other_results_as_frames(fit: ac.Fit, run: ac.Recording) -> None:
    comparison = ac.compare([fit, fit], run)
    assert comparison.to_dataframe()["simulation"].iloc[0] == comparison[0].simulated_rms
    power = ac.power(fit, run)
    assert power.to_dataframe().loc["cubic", "smallest"] == power["cubic"].smallest[0]
    coast = ac.verbs.coast(fit, run, 2.0, 5.0)
    np.testing.assert_array_equal(coast.to_dataframe()["floor"], coast.floor)
    np.testing.assert_array_equal(coast.to_xarray()["floor"].values, coast.floor)


@pytest.mark.parametrize("library", ["pandas", "xarray"])
def test_a_missing_library_is_asked_for(fit: ac.Fit, library: str, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, library, None)
    with pytest.raises(MissingExtra, match=rf"pip install \"accelcal\[{library}\]\""):
        fit.to_dataframe() if library == "pandas" else fit.to_xarray()


def test_where_it_fails_is_a_frame_of_the_worst_regions(evaluation: Evaluation) -> None:
    frame = evaluation.to_dataframe("regions")
    assert frame.index.tolist() == [region.variable for region in evaluation.worst_regions]
    first = evaluation.worst_regions[0]
    assert first.stretch is not None
    assert frame.iloc[0][["low", "high", "excess", "p", "start", "end"]].tolist() == [
        *(first.low, first.high, first.excess, first.p),
        *first.stretch,
    ]


def test_figures_are_drawn_by_the_results(fit: ac.Fit, evaluation: Evaluation, run: ac.Recording) -> None:
    for figure in (
        fit.plot(),
        evaluation.plot(),
        evaluation.plot("regions", theme="dark"),
        ac.diagnose(fit, run).plot(),
    ):
        assert figure.axes or figure.subfigs
    with pytest.raises(ValueError, match="expected 'overlay'"):
        evaluation.plot("nonsense")  # type: ignore[arg-type]


def test_nothing_that_draws_is_imported_before_it_draws() -> None:
    import subprocess

    code = "import accelcal as ac, sys; ac.Fit; ac.fit; print({'matplotlib', 'pandas', 'xarray'} & set(sys.modules))"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "set()"
