"""Two clocks made one: of two loggers, or of one file whose channels are stamped by clocks of different rates."""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import fields, replace
from pathlib import Path
from shlex import quote
from typing import Any, Literal

import numpy as np

from accelcal.data import GRAVITY, QUATERNION, Array, Channel, Finding, Recording, RecordingError, Rig, Sensor
from accelcal.data.arrays import median_step
from accelcal.data.clocks import Alignment, align, restamped
from accelcal.data.rates import Rate, Search
from accelcal.data.rig import Uncertainty
from accelcal.io import naming
from accelcal.io.sidecar import (
    ASSUMED_ARM,
    ASSUMED_LOWPASS,
    ASSUMED_NOISE,
    ASSUMED_OFFSET_TOLERANCE,
    ASSUMED_TOLERANCE,
    ASSUMED_ZERO,
    KEYS,
)
from accelcal.io.table import Column, Table, on_stamps


def joined(output: Recording, reference: Recording, rates: Rates = (None, None)) -> Recording:
    """One recording of two loggers: the output of one, shifted onto the clock of the position of the other.

    Parameters
    ----------
    output : recording whose position is not used.
    reference : recording whose output is not used; what the rig of `output` leaves open of stage and encoder
        is taken from its rig.
    rates : that are declared in place of stamps.

    Raises
    ------
    RecordingError
        If they cannot be aligned.
    """
    both = replace(
        output,
        origin=replace(
            output.origin,
            file="",
            arguments=f"{output.origin.arguments} --position {quote(reference.origin.file)}",
            columns={**reference.origin.columns, **output.origin.columns},
            scales={**reference.origin.scales, **output.origin.scales},
        ),
        position=reference.position,
        rig=completed(output.rig, reference.rig),
        side={**{key: channel for key, channel in reference.side.items() if key not in output.side}, **output.side},
        name=f"{output.name} with {reference.name}",
        findings=(*output.findings, *reference.findings),
        position_steps=reference.position_steps,
        reference=reference.reference,
    )
    alignment = alignment_of(both, output.side)
    digest = f"{output.digest} at {alignment.shift!r} on {reference.digest}"
    return aligned(replace(both, digest=hashlib.sha256(digest.encode()).hexdigest()), alignment, rates, output.side)


OF_STAGE: dict[tuple[str, ...], str] = {
    ("axis", "gravity_along_axis"): KEYS["rig"]["axis"].assumed,
    ("mount",): KEYS["rig"]["mount"].assumed,
    ("offset_tolerance",): ASSUMED_OFFSET_TOLERANCE,
    ("position_filters",): "",
    ("resolution",): "",
    ("reading_noise",): "",
    ("ratio",): "",
    ("arm", "arm_std", "axle"): "",
    ("tolerance",): "",
}
"""What the sidecar of the encoder may declare, what belongs together in one, and the sentence that tells a value from a
default that was only assumed."""
OF_OUTPUT = {ASSUMED_ARM, ASSUMED_LOWPASS, ASSUMED_NOISE, ASSUMED_TOLERANCE, ASSUMED_ZERO}
"""Assumptions that no declaration of stage and encoder ends."""


def completed(declared: Rig, further: Rig) -> Rig:
    """The rig of the output, with what it leaves open of stage and encoder as the rig of the encoder has it.

    Filters and scale of the output are never taken, and its sensor only where none is declared.
    """
    values = dict[str, Any]()
    for names, assumed in OF_STAGE.items():
        if assumed in declared.assumptions if assumed else all(not getattr(declared, name) for name in names):
            values |= {name: getattr(further, name) for name in names}
    certain, other = declared.uncertainty, further.uncertainty
    if declared.trusted_clock is None and certain.clock_rate is None:  # the rate is that of the clock that is trusted
        values["trusted_clock"] = further.trusted_clock
    else:
        other = replace(other, clock_rate=None)
    missing = [item.name for item in fields(certain) if getattr(certain, item.name) is None]
    values["uncertainty"] = replace(certain, **{name: getattr(other, name) for name in missing})
    values["sensor"] = sensor = _completed_sensor(declared.sensor, further.sensor)
    ended = {*declared.assumptions} - {*further.assumptions} - OF_OUTPUT
    ended |= {ASSUMED_NOISE} if sensor.noise is not None else set()
    return replace(declared, assumptions=tuple(text for text in declared.assumptions if text not in ended), **values)


def _completed_sensor(declared: Sensor, further: Sensor) -> Sensor:
    """The sensor as its sidecar has it; model and serial number of the other where they do not contradict."""
    if declared == Sensor():
        return replace(further, scale=None, scale_unit="", zero=None)  # the output was read without them
    model, serial = declared.model or further.model, declared.serial or further.serial
    if (further.model or model, further.serial or serial) != (model, serial):
        return declared
    return replace(declared, model=model, serial=serial)


