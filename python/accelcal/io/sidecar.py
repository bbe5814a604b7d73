"""The sidecar: what the user declares of sensor, rig and columns, in TOML, checked key by key."""

from __future__ import annotations

import difflib
import tomllib
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

from accelcal.data import units
from accelcal.data.recording import RecordingError
from accelcal.data.rig import LowPass, Rig, Sensor, Uncertainty

ASSUMED_AXIS = 'axis is not declared: "level" is assumed, so gravity along the stage axis is taken as 0 m/s^2'
ASSUMED_MOUNT = 'mount is not declared: "normal" is assumed, so the input axis points along the stage axis'
ASSUMED_LOWPASS = "no low-pass is declared for the accelerometer channel: none is assumed"
ASSUMED_LOWPASS_TOLERANCE = (
    "tolerance of the low-pass is not declared: the fit takes its corner as exact; a "
    "delay counts as an effect only beyond 5 % of its time constant"
)
ASSUMED_RESOLUTION = "encoder resolution is not declared: position noise is estimated from the data alone"
ASSUMED_NOISE = "sensor noise density is not declared: there is nothing to compare the fitted noise with"
ASSUMED_OFFSET_TOLERANCE = "offset_tolerance is not declared: the clocks are taken as meant to agree"
ASSUMED_ZERO = "sensor zero is not declared: 0 is assumed, so the whole electrical offset counts as bias"


@dataclass(frozen=True, slots=True)
class Clock:
    """Where the stamps of a channel come from: a column, or a constant rate."""

    column: str | None = None
    unit: str | None = None
    rate: float | None = None
    """Hz; the first sample is at 0 s."""


@dataclass(frozen=True, slots=True)
class Source:
    """Where a channel comes from."""

    column: str
    unit: str | None = None
    time: Clock | None = None
    """None = the common time column."""


@dataclass(frozen=True, slots=True)
class Sidecar:
    """Everything that one sidecar declares."""

    path: Path | None = None
    """None = there is no sidecar."""
    rig: Rig = field(default_factory=Rig)
    time: Clock | None = None
    channels: Mapping[str, Source] = field(default_factory=dict)
    """By channel name; without time."""


def read_sidecar(path: Path) -> Sidecar:
    """Read and check a sidecar.

    Raises
    ------
    RecordingError
        Naming file, key, what was found, what was expected and, for an unknown key, the nearest known one.
    """
    try:
        content = tomllib.loads(path.read_text(encoding="utf-8-sig"))
    except FileNotFoundError:
        raise RecordingError(f"{path}: there is no such sidecar; check the path.") from None
    except IsADirectoryError:
        raise RecordingError(f"{path}: this is a directory; give the sidecar file itself.") from None
    except OSError as error:
        raise RecordingError(f"{path}: cannot be read ({error.strerror}).") from None
    except UnicodeDecodeError as error:
        raise RecordingError(f"{path}: not UTF-8 at byte {error.start}; save the sidecar as UTF-8.") from None
    except tomllib.TOMLDecodeError as error:
        raise RecordingError(f"{path}: not valid TOML: {error}; correct that line.") from None
    return _sidecar(content, path)


def sidecar_of(path: Path) -> Path:
    """Return where the sidecar of a recording file is looked for."""
    return path.with_suffix(".toml")


def no_sidecar() -> Sidecar:
    """Return what holds when nothing is declared: the defaults, each with the sentence that states it."""
    return replace(_sidecar({}, Path()), path=None)


# Checks of single values: each returns the value in SI, or raises a ValueError that says what was expected.
_Check = Callable[[object], Any]
_Sign = Literal["any", "not negative", "positive", "not zero"]


def _text(found: object) -> str:
    if not isinstance(found, str):
        raise ValueError(f"found {found!r}, expected a text in quotes")
    return found


def _one_of(*words: str) -> _Check:
    def check(found: object) -> str:
        if found not in words:
            raise ValueError(f"found {found!r}, expected " + " or ".join(f'"{word}"' for word in words))
        return str(found)

    return check


def _amount(kind: str, sign: _Sign = "any") -> _Check:
    def check(found: object) -> float:
        value = units.quantity(found, kind)
        kept = {"any": True, "not negative": value >= 0, "positive": value > 0, "not zero": value != 0}
        if not kept[sign]:
            raise ValueError(f"found {found!r}, expected {units.KINDS[kind].name} that is {sign}")
        return value

    return check


def _electrical(volts: str, counts: str, sign: _Sign) -> _Check:
    """Accept one kind in volts and one in counts; return the value with "V" or "count"."""

    def check(found: object) -> tuple[float, str]:
        try:
            return _amount(counts, sign)(found), "count"
        except units.UnitError:
            return _amount(volts, sign)(found), "V"

    return check


_ANY_OTHER = "*"


def _table(found: object, where: str, checks: Mapping[str, _Check]) -> dict[str, Any]:
    """Check one table against its keys; the values come back in SI."""
    if not isinstance(found, Mapping):
        raise _KeyError(where, f"found {found!r}, expected a table")
    values = {}
    for key, value in found.items():
        check = checks.get(key) or checks.get(_ANY_OTHER)
        if check is None:
            raise _KeyError(_join(where, key), f"unknown key; {_nearest(key, checks)}")
        try:
            values[key] = check(value)
        except _KeyError as error:
            raise _KeyError(_join(where, key, error.where), error.text) from None
        except ValueError as error:
            raise _KeyError(_join(where, key), str(error)) from None
    return values


class _KeyError(ValueError):
    """Something wrong at the key `where`; becomes a RecordingError once the file is known."""

    def __init__(self, where: str, text: str) -> None:
        super().__init__(text)
        self.where = where
        self.text = text


