"""Results whose arrays have axes as xarray Datasets: SI numbers, units in the attributes of each variable."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from accelcal.data.recording import Recording
from accelcal.estimation.estimate import Fit
from accelcal.estimation.parameter_tracks import Track
from accelcal.filters.choice import STATE_UNITS
from accelcal.filters.record import FilterRun
from accelcal.frames.dataframes import label_of
from accelcal.frames.packages import xarray
from accelcal.simulation.sensor import Simulated
from accelcal.validation.comparison import Coast, Comparison

if TYPE_CHECKING:
    from xarray import Dataset


def variable(dims: str | tuple[str, ...], values: Any, unit: str, text: str = "") -> Any:
    """A variable with its unit, and what it is."""
    about = {"units": unit, **({"long_name": text} if text else {})}
    return xarray().Variable(dims, values, about)


def dataset(variables: Any, coordinates: Any, about: Any = None) -> Dataset:
    """A Dataset of variables on coordinates, with its attributes."""
    made: Dataset = xarray().Dataset(variables, coordinates, about)
    return made


def of_recording(recording: Recording) -> Dataset:
    """Channels, each on a time axis of its own: accel on t_accel, position on t_position, and a reference beside it."""
    reference = [] if recording.reference is None else [recording.reference]
    channels = [recording.accel, recording.position, *reference, *recording.side.values()]
    return dataset(
        {c.name: variable(f"t_{c.name}", c.y, c.unit) for c in channels},
        {f"t_{c.name}": variable(f"t_{c.name}", c.t, "s") for c in channels},
        {"name": recording.name},
    )


def of_fit(fit: Fit) -> Dataset:
    """Values of the free parameters, their standard uncertainties and their covariance."""
    names = [label_of(fit, e) for e in fit.free]
    units = [e.unit for e in fit.free]
    return dataset(
        {
            "value": ("parameter", [e.value for e in fit.free]),
            "std": ("parameter", [e.std for e in fit.free]),
            "covariance": (("parameter", "other"), fit.covariance),
        },
        {"parameter": names, "other": names, "unit": ("parameter", units)},
        {"name": ", ".join(name for name, _ in fit.sources)},
    )


def of_comparison(seen: Comparison) -> Dataset:
    """Simulation and measurement, one-step residuals, and the residual at the accelerometer, each on its own time."""
    t, measured, simulated = seen.simulated
    return dataset(
        {
            "measured": variable("t", measured, "m", "measured position"),
            "simulated": variable("t", simulated, "m", "position simulated without readings"),
            "simulated_std": variable("t", seen.simulated_std, "m", "standard deviation from noise and start state"),
            "one_step": variable("t_reading", seen.residual[1], "m", "one-step prediction error"),
            "one_step_std": variable("t_reading", seen.residual_std, "m", "its predicted standard deviation"),
            "accel_residual": variable("t_accel", seen.accel_residual[1], "m/s²", "residual at the accelerometer"),
        },
        {
            "t": variable("t", t, "s"),
            "t_reading": variable("t_reading", seen.residual[0], "s"),
            "t_accel": variable("t_accel", seen.accel_residual[0], "s"),
        },
        {"name": seen.recording},
    )


def of_coast(coast: Coast) -> Dataset:
    """Position predicted without readings."""
    return dataset(
        {
            "frozen": variable("t", coast.frozen, "m", "every parameter from the fit"),
            "rezeroed": variable("t", coast.rezeroed, "m", "bias estimated before the start"),
            "floor": variable("t", coast.floor, "m", "standard deviation from noise and start state"),
        },
        {"t": variable("t", coast.t, "s")},
        {"start": coast.start},
    )


def of_track(track: Track) -> Dataset:
    """Estimates against time and parameter."""
    return dataset(
        {"value": (("t", "parameter"), track.values), "std": (("t", "parameter"), track.std)},
        {
            "t": variable("t", track.t, "s"),
            "parameter": list(track.names),
            "unit": ("parameter", list(track.units)),
        },
    )


def of_filter_run(run: FilterRun) -> Dataset:
    """History of a filter: states against time and state, innovations against time."""
    smoothed = {"smoothed_state": run.smoothed_states, "smoothed_variance": run.smoothed_variances}
    return dataset(
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


def of_simulated(made: Simulated) -> Dataset:
    """The recording, and the exact motion at the samples of the output."""
    t = made.recording.accel.t
    exact = np.asarray(made.truth.motion.derivatives(t))
    names = {"p": "m", "v": "m/s", "a": "m/s²", "jerk": "m/s³"}
    found = of_recording(made.recording)
    return found.assign(
        {name: variable("t_accel", y, unit, "exact") for (name, unit), y in zip(names.items(), exact, strict=True)}
    )
