"""Fits to a recording with a contribution of the tests' own."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable

from accelcal.data.arrays import Array
from accelcal.estimation.estimate import solve_runs
from accelcal.estimation.run_state import RunState
from accelcal.model import Model
from accelcal.simulation.sensor import Simulated


def fitted(run: Simulated, more: Callable[[Array], Array]) -> RunState:
    """The base fitted to a recording with a contribution to its output, a function of the times of its samples."""
    accel = run.recording.accel
    return solve_runs(
        Model.linear(),
        [dataclasses.replace(run.recording, accel=dataclasses.replace(accel, y=accel.y + more(accel.t)))],
    ).states[0]
