"""The sidecar: what the user declares of sensor, rig and columns, in TOML, checked key by key."""

from __future__ import annotations

import difflib
import json
import math
import re
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import partial
from itertools import groupby
from pathlib import Path
from typing import Any, Literal

from accelcal._support.arguments import check_fields
from accelcal._support.errors import AccelcalError
from accelcal.data import (
    ACCELERATION,
    ANGLE,
    GRAVITY,
    GYROSCOPE,
    LEVERS,
    NO_LABELS,
    OUTPUTS,
    PLACE,
    QUATERNION,
    VELOCITY,
    ChannelFilter,
    DwellSetup,
    Finding,
    LowPass,
    RecordingError,
    Rig,
    RunLabels,
    Sensor,
    high_passes,
    low_passes,
    reference_among,
    units,
)
from accelcal.data.dwells import ATTITUDES
from accelcal.data.orientation import Sense
from accelcal.data.recording import days_of
from accelcal.data.rig import KINDS, Pass, Uncertainty
from accelcal.io.files import content_of, is_there, shown
from accelcal.io.table import SIDECAR_BYTES, Order

ASSUMED_ARM = (
    "arm_std is not declared: 1 % of the arm is assumed, at least 1 mm; the scale factor shares it where both act alike"
)
_THREE_OUTPUTS = "accel_x, accel_y and accel_z beside [channels.attitude]"
ASSUMED_TOLERANCE = (
    "tolerance of the low-pass is not declared: the fit takes its corner as exact; a delay counts as an effect only "
    "beyond 5 % of its time constant"
)
ASSUMED_LOWPASS = "no low-pass is declared for the accelerometer channel: none is assumed"
ASSUMED_NOISE = "sensor noise density is not declared: there is nothing to compare the fitted noise with"
ASSUMED_ZERO = "sensor zero is not declared: 0 is assumed, so the whole electrical offset counts as bias"
ASSUMED_OFFSET_TOLERANCE = "offset_tolerance is not declared: the clocks are taken as meant to agree"


@dataclass(frozen=True, slots=True)
class Clock:
    """Where the stamps of a channel come from: a column, or a constant rate."""

    column: str | None = None
    unit: str | None = None
    rate: float | None = None
    """Hz; the first sample is at 0 s. Of the counter in `column` where that is given."""
    date: str | None = None
    """Column of the dates, where `column` has the times of day alone."""
    fraction: Source | None = None
    """Column of what is to be added to each stamp: the fraction of its second."""
    order: Order | None = None
    """Of day and month in the dates; None = as the dates themselves say."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where a channel comes from."""

    column: str
    unit: str | None = None
    time: Clock | None = None
    """None = the common time column."""
    scale: units.Sensitivity | None = None
    """Of a column in V or counts; that of the accelerometer is the sensor's."""
    zero: float = 0.0
    """What it reads where the channel is 0, V or counts."""
    where: tuple[str, float | str] | None = None
    """The rows of a channel that shares its column with others: a column, and what it holds there."""


@dataclass(frozen=True, slots=True)
class Attitude:
    """Where the orientation of a body comes from."""

    columns: tuple[str, str, str, str]
    """w, x, y, z of the quaternion."""
    maps: Sense
    time: Clock | None = None
    """None = the common time column."""
    noise: float | None = None
    """Standard deviation of one reading about each axis, rad; None = by its scatter."""


@dataclass(frozen=True, slots=True)
class Sidecar:
    """Everything that one sidecar declares."""

    path: Path | None = None
    """None = there is no sidecar."""
    rig: Rig = field(default_factory=Rig)
    time: Clock | None = None
    channels: Mapping[str, Source] = field(default_factory=dict)
    """By channel name; without time."""
    attitude: Attitude | None = None
    input_axis: tuple[float, float, float] | None = None
    """Direction of the input axis in axes of the sensor, of length 1; on an arm outward, forward, along the axle."""
    angle_zero: float | None = None
    """What the angle of an arm reads where the arm is level, rad; None where there is no arm."""
    labels: RunLabels = NO_LABELS
    """When, how mounted, by whom."""
    noticed: tuple[Finding, ...] = ()
    """What was noticed in the recording that this is a part of."""
    dwell: DwellSetup | None = None
    """What is declared of dwells; None without that table."""
    prior_sizes: Mapping[str, str] = field(default_factory=dict)
    """Typical sizes of effects by name, as they are written."""
    axis: str = ""
    """Which of three outputs it was read for."""
    aside: tuple[str, ...] = ()
    """Columns of the other outputs."""

    @property
    def triad(self) -> bool:
        """Whether the attitude of a body with three outputs is recorded."""
        return self.attitude is not None and OUTPUTS["x"] in self.channels

    @property
    def turns(self) -> bool:
        """Whether the position is made from what is recorded of a body that turns."""
        return self.attitude is not None or self.angle_zero is not None


def read_sidecar(path: Path, axis: str = "") -> Sidecar:
    """Read and check a sidecar.

    Parameters
    ----------
    path : the sidecar.
    axis : of three outputs, the one that is read as the output of the accelerometer: x, y or z.

    Raises
    ------
    RecordingError
        Naming file, key, what was found, what was expected and, for an unknown key, the nearest known one.
    """
    return sidecar_from(declared_tables(path), path, axis)


def declared_tables(path: Path) -> dict[str, Any]:
    """The tables of a sidecar as they are written; errors are those of `read_sidecar`."""
    text = sidecar_text(path)
    try:
        return _parsed(text)
    except RecursionError:
        raise RecordingError(
            f"{path}: brackets lie too deep inside one another; expected tables as in the template, accelcal init"
        ) from None
    except tomllib.TOMLDecodeError as error:
        cure = (
            "move its lines under the first, and leave out this one" if "twice" in str(error) else "correct that line"
        )
        raise RecordingError(f"{path}: not valid TOML: {str(error)[:200]}; {cure}.") from None


def sidecar_text(path: Path) -> str:
    """The text of a sidecar.

    Raises
    ------
    RecordingError
        If there is none, it is no regular file, larger than `SIDECAR_BYTES`, or not UTF-8.
    """
    try:
        return content_of(path, "the sidecar file itself", SIDECAR_BYTES).decode("utf-8-sig")
    except FileNotFoundError:
        raise RecordingError(f"{shown(path)}: there is no such sidecar; check the path.") from None
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 at byte {error.start}; save the sidecar as UTF-8.") from None