def declared_of_two(
    output: Mapping[str, Any], body: Mapping[str, Any], rig: Rig, alignment: Alignment, channels: Sequence[Channel]
) -> dict[str, Any]:
    """Tables of one sidecar of two: those of the output, and of its body what they leave open.

    Parameters
    ----------
    output, body : tables of the sidecars.
    rig : that of both, as `completed` has it.
    alignment : of the two clocks; what it leaves uncertain is declared.
    channels : what was read, in SI, on one clock.
    """
    further = {name: {k: v for k, v in table.items() if (name, k) not in _OF_OUTPUT} for name, table in body.items()}
    tables = {name: {**further.get(name, {}), **output.get(name, {})} for name in {**output, **body}}
    tables["sensor"] = output.get("sensor") or further.get("sensor", {})
    declared = tables["channels"]
    tables["channels"] = {"time": {"column": STAMPS, "unit": "s"}}
    for channel in channels:
        if not channel.name.startswith("attitude."):
            further = {k: v for k, v in declared.get(channel.name, {}).items() if k in _FILTER_KEYS}
            column = naming.column_name(channel.name, channel.unit)
            tables["channels"][channel.name] = {"column": column, "unit": channel.unit, **further}
    columns = [naming.column_name(f"attitude.{name}", "1") for name in QUATERNION]
    senses = {name: value for name, value in declared["attitude"].items() if name not in ("columns", "time")}
    tables["channels"]["attitude"] = {"columns": columns, **senses}
    tables["clock"] = {
        "offset_tolerance": f"{_offset_left(rig, alignment, channels)!r} s",
        **({"trusted": rig.trusted_clock} if rig.trusted_clock else {}),
    }
    rate = _uncertainty_of(rig, alignment).clock_rate
    tables["uncertainty"] = {
        **{k: v for k, v in tables.get("uncertainty", {}).items() if k != "clock_rate"},
        **({"clock_rate": rate} if rate is not None else {}),
    }
    before = [finding for content in (output, body) for finding in content.get("run", {}).get("noticed", ())]
    tables["run"] = {**tables.get("run", {}), **({"noticed": before} if before else {})}
    return tables


_OF_OUTPUT = {("sensor", "scale"), ("sensor", "zero"), ("rig", "input_axis")}
"""Tables and keys that hold of an output alone."""
STAMPS = "t_s"
"""Column of the stamps of what was joined."""
_FILTER_KEYS = "lowpass", "highpass", "noise", "resolution", "u_scale"
"""Keys of a channel that hold of its values in SI, on whatever clock."""


def table_of(path: Path, channels: Sequence[Channel]) -> Table:
    """A table of channels, in SI, on all instants at which one was sampled; `path` stands in messages."""
    t = np.unique(np.concatenate([channel.t for channel in channels]))
    columns = {STAMPS: Column(t)}
    for channel in channels:
        columns[naming.column_name(channel.name, channel.unit)] = Column(*on_stamps(channel, t))
    return Table(
        path, tuple(columns), lambda names: {name: columns[name] for name in names}, lambda i: f"instant {t[i]:.6g} s"
    )


Restamp = Callable[[Array], Array]
Rates = tuple[float | None, float | None]
"""Rates that are declared for output and position in place of stamps, Hz."""


def alignment_of(
    recording: Recording, beside: Iterable[str], sign: float = 1.0, near: Alignment | None = None
) -> Alignment:
    """How the clock of the output lies upon that of the position; with `sign` -1 as if it were mounted otherwise.

    Parameters
    ----------
    beside : side channels that are on the clock of the output.
    near : of another output, at whose shift and rate this one is compared.

    Raises
    ------
    RecordingError
        If they cannot be aligned.
    """
    rig, search = recording.rig, None
    delay = rig.lowpass_tau
    gravity = None if GRAVITY in beside else recording.side.get(GRAVITY)
    if near is not None:
        lag = float(recording.position.t[0] - recording.accel.t[0]) + delay - near.shift
        rate = Rate(0.0, 0.0, 0.0, 0.0) if near.rate is None else near.rate
        search = Search(replace(rate, correlation=0.0, lag=lag), "", slips=near.rate is not None)
    return align(
        recording.accel,
        recording.position,
        polarity=sign * rig.polarity,
        delay=delay,
        name=recording.name,
        gravity=gravity,
        search=search,
    )


