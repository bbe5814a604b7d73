"""Time series of results as pandas DataFrames, and their arrays as xarray Datasets: SI units, named axes.

Everything that is no time series is a DataFrame by its table.
"""

from __future__ import annotations

from functools import singledispatch
from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal._support.arguments import kind_of
from accelcal._support.errors import optional
from accelcal._support.result import Result
from accelcal._support.values import listing
from accelcal.data import Dwells, Recording
from accelcal.diagnosis.experiment.detectability import Power
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.estimation.estimate import Fit
from accelcal.estimation.tracks import Path, Track
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.io.write import common_rows, common_stamps
from accelcal.results.table import as_frame, pandas_module
from accelcal.simulation.sensor import Simulated
from accelcal.validation.comparison import Coast, Evaluation
from accelcal.validation.differences import Comparison

if TYPE_CHECKING:
    from pandas import DataFrame

Columns = dict[str, tuple[Any, str]]
"""Values and SI unit of each column; the first one is the index."""
IN_FULL = (Fit, Diagnosis, Power)
"""Results whose data frame has every coefficient of every effect."""


def frame(result: Result, which: str = "") -> DataFrame:
    """DataFrame of a result: its time series where it is one, else its table.

    Raises
    ------
    MissingExtra
        If pandas is not installed.
    ValueError
        If there is no table of that name.
    """
    if not which and isinstance(result, Recording | Dwells | Coast | Path | Track | FilterRun):
        columns, name = series(result)
        data = pandas_module().DataFrame({key: values for key, (values, _) in columns.items()})
        data = data.set_index(next(iter(columns)))
        data.attrs = {
            "units": {key: unit for key, (_, unit) in columns.items() if unit},
            **({"name": name} if name else {}),
        }
        return data
    return as_frame(result.table(which or ("coefficients" if isinstance(result, IN_FULL) else "")))


@singledispatch
def series(result: object) -> tuple[Columns, str]:
    """Columns of a time series, and its name."""
    raise TypeError(f"a {type(result).__name__} is no time series")


@series.register
def _(recording: Recording) -> tuple[Columns, str]:
    columns: Columns = {"t": (common_stamps(recording), "s")}
    for channel, values, missing in common_rows(recording):
        columns[channel.name] = (np.where(missing, np.nan, values), channel.unit)
    return columns, recording.name


@series.register
def _(dwells: Dwells) -> tuple[Columns, str]:
    units = {"angle": "rad", "mean": "m/s²", "std": "m/s²", "duration": "s", "samples": "", "group": ""}
    columns: Columns = {
        "dwell": (np.arange(len(dwells)), ""),
        **{key: (getattr(dwells, key), unit) for key, unit in units.items()},
    }
    if dwells.temperature is not None:
        columns["temperature"] = (dwells.temperature, "degC")
    return columns, dwells.name


@series.register
def _(coast: Coast) -> tuple[Columns, str]:
    predicted = {key: (getattr(coast, key), "m") for key in ("frozen", "rezeroed", "floor")}
    return {"t": (coast.t, "s"), **predicted}, ""


@series.register
def _(track: Track) -> tuple[Columns, str]:
    columns: Columns = {"t": (track.t, "s")}
    for k, (name, unit) in enumerate(zip(track.names, track.units, strict=True)):
        columns |= {name: (track.values[:, k], unit), f"{name}_std": (track.std[:, k], unit)}
    return columns, ""


@series.register
def _(path: Path) -> tuple[Columns, str]:
    followers = {follower.mechanism: (follower.value, path.unit) for follower in path.followers}
    return {"t": (path.t, "s"), "value": (path.value, path.unit), "std": (path.std, path.unit)} | followers, ""


@series.register
def _(run: FilterRun) -> tuple[Columns, str]:
    columns: Columns = {"t": (run.times, "s"), "from_position": (run.from_position, "")}
    for k, name in enumerate(run.names):
        unit = STATE_UNITS[name]
        columns |= {name: (run.states[:, k], unit), f"{name}_std": (np.sqrt(run.variances[:, k]), unit)}
    columns["innovation"] = (run.innovations, "")
    columns["innovation_std"] = (np.sqrt(run.innovation_variances), "")
    return columns, ""


def correlations(fit: Fit) -> DataFrame:
    """Correlations of the free parameters, names on both sides."""
    std = np.sqrt(np.diag(fit.covariance))
    names = [fit.label(e) for e in fit.free]
    frame: DataFrame = pandas_module().DataFrame(fit.covariance / np.outer(std, std), index=names, columns=names)
    return frame


def variable(dims: str | tuple[str, ...], values: Any, unit: str, text: str = "") -> Any:
    """A variable of a Dataset with its unit, and what it is.

    Raises
    ------
    MissingExtra
        If xarray is not installed.
    """
    return xarray_module().Variable(dims, values, {"units": unit, **({"long_name": text} if text else {})})


def xarray_module() -> Any:
    """The module xarray.

    Raises
    ------
    MissingExtra
        If it is not installed.
    """
    return optional("xarray", "a Dataset needs", "xarray")


