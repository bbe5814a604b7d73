"""Recordings: channels, each on its own clock, notes made when they were read, and sets with dwells."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from datetime import UTC, date, datetime, timedelta
from operator import attrgetter
from typing import TYPE_CHECKING, ClassVar, Final, Literal

import numpy as np
import scipy
from numpy.typing import ArrayLike, NDArray

from accelcal._support.arguments import check_fields
from accelcal._support.errors import AccelcalError, visible
from accelcal._support.result import Result
from accelcal._support.values import face, immutable, listing
from accelcal.data import units
from accelcal.data.arrays import Array, copied
from accelcal.data.dwells import Dwells, Positions
from accelcal.data.rig import STANDARD_GRAVITY, Rig
from accelcal.data.units import shown

if TYPE_CHECKING:
    from pandas import DataFrame


EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class RunLabels:
    """Labels of one run; None or empty = not declared."""

    date: float | None = None
    """Days since 1970-01-01 UTC."""
    mounting: str = ""
    """Name of the mounting; runs between which the sensor stayed in place share it."""
    operator: str = ""

    @property
    def day(self) -> str:
        """The date as ISO 8601, with the time where one was declared; empty where nothing was.

        Examples
        --------
        >>> RunLabels(date=20760.0).day, RunLabels(date=20760.5).day
        ('2026-11-03', '2026-11-03 12:00 UTC')
        """
        if self.date is None:
            return ""
        at = EPOCH + timedelta(days=self.date)
        return f"{at:%Y-%m-%d}" if self.date == int(self.date) else f"{at:%Y-%m-%d %H:%M} UTC"


NO_LABELS = RunLabels()


def days_of(value: object) -> float:
    """Days since 1970 of a date, or a date with time, as TOML has them or as ISO 8601; UTC where no zone is given.

    Raises
    ------
    ValueError
        If it is no date.
    """
    if isinstance(value, str):
        with suppress(ValueError):
            value = datetime.fromisoformat(value)
    if isinstance(value, datetime):
        at = value if value.tzinfo else value.replace(tzinfo=UTC)
        return (at - EPOCH) / timedelta(days=1)
    if isinstance(value, date):
        return float((value - date(1970, 1, 1)).days)
    raise AccelcalError(f"found {shown(value)}, expected a date such as 2026-11-03 or 2026-11-03T14:30:00")


class RecordingError(AccelcalError):
    """The data cannot be used as they are. The text states what was found, where, and the next step.

    Examples
    --------
    >>> try:
    ...     Channel("position", [0.0, 1.0], [0.0], "m")
    ... except RecordingError as error:
    ...     print(error)
    position: (2,) stamps and (1,) readings, expected as many of each
    """


@immutable
@dataclass(frozen=True, slots=True)
class Channel:
    """One measured quantity on its own clock, in SI; values that are given in another unit are converted.

    Raises
    ------
    RecordingError
        If the unit is unknown, or stamps and values do not pair.

    Examples
    --------
    >>> Channel("position", [0.0, 0.1], [1.0, 2.5], "mm")
    Channel(position: 2 samples, 0 s to 0.1 s, m)
    """

    name: str
    t: Array
    """(n,) s, strictly rising, finite."""
    y: Array
    """(n,) in `unit`, finite: a sample that was not taken is simply absent, as is one that is masked."""
    unit: str
    """SI unit of `y` (temperature: "degC")."""

    def __post_init__(self) -> None:
        t, y = series(self.name, "t", self.t), series(self.name, "y", self.y)
        if len(t) != len(y):
            raise RecordingError(f"{self.name}: {t.shape} stamps and {y.shape} readings, expected as many of each")
        if np.ma.isMaskedArray(self.t) or np.ma.isMaskedArray(self.y):
            sampled = ~(np.isnan(t) | np.isnan(y))
            t, y = t[sampled], y[sampled]
        try:
            rule = units.conversion(self.unit)
        except units.UnitError as error:
            raise RecordingError(f"{self.name}: {error}") from None
        for key, value in (("t", t), ("y", rule.apply(y)), ("unit", rule.si)):
            object.__setattr__(self, key, value)

    def __len__(self) -> int:
        return len(self.t)

    def __repr__(self) -> str:
        span = f", {units.instant(self.t[0])} s to {units.instant(self.t[-1])} s" if len(self) else ""
        return f"Channel({self.name}: {len(self)} samples{span}, {self.unit})"


HINTS = {
    0: ". list(...) takes what a generator gives",
    1: '. pandas makes numbers of text: pandas.read_csv(..., decimal=","), pandas.to_numeric, pandas.to_datetime',
    2: ". A column of it is [:, 0]",
}
"""Hint on how to make an array usable, by its dimensions."""


def series(name: str, key: str, values: ArrayLike) -> Array:
    """Real numbers in one dimension, copied; NaN, or None in a list = not sampled.

    Raises
    ------
    RecordingError
        If they are something else.
    """
    numbers = copied(values)
    if numbers.dtype == object and not any(isinstance(x, str | bytes) for x in numbers.flat):
        with suppress(TypeError, ValueError):
            numbers = numbers.astype(np.float64)
    if numbers.ndim != 1 or numbers.dtype.kind not in "fiu":
        hint = HINTS.get(numbers.ndim, "") if numbers.ndim == 2 or numbers.dtype.kind in "OUST" else ""
        raise RecordingError(
            f"{name}: {key} is an array of {numbers.dtype} of shape {numbers.shape}; expected real numbers in one "
            f"dimension{hint}"
        )
    return numbers.astype(np.float64, copy=False)


@dataclass(frozen=True, slots=True)
class Finding:
    """Something noticed while reading, and the policy that was applied to it."""

    kind: str
    """One word: gap, held_repeats, duplicate_stamps, clipping, constant, ... (see `accelcal.data.quality`)."""
    channel: str
    count: int
    first: float
    """Time of the first occurrence, s."""
    text: str
    """A whole sentence: what was found, where, what was done about it."""
    severity: Literal["note", "warning"] = "note"
    size: float = 0.0
    """Step of rounded stamps, or of the logger's ticks where samples are held, s; 0 for all else."""
    common: float = 0.0
    """Standard deviation of the error that all stamps of the channel share because of it, s."""
    jitter: float = 0.0
    """Standard deviation of the error that each stamp is left with, s; 0 where the instants of a clock are used."""

    @property
    def lasts(self) -> bool:
        """Whether a file that is made of the recording has to say so: warnings, and what is uncertain of its clocks."""
        return self.severity == "warning" or self.common > 0.0 or self.kind == "alignment"


