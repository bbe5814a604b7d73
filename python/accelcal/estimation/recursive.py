"""Fit with the paper's live filters instead of the replay: ACI or CWPA over one recording."""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from accelcal._support.arguments import checked
from accelcal.data import DERIVED, Array, Channel, Recording, RecordingError, unsupported
from accelcal.effects import find, polynomial
from accelcal.estimation.estimate import Fit, estimate
from accelcal.estimation.remarks import remark
from accelcal.estimation.run import PreparedRun, prepare
from accelcal.estimation.smoothing import output_at, uniform_times
from accelcal.filters.choice import FilterChoice, spread_start, to_stage
from accelcal.filters.record import FilterRun, ForwardParameters, forward_parameters, run
from accelcal.model import NOMINAL, Estimate, Model

PARAMETER_OF = {find(name).symbol: name for name in ("scale_factor", "bias", *polynomial(3))}
"""Public name of each filter parameter."""
PRIOR_STD = {"k": 0.3, "K0": 3.0, "K2": 1e-2, "K3": 1e-3}
"""Standard deviations before the first sample, SI: wide for any working sensor."""


@checked
def fit_recursive(
    choice: FilterChoice, recording: Recording, *, start: float | None = None, end: float | None = None
) -> tuple[Fit, FilterRun]:
    """Estimate parameters with a live filter; noise and ranges come from the replay on the same recording.

    Parameters
    ----------
    choice : system, sensor model and the five choices.
    recording : one run. Its output is re-stamped by the time offset that the replay finds, since the paper's filters
        do not estimate it.
    start, end : s, optional; only this part is used.

    Returns
    -------
    The fit, in forward sense, and the filter's own record with a row for each event.

    Raises
    ------
    FilterError
        If a step fails, among others when RK2 loses positive definiteness.
    NotIdentifiable, RecordingError
        From the replay.
    ValueError
        If `choice` has consider parameters.

    Notes
    -----
    A declared low-pass is a state in CWPA and reads p + tau v in ACI. CWPA takes its jerk density from the rms change
    of acceleration between samples, q dt = (delta a)² (Bar-Shalom 2001, 6.2.3; derivations 4.1).

    Examples
    --------
    >>> import numpy as np
    >>> import accelcal as ac
    >>> truth = {"bias": 0.05, "cubic": 1e-3}
    >>> rng = np.random.default_rng(1)
    >>> made = ac.simulate("interleaved", seconds=12.0, rig=ac.simulation.CXL02_RIG, parameters=truth, rng=rng)
    >>> fit, run = fit_recursive(ac.FilterChoice("aci", "cubic"), made.recording)
    >>> run.names
    ('p', 'v', 'k', 'K0', 'K2', 'K3')
    """
    choice.refuse_consider("a fit by a live filter")
    refused = unsupported(recording.rig.filters, "a fit by a live filter")
    if refused:
        raise RecordingError(f"{recording.name or 'recording'}: {refused}")
    turning = next((name for name in DERIVED if name in recording.side), None)
    if turning:
        raise RecordingError(
            f"{recording.name or 'recording'}: {turning}: a fit by a live filter takes gravity along the axis as "
            "constant; use the replay"
        )
    if recording.reference is not None:
        raise RecordingError(
            f"{recording.name or 'recording'}: a fit by a live filter reads positions, and here is "
            f"{recording.reference.name}, whose integral has other noise; fit it by the weak form"
        )
    model = Model.cubic() if choice.model == "cubic" else Model.linear()
    replayed = estimate(model, recording, start=start, end=end, method="replay")
    offset = replayed["time_offset"]
    prepared = prepare(recording, replayed.origins, start=start, end=end)
    accel = Channel("accel", prepared.accel.t - offset.value, stage_output(prepared), "m/s^2")
    position = Channel("position", prepared.t, prepared.z, "m")
    noise, scale, tau = replayed.noise(), replayed.values().scale, prepared.tau(replayed.values())
    density = noise.q * scale**2
    names = choice.states(low_pass=tau > 0.0)
    x0 = np.zeros(len(names))
    x0[0] = prepared.z[0]
    std = {"p": math.sqrt(noise.r), "v": prepared.speed, "a": float(np.std(accel.y)), "y": float(np.std(accel.y))}
    P0 = np.diag([({**std, **PRIOR_STD}[name]) ** 2 for name in names])
    # The filter starts at the output before the first reading, where p is z - v ahead; under ACI, whose motion lags by
    # the low-pass, z - (ahead + tau) v. It is as uncertain as v and a make it.
    first = max(0, int(np.searchsorted(accel.t, position.t[0], side="right")) - 1)
    accel = Channel(accel.name, accel.t[first:], accel.y[first:], accel.unit)
    ahead = max(0.0, float(position.t[0] - accel.t[0]))
    spread_start(P0, v_std=std["v"], a_std=std["a"], ahead=ahead, lag=tau if choice.system == "aci" else 0.0)
    if choice.system == "aci":
        filtered = run(choice, accel, position, q=density, r_position=noise.r, x0=x0, P0=P0, tau=tau)
    else:
        change = float(np.mean(np.diff(smoothed_acceleration(prepared, replayed)) ** 2))
        coloured = tau > 0.0
        filtered = run(
            choice,
            accel,
            position,
            q=change / prepared.accel_step,
            r_position=noise.r,
            r_accel=READ_OUT_SHARE * density / prepared.accel_step if coloured else density / prepared.accel_step,
            q_accel=density if coloured else None,
            x0=x0,
            P0=P0,
            tau=tau,
        )
    return as_fit(replayed, forward_parameters(filtered), choice), filtered