def _join(*parts: str) -> str:
    return ".".join(part for part in parts if part)


def _nearest(key: str, known: Mapping[str, Any]) -> str:
    close = difflib.get_close_matches(key, known, n=1)
    return f'did you mean "{close[0]}"?' if close else "known keys here: " + ", ".join(known)


def _clock(found: object) -> Clock:
    values = _table(found, "", {"column": _text, "unit": _text, "rate": _amount("frequency", "positive")})
    if ("column" in values) == ("rate" in values):
        raise ValueError('expected either column = "..." with its unit, or rate = "1667 Hz"')
    return Clock(**values)


_SOURCE: dict[str, _Check] = {"column": _text, "unit": _text, "time": _clock}
_LOWPASS: dict[str, _Check] = {
    "kind": _one_of("RC"),
    "fc": _amount("frequency", "positive"),
    "tolerance": _amount("ratio", "not negative"),
}


def _lowpass(found: object) -> LowPass:
    values = _table(found, "", _LOWPASS)
    if "fc" not in values:
        raise ValueError('a low-pass needs its corner frequency, e.g. lowpass = { kind = "RC", fc = "159 Hz" }')
    return LowPass(values["fc"], values.get("tolerance"))


def _source(**further: _Check) -> _Check:
    def check(found: object) -> tuple[Source, dict[str, Any]]:
        values = _table(found, "", _SOURCE | further)
        if "column" not in values:
            raise ValueError('column is missing; expected e.g. { column = "accel", unit = "m/s^2" }')
        extra = {key: values.pop(key) for key in further if key in values}
        return Source(**values), extra

    return check


_TABLES: dict[str, dict[str, _Check]] = {
    "sensor": {
        "model": _text,
        "serial": _text,
        "noise": _amount("noise density", "positive"),
        "bias_instability": _amount("acceleration", "positive"),
        "range": _amount("acceleration", "positive"),
        "scale": _electrical("scale in volts", "scale in counts", "not zero"),
        "zero": _electrical("voltage", "count", "any"),
    },
    "rig": {
        "axis": _one_of("level", "up", "down"),
        "mount": _one_of("normal", "reversed", "rolled"),
        "gravity_along_axis": _amount("acceleration"),
    },
    "clock": {"offset_tolerance": _amount("time", "not negative")},
    "channels": {
        "time": _clock,
        "rate": _amount("frequency", "positive"),
        "accel": _source(lowpass=_lowpass),
        "position": _source(resolution=_amount("length", "positive")),
        _ANY_OTHER: _source(),
    },
    "uncertainty": {
        "encoder_scale": _amount("ratio", "not negative"),
        "level": _amount("angle", "not negative"),
        "misalignment": _amount("angle", "not negative"),
    },
    "judge": {"tolerance": _amount("acceleration", "positive")},
}
"""Every key of a sidecar with its check; any other key of [channels] is a side channel."""


def _sidecar(content: Mapping[str, Any], path: Path) -> Sidecar:
    try:
        for name in content:
            if name not in _TABLES:
                raise _KeyError(name, f"unknown table; {_nearest(name, _TABLES)}")
        tables = {name: _table(content.get(name, {}), name, checks) for name, checks in _TABLES.items()}
        channels = tables["channels"]
        time, rate = channels.pop("time", None), channels.pop("rate", None)
        if time is not None and rate is not None:
            raise _KeyError("channels.rate", "there is a time as well; keep one of the two")
        return Sidecar(
            path=path,
            rig=_rig(tables),
            time=Clock(rate=rate) if rate is not None else time,
            channels={name: source for name, (source, _) in channels.items()},
        )
    except _KeyError as error:
        raise RecordingError(f"{path}: {error.where}: {error.text}") from None


def _rig(tables: Mapping[str, dict[str, Any]]) -> Rig:
    rig, channels = tables["rig"], tables["channels"]
    lowpass = channels["accel"][1].get("lowpass") if "accel" in channels else None
    resolution = channels["position"][1].get("resolution") if "position" in channels else None
    sensor = _sensor(tables["sensor"])
    assumptions = {
        ASSUMED_AXIS: "axis" in rig or "gravity_along_axis" in rig,
        ASSUMED_MOUNT: "mount" in rig,
        ASSUMED_LOWPASS: lowpass is not None,
        ASSUMED_LOWPASS_TOLERANCE: lowpass is None or lowpass.tolerance is not None,
        ASSUMED_RESOLUTION: resolution is not None,
        ASSUMED_NOISE: sensor.noise is not None,
        ASSUMED_ZERO: sensor.scale is None or sensor.zero is not None,
        ASSUMED_OFFSET_TOLERANCE: "offset_tolerance" in tables["clock"],
    }
    return Rig(
        sensor=sensor,
        lowpass=lowpass,
        resolution=resolution,
        uncertainty=Uncertainty(**tables["uncertainty"]),
        assumptions=tuple(sentence for sentence, declared in assumptions.items() if not declared),
        **rig,
        **tables["clock"],
        **tables["judge"],
    )


def _sensor(values: dict[str, Any]) -> Sensor:
    scale, unit = values.pop("scale", (None, ""))
    zero, zero_unit = values.pop("zero", (None, ""))
    if scale is not None and zero is not None and unit != zero_unit:
        raise _KeyError(
            "sensor.zero", f"found a value in {zero_unit}, but scale counts in {unit}; give both in the same"
        )
    return Sensor(scale=scale, scale_unit=unit or zero_unit, zero=zero, **values)