@dataclass(frozen=True, slots=True)
class PositionStep:
    """A jump of the encoder's reading that stays: counts were lost, or its zero was set anew."""

    time: float
    """Of the first reading behind it, s."""
    size: float
    """m"""
    p_value: float
    """Probability of such a jump anywhere in a record without one."""

    @property
    def sentence(self) -> str:
        """For people."""
        size, time = units.in_usual_unit(self.size, "m", sign="+"), units.instant(self.time)
        return (
            f"position: the reading jumps by {size} at t = {time} s and stays: missed counts, or the encoder was zeroed"
        )


@dataclass(frozen=True, slots=True)
class Origin:
    """Where the channels of a recording come from, for sentences that say what to write."""

    file: str = ""
    """Path; empty where the channels were arrays."""
    sidecar: str = ""
    """Path of what was read beside it; empty where there was none."""
    arguments: str = ""
    """Arguments of a command that reads it, as a shell takes them; empty where the channels were arrays."""
    columns: Mapping[str, tuple[str, str]] = field(default_factory=dict)
    """Column and unit by channel, those of the stamps of the output as "time"."""
    scales: Mapping[str, tuple[float, str]] = field(default_factory=dict)
    """By channel, where one is declared beside the column: counts or V for each SI unit, and which of both."""


WrongKind = Literal["denied", "saturated", "stuck", "other_scale", "unrelated", "lost_signal"]
"""Far beyond the rest while the reference shows nothing; at the limit of its range; one value repeated while the other
channel moves; of another scale factor than the rest; before any relation to the reference; or a drop-out of a
vibrometer."""