_MOST_DOTS = 100
"""Dots of a line outside decimal numbers: the parser takes the square of the parts of a dotted key."""


def _parsed(text: str) -> dict[str, Any]:
    """The tables of a sidecar."""
    _require_short_keys(text)
    try:
        return tomllib.loads(text)
    except tomllib.TOMLDecodeError:
        raise
    except ValueError:  # of Python itself
        raise tomllib.TOMLDecodeError("an integer has thousands of digits") from None


def _require_short_keys(text: str) -> None:
    for number, line in enumerate(text.splitlines(), start=1):
        if line.count(".") > _MOST_DOTS and not line.lstrip().startswith("#"):
            dots = re.sub(r"[0-9]\.[0-9]", "", line).count(".")
            if dots > _MOST_DOTS:
                raise tomllib.TOMLDecodeError(f"{dots} dots in line {number}, expected a short key")


def declared_rate(declared: Sidecar, channel: str) -> float | None:
    """Rate that a sidecar declares for a channel without stamps, Hz; None where it has some."""
    source = declared.channels.get(channel)
    clock = (source and source.time) or declared.time
    return None if clock is None or clock.column is not None else clock.rate


def toml_key(name: str) -> str:
    """Return `name` as a TOML key, in quotes only if it needs them."""
    return name if re.fullmatch(r"[A-Za-z0-9_-]+", name) else toml_text(name)


def toml_text(value: str | float) -> str:
    """Return `value` as a TOML string in quotes, or as a number."""
    return json.dumps(value, ensure_ascii=False, default=int).replace("\x7f", "\\u007f")


def toml_of(value: object) -> str:
    """Return a value of a sidecar as TOML has it, tables in one line."""
    if isinstance(value, Mapping):
        return f"{{ {', '.join(f'{toml_key(key)} = {toml_of(item)}' for key, item in value.items())} }}"
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(toml_of, value))}]"
    return toml_text(value) if isinstance(value, str | int | float) else str(value)  # a date


def has_sidecar(path: Path) -> bool:
    """Whether there is a sidecar beside a recording file."""
    return is_there(sidecar_of(path))


def sidecar_of(path: Path) -> Path:
    """Return where the sidecar of a recording file is looked for."""
    return path.parent / f"{path.stem}.toml"


def no_sidecar() -> Sidecar:
    """Return what holds when nothing is declared: the defaults, each with the sentence that states it."""
    return replace(sidecar_from({}, Path()), path=None)


# Checks of single values: each returns the value in SI, or raises a ValueError that says what was expected.
_Check = Callable[[object], Any]
_Sign = Literal["any", "not negative", "positive", "not zero"]


def _text(value: object) -> str:
    if not isinstance(value, str):
        raise AccelcalError(f"found {units.shown(value)}, expected a text in quotes")
    return value


def _one_of(*words: str) -> _Check:
    def check(value: object) -> str:
        if value not in words:
            raise AccelcalError(f"found {units.shown(value)}, expected " + " or ".join(f'"{word}"' for word in words))
        return str(value)

    return check


def _amount(kind: str, sign: _Sign = "any") -> _Check:
    def check(declared: object) -> float:
        value = units.quantity(declared, kind)
        allowed = {"any": True, "not negative": value >= 0, "positive": value > 0, "not zero": value != 0}
        if not allowed[sign]:
            raise AccelcalError(f"found {units.shown(declared)}, expected {units.KINDS[kind].name} that is {sign}")
        return value

    return check


def _electrical(value: object) -> tuple[float, str]:
    """Accept a voltage or counts; return the value with "V" or "count"."""
    try:
        return _amount("count")(value), "count"
    except units.UnitError:
        return _amount("voltage")(value), "V"


def _scaled(values: dict[str, Any], where: str) -> tuple[units.Sensitivity | None, float | None, str]:
    """Take scale and zero out of the values of a table; return both and what they count in."""
    scale, (zero, unit) = values.pop("scale", None), values.pop("zero", (None, ""))
    if scale is not None and zero is not None and scale[1] != unit:
        raise _KeyError(
            _join(where, "zero"),
            f"found a value in {unit}, but scale counts in {scale[1]}; give both in the same",
        )
    return scale, zero, scale[1] if scale is not None else unit


def _size(value: object) -> str:
    """A positive size of an effect as it is written; the search, which knows the effects, compares its unit."""
    units.coefficient(value)
    return str(value)


def _whole(value: object) -> int:
    if not isinstance(value, int) or isinstance(value, bool):
        raise AccelcalError(f"found {units.shown(value)}, expected a whole number")
    if abs(value) > MOST_WHOLE:
        raise AccelcalError(f"found {units.shown(value)}, expected a whole number of at most {MOST_WHOLE}")
    return value


def _numbers(value: object) -> tuple[float, ...]:
    plain = isinstance(value, list) and all(isinstance(x, int | float) and not isinstance(x, bool) for x in value)
    if not plain or not isinstance(value, list):
        raise AccelcalError(f"found {units.shown(value)}, expected a list of numbers such as [0.25, 0.5, 0.25]")
    try:
        numbers = tuple(float(x) for x in value)
    except OverflowError:
        numbers = (math.inf,)
    if not all(map(units.is_measurable, numbers)):
        raise AccelcalError(f"found {units.shown(value)}, expected finite numbers, none beyond {units.LARGEST:g}")
    return numbers


AXES = {"x": (1.0, 0.0, 0.0), "y": (0.0, 1.0, 0.0), "z": (0.0, 0.0, 1.0)}
ON_ARM = dict(zip(("radial", "tangential", "axial"), AXES.values(), strict=True))
_LETTERS = '"x", "y", "z" or a unit vector'
AXLES = {"horizontal": 0.0, "vertical": 0.5 * math.pi}
"""Elevation of an axle, rad."""


def _input_axis(value: object) -> tuple[float, float, float]:
    """A letter, a word for a direction on an arm, or a direction of length 1."""
    words = AXES | ON_ARM
    if isinstance(value, str) and value in words:
        return words[value]
    return _unit_vector(value, '"x", "y", "z"', ', on an arm "radial", "tangential" or "axial"')


def _axle(value: object) -> float:
    """The elevation of an axle, rad: a word, an angle, or its direction to the east, to the north and up."""
    if isinstance(value, str) and value in AXLES:
        return AXLES[value]
    if isinstance(value, str) and any(letter.isdigit() for letter in value):
        elevation: float = _amount("angle")(value)
        if abs(elevation) > AXLES["vertical"]:
            raise AccelcalError(f"found {units.shown(value)}, expected an elevation from -90 deg to 90 deg")
        return elevation
    return math.asin(_unit_vector(value, '"horizontal", "vertical", an elevation such as "30 deg"')[2])