READ_OUT_SHARE = 1e-4
"""Reading noise of a filtered output over the variance of its unfiltered noise: the converter, not the sensor."""


def stage_output(run: PreparedRun) -> Array:
    """Output as a level, normally mounted sensor would give it, (n,) m/s²."""
    return run.rig.polarity * run.accel.y - run.rig.gravity


def smoothed_acceleration(prepared: PreparedRun, replayed: Fit) -> Array:
    """Acceleration of the stage at the accelerometer's rate, without most of the noise, (n,) m/s²."""
    cutoff = replayed.validity["frequency"][1]
    values = replayed.values()
    return output_at(prepared, uniform_times(prepared), cutoff, prepared.tau(values)) / values.scale


def as_fit(replayed: Fit, found: ForwardParameters, choice: FilterChoice) -> Fit:
    """The fit with the parameters that a filter found on polarity * output - gravity in the place of its own."""
    order = {PARAMETER_OF[name]: i for i, name in enumerate(found.names)}
    held = {e.name: e.value for e in replayed.free if e.name in NOMINAL and e.name not in order}
    frozen = replayed.model.freeze(**held)
    T = np.linalg.inv(to_stage(found.names, replayed.rig.polarity, replayed.rig.gravity))
    values, covariance = T @ found.values, T @ found.covariance @ T.T
    rows = [order[e.name] for e in replayed.estimates if e.name in order and e.name not in frozen.fixed]
    estimates = tuple(
        replace(e, value=float(values[order[e.name]]), std=math.sqrt(covariance[order[e.name], order[e.name]]))
        if e.name in order
        else Estimate(e.name, e.symbol, e.unit, e.value, 0.0, e.owner)
        for e in replayed.estimates
    )
    text = (
        f"{' and '.join(f'{name} {value:.3g} s' for name, value in held.items())} and the noise are the replay's; "
        "the filter does not estimate them, and its standard deviations take them as known"
    )
    parts = (
        choice.system,
        choice.form,
        choice.interpolation,
        choice.integrator,
        f"order {choice.order}",
        choice.carrier,
    )
    return replace(
        replayed,
        model=frozen,
        estimates=estimates,
        covariance=covariance[np.ix_(rows, rows)],
        method=" ".join(parts),
        remarks=(remark("live_filter", text=text), *replayed.remarks),
    )