@dataclass(frozen=True, slots=True)
class LeftOut:
    """Readings of one channel that are known to be wrong, and were left out before anything was estimated."""

    kind: WrongKind
    channel: str
    count: int
    of: int
    """Readings that the channel had."""
    stretches: tuple[tuple[float, float], ...]
    """First and last reading of each, s."""
    reach: float
    """Time on both sides that the declared filters spread them over, s; it is left out with them."""
    scale: float = 1.0
    """Scale factor in them over that of the rest."""


@immutable
@dataclass(frozen=True, slots=True, weakref_slot=True)
class Recording(Result):
    """One run: the accelerometer output, the encoder position, side channels, and the rig it came from.

    `accelcal.load` reads one from a file, `from_arrays` and `from_dataframe` make one of what is in memory.

    Examples
    --------
    >>> import numpy as np
    >>> t = np.arange(0.0, 1.0, 1e-3)
    >>> run = Recording(Channel("accel", t, np.sin(20 * t), "g"), Channel("position", t, np.cos(20 * t), "mm"), Rig())
    >>> run.position.unit, len(run.part(0.2, 0.4).accel)
    ('m', 201)
    """

    counterparts: ClassVar[Mapping[str, str]] = {
        **dict.fromkeys(("plot", "columns", "head", "describe"), "recording.to_dataframe(), in SI units"),
        **dict.fromkeys(("t", "time", "index"), "recording.accel.t and recording.position.t, s"),
    }

    accel: Channel
    """Accelerometer output, m/s² (converted from V or counts through the declared scale)."""
    position: Channel
    """Encoder reading, m."""
    rig: Rig
    side: Mapping[str, Channel] = field(default_factory=dict)
    """Further channels by name: temperature, a_y, ..."""
    name: str = ""
    """File name, for messages."""
    digest: str = ""
    """SHA-256 of the source file, hex."""
    source: str = ""
    """Digest of the whole recording that this is a part of; empty for a whole one."""
    findings: tuple[Finding, ...] = ()
    position_steps: tuple[PositionStep, ...] = ()
    """Jumps of the position that were found; the replay starts anew behind each."""
    left_out: tuple[LeftOut, ...] = ()
    """Readings that are missing because they are known to be wrong."""
    labels: RunLabels = NO_LABELS
    """When, how mounted, by whom."""
    dwells: Dwells | None = None
    """Static dwells of the same sensor: further rows of the regression of this run."""
    positions: Positions | None = None
    """Static positions of all three outputs of the sensor: further rows of a fit of all three."""
    gravity: float = STANDARD_GRAVITY
    """Local gravity that a turning axis is taken to show, m/s²."""
    reference: Channel | None = None
    """A velocity or an acceleration where that was measured in place of the position, which is its integral."""
    origin: Origin = field(default=Origin(), repr=False)
    axis: str = ""
    """Which output of one sensor with several this is: "x", "y" or "z"; empty where it has one."""
    prior_sizes: Mapping[str, str] = field(default_factory=dict, repr=False)
    """Typical sizes of effects by name, as in "100 ug/g^3", in place of those that the catalogue has."""

    def __post_init__(self) -> None:
        check_fields(self)
        for channel, unit in ((self.accel, "m/s^2"), (self.position, "m")):
            if not units.same_unit(channel.unit, unit):
                scaled = ", with a Rig whose sensor has scale and zero," if channel.unit in ("V", "count") else ""
                raise RecordingError(
                    f"{self.title}: {channel.name} is in {channel.unit}; expected {unit}, or a unit that "
                    f"converts to it. Recording.from_arrays{scaled} converts it"
                )
        if np.array_equal(self.accel.t, self.position.t):  # on one clock: one array for both
            object.__setattr__(self.position, "t", self.accel.t)

    @classmethod
    def from_arrays(
        cls,
        t: ArrayLike,
        accel: ArrayLike,
        position: ArrayLike,
        *,
        units: Mapping[str, str],
        rig: Rig | None = None,
        position_t: ArrayLike | None = None,
        side: Mapping[str, ArrayLike] | None = None,
        name: str = "",
        reference: Literal["position", "velocity", "reference_acceleration"] = "position",
    ) -> Recording:
        """Make a recording of arrays, with the checks and policies that apply to a file (`accelcal.data.quality`).

        Parameters
        ----------
        t : (n,) stamps, s, or in `units["t"]`; dates, which count from the first of all, and time deltas need no unit.
        accel : (n,) output of the accelerometer; V or counts are converted by `rig.sensor.scale`. NaN = not sampled.
        position : (n,) position of the carriage, or what `reference` says; NaN = not sampled. (m,) with `position_t`.
        units : unit of "accel", of the reference by its name and of every side channel; units are never guessed.
        rig : what is known of sensor and rig; by default a level axis and nothing else.
        position_t : (m,) stamps of the position where it has a clock of its own, in the unit of `t`.
        side : further channels by name, (n,) each: temperature, supply voltage, ...
        name : for messages.
        reference : what tells the motion: "position", "velocity" (laser vibrometer), or "reference_acceleration" (a
            second accelerometer, already calibrated).

        Raises
        ------
        RecordingError
            If a unit is missing or of the wrong dimension, or the samples cannot be used.

        Examples
        --------
        >>> import numpy as np
        >>> t = np.arange(0.0, 1.0, 1e-3)
        >>> a, p = np.sin(20.0 * t), -2.5 * np.sin(20.0 * t)
        >>> Recording.from_arrays(t, a, p, units={"accel": "m/s^2", "position": "mm"}, name="sweep")
        Recording('sweep': 1000 samples of accel, 1000 of position)
        """
        recording: Recording = face("io.memory").from_arrays(
            t,
            accel,
            position,
            units=units,
            rig=rig,
            position_t=position_t,
            side=side or {},
            name=name,
            reference=reference,
        )
        return recording

    @classmethod
    def from_dataframe(
        cls, frame: DataFrame, *, units: Mapping[str, str] | None = None, rig: Rig | None = None, name: str = ""
    ) -> Recording:
        """Make a recording of a pandas DataFrame, whose columns are found as those of a file are.

        Parameters
        ----------
        frame : columns t, accel, position (or accel_g, position_mm, ...) and side channels; without a column for time
            its index is the time. Stamps are numbers, time deltas, or dates, which count from the first of all; the
            last two need no unit. A clock of one channel is called accel_t or position_t. NaN = not sampled.
        units : unit by column, of a time in numbers as well ("s"); by default those in `frame.attrs["units"]`, else
            those in the names of the columns.
        rig, name : as in `from_arrays`.

        Raises
        ------
        RecordingError
            If a column or a unit is missing, or the samples cannot be used.

        Examples
        --------
        >>> import numpy as np
        >>> import pandas as pd
        >>> t = np.arange(0.0, 1.0, 1e-3)
        >>> frame = pd.DataFrame({"t_s": t, "accel_g": np.sin(20.0 * t), "position_mm": -24.5 * np.sin(20.0 * t)})
        >>> Recording.from_dataframe(frame)
        Recording('': 1000 samples of accel, 1000 of position)
        """
        recording: Recording = face("io.memory").from_dataframe(frame, units=units, rig=rig, name=name)
        return recording

    @property
    def sums(self) -> tuple[float, float, float, float]:
        """Sums of stamps and values of both channels: an array that was written into shows."""
        return tuple(float(np.sum(y)) for c in (self.accel, self.position) for y in (c.t, c.y))  # type: ignore[return-value]

    @property
    def title(self) -> str:
        """Name in messages and tables: "recording" where it has none."""
        return self.name or "recording"

    @property
    def session(self) -> str:
        """Digest of the whole recording: parts of one have one clock."""
        return self.source or self.digest

    @property
    def stamp_std(self) -> float:
        """Standard deviation of the offset of the two clocks that is unknown because of rounded stamps, s."""
        return math.hypot(*(finding.common for finding in self.findings))

    def __repr__(self) -> str:
        side = "".join(f", {name}" for name in self.side)
        return f"Recording({self.name!r}: {len(self.accel)} samples of accel, {len(self.position)} of position{side})"

    def with_dwells(self, dwells: Dwells) -> Recording:
        """The recording with static dwells of the same sensor in place of its own; every fit to it then uses them.

        Raises
        ------
        RecordingError
            If a sidecar declares another sensor, or a constant does not reach the output.
        """
        require_same_sensor(self, dwells.rig, dwells.name or "the dwells")
        if not self.rig.coupled:
            raise RecordingError(
                f"{self.name}: its output passes a high-pass, so that dwells show another sensor than this recording; "
                "fit it without them"
            )
        return replace(self, dwells=dwells)

    def part(self, start: float, end: float) -> Recording:
        """The recording from `start` to `end`, both included, s.

        The digest becomes that of the old one with the stretch, for it is not the whole file any more.

        Raises
        ------
        RecordingError
            If the stretch is not rising, or no sample or reading lies in it.
        """
        return self._cut(start, end, lambda t: (t >= start) & (t <= end), "only")

    def without(self, *stretches: tuple[float, float]) -> Recording:
        """The recording without some stretches (start, end), ends included, s: what was not sampled is absent.

        Raises
        ------
        RecordingError
            If a stretch is not rising, or nothing is left.
        """
        left = self
        for start, end in stretches:
            left = left._cut(start, end, lambda t, a=start, b=end: (t < a) | (t > b), "without")  # type: ignore[misc]
        return left

    def _cut(self, start: float, end: float, keep: Callable[[Array], NDArray[np.bool_]], word: str) -> Recording:
        if not start < end:
            raise RecordingError(
                f"{self.name}: a stretch from {units.instant(start)} s to {units.instant(end)} s is empty; "
                "give start before end"
            )

        def part_of(channel: Channel) -> Channel:
            rows = keep(channel.t)
            return replace(channel, t=channel.t[rows], y=channel.y[rows])

        accel, position = part_of(self.accel), part_of(self.position)
        reference = None if self.reference is None else part_of(self.reference)
        if (len(self.accel) and not len(accel)) or (len(self.position) and not len(position)):
            raise RecordingError(
                f"{self.name}: nothing is left {word} {units.instant(start)} s to {units.instant(end)} s; "
                "choose another stretch"
            )
        side = {name: part_of(channel) for name, channel in self.side.items()}
        digest = hashlib.sha256(f"{self.digest} {word} {start!r} {end!r}".encode()).hexdigest()
        side = {name: channel for name, channel in side.items() if len(channel)}
        return replace(
            self,
            accel=accel,
            position=position,
            side=side,
            digest=digest,
            source=self.session,
            reference=reference,
        )


