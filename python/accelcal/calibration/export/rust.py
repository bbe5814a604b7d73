"""The calibration as one Rust module: constant functions without the standard library, proven by their test vector."""

from __future__ import annotations

import struct
from collections.abc import Sequence

from accelcal.calibration.export.approximate import READING_OUTSIDE, SINGLE, TEMPERATURE_OUTSIDE
from accelcal.calibration.export.calibration import Calibration, Code, comment, unit, upwards


def module(c: Calibration) -> str:
    """Return the text of a module; compiling it runs its test vector.

    Parameters
    ----------
    c : what is exported.
    """
    about = "\n".join(f"//! {line}".rstrip() for line in comment(c))
    low, high = c.domain.acceleration
    return f"""\
{about}

#![cfg_attr(rustfmt, rustfmt_skip)]
#![allow(dead_code)] // both number formats are here; a program may want one
#![allow(clippy::neg_cmp_op_on_partial_ord)] // a reading that is not a number is outside too
#![allow(clippy::pedantic)] // written by a program

/// The reading lies beyond the range; acceleration is extrapolated in a straight line.
pub const READING_OUTSIDE: u8 = {READING_OUTSIDE};
/// The temperature lies beyond the range.
pub const TEMPERATURE_OUTSIDE: u8 = {TEMPERATURE_OUTSIDE};

/// Least acceleration of the range, m/s^2: {low:.9g}.
pub const LEAST: f64 = {literal(c.double, low)};
/// Largest acceleration of the range, m/s^2: {high:.9g}.
pub const LARGEST: f64 = {literal(c.double, high)};

/// An acceleration, and where it comes from.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct Corrected<T> {{
    /// Specific force along the input axis, m/s^2.
    pub acceleration: T,
    /// 0 inside the range, else the sum of the flags.
    pub outside: u8,
}}

{_function(c, c.double)}
{_function(c, c.single)}
{_self_test(c.double)}
{_self_test(c.single)}
const _: () = assert!(
    self_test() == 0 && self_test_f32() == 0,
    "a number of this file was changed: its test vector fails"
);
"""


def literal(code: Code, value: float) -> str:
    """A constant by its bits, exact."""
    if code.inverse.format is SINGLE:
        (bits,) = struct.unpack(">I", struct.pack(">f", value))
        return f"f32::from_bits(0x{bits >> 16:04x}_{bits & 0xFFFF:04x})"
    text = struct.pack(">d", value).hex()
    return f"f64::from_bits(0x{'_'.join(text[i : i + 4] for i in range(0, 16, 4))})"


def _kind(code: Code) -> str:
    return "f32" if code.inverse.format is SINGLE else "f64"


def _suffix(code: Code) -> str:
    return "_f32" if code.inverse.format is SINGLE else ""


def _numbers(code: Code, values: Sequence[float]) -> str:
    return "[" + ", ".join(literal(code, v) for v in values) + "]"


def _rows(code: Code, rows: Sequence[Sequence[float]], indent: str) -> str:
    """Rows of numbers, with what they are in decimals behind."""
    comments = [", ".join(f"{v:.9g}" for v in row) for row in rows]
    lines = [f"{indent}    {_numbers(code, row)}, // {text}\n" for row, text in zip(rows, comments, strict=True)]
    return "[\n" + "".join(lines) + f"{indent}]"