def _unit_vector(value: object, words: str, further: str = "") -> tuple[float, float, float]:
    if not isinstance(value, list) or len(value) != 3:
        vector = "a unit vector such as [0.0, 0.6, 0.8]"
        raise AccelcalError(f"found {units.shown(value)}, expected {words} or {vector}{further}")
    x, y, z = _numbers(value)
    length = math.hypot(x, y, z)
    if not abs(length - 1.0) < UNIT_LENGTH:
        raise AccelcalError(
            f"found {units.shown(value)}, of length {length:.4g}, expected a unit vector"
            + (f"; the same direction is [{x / length:.6g}, {y / length:.6g}, {z / length:.6g}]" if length else "")
        )
    return x / length, y / length, z / length


MOST_WHOLE = 1_000_000
"""Largest whole number: samples of a moving average."""
UNIT_LENGTH = 1e-3
"""Difference of the length of a unit vector from 1 that rounding explains."""
_ANY_OTHER = "*"


def _table(declared: object, where: str, checks: Mapping[str, _Check]) -> dict[str, Any]:
    """Check one table against its keys; the values come back in SI."""
    if not isinstance(declared, Mapping):
        raise _KeyError(where, f"found {units.shown(declared)}, expected a table")
    values = {}
    for key, value in declared.items():
        check = checks.get(key) or checks.get(_ANY_OTHER)
        if check is None:
            raise _KeyError(_join(where, key), f"unknown key; {_nearest(key, checks)}")
        values[key] = _checked(check, value, _join(where, key))
    return values


def _checked(check: _Check, value: object, where: str) -> Any:
    """The value in SI; an error tells where it stands."""
    try:
        return check(value)
    except ValueError as error:
        inside = error.where if isinstance(error, _KeyError) else ""
        raise _KeyError(_join(where, inside), str(error)) from None


class _KeyError(AccelcalError):
    """Something wrong at the key `where`; becomes a RecordingError once the file is known."""

    def __init__(self, where: str, text: str) -> None:
        super().__init__(text)
        self.where = where
        self.text = text


def _join(*parts: str) -> str:
    return ".".join(part for part in parts if part)


def _nearest(key: str, keys: Mapping[str, Any]) -> str:
    if close := difflib.get_close_matches(key, keys, n=1):
        return f'did you mean "{close[0]}"?'
    table = next((f"it stands in [{name}]; " for name, declared in KEYS.items() if key in declared), "")
    return f"{table}known keys here: {', '.join(keys)}"


def _pair(example: str, **keys: _Check) -> _Check:
    """Accept a table with two keys, both needed."""

    def check(value: object) -> dict[str, Any]:
        values = _table(value, "", keys)
        if len(values) < len(keys):
            raise AccelcalError(f"{' and '.join(keys)} are needed, e.g. {example}")
        return {key: values[key] for key in keys}

    return check


def _cell(value: object) -> float | str:
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        raise AccelcalError(f"found {units.shown(value)}, expected a number, or a text in quotes")
    return value


_where = _pair('{ column = "I", equals = 0 }', column=_text, equals=_cell)
_fraction = _pair('{ column = "us", unit = "us" }', column=_text, unit=_text)
_CLOCK: dict[str, _Check] = {
    "column": _text,
    "unit": _text,
    "rate": _amount("frequency", "positive"),
    "date": _text,
    "fraction": lambda value: Source(**_fraction(value)),
    "order": _one_of("DMY", "MDY"),
}


def _clock(value: object) -> Clock:
    values = _table(value, "", {**_CLOCK, "counter": _text})
    if ("column" in values) == ("rate" in values) or ("counter" in values and not values.keys() == {"counter", "rate"}):
        raise AccelcalError(
            'expected either column = "..." with its unit, or rate = "1667 Hz", with counter = "..." where a column '
            "counts the samples"
        )
    counter = {"column": values.pop("counter")} if "counter" in values else {}
    return Clock(**values, **counter)


def _four_columns(value: object) -> tuple[str, ...]:
    if not isinstance(value, list) or len(value) != 4 or not all(isinstance(name, str) for name in value):
        raise AccelcalError(
            f"found {units.shown(value)}, expected four columns such as {list(QUATERNION)}".replace("'", '"')
        )
    if len(set(value)) != 4:
        raise AccelcalError(
            f"found {units.shown(value)}, expected four different columns, w, x, y, z of the quaternion"
        )
    return tuple(value)


_ATTITUDE: dict[str, _Check] = {
    "columns": _four_columns,
    "maps": _one_of("sensor to ENU", "ENU to sensor"),
    "time": _clock,
    "noise": _amount("angle", "positive"),
}


def _attitude(value: object) -> Attitude:
    values = _table(value, "", _ATTITUDE)
    for key, example in (("columns", f"{list(QUATERNION)}".replace("'", '"')), ("maps", '"sensor to ENU"')):
        if key not in values:
            raise AccelcalError(f"{key} is missing; expected e.g. {key} = {example}")
    return Attitude(**values)


_SOURCE: dict[str, _Check] = {
    "column": _text,
    "unit": _text,
    "time": _clock,
    "where": lambda value: tuple(_where(value).values()),
}
_CORNER = (
    'fc and order are needed, e.g. {passes} = {{ kind = "{kind}", fc = "50 Hz", order = 4 }}, with the corner at -3 dB'
)
_FILTERS: dict[str, tuple[tuple[str, ...], set[str], str]] = {
    "RC": (("fc", "tau", "tolerance"), set(), ""),
    "butterworth": (("fc", "order", "rate"), {"fc", "order"}, _CORNER),
    "bessel": (("fc", "order", "rate"), {"fc", "order"}, _CORNER),
    "resonance": (
        ("f0", "Q", "tolerance"),
        {"f0", "Q"},
        'f0 and Q are needed, e.g. {passes} = {{ kind = "resonance", f0 = "120 Hz", Q = 10 }}',
    ),
    "biquad": (
        ("b", "a", "rate"),
        {"b", "a"},
        'b and a are needed, e.g. {{ kind = "biquad", b = [0.2, 0.4, 0.2], a = [1.0, -0.4, 0.2] }}',
    ),
    "sinc": (
        ("length", "order", "rate"),
        {"length"},
        'length is needed, e.g. {{ kind = "sinc", length = 16, order = 3 }}',
    ),
    "fir": (("taps", "rate"), {"taps"}, 'taps are needed, e.g. {{ kind = "fir", taps = [0.25, 0.5, 0.25] }}'),
}
"""Keys that describe a filter of each kind, those that it needs, and what is said where one is missing."""
_FILTER: dict[str, _Check] = {
    "kind": _one_of(*KINDS),
    "fc": _amount("frequency", "positive"),
    "f0": _amount("frequency", "positive"),
    "Q": _amount("ratio", "positive"),
    "tau": _amount("time", "positive"),
    "tolerance": _amount("ratio", "not negative"),
    "order": _whole,
    "length": _whole,
    "b": _numbers,
    "a": _numbers,
    "taps": _numbers,
    "rate": _amount("frequency", "positive"),
}