def listed(recordings: Recording | Sequence[Recording]) -> list[Recording]:
    """One recording, or several, as a list."""
    return [recordings] if isinstance(recordings, Recording) else list(recordings)


def require_same_sensor(recording: Recording | Dwells | Positions, rig: Rig, other: str) -> None:
    """Refuse a recording whose sidecar declares another sensor than `rig`, which belongs to `other`.

    Raises
    ------
    RecordingError
        Naming both; what is declared on one side only is not compared.
    """
    for key in ("model", "serial"):
        here, there = (visible(getattr(sensor, key), one_line=True) for sensor in (recording.rig.sensor, rig.sensor))
        if here and there and here != there:
            raise RecordingError(
                f'{recording.name}: sensor.{key} is "{here}" but that of {other} is "{there}"; expected one sensor. '
                "Give a recording of that sensor, or correct [sensor] in the sidecar"
            )


Reference = Literal["position", "velocity", "reference_acceleration"]
"""Kinds of channels that show the motion of the stage."""
VELOCITY: Final = "velocity"
ACCELERATION: Final = "reference_acceleration"
POSITION_ORDER: Final = 2
"""Derivatives of a position that make an acceleration."""
Order = Literal[0, 1, 2]
"""Derivatives of a reference that make an acceleration."""
ORDERS: Final[dict[str, tuple[Order, str]]] = {ACCELERATION: (0, "m/s^2"), VELOCITY: (1, "m/s")}
"""By channel name: how many derivatives of it make an acceleration, and its unit."""
UNITS = {"position": "m", **{name: unit for name, (_, unit) in ORDERS.items()}}
"""SI unit of the readings, by reference."""


