"""Parse a column name: the quantity, the unit in a suffix or in brackets, and its possible roles."""

from __future__ import annotations

import re
from collections.abc import Iterable
from dataclasses import dataclass

from accelcal.data import units
from accelcal.io.table import MOST_NAME

ROLES = {
    "time": ("t", "time", "timestamp", "x_value"),
    "accel": ("accel", "acceleration", "acc"),
    "position": ("position", "pos"),
    "temperature": ("temperature", "temp"),
}
"""Names, without unit and in lower case, by which a column is recognised when no sidecar maps it."""

ANGLES = ("angle", "theta", "phi", "deg", "degrees", "rad", "rev")
"""Names in lower case of the angle of an arm, the last of them units that stand alone."""
ENCODERS = (*ANGLES, "enc", "encoder")
"""Names in lower case of such an angle in a unit of one."""

_ORIENTATION = (
    (re.compile(r"(?:gyr|gyro|gyroscope|omega|angular_velocity|angular_rate)_?(?P<axis>[xyz])"), "gyr_{axis}"),
    (re.compile(r"(?:q|quat|quaternion)_?(?P<axis>[wxyz])"), "q_{axis}"),
    (re.compile(r"pos(?:ition)?_?(?P<axis>[enu])"), "position_{axis}"),
    (re.compile(r"(?:pos(?:ition)?_)?(?P<axis>east|north|up)"), "position_{axis}"),
    (re.compile(r"acc(?:el|eleration|elerometer)?_?(?P<axis>[xyz])"), "accel_{axis}"),
)
"""Names by which columns of an orientation are recognised, and what a sidecar calls them."""

SUFFIXES = {
    "m_per_s2": "m/s^2",
    "mm_per_s2": "mm/s^2",
    "rad_per_s": "rad/s",
    "deg_per_s": "deg/s",
    "m_per_s": "m/s",
    "mm_per_s": "mm/s",
    "mps2": "m/s^2",
    "mps": "m/s",
    "m_s2": "m/s^2",
    "m_s": "m/s",
    "rad_s": "rad/s",
    "deg_s": "deg/s",
} | {
    unit: unit
    for family in (
        ("s", "ms", "us", "ns", "min", "h"),
        ("m", "mm", "um", "nm", "cm", "inch", "ft"),
        ("g", "mg", "ug", "Gal"),
        ("V", "mV", "uV", "count", "counts", "LSB"),
        ("degC", "degF", "K"),
        ("rad", "deg", "arcsec", "arcmin", "dps"),
        ("Hz", "kHz", "Pa", "hPa", "kPa", "bar", "psi", "A", "mA", "percent"),
    )
    for unit in family
}
"""Unit suffixes of column names, after an underscore; letter case counts."""

COUNTED = {
    **dict.fromkeys(("ms", "millis", "milliseconds", "msec"), "ms"),
    **dict.fromkeys(("us", "µs", "micros", "microseconds", "usec"), "us"),
    **dict.fromkeys(("ns", "nanos", "nanoseconds", "nsec"), "ns"),
}
"""Names in lower case that are a unit of time themselves."""
_BRACKETS = re.compile(r"(?P<base>.*?)\s*(?:\[(?P<square>[^\[\]]*)\]|\((?P<round>[^()]*(?:\([^()]*\)[^()]*)*)\))\s*")
_INDEX = re.compile(r"(?P<base>.*?)\s*[\[(](?P<index>\d+)[\])]")
"""A bare number in brackets, which is the place in an array and no unit."""
_QUOTIENT = re.compile(r"(?P<base>.*?\S)\s+/\s+(?:\((?P<group>.*)\)|(?P<unit>\S.*?))\s*")
"""A quantity over its unit, as ISO 80000-1 writes the head of a column."""
_FULL_WIDTH = dict(zip(map(ord, "\uff08\uff09\uff3b\uff3d"), "()[]", strict=True))
"""Brackets of East Asian keyboards."""


@dataclass(frozen=True, slots=True)
class Named:
    """A parsed column name."""

    base: str
    """The quantity, without its unit."""
    suffix: str | None
    """Unit after the last underscore."""
    brackets: str | None
    """Unit in brackets."""


def take_apart(column: str) -> Named:
    """Split a column name into quantity and unit.

    Examples
    --------
    >>> take_apart("accel_m_per_s2")
    Named(base='accel', suffix='m/s^2', brackets=None)
    >>> take_apart("Position [µm]")
    Named(base='Position', suffix=None, brackets='µm')
    >>> take_apart("accel_m_s2[0]")
    Named(base='accel_0', suffix='m/s^2', brackets=None)
    >>> take_apart("accel_mm/s^2")
    Named(base='accel', suffix='mm/s^2', brackets=None)
    >>> take_apart("a / (m/s²)"), take_apart("t / s")
    (Named(base='a', suffix=None, brackets='m/s²'), Named(base='t', suffix=None, brackets='s'))
    """
    if len(column) > MOST_NAME:
        return Named(column, None, None)
    base, brackets, index = column.strip().translate(_FULL_WIDTH), None, ""
    if match := _INDEX.fullmatch(base):
        base, index = match["base"], f"_{match['index']}"
    match = _QUOTIENT.fullmatch(base)
    if match and units.is_unit(match["unit"] or match["group"]):
        base, brackets = match["base"], match["unit"] or match["group"]
    match = _BRACKETS.fullmatch(base)
    if match and (match["square"] is not None or units.is_unit(match["round"])):
        base, brackets = match["base"], match["square"] if match["square"] is not None else match["round"]
    brackets = "1" if brackets == "-" else brackets
    if base.lower() in ANGLES[-4:]:
        return Named(base + index, "deg" if base.lower() == "degrees" else base.lower(), brackets)
    if base.lower() in COUNTED:
        return Named(base + index, COUNTED[base.lower()], brackets)
    parts = base.split("_")
    for k in range(1, len(parts)):  # the longest suffix first: m_per_s2 before s2
        suffix = "_".join(parts[k:])
        if suffix in SUFFIXES or ("/" in suffix and units.is_unit(suffix)):
            return Named("_".join(parts[:k]) + index, SUFFIXES.get(suffix, suffix), brackets)
    return Named(base + index, None, brackets)


def role(base: str) -> str | None:
    """Return the role that a quantity called `base` plays: time, accel, position, temperature, or None."""
    return next((role for role, names in ROLES.items() if base.lower() in names), None)


def orientation_role(base: str) -> str | None:
    """Return what a sidecar calls a quantity of a body that turns: gyr_x, q_w, position_e, accel_x; None if it is none.

    Examples
    --------
    >>> orientation_role("quat_w"), orientation_role("gyro_x"), orientation_role("pos_u"), orientation_role("speed")
    ('q_w', 'gyr_x', 'position_u', None)
    """
    if len(base) > MOST_NAME:
        return None
    for pattern, name in _ORIENTATION:
        match = pattern.fullmatch(base.lower())
        if match:
            return name.format(axis=match["axis"][0])
    return None


def orientation_roles(columns: Iterable[str]) -> dict[str | None, str]:
    """Columns by what a sidecar calls their quantity of a body that turns; under None one that is no such quantity."""
    return {orientation_role(take_apart(column).base): column for column in columns}


def column_name(channel: str, unit: str) -> str:
    """Name a column so that `take_apart` gives back `channel` and `unit`; a pure number has the unit ``[-]``."""
    suffix = next((suffix for suffix, listed in SUFFIXES.items() if listed == unit), None)
    return f"{channel}_{suffix}" if suffix else f"{channel} [{'-' if unit == '1' else unit}]"