def _filter(value: object, passes: Pass) -> ChannelFilter:
    """One filter, with the declared tolerance of its time constant or natural frequency."""
    values = _table(value, "", _FILTER)
    kind = values.pop("kind", "RC")
    keys, needed, missing = _FILTERS[kind]
    for key in values:
        if key not in keys:
            raise _KeyError(key, f"no key of {kind}; known keys here: kind, {', '.join(keys)}")
    if kind == "RC" and ("fc" in values) == ("tau" in values):
        word = "low" if passes == "lowpass" else "high"
        raise AccelcalError(
            f'a {word}-pass needs its corner frequency, e.g. {passes} = {{ kind = "RC", fc = "159 Hz" }}, or tau, '
            "not both"
        )
    if not needed <= values.keys():
        raise AccelcalError(missing.format(passes=passes, kind=kind))
    cutoff = 1.0 / (2.0 * math.pi * values["tau"]) if "tau" in values else values.get("fc", values.get("f0"))
    return ChannelFilter(
        kind,
        passes,
        cutoff=cutoff,
        order=values.get("order", 1),
        b=values.get("taps", values.get("b", ())),
        a=values.get("a", ()),
        quality=values.get("Q"),
        length=values.get("length", 0),
        rate=values.get("rate"),
        tolerance=values.get("tolerance"),
    )


def _filters(passes: Pass) -> _Check:
    """One filter or a list of several, as the signal passes them."""

    def check(value: object) -> list[ChannelFilter]:
        if not isinstance(value, list):
            return [_filter(value, passes)]
        if not value:
            raise AccelcalError(
                "found an empty list, expected at least one filter; leave the key out where there is none"
            )
        of_passes = partial(_filter, passes=passes)
        return [_checked(of_passes, item, str(number)) for number, item in enumerate(value, 1)]

    return check


_FILTERED: dict[str, _Check] = {"lowpass": _filters("lowpass"), "highpass": _filters("highpass")}


def _source(example: str = 'column = "accel", unit = "m/s^2"', /, **further: _Check) -> _Check:
    """A channel; scale and zero are of the source, keys of its own come back beside it, and a zero that is an angle."""

    def check(value: object) -> tuple[Source, dict[str, Any]]:
        values = _table(value, "", _SOURCE | further)
        if "column" not in values:
            raise AccelcalError(f"column is missing; expected e.g. {{ {example} }}")
        angle = {"zero": values.pop("zero")} if isinstance(values.get("zero"), float) else {}
        scale, zero, _ = _scaled(values, "")
        if zero is not None and scale is None:
            raise _KeyError("zero", 'needs a scale beside it, e.g. scale = "20 V/m"')
        extra = {key: values.pop(key) for key in further if key in values}
        return Source(**values, scale=scale, zero=zero or 0.0), extra | angle

    return check


def _scaled_source(kind: str | None = None, **further: _Check) -> _Check:
    """A channel that may be in V or counts; that of the accelerometer has its scale and zero in [sensor]."""
    return _source(scale=partial(units.sensitivity, kind=kind), zero=_electrical, **further)


def _reference(kind: str, **further: _Check) -> _Check:
    """What tells the motion: filters, noise of a reading and the uncertainty of its scale come beside it."""
    reading_checks = {"noise": _amount(kind, "positive"), "u_scale": _amount("ratio", "not negative")}
    return _scaled_source(kind, **reading_checks, **_FILTERED, **further)


def _angle(value: object) -> tuple[Source, dict[str, Any]]:
    """The angle of an arm: its zero is a reading, in the unit of the scale or an angle."""

    def zero(given: object) -> object:
        try:
            return _amount("angle")(given)
        except units.UnitError as error:
            if not isinstance(value, Mapping) or "scale" not in value:
                raise AccelcalError(str(error)) from None
            return _electrical(given)

    amounts = {"noise": _amount("angle", "positive"), "resolution": _amount("angle", "positive")}
    scale = partial(units.sensitivity, kind="angle")
    source, extra = _source('column = "angle", unit = "deg"', scale=scale, zero=zero, **amounts)(value)
    return source, {"zero": 0.0} | extra


def _noticed(value: object) -> tuple[Finding, ...]:
    try:
        findings = tuple(Finding(**entry) for entry in value)  # type: ignore[attr-defined]
        for finding in findings:
            check_fields(finding)
    except (TypeError, ValueError):
        raise AccelcalError("expected what accelcal cut writes; delete the key") from None
    return findings


_PROVENANCE = ("text", "provenance", "left empty")


@dataclass(frozen=True, slots=True)
class Key:
    """One key of a sidecar: what it may hold, how it is written, and what people read of it."""

    check: _Check
    at: str = ""
    """Where it is held: in a rig, in `DwellSetup` or in `RunLabels`, as "rig.sensor.noise"; "": written elsewhere."""
    unit: str = ""
    """Unit in which it is written in full, {0} for that of the sensor's output; "1": a bare number; "": a text."""
    usual: str = ""
    """Unit in which it is written where it is round there."""
    about: tuple[str, ...] = ()
    """What it may be, what it is for, what holds when it is missing: a row of the documents, as Markdown."""
    example: str = ""
    """Its value in the template, as TOML; keys without one are not in it."""
    note: str = ""
    """Comment beside it in the template."""
    label: str = ""
    """Its name in the form of the workbench."""
    assumed: str = ""
    """What is assumed where it is not declared."""