def reference_among(channels: Iterable[str]) -> str | None:
    """The channel that tells the motion where no position does; None where one does, or nothing.

    Beside a position a velocity or an acceleration is a further channel like any other.
    """
    names = {*channels}
    return None if "position" in names else next((name for name in (VELOCITY, ACCELERATION) if name in names), None)


def integrated(reference: Channel) -> Channel:
    """The position that a velocity or an acceleration integrates to, zero at its first reading, at rest there.

    A cubic spline through the readings is integrated, once or twice.

    Raises
    ------
    RecordingError
        If it is called otherwise, is in another unit, or has fewer than two readings.
    """
    order, _ = require_reference(reference)
    if len(reference) < 2:
        raise RecordingError(f"{reference.name}: {len(reference)} readings, expected at least 2")
    spline = scipy.interpolate.CubicSpline(reference.t, reference.y)
    return Channel("position", reference.t, spline.antiderivative(POSITION_ORDER - order)(reference.t), "m")


def require_reference(channel: Channel) -> tuple[Order, str]:
    """How many derivatives of a reference make an acceleration, and its unit.

    Raises
    ------
    RecordingError
        If it is no velocity or acceleration.
    """
    order = ORDERS.get(channel.name)
    if order is None:
        raise RecordingError(f"{channel.name}: no reference; expected {' or '.join(ORDERS)}")
    if not units.same_unit(channel.unit, order[1]):
        raise RecordingError(
            f"{channel.name} is in {channel.unit}; expected {order[1]}, or a unit that converts to it: the reference "
            "moves along one axis; the angle of an arm is [channels] angle, with arm, axle and input_axis in [rig]"
        )
    return order