@singledispatch
def dataset(result: object) -> Any:
    """Dataset of the arrays of a result.

    Raises
    ------
    MissingExtra
        If xarray is not installed.
    TypeError
        If it has no arrays.
    """
    raise TypeError(f"{kind_of(result)} has no arrays; to_dataframe() gives its numbers")


@dataset.register
def _(recording: Recording) -> Any:
    reference = [] if recording.reference is None else [recording.reference]
    channels = [recording.accel, recording.position, *reference, *recording.side.values()]
    return xarray_module().Dataset(
        {c.name: variable(f"t_{c.name}", c.y, c.unit) for c in channels},
        {f"t_{c.name}": variable(f"t_{c.name}", c.t, "s") for c in channels},
        {"name": recording.name},
    )


@dataset.register
def _(fit: Fit) -> Any:
    names = [fit.label(e) for e in fit.free]
    units = [e.unit for e in fit.free]
    return xarray_module().Dataset(
        {
            "value": ("parameter", [e.value for e in fit.free]),
            "std": ("parameter", [e.std for e in fit.free]),
            "covariance": (("parameter", "other"), fit.covariance),
        },
        {"parameter": names, "other": names, "unit": ("parameter", units)},
        {"name": ", ".join(name for name, _ in fit.sources)},
    )


@dataset.register
def _(evaluation: Evaluation) -> Any:
    t, measured, simulated = evaluation.simulated
    return xarray_module().Dataset(
        {
            "measured": variable("t", measured, "m", "measured position"),
            "simulated": variable("t", simulated, "m", "position simulated without readings"),
            "simulated_std": variable(
                "t", evaluation.simulated_std, "m", "standard deviation from noise and start state"
            ),
            "one_step": variable("t_reading", evaluation.residual[1], "m", "one-step prediction error"),
            "one_step_std": variable("t_reading", evaluation.residual_std, "m", "its predicted standard deviation"),
            "accel_residual": variable(
                "t_accel", evaluation.accel_residual[1], "m/s²", "residual at the accelerometer"
            ),
        },
        {
            "t": variable("t", t, "s"),
            "t_reading": variable("t_reading", evaluation.residual[0], "s"),
            "t_accel": variable("t_accel", evaluation.accel_residual[0], "s"),
        },
        {"name": evaluation.recording},
    )


@dataset.register
def _(comparison: Comparison) -> Any:
    """The arrays of every evaluation; instants that an evaluation does not have are NaN."""
    concat = xarray_module().concat
    models = xarray_module().Variable("model", list(comparison.names))
    names = [name or f"recording {number}" for number, name in enumerate(comparison.recordings)]
    by_recording = [
        concat([dataset(evaluation) for evaluation in evaluations], models, join="outer", combine_attrs="drop")
        for evaluations in comparison.evaluations
    ]
    recordings = xarray_module().Variable("recording", names)
    return concat(by_recording, recordings, join="outer", combine_attrs="drop")


@dataset.register
def _(coast: Coast) -> Any:
    return xarray_module().Dataset(
        {
            "frozen": variable("t", coast.frozen, "m", "every parameter from the fit"),
            "rezeroed": variable("t", coast.rezeroed, "m", "bias estimated before the start"),
            "floor": variable("t", coast.floor, "m", "standard deviation from noise and start state"),
        },
        {"t": variable("t", coast.t, "s")},
        {"start": coast.start},
    )


@dataset.register
def _(track: Track) -> Any:
    return xarray_module().Dataset(
        {"value": (("t", "parameter"), track.values), "std": (("t", "parameter"), track.std)},
        {
            "t": variable("t", track.t, "s"),
            "parameter": list(track.names),
            "unit": ("parameter", list(track.units)),
        },
    )


@dataset.register
def _(path: Path) -> Any:
    arrays = {"value": path.value, "std": path.std} | {f.mechanism: f.value for f in path.followers}
    times = {"t": variable("t", path.t, "s")}
    return xarray_module().Dataset({name: variable("t", y, path.unit) for name, y in arrays.items()}, times)


@dataset.register
def _(run: FilterRun) -> Any:
    smoothed = {"smoothed_state": run.smoothed_states, "smoothed_variance": run.smoothed_variances}
    return xarray_module().Dataset(
        {
            "state": (("t", "state_name"), run.states),
            "variance": (("t", "state_name"), run.variances),
            "innovation": ("t", run.innovations),
            "innovation_variance": ("t", run.innovation_variances),
            "from_position": ("t", run.from_position),
            **{key: (("t", "state_name"), y) for key, y in smoothed.items() if y is not None},
        },
        {
            "t": variable("t", run.times, "s"),
            "state_name": list(run.names),
            "unit": ("state_name", [STATE_UNITS[name] for name in run.names]),
        },
        {"log_likelihood": run.log_likelihood},
    )


@dataset.register
def _(simulated: Simulated) -> Any:
    t = simulated.recording.accel.t
    exact = np.asarray(simulated.truth.motion.derivatives(t))
    names = {"p": "m", "v": "m/s", "a": "m/s²", "jerk": "m/s³"}
    return dataset(simulated.recording).assign(
        {name: variable("t_accel", y, unit, "exact") for (name, unit), y in zip(names.items(), exact, strict=True)}
    )


__dir__ = listing(globals())