KEYS: dict[str, dict[str, Key]] = {
    "sensor": {
        "model": Key(_text, "rig.sensor.model", about=_PROVENANCE, example='"ADXL105"', label="Model"),
        "serial": Key(_text, "rig.sensor.serial", about=_PROVENANCE, example='"12"'),
        "noise": Key(
            _amount("noise density", "positive"),
            "rig.sensor.noise",
            "m/s^2/Hz^0.5",
            "ug/sqrt(Hz)",
            (
                'noise density, one-sided, as in `"225 ug/sqrt(Hz)"`',
                "the fitted noise is compared with it: a residual above 1.5 times the data sheet is never called "
                "adequate",
                "no comparison",
            ),
            '"225 ug/sqrt(Hz)"',
            "one-sided density",
            "Noise density",
        ),
        "bias_instability": Key(
            _amount("acceleration", "positive"),
            "rig.sensor.bias_instability",
            "m/s^2",
            "ug",
            (
                'an acceleration, rms, as in `"100 ug"`',
                "a slow residual beyond it, with no effect to explain it, is reported as a tilt of the sensor or a "
                "slow drift of either channel (remark `turning_sensor`) and nothing is named",
                "0.02 m/s²",
            ),
            '"100 ug"',
            "slow change of the bias, rms",
        ),
        "random_walk": Key(
            _amount("random walk", "positive"),
            "rig.sensor.random_walk",
            "m/s^2/s^0.5",
            about=(
                'a random walk of the bias, as in `"10 ug/sqrt(h)"`',
                "variance of the mean of a long dwell",
                "none",
            ),
        ),
        "range": Key(
            _amount("acceleration", "positive"),
            "rig.sensor.range",
            "m/s^2",
            "g",
            (
                'full scale, ±, as in `"5 g"`',
                "readings at it are left out of every estimate; contributions in percent of full scale",
                "neither",
            ),
            '"5 g"',
            label="Range",
        ),
        "scale": Key(
            partial(units.sensitivity, kind="acceleration"),
            "rig.sensor.scale",
            "{0}/(m/s^2)",
            about=(
                '`"0.25 V/g"` or `"1024 count/g"`',
                "raw readings to m/s²; sensitivity in V/g in the results",
                "needed where the channel is in V or counts",
            ),
            example='"0.25 V/g"',
            note="when the channel is in V or counts",
            label="Scale",
        ),
        "zero": Key(
            _electrical,
            "rig.sensor.zero",
            "{0}",
            about=(
                '`"2.5 V"` or `"2048 count"`, the unit of the scale',
                "output at zero acceleration",
                "0, so the whole electrical offset counts as bias",
            ),
            example='"2.5 V"',
            note="output at zero acceleration",
            label="Output at 0 g",
        ),
    },
    "rig": {
        "axis": Key(
            _one_of("level", "up", "down"),
            "rig.axis",
            about=(
                '`"level"`, `"up"` or `"down"`',
                "gravity along the axis of the stage: none, or ±1 g",
                '`"level"`',
            ),
            example='"level"',
            note="level | up | down",
            label="Axis of the stage",
            assumed='axis is not declared: "level" is assumed, so gravity along the stage axis is taken as 0 m/s^2',
        ),
        "mount": Key(
            _one_of("normal", "reversed", "rolled"),
            "rig.mount",
            about=(
                '`"normal"`, `"reversed"` or `"rolled"`',
                "turned by 180° about the vertical axis, or rolled by 180° about the input axis; runs with different "
                "mounts, fitted together, separate tilt and the cross-axis product",
                '`"normal"`',
            ),
            example='"normal"',
            note="normal | reversed | rolled",
            assumed='mount is not declared: "normal" is assumed, so the input axis points along the stage axis',
        ),
        GRAVITY: Key(
            _amount("acceleration"),
            "rig.gravity_along_axis",
            "m/s^2",
            about=(
                "an acceleration",
                "for a stage at an angle: the specific force at rest along the axis, in place of what `axis` says",
                "as `axis` says",
            ),
            example='"0 m/s^2"',
            label="Gravity along the axis",
        ),
        "ratio": Key(
            _amount("ratio", "not zero"),
            "rig.ratio",
            "1",
            about=(
                "a pure number",
                "1 + k that the rig itself makes: a lever, or a ratio of masses; the scale factor is judged against it",
                "1: a scale factor beyond 0.7 to 1.4 is taken for a wrong unit, range or column",
            ),
        ),
        "input_axis": Key(
            _input_axis,
            example='"x"',
            note="of a body that turns: x | y | z | [0.0, 0.6, 0.8], in axes of attitude or gyroscope",
        ),
        "arm": Key(
            _amount("length", "not negative"),
            "rig.arm",
            "m",
            "mm",
            (
                'a length, as in `"200 mm"`',
                "distance of the sensor from the axle about which it turns by `[channels] angle`; 0 on the axle",
                "needed beside an angle",
            ),
        ),
        "arm_std": Key(
            _amount("length", "positive"),
            "rig.arm_std",
            "m",
            "mm",
            (
                'a length, as in `"0.1 mm"`',
                "standard uncertainty of the arm: it is estimated with that as its prior",
                "1 % of the arm, at least 1 mm",
            ),
            assumed=ASSUMED_ARM,
        ),
        "axle": Key(
            _axle,
            "rig.axle",
            "deg",
            about=(
                '`"horizontal"`, `"vertical"`, its elevation as in `"30 deg"`, or its direction to the east, to the '
                "north and up",
                "how much gravity turns along the axis of a sensor on an arm",
                "needed beside an angle",
            ),
        ),
    },
    "clock": {
        "offset_tolerance": Key(
            _amount("time", "not negative"),
            "rig.offset_tolerance",
            "s",
            "us",
            (
                'a time, as in `"20 us"`',
                "how far the two clocks may disagree without a fault; a delay beyond it is reported as an effect",
                "0",
            ),
            '"0 us"',
            "how far the clocks of accel and position may disagree",
            assumed=ASSUMED_OFFSET_TOLERANCE,
        ),
        "trusted": Key(
            _one_of("position", "accel"),
            "rig.trusted_clock",
            about=(
                '`"position"` or `"accel"`',
                "whose clock runs at the true rate where the two differ: two recordings tell the ratio of their clocks "
                "alone, and k changes by twice the difference",
                "stamps before a declared rate, else the position; the difference is in the budget of k",
            ),
        ),
    },
    "channels": {
        "time": Key(_clock),
        "rate": Key(_amount("frequency", "positive")),
        "accel": Key(_source(**_FILTERED)),
        **{name: Key(_scaled_source(None, **_FILTERED)) for name in OUTPUTS.values()},
        "position": Key(_reference("length", resolution=_amount("length", "positive"))),
        VELOCITY: Key(_reference("speed")),
        ACCELERATION: Key(_reference("acceleration", u_zero=_amount("acceleration", "not negative"))),
        "attitude": Key(_attitude),
        ANGLE: Key(_angle),
        "temperature": Key(_scaled_source("temperature")),
        _ANY_OTHER: Key(_scaled_source()),
    },
    "uncertainty": {
        "encoder_scale": Key(
            _amount("ratio", "not negative"),
            "rig.uncertainty.encoder_scale",
            "1",
            about=(
                "a pure number",
                "relative standard uncertainty of the encoder's scale: all of it goes into k",
                "no budget; the report says which key is missing",
            ),
            example="1e-5",
        ),
        "reference_zero": Key(
            _amount("acceleration", "not negative"),
            "rig.uncertainty.reference_zero",
            "m/s^2",
            about=(
                "an acceleration",
                "standard uncertainty of the zero of a reference accelerometer: all of it goes into K0",
                "0",
            ),
        ),
        "level": Key(
            _amount("angle", "not negative"),
            "rig.uncertainty.level",
            "rad",
            about=(
                'an angle, as in `"0.05 deg"`',
                "standard uncertainty of level: times g0 it goes into K0",
                "the same",
            ),
            example='"0.05 deg"',
        ),
        "misalignment": Key(
            _amount("angle", "not negative"),
            "rig.uncertainty.misalignment",
            "rad",
            about=("an angle", "standard uncertainty of the direction of the input axis", "the same"),
            example='"0.1 deg"',
        ),
        "clock_rate": Key(
            _amount("ratio", "not negative"),
            "rig.uncertainty.clock_rate",
            "1",
            about=(
                'a ratio, as in `"50 ppm"`',
                "relative standard uncertainty of the rate of the clock that is trusted, or of both where none is: "
                "twice goes into k, once where the reference is a velocity",
                "none; where two rates differ and `[clock] trusted` is not declared, their difference",
            ),
        ),
    },
    "run": {
        "date": Key(
            days_of,
            "run.date",
            "date",
            about=(
                "a date, or a date with time, UTC without a zone",
                "drift of the bias from run to run",
                "not tried",
            ),
        ),
        "mounting": Key(
            _text,
            "run.mounting",
            about=(
                "text",
                "runs between which the sensor stayed in place share it; does the bias go with it?",
                "not tried",
            ),
        ),
        "operator": Key(_text, "run.operator", about=("text", "the same for the operator", "not tried")),
        "noticed": Key(
            _noticed,
            "noticed",
            about=(
                "what `accelcal cut` writes",
                "what was noticed in the recording that this is a part of; what it says of clocks counts in the budget",
                "the file is a whole recording",
            ),
        ),
    },
    "dwell": {
        "attitude": Key(
            _one_of(*ATTITUDES, "unknown"),
            about=(
                '`"up"`, `"down"`, `"level"` or `"unknown"`',
                'elevation of the input axis: +90, -90 or 0 degrees; `"unknown"` for positions of a triad held by hand',
                "the recording is no dwell",
            ),
        ),
        "angle": Key(
            _amount("angle"),
            "dwell.angle",
            "deg",
            about=('an angle, as in `"30 deg"`', "the same, in place of `attitude`", "as `attitude` says"),
        ),
        "angle_std": Key(
            _amount("angle", "not negative"),
            "dwell.angle_std",
            "deg",
            about=(
                "an angle",
                "standard uncertainty of each angle, beside the zero of its group; `[uncertainty] level` is that of "
                "the zero",
                "the angles are exact, and a remark says so",
            ),
        ),
        "gravity": Key(
            _amount("acceleration", "positive"),
            "dwell.gravity",
            "m/s^2",
            about=(
                "an acceleration",
                "local gravity, of dwells and along an axis by its attitude; the scale factor is relative to it",
                "standard gravity, and a remark says so",
            ),
        ),
        "table": Key(_text, about=("a file", "dwells of the same sensor for every fit of this recording", "none")),
    },
    "judge": {
        "tolerance": Key(
            _amount("acceleration", "positive"),
            "rig.tolerance",
            "m/s^2",
            "mg",
            (
                'an acceleration, as in `"1 mg"`',
                "effects that contribute less are listed as below tolerance",
                "every effect is listed",
            ),
            '"1 mg"',
            "effects that contribute less are listed as below tolerance",
        )
    },
    "prior": {
        _ANY_OTHER: Key(
            _size,
            about=(
                'size of its coefficient, as in `"100 ug/g^3"`; a pure number may be a bare one',
                "typical size of that effect in this type of sensor, for the second set of "
                "[weights](posterior.md) of confounded causes; 10 and 100 times as much stay as likely",
                "that of [its card](effects.md)",
            ),
        )
    },
}
"""Every key of a sidecar by its table; any other key of [channels] is a side channel, any key of [prior] an effect."""