def aligned(recording: Recording, alignment: Alignment, rates: Rates, beside: Iterable[str]) -> Recording:
    """A recording of two clocks on one: that of the position, unless the other is trusted.

    Parameters
    ----------
    beside : side channels that are on the clock of the output.
    """
    accel, position, rig, first = recording.accel, recording.position, recording.rig, recording.accel.t[0]
    assumptions = tuple(assumption for assumption in rig.assumptions if assumption != ASSUMED_OFFSET_TOLERANCE)
    free, uncertainty = _offset_left(rig, alignment, (accel, position)), _uncertainty_of(rig, alignment)
    of_output, of_position, note = on_trusted(rig, alignment, rates, first)
    return replace(
        recording,
        accel=restamped(accel, of_output),
        position=restamped(position, of_position),
        rig=replace(rig, offset_tolerance=free, assumptions=assumptions, uncertainty=uncertainty),
        side={
            key: restamped(channel, of_output if key in beside else of_position)
            for key, channel in recording.side.items()
        },
        findings=(note, *recording.findings),
        position_steps=tuple(
            replace(jump, time=float(of_position(np.array([jump.time]))[0])) for jump in recording.position_steps
        ),
        reference=recording.reference and restamped(recording.reference, of_position),
    )


def _offset_left(rig: Rig, alignment: Alignment, channels: Iterable[Channel]) -> float:
    """Largest offset that an alignment leaves, s, at least what is declared."""
    drifted = 4.0 * alignment.std + abs(alignment.skew) * alignment.overlap
    return float(f"{max(rig.offset_tolerance, drifted, *(median_step(channel.t) for channel in channels)):.6g}")


def _uncertainty_of(rig: Rig, alignment: Alignment) -> Uncertainty:
    """What is uncertain of a rig, with the difference of two rates where nothing says which of them is right."""
    skew = 0.0 if alignment.rate is None else abs(float(alignment.rate.skew))
    if not skew or rig.trusted_clock or rig.uncertainty.clock_rate is not None:
        return rig.uncertainty
    return replace(rig.uncertainty, clock_rate=skew)


def on_trusted(rig: Rig, alignment: Alignment, rates: Rates, first: float) -> tuple[Restamp, Restamp, Finding]:
    """How stamps of output and position come onto the clock that is trusted, and the sentence that says so.

    Parameters
    ----------
    rates : that are declared in place of stamps.
    first : stamp of the first sample of the output, s.
    """
    trusted = rig.trusted_clock or ("accel" if rates[1] and not rates[0] else "position")
    begin, later = alignment.instants(np.array([first, first + 1.0]), first)

    def of_output(t: Array) -> Array:
        return t if trusted == "accel" else alignment.instants(t, first)

    def of_position(t: Array) -> Array:
        return first + (t - begin) / (later - begin) if trusted == "accel" else t

    settled = bool(rig.trusted_clock or rig.uncertainty.clock_rate)
    text = f"{_rate_sentence(alignment.rate, trusted, rates, settled)}{alignment.sentence}"
    severity: Literal["note", "warning"] = "warning" if alignment.is_ambiguous else "note"
    return of_output, of_position, Finding("alignment", "accel", 1, alignment.middle, text, severity)


def _rate_sentence(rate: Rate | None, trusted: str, rates: Rates, declared: bool) -> str:
    """Which rate is not as declared, whose clock is trusted, and what k would be with the other; empty where both are
    alike."""
    if rate is None:
        return ""
    by_position = trusted == "position"
    nominal, factor, other = (
        (rates[0], 1.0 + rate.skew, "accel") if by_position else (rates[1], 1.0 / (1.0 + rate.skew), "position")
    )
    runs = f"the clock of the output runs by {abs(rate.skew):.4%} {'fast' if rate.skew > 0.0 else 'slow'}"
    if nominal:
        runs = f"the {'sensor' if by_position else 'position'} runs at {nominal * factor:.7g} Hz, not {nominal:.6g}"
    doubt = (
        f'; with the clock of {other}, [clock] trusted = "{other}", k would differ by {2.0 * (factor - 1.0):+.2%}, '
        "which is in its budget until [clock] trusted is declared"
    )
    return (
        f"{runs} (skew {rate.skew * 1e6:+.1f} ppm, standard deviation {rate.std * 1e6:.2g} ppm, correlation "
        f"{rate.correlation:.3f}): the clock of {trusted} is trusted{'' if declared else doubt}; "
    )


def of_two_clocks(recording: Recording, rates: Rates, beside: Iterable[str]) -> Recording:
    """A recording of one file whose channels have clocks of their own, on one where their rates differ.

    The sign is judged later, and so is whether they are alike at all.
    """
    refusals = []
    for sign in (1.0, -1.0):
        try:
            alignment = alignment_of(recording, beside, sign)
        except RecordingError as error:
            refusals.append(Finding("rates_searched", "accel", 1, 0.0, str(error)))
            continue
        if alignment.rate is None:
            return recording
        return aligned(recording, alignment, rates, beside)
    return replace(recording, findings=(*recording.findings, *refusals[:1]))