def with_dwells(
    several: Recording | Dwells | Positions | Sequence[Recording | Dwells | Positions],
) -> list[Recording] | Dwells:
    """Recordings, all dwells and positions among them given to the first; the dwells themselves where there is no
    recording.

    Raises
    ------
    RecordingError
        If there is none, dwells of one output stand beside three, or positions of three beside one or alone.
    """
    items = [several] if isinstance(several, Recording | Dwells | Positions) else list(several)
    if not items:
        raise RecordingError("the list of recordings is empty; expected at least one")
    recordings = [item for item in items if isinstance(item, Recording)]
    dwells = [item for item in items if isinstance(item, Dwells)]
    positions = [item for item in items if isinstance(item, Positions)]
    if positions:
        recordings = with_positions(recordings, positions)
    if not recordings:
        return joined_dwells(dwells)
    return dwells_with_first(recordings, dwells)


def with_positions(recordings: Sequence[Recording], positions: Sequence[Positions]) -> list[Recording]:
    """The recordings of three outputs, the first with static positions of all of them."""
    held, *further = positions
    name, axes = held.name or "positions", {recording.axis for recording in recordings}
    if not axes >= {*"xyz"}:
        beside = f"beside {recordings[0].name or 'a recording'}, which is of one" if recordings else "without a motion"
        raise RecordingError(
            f"{name}: positions of three outputs {beside}; expected all three on a body whose attitude is recorded, as "
            "load_axes reads them. By themselves `accelcal dwells` calibrates positions"
        )
    if further:
        raise RecordingError(f"{further[0].name} beside {name}: expected one set of positions; join both in one table")
    first = recordings[0]
    require_same_sensor(held, first.rig, first.name or "the motion")
    if not math.isclose(held.gravity, first.gravity, rel_tol=1e-9):
        raise RecordingError(
            f"{name}: local gravity is {held.gravity:.7g} m/s^2, but {first.gravity:.7g} m/s^2 in {first.name}; scale "
            "factors of one fit are relative to one: declare the same [dwell] gravity in both sidecars"
        )
    if held.unit != "m/s^2" or not np.all(held.variance > 0.0):
        what = f"in {held.unit}" if held.unit != "m/s^2" else "without any scatter, as if they were exact"
        raise RecordingError(
            f"{name}: outputs {what}; expected means in m/s^2 that scatter: declare unit, scale and noise of the "
            "sensor in the sidecar"
        )
    return [replace(first, positions=held), *recordings[1:]]