def markdown(table: str) -> str:
    """The keys of a table as a table of the documents."""
    rows = [
        f"| {', '.join(f'`{name}`' for name, _ in group).replace(_ANY_OTHER, 'EFFECT')} | {' | '.join(about)} |\n"
        for about, group in groupby(KEYS[table].items(), lambda item: item[1].about)
        if about
    ]
    return "".join(["| key | value | what it is for | when it is missing |\n|---|---|---|---|\n", *rows])


def _of_axis(content: dict[str, Any], path: Path, axis: str) -> dict[str, Any]:
    """What a sidecar of three outputs declares of one of them."""
    channels, rig = content.get("channels"), content.get("rig", {})
    if not axis or not isinstance(channels, dict) or not isinstance(rig, dict):
        return content
    if OUTPUTS[axis] not in channels:
        raise RecordingError(f"{path}: channels.{OUTPUTS[axis]} is missing; expected {_THREE_OUTPUTS}")
    for key, given in (("channels.accel", channels), ("rig.input_axis", rig)):
        if key.partition(".")[2] in given:
            raise RecordingError(f"{path}: {key} beside {', '.join(OUTPUTS.values())} is one too many; leave it out")
    return {**with_one_output(content, OUTPUTS[axis]), "rig": {**rig, "input_axis": axis}}


