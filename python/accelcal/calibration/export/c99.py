"""The calibration as one C99 header: two functions, a test vector, no memory, no library."""

from __future__ import annotations

import re
from collections.abc import Sequence

from accelcal.calibration.export.approximate import READING_OUTSIDE, SINGLE, TEMPERATURE_OUTSIDE, Warmth
from accelcal.calibration.export.calibration import Calibration, Code, comment, identifier, strict, unit


def header(c: Calibration, file: str) -> str:
    """Return the text of a header.

    Parameters
    ----------
    c : what is exported.
    file : name of the file; functions and macros begin with its stem.
    """
    name = identifier(file.removesuffix(".h"))
    big = name.upper()
    low, high = c.domain.acceleration
    about = "\n".join(f" * {line}".rstrip() for line in comment(c))
    return f"""\
/*
{about}
 *
 * unsigned outside = {name}_acceleration(reading{_given(c)}, &a);      in double
 * unsigned outside = {name}_acceleration_f(reading{_given(c)}, &a);    in float
 * {name}_self_test() and {name}_self_test_f() return how many lines of the test vector fail: 0.
 */
#ifndef {big}_H
#define {big}_H

{strict("bounds and flags")}

#define {big}_READING_OUTSIDE {READING_OUTSIDE}u
#define {big}_TEMPERATURE_OUTSIDE {TEMPERATURE_OUTSIDE}u

/* Range of acceleration, m/s^2. */
#define {big}_LEAST ({literal(c.double, low)})
#define {big}_LARGEST ({literal(c.double, high)})

/* Proven bound on the distance from the exact inverse, m/s^2. */
#define {big}_BOUND {literal(c.double, c.double.bound)}
#define {big}_BOUND_F {literal(c.single, c.single.bound)}

{_function(c, c.double, name)}
{_function(c, c.single, name)}
{_self_test(c.double, name)}
{_self_test(c.single, name)}
#endif
"""


def literal(code: Code, value: float) -> str:
    """A hexadecimal constant of C99, exact."""
    text = re.sub(r"\.?0*p", "p", value.hex())
    return f"{text}f" if code.inverse.format is SINGLE else text


def _given(c: Calibration) -> str:
    return ", temperature" if c.double.inverse.warmth else ""


def _suffix(code: Code) -> str:
    return "_f" if code.inverse.format is SINGLE else ""


def _function(c: Calibration, code: Code, name: str) -> str:
    """One function: its tables, compensation of temperature, choice of the segment, Horner's rule."""
    kind, w = code.inverse.format.name, code.inverse.warmth
    lines = [
        f"/* Reading ({unit(c.unit)}){' and temperature (degC)' if w else ''} to acceleration (m/s^2), in {kind}; "
        "returns 0 inside the range, else the flags. */",
        f"static inline unsigned {name}_acceleration{_suffix(code)}({kind} reading, "
        f"{f'{kind} temperature, ' if w else ''}{kind} *acceleration)",
        "{",
        *_tables(code),
        *([] if w is None else _temperature(code, w, name)),
        *_range(code, name),
        *_polynomial(code),
        f"    if (outside & {name.upper()}_READING_OUTSIDE) {{",
        "        a = a + slope * (y - inside);",
        "    }",
        "    *acceleration = a;",
        "    return outside;",
        "}",
        "",
    ]
    return "\n".join(lines)


def _tables(code: Code) -> list[str]:
    """Coefficients and ranges of the segments, and the variables."""
    inverse, kind, segments = code.inverse, code.inverse.format.name, code.inverse.segments
    rows, columns = len(segments[0].coefficients), len(segments[0].coefficients[0])
    warm = columns > 1

    def number(value: float) -> str:
        return literal(code, value)

    table = ",\n".join(f"        {{\n{_rows(code, s.coefficients)}\n        }}" for s in segments)
    lines = [
        f"    static const {kind} coefficient[{len(segments)}][{rows}]{f'[{columns}]' if warm else ''} = {{",
        table,
        "    };",
        f"    static const {kind} centre[{len(segments)}] = {_row([number(s.centre) for s in segments], True)};",
        f"    static const {kind} per_half[{len(segments)}] = {_row([number(s.per_half) for s in segments], True)};",
    ]
    if len(segments) > 1:
        starts = _row([number(s.low) for s in segments[1:]], True)
        lines += [f"    static const {kind} start[{len(segments) - 1}] = {starts};"]
    return [
        *lines,
        f"    const {kind} low = {number(inverse.low)}, high = {number(inverse.high)};",
        f"    unsigned outside = 0u, segment = 0u, i{', j' if warm else ''};",
        f"    {kind} y = reading, inside, slope = {number(0.0)}, x, a;",
    ]


