"""Integrals that drive the motion between encoder readings, and the two-state filter over them."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from typing import Literal

import numpy as np

from accelcal import _core
from accelcal.data import Array, Flags, RecordingError
from accelcal.data.orientation import HOLE
from accelcal.estimation.plausible import suspicion
from accelcal.estimation.run import PreparedRun
from accelcal.estimation.values import Noise, Values
from accelcal.signals.signals import Signals

INTERPOLATION: Literal["hold", "linear", "cubic"] = "cubic"
"""Of the output between its samples."""


@dataclass(frozen=True, slots=True)
class DriveIntegrals:
    """Encoder readings and the integrals of acceleration between them."""

    t: Array
    z: Array
    first: Array
    """Velocity gained over the interval that ends at each reading, m/s."""
    second: Array
    """Position gained over it beyond v h, m."""
    restart: Flags
    """Where the accelerometer record does not reach across the interval, or the position counts from another zero."""
    extra_q: Array
    """Density of process noise of the interval beyond that of the record: what sampling hides, (m/s²)²/Hz."""
    extra_r: Array = field(default_factory=lambda: np.empty(0))
    """Variance of each reading beyond that of the record, m²; empty where all readings are alike."""

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Flags, Array, Array]:
        """In the order that the core takes them."""
        return self.t, self.z, self.first, self.second, self.restart, self.extra_q, self.extra_r

    def settled(self, wait: float) -> Flags:
        """Readings later than `wait` behind the last start; of a short stretch at least the last four fifths."""
        wait = min(wait, 0.2 * float(self.t[-1] - self.t[0]))
        begins = np.flatnonzero(self.restart)
        if len(begins) > 1:
            return np.asarray(self.t > np.repeat(self.t[begins] + wait, np.diff(begins, append=len(self.t))))
        return np.asarray(self.t > self.t[begins] + wait)

    def part(self, rows: slice) -> DriveIntegrals:
        """The readings in `rows`, with a restart at the first."""
        restart = self.restart[rows].copy()
        restart[0] = True
        first, second, extra = self.first[rows], self.second[rows], self.extra_q[rows]
        of_readings = self.extra_r[rows] if len(self.extra_r) else self.extra_r
        return DriveIntegrals(self.t[rows], self.z[rows], first, second, restart, extra, of_readings)


def drive(run: PreparedRun, values: Values, signals: Signals | None) -> DriveIntegrals:
    """Integrals of the stage acceleration that output and model imply, interval by interval.

    Parameters
    ----------
    run : readings and output.
    values : coefficients at which the model is taken.
    signals : smoothed motion that non-constant effects are evaluated on; None while there is none yet.

    Raises
    ------
    RecordingError
        If the scale factor is that of a sensor without output.
    """
    begin = run.t[0]  # a small offset would be lost in the last digits of a clock that counts from 1970
    stamps = run.driving.t - begin
    if values.clock_skew:
        stamps = values.instants(stamps, run.origins.t - begin) + values.time_offset
    first, second, covered = _core.drive(
        stamps,
        run.driving.y,
        run.t - begin,
        how=INTERPOLATION,
        tau=run.tau(values),
        delay=values.time_offset,
        hole=HOLE * run.accel_step,
    )
    del stamps
    filters = run.filters
    if values.bias:
        h = np.diff(run.t, prepend=run.t[0])
        first -= values.bias * filters.at_rest * h
        second -= values.bias * filters.at_rest * h**2 / 2.0
        del h
    z = run.readings
    if signals is not None:
        t_grid = signals.t + run.origins.t
        total = values.total("output", signals)
        if total is not None:
            total = filters.behind(total, signals.step)
            once, twice, _ = _core.drive(t_grid, total, run.t, how=INTERPOLATION, tau=0.0, delay=0.0, hole=np.inf)
            first -= once
            second -= twice
        if any(values.additive("position")):
            read = values.total("position", signals.resampled(run.t - run.origins.t))
            z = z if read is None else z - filters.behind_at(run.t, read)
    require_output(run, values)
    gain = run.rig.polarity / values.scale
    restart = ~covered | filters.gaps(run.t)
    restart[0] = True
    restart[np.searchsorted(run.t, run.restarts)] = True
    first *= gain  # in place, as all of it: what is kept lies below what is not, and memory is given back
    second *= gain
    pulls = run.gravity_integrals
    first -= pulls[0]
    second -= pulls[1]
    first[restart] = second[restart] = 0.0
    return DriveIntegrals(run.t, z, first, second, restart, run.extra_q)


def without_transients(run: PreparedRun, integrals: DriveIntegrals, noise: Noise) -> DriveIntegrals:
    """The integrals without what is unknown behind a high-pass of the output, fitted to the innovations.

    A constant that enters behind the high-pass and its state at the start are no parameters of the sensor; they are
    eliminated at given coefficients and noise. Without a high-pass the integrals are returned as they are.
    """
    columns = run.filters.transients(run.t)
    if not columns:
        return integrals
    track = run_filter(run, integrals, noise)
    counts = integrals.settled(run.wait(noise))
    weight = 1.0 / np.sqrt(track.series("S")[counts])
    zero, begin = np.zeros_like(integrals.z), integrals.restart
    columns = [(np.where(begin, 0.0, once), np.where(begin, 0.0, twice)) for once, twice in columns]
    alone = [
        run_filter(run, replace(integrals, z=zero, first=column[0], second=column[1]), noise).series("e")[counts]
        * weight
        for column in columns
    ]
    sizes, *_ = np.linalg.lstsq(np.column_stack(alone), -track.series("e")[counts] * weight, rcond=1e-8)
    first, second = integrals.first.copy(), integrals.second.copy()
    for size, (once, twice) in zip(sizes, columns, strict=True):
        first += size * once
        second += size * twice
    return replace(integrals, first=first, second=second)


LEAST_SCALE = 1e-6
"""1 + k below which there is no output that could be inverted: a thousandth of mm read as m."""


def require_output(run: PreparedRun, values: Values) -> None:
    """Refuse a recording whose output is so small beside its motion that the sensor has no scale left.

    Raises
    ------
    RecordingError
        With the recording and what to check.
    """
    if abs(values.scale) < LEAST_SCALE:
        cause = suspicion(run.recording)
        raise RecordingError(
            f"{run.recording.title}: the output is as good as zero beside the acceleration of the "
            f"position; check the units of accel and position{': ' * bool(cause)}{cause}"
        )


def after_readings(track: _core.ReplayTrack) -> tuple[Array, Array, Array]:
    """Innovations, and position (m) and velocity (m/s) of a filter after each reading, (n,) each."""
    e = track.series("e")
    return e, track.series("p") + track.series("gain_p") * e, track.series("v") + track.series("gain_v") * e


def run_filter(run: PreparedRun, integrals: DriveIntegrals, noise: Noise) -> _core.ReplayTrack:
    """Track of the two-state filter over the readings."""
    return _core.ReplayTrack(*integrals.arrays, q=noise.q, r=noise.r, prior=run.prior(noise.r))