def with_one_output(content: Mapping[str, Any], name: str) -> dict[str, Any]:
    """Tables of a sidecar of three outputs as if it had one of them alone, by the name of its channel."""
    others = {key: channel for key, channel in content["channels"].items() if key not in OUTPUTS.values()}
    output, sensor = content["channels"][name], content.get("sensor", {})
    if isinstance(output, dict) and isinstance(sensor, dict):  # what an output has of its own, the sensor has
        sensor = {**sensor, **{key: output[key] for key in ("scale", "zero") if key in output}}
        output = {key: value for key, value in output.items() if key not in ("scale", "zero")}
    return {**content, "sensor": sensor, "channels": {**others, "accel": output}}


def sidecar_from(content: dict[str, Any], path: Path, axis: str = "") -> Sidecar:
    """What the tables of a sidecar declare; axis and errors are those of `read_sidecar`."""
    of_all = content.get("channels") if axis else None
    others = [(of_all or {}).get(name) for output, name in OUTPUTS.items() if output != axis]
    aside = tuple(str(other.get("column")) for other in others if isinstance(other, dict))
    return replace(_sidecar(_of_axis(content, path, axis), path), axis=axis, aside=aside if axis else ())


def _sidecar(content: Mapping[str, Any], path: Path) -> Sidecar:
    try:
        for name in content:
            if name not in KEYS:
                raise _KeyError(name, f"unknown table; {_nearest(name, KEYS)}")
        checks = {name: {key: entry.check for key, entry in keys.items()} for name, keys in KEYS.items()}
        tables = {name: _table(content.get(name, {}), name, checks[name]) for name in KEYS}
        channels = tables["channels"]
        time, rate = channels.pop("time", None), channels.pop("rate", None)
        if time is not None and rate is not None:
            raise _KeyError("channels.rate", "there is a time as well; keep one of the two")
        _require_one_orientation(tables)
        _require_word_of_rig(content.get("rig", {}).get("input_axis"), arm=ANGLE in channels)
        attitude, input_axis = channels.pop("attitude", None), tables["rig"].pop("input_axis", None)
        return Sidecar(
            path=path,
            rig=_rig(tables, input_axis if ANGLE in channels else None, turning=attitude is not None),
            time=Clock(rate=rate) if rate is not None else time,
            channels={name: source for name, (source, _) in channels.items()},
            attitude=attitude,
            input_axis=input_axis,
            angle_zero=channels[ANGLE][1]["zero"] if ANGLE in channels else None,
            noticed=tables["run"].pop("noticed", ()),
            labels=RunLabels(**tables["run"]),
            dwell=_dwell(tables["dwell"]) if "dwell" in content else None,
            prior_sizes=tables["prior"],
        )
    except _KeyError as error:
        if units.shown(UNKNOWN) in error.text:
            raise RecordingError(unfilled(path, error.where, error.text)) from None
        raise RecordingError(f"{path}: {error.where}: {error.text}") from None


UNKNOWN = "?"
"""What a template puts where the user must fill in a value."""


def unfilled(path: Path, where: str, text: str) -> str:
    """The sentence on a key that is still to be filled in, with its line, whose comment has examples in a template.

    Parameters
    ----------
    path, where : sidecar, and key with the tables that it stands in.
    text : what is expected.
    """
    lines = sidecar_text(path).splitlines() if is_there(path) else []
    for number, line in enumerate(lines, start=1):
        declared = line.partition("#")[0]
        if toml_text(UNKNOWN) in declared and declared.partition("=")[0].strip(' "') in where.split("."):
            return f"{path}, line {number}: {where}: still to be filled in; {text}\n    {line.strip()}"
    return f"{path}: {where}: still to be filled in; {text}"


def _dwell(values: dict[str, Any]) -> DwellSetup:
    given = [key for key in ("attitude", "angle", "table") if key in values]
    if len(given) > 1:
        raise _KeyError(f"dwell.{given[1]}", f"dwell.{given[0]} is given as well; keep one of the two")
    attitude = values.pop("attitude", None)
    angle = values.pop("angle", ATTITUDES.get(attitude or ""))
    return DwellSetup(angle=angle, unknown=attitude == "unknown", **values)


def _require_one_orientation(tables: Mapping[str, dict[str, Any]]) -> None:
    """Refuse an orientation that is declared twice, or in part."""
    rig, channels = tables["rig"], tables["channels"]
    if ANGLE in channels or ("arm" in rig and LEVERS[0] not in channels):
        _require_whole_arm(rig, channels)
        return
    attitude, level, axis = "attitude" in channels, GRAVITY in channels, "input_axis" in rig
    given = "[channels.attitude] gives" if attitude else "channels.gravity_along_axis gives"
    twice = f"{given} gravity along the axis already; keep one of the two"
    rates = [name for name in GYROSCOPE if name in channels]
    rate = next((name for name in GYROSCOPE if name not in rates), "")
    place = next((name for name in PLACE if name not in channels), "")
    further = next((name for name in ("position", ACCELERATION) if name in channels), "")
    outputs = [name for name in OUTPUTS.values() if name in channels]
    lost = next((name for name in OUTPUTS.values() if outputs and name not in outputs), "")
    faults = (
        (GRAVITY in rig and (attitude or level), f"rig.{GRAVITY}", twice),
        (attitude and level, f"channels.{GRAVITY}", twice),
        (
            axis and not attitude and (level or not rates),
            "rig.input_axis",
            "is the direction of the axis in a body whose turning is recorded; declare [channels.attitude] with "
            f"{', '.join(PLACE)}, an angle with rig.arm, or a gyroscope as {', '.join(GYROSCOPE)}, or leave it out",
        ),
        (
            axis and not attitude and rate,
            f"channels.{rate}",
            f"is missing; a gyroscope is {', '.join(GYROSCOPE)}, in rad/s",
        ),
        (
            attitude and not axis and lost,
            f"channels.{lost}",
            f"is missing beside {', '.join(outputs)}; map all three outputs, or one as accel with [rig] input_axis",
        ),
        (
            attitude and not axis and outputs and "accel" in channels,
            "channels.accel",
            f"beside {', '.join(outputs)} is one too many; leave it out",
        ),
        (
            attitude and not axis and not outputs,
            "rig.input_axis",
            f"is missing beside [channels.attitude]; write input_axis = {_LETTERS}"
            + ", or leave it out and give this file as --position beside that of the three outputs"
            * ("accel" not in channels),
        ),
        (
            attitude and place,
            f"channels.{place}",
            "is missing beside [channels.attitude]; the acceleration along a turning axis is made from "
            f'{", ".join(PLACE)}, each as {{ column = "...", unit = "m" }}',
        ),
        (
            attitude and further,
            f"channels.{further}",
            f"beside [channels.attitude] the position along the axis is made from {', '.join(PLACE)}; leave it out",
        ),
        (
            attitude and rig.get("mount", "normal") != "normal",
            "rig.mount",
            "beside [channels.attitude] input_axis says how the sensor points; leave mount out",
        ),
    )
    for wrong, where, text in faults:
        if wrong:
            raise _KeyError(where, text)