def _temperature(code: Code, w: Warmth, name: str) -> list[str]:
    """Compensation of the reading for temperature, held at the ends of its range."""
    kind, flag = code.inverse.format.name, f"{name.upper()}_TEMPERATURE_OUTSIDE"
    return [
        f"    const {kind} half = {literal(code, w.half)};",
        f"    {kind} t = temperature - {literal(code, w.centre)};",
        f"    y = y - {literal(code, w.shift)} * t;",
        "    if (!(t >= -half)) {",
        "        t = -half;",
        f"        outside |= {flag};",
        "    } else if (!(t <= half)) {",
        "        t = half;",
        f"        outside |= {flag};",
        "    }",
    ]


def _range(code: Code, name: str) -> list[str]:
    """The reading held at the ends of its range, and the segment that it belongs to."""
    low, high = (literal(code, slope) for slope in code.inverse.slopes)
    count, flag = len(code.inverse.segments), f"{name.upper()}_READING_OUTSIDE"
    lines = [
        "    inside = y;",
        "    if (!(y >= low)) {",
        "        inside = low;",
        f"        slope = {low};",
        f"        outside |= {flag};",
        "    } else if (!(y <= high)) {",
        "        inside = high;",
        f"        slope = {high};",
        f"        outside |= {flag};",
        "    }",
    ]
    if count > 1:
        lines += [
            f"    while (segment < {count - 1}u && inside >= start[segment]) {{",
            "        ++segment;",
            "    }",
        ]
    return [*lines, "    x = (inside - centre[segment]) * per_half[segment];"]


def _polynomial(code: Code) -> list[str]:
    """Horner's rule in x, and in temperature inside it where that matters."""
    kind, w, coefficients = code.inverse.format.name, code.inverse.warmth, code.inverse.segments[0].coefficients
    rows, columns = len(coefficients), len(coefficients[0])
    if columns > 1:
        assert w is not None
        last = f"coefficient[segment][{rows - 1}]"
        return [
            f"    t = t * {literal(code, w.per_half)};",
            f"    a = {last}[{columns - 1}];",
            f"    for (j = {columns - 1}u; j-- > 0u;) {{",
            f"        a = a * t + {last}[j];",
            "    }",
            f"    for (i = {rows - 1}u; i-- > 0u;) {{",
            f"        {kind} row = coefficient[segment][i][{columns - 1}];",
            f"        for (j = {columns - 1}u; j-- > 0u;) {{",
            "            row = row * t + coefficient[segment][i][j];",
            "        }",
            "        a = a * x + row;",
            "    }",
        ]
    return [
        f"    a = coefficient[segment][{rows - 1}];",
        f"    for (i = {rows - 1}u; i-- > 0u;) {{",
        "        a = a * x + coefficient[segment][i];",
        "    }",
    ]


def _rows(code: Code, rows: Sequence[Sequence[float]]) -> str:
    """Coefficients by power of x, one row a line, with what they are in decimals behind."""
    lines = []
    for power, row in enumerate(rows):
        numbers = _row([literal(code, v) for v in row], len(row) > 1)
        comma = "," if power + 1 < len(rows) else ""
        lines.append(f"            {numbers}{comma} /* x^{power}: {', '.join(f'{v:.6g}' for v in row)} */")
    return "\n".join(lines)


def _row(values: list[str], braces: bool) -> str:
    return "{ " + ", ".join(values) + " }" if braces else ", ".join(values)


def _self_test(code: Code, name: str) -> str:
    kind, warm = code.inverse.format.name, code.inverse.warmth is not None
    values = [[e.reading, *([e.temperature] if warm else []), e.acceleration] for e in code.vector]
    table = ",\n".join("        " + _row([literal(code, v) for v in row], True) for row in values)
    flags = ", ".join(f"{e.outside}u" for e in code.vector)
    given = "vector[i][0], vector[i][1]" if warm else "vector[i][0]"
    columns = 3 if warm else 2
    return f"""\
/* Lines of the test vector that fail: the numbers of the model file, up to rounding, in {kind}. */
static inline unsigned {name}_self_test{_suffix(code)}(void)
{{
    static const {kind} vector[{len(values)}][{columns}] = {{
{table}
    }};
    static const unsigned expected[{len(values)}] = {{ {flags} }};
    const {kind} tolerance = {literal(code, code.tolerance)};
    unsigned failed = 0u, i;
    for (i = 0u; i < {len(values)}u; ++i) {{
        {kind} a;
        const unsigned outside = {name}_acceleration{_suffix(code)}({given}, &a);
        const {kind} error = a - vector[i][{columns - 1}];
        if (outside != expected[i] || !(error <= tolerance && error >= -tolerance)) {{
            ++failed;
        }}
    }}
    return failed;
}}
"""