def dwells_with_first(recordings: Sequence[Recording], further: Sequence[Dwells] = ()) -> list[Recording]:
    """The recordings, all their dwells and further ones with the first; a table that several sidecars name counts
    once.

    Raises
    ------
    RecordingError
        If there are dwells beside three outputs.
    """
    by_digest = {
        r.dwells.digest or str(number): r.dwells for number, r in enumerate(recordings) if r.dwells is not None
    }
    every = [
        *by_digest.values(),
        *(dwells for dwells in further if not dwells.digest or dwells.digest not in by_digest),
    ]
    if not every:
        return list(recordings)
    first, *others = recordings
    if {recording.axis for recording in others} - {first.axis}:
        raise RecordingError(
            f"{every[0].name or 'dwells'}: dwells of one output beside {first.name.removesuffix(f' {first.axis}')}, "
            "which has three; expected positions of all three: a record of the rests whose sidecar maps accel_x, "
            'accel_y, accel_z, with [dwell] attitude = "unknown". Or fit one output alone, accel with [rig] input_axis'
        )
    return [first.with_dwells(joined_dwells(every)), *(replace(r, dwells=None) for r in others)]


def joined_dwells(several: Sequence[Dwells]) -> Dwells:
    """Dwells of several files as one set; groups of two files have angle zeros of their own.

    Raises
    ------
    RecordingError
        If they are not of one sensor, or declare different gravity or uncertainty of the angle.
    """
    first, *others = several
    if not others:
        return first
    declared = ("sensor.noise", "sensor.bias_instability", "sensor.random_walk", "uncertainty.level")
    for further in others:
        for key, words in (("gravity", "local gravity"), ("angle_std", "an angle_std")):
            if getattr(further, key) != getattr(first, key):
                raise RecordingError(
                    f"{further.name}: {words} of {getattr(further, key):.6g} is declared, but {first.name} has "
                    f"{getattr(first, key):.6g}; dwells of one fit share it: correct [dwell] in one of the sidecars"
                )
        for key in declared:
            if attrgetter(key)(further.rig) != attrgetter(key)(first.rig):
                raise RecordingError(
                    f"{further.name}: {key} is not that of {first.name}; dwells of one fit share it: declare the same "
                    "in both sidecars"
                )
        require_same_sensor(further, first.rig, first.name)
        if further.digest and further.digest in {
            first.digest,
            *(other.digest for other in others if other is not further),
        }:
            raise RecordingError(f"{further.name} is given twice: its dwells would count twice. Give it once")
    warm = [dwells.temperature for dwells in several]
    return replace(
        first,
        angle=np.concatenate([dwells.angle for dwells in several]),
        mean=np.concatenate([dwells.mean for dwells in several]),
        std=np.concatenate([dwells.std for dwells in several]),
        duration=np.concatenate([dwells.duration for dwells in several]),
        samples=np.concatenate([dwells.samples for dwells in several]),
        group=tuple(f"{k}: {group}" if group else str(k) for k, dwells in enumerate(several) for group in dwells.group),
        temperature=None
        if any(warmth is None for warmth in warm)
        else np.concatenate([w for w in warm if w is not None]),
        name=" and ".join(dwells.name for dwells in several),
        digest=hashlib.sha256(" ".join(dwells.digest for dwells in several).encode()).hexdigest(),
        assumptions=tuple(dict.fromkeys(text for dwells in several for text in dwells.assumptions)),
    )


__dir__ = listing(globals())