def _require_word_of_rig(axis: object, *, arm: bool) -> None:
    """Refuse a word for the input axis that is one of another rig."""
    if isinstance(axis, str) and (axis in ON_ARM) != arm:
        words = '"radial", "tangential", "axial" or a unit vector of these three' if arm else _LETTERS
        beside = f"beside channels.{ANGLE}" if arm else f"without channels.{ANGLE}"
        raise _KeyError("rig.input_axis", f"found {units.shown(axis)} {beside}, expected {words}")


def _require_whole_arm(rig: Mapping[str, Any], channels: Mapping[str, Any]) -> None:
    """Refuse the angle of an arm that is declared in part, or beside another reference."""
    if ANGLE not in channels:
        example = f'[channels] {ANGLE} = {{ column = "...", unit = "deg" }}'
        raise _KeyError("rig.arm", f"is that of a sensor that turns by an angle; write {example}, or leave it out")
    others = ("position", VELOCITY, ACCELERATION, *PLACE, "attitude", GRAVITY, *GYROSCOPE)
    other = next((name for name in others if name in channels), "")
    if other:
        raise _KeyError(
            f"channels.{other}",
            f"beside channels.{ANGLE} the motion is made from the angle and rig.arm; leave one of the two out, or call "
            "an angle that is no reference otherwise, shaft_angle for example",
        )
    for key, what in (
        ("arm", 'the distance from the axle to the sensor; write arm = "200 mm"'),
        ("axle", 'write axle = "horizontal", "vertical", its elevation or its direction'),
        ("input_axis", 'write input_axis = "radial", "tangential", "axial" or a unit vector of these three'),
    ):
        if key not in rig:
            raise _KeyError(f"rig.{key}", f"is missing beside channels.{ANGLE}: {what}")
    for key in (GRAVITY, "mount"):
        if rig.get(key, "normal") != "normal":
            raise _KeyError(
                f"rig.{key}", f"beside channels.{ANGLE} axle and input_axis say how the sensor points; leave it out"
            )


def _rig(tables: Mapping[str, dict[str, Any]], arm_axis: tuple[float, ...] | None = None, *, turning: bool) -> Rig:
    rig, channels = tables["rig"], tables["channels"]
    turning = turning or arm_axis is not None
    lowpass, output_filters = _of_output(channels)
    reference = reference_among(channels) or "position"
    reading = channels[reference][1] if reference in channels else {}
    resolution, noise = reading.get("resolution"), reading.get("noise")
    if arm_axis is not None:  # of the path that is made of an angle
        reach = rig["arm"] * abs(arm_axis[1])
        resolution, noise = (channels[ANGLE][1].get(key, 0.0) * reach or None for key in ("resolution", "noise"))
    uncertainty = dict(tables["uncertainty"])
    for key, of_budget in (("u_scale", "encoder_scale"), ("u_zero", "reference_zero")):
        if key in reading and of_budget in uncertainty:
            raise _KeyError(f"channels.{reference}.{key}", f"uncertainty.{of_budget} is given as well; keep one")
        uncertainty |= {of_budget: reading[key]} if key in reading else {}
    sensor = _sensor(tables["sensor"])
    assumptions = {
        KEYS["rig"]["axis"].assumed: "axis" in rig or GRAVITY in rig or GRAVITY in channels or turning,
        KEYS["rig"]["mount"].assumed: "mount" in rig or turning,
        ASSUMED_LOWPASS: bool(lowpass or output_filters),
        ASSUMED_TOLERANCE: lowpass is None or lowpass.tolerance is not None,
        "encoder resolution is not declared: position noise is estimated from the data alone": bool(resolution or noise)
        or reference != "position"
        or (arm_axis is not None and abs(arm_axis[1]) < UNIT_LENGTH),
        ASSUMED_ARM: arm_axis is None or "arm_std" in rig,
        ASSUMED_NOISE: sensor.noise is not None,
        ASSUMED_ZERO: sensor.scale is None or sensor.zero is not None,
        ASSUMED_OFFSET_TOLERANCE: "offset_tolerance" in tables["clock"],
    }
    return Rig(
        sensor=sensor,
        lowpass=lowpass,
        output_filters=output_filters,
        position_filters=tuple(_declared(channels, reference)),
        resolution=resolution,
        reading_noise=noise,
        uncertainty=Uncertainty(**uncertainty),
        assumptions=tuple(sentence for sentence, declared in assumptions.items() if not declared),
        trusted_clock=tables["clock"].pop("trusted", None),
        **rig,
        **tables["clock"],
        **tables["judge"],
    )


def _declared(channels: Mapping[str, Any], name: str) -> list[ChannelFilter]:
    """Declared filters of one channel: high-passes first."""
    extra = channels[name][1] if name in channels else {}
    filters = [*extra.get("highpass", ()), *extra.get("lowpass", ())]
    alone = len(extra.get("lowpass", ())) == 1
    if any(
        name != "accel" or item.passes == "highpass" or not (alone or item.kind == "resonance")
        for item in filters
        if item.tolerance is not None
    ):
        raise _KeyError(
            f"channels.{name}",
            "a tolerance is estimated where the accelerometer has one RC as its only low-pass, and of its resonance; "
            "leave out tolerance, and give the corner as it was measured",
        )
    return filters


def _of_output(channels: Mapping[str, Any]) -> tuple[LowPass | None, tuple[ChannelFilter, ...]]:
    """The low-pass of the accelerometer where it is one RC alone, and every other filter of it."""
    filters = tuple(_declared(channels, "accel"))
    low = low_passes(filters)
    if len(low) == 1 and low[0].kind == "RC" and low[0].cutoff is not None:
        return LowPass(low[0].cutoff, low[0].tolerance), tuple(high_passes(filters))
    return None, filters


def _sensor(values: dict[str, Any]) -> Sensor:
    scale, zero, unit = _scaled(values, "sensor")
    return Sensor(scale=None if scale is None else scale[0], scale_unit=unit, zero=zero, **values)