def _function(c: Calibration, code: Code) -> str:
    inverse, kind = code.inverse, _kind(code)
    segments, w = inverse.segments, inverse.warmth
    rows, columns = len(segments[0].coefficients), len(segments[0].coefficients[0])

    def number(value: float) -> str:
        return literal(code, value)

    segment_rows = "".join(f"        {_rows(code, s.coefficients, ' ' * 8)},\n" for s in segments)
    lines = [
        f"/// Bound on the distance from the exact inverse inside the range, m/s^2: {upwards(code.bound)}.",
        f"pub const BOUND{_suffix(code).upper()}: {kind} = {number(code.bound)};",
        "",
        f"/// Takes a reading ({unit(c.unit)}){' and a temperature (degC)' if w else ''} to acceleration.",
        "#[must_use]",
        f"pub const fn acceleration{_suffix(code)}(reading: {kind}{f', temperature: {kind}' if w else ''}) "
        f"-> Corrected<{kind}> {{",
        f"    const COEFFICIENT: [[[{kind}; {columns}]; {rows}]; {len(segments)}] = [\n{segment_rows}    ];",
        f"    const CENTRE: [{kind}; {len(segments)}] = {_numbers(code, [s.centre for s in segments])};",
        f"    const PER_HALF: [{kind}; {len(segments)}] = {_numbers(code, [s.per_half for s in segments])};",
        f"    const START: [{kind}; {len(segments)}] = {_numbers(code, [s.low for s in segments])};",
        f"    const HIGH: {kind} = {number(inverse.high)};",
        "    let mut outside = 0;",
        "    let y = reading;",
        *_temperature(code),
        "    let (inside, slope) = if !(y >= START[0]) {",
        "        outside |= READING_OUTSIDE;",
        f"        (START[0], {number(inverse.slopes[0])})",
        "    } else if !(y <= HIGH) {",
        "        outside |= READING_OUTSIDE;",
        f"        (HIGH, {number(inverse.slopes[1])})",
        "    } else {",
        "        (y, 0.0)",
        "    };",
        *_choice(len(segments)),
        "    let x = (inside - CENTRE[segment]) * PER_HALF[segment];",
        "    let mut a = 0.0;",
        f"    let mut i = {rows};",
        "    while i > 0 {",
        "        i -= 1;",
        f"        let mut row = COEFFICIENT[segment][i][{columns - 1}];",
        f"        let mut j = {columns - 1};",
        "        while j > 0 {",
        "            j -= 1;",
        "            row = row * tau + COEFFICIENT[segment][i][j];",
        "        }",
        f"        a = if i + 1 == {rows} {{ row }} else {{ a * x + row }};",
        "    }",
        "    if outside & READING_OUTSIDE != 0 {",
        "        a += slope * (y - inside);",
        "    }",
        "    Corrected { acceleration: a, outside }",
        "}",
        "",
    ]
    return "\n".join(lines)


def _temperature(code: Code) -> list[str]:
    """Compensation of the reading for temperature, held at the ends of its range."""
    kind, w = _kind(code), code.inverse.warmth
    if w is None:
        return [f"    let tau: {kind} = 0.0;"]
    return [
        f"    const HALF: {kind} = {literal(code, w.half)};",
        f"    let t = temperature - {literal(code, w.centre)};",
        f"    let y = y - {literal(code, w.shift)} * t;",
        "    let held = if !(t >= -HALF) {",
        "        outside |= TEMPERATURE_OUTSIDE;",
        "        -HALF",
        "    } else if !(t <= HALF) {",
        "        outside |= TEMPERATURE_OUTSIDE;",
        "        HALF",
        "    } else {",
        "        t",
        "    };",
        f"    let tau = held * {literal(code, w.per_half)};",
    ]


def _choice(count: int) -> list[str]:
    if count == 1:
        return ["    let segment = 0;"]
    return [
        "    let mut segment = 0;",
        f"    while segment < {count - 1} && inside >= START[segment + 1] {{",
        "        segment += 1;",
        "    }",
    ]


def _self_test(code: Code) -> str:
    kind, warm = _kind(code), code.inverse.warmth is not None
    lines = [
        f"        ({', '.join(literal(code, v) for v in (e.reading, e.temperature, e.acceleration))}, {e.outside}),\n"
        for e in code.vector
    ]
    return f"""\
/// Lines of the test vector that fail: the numbers of the model file, up to rounding.
#[must_use]
pub const fn self_test{_suffix(code)}() -> usize {{
    const VECTOR: [({kind}, {kind}, {kind}, u8); {len(lines)}] = [
{"".join(lines)}    ];
    const TOLERANCE: {kind} = {literal(code, code.tolerance)};
    let mut failed = 0;
    let mut i = 0;
    while i < VECTOR.len() {{
        let (reading, {"temperature" if warm else "_"}, expected, outside) = VECTOR[i];
        let found = acceleration{_suffix(code)}(reading{", temperature" if warm else ""});
        let error = found.acceleration - expected;
        if found.outside != outside || !(error <= TOLERANCE && error >= -TOLERANCE) {{
            failed += 1;
        }}
        i += 1;
    }}
    failed
}}
"""
