"""Comments of an exported file in plain ASCII, equal in every language."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator

from accelcal._core import __version__
from accelcal.calibration.characteristic import COVERAGE_FACTOR, STATIC
from accelcal.calibration.export.calibration import Calibration
from accelcal.data import normalise

WIDTH = 100
SPELT = {"²": "^2", "³": "^3", "⁻¹": "^-1", "⁻²": "^-2", "µ": "u", "°": "deg ", "√": "sqrt"}


def plain(text: str) -> str:
    """One line of ASCII that cannot end a comment."""
    ascii_text = text
    for letter, spelt in SPELT.items():
        ascii_text = ascii_text.replace(letter, spelt)
    return " ".join(ascii_text.encode("ascii", "replace").decode().split()).replace("*/", "* /").replace("/*", "/ *")


def unit(text: str) -> str:
    """A unit in ASCII, empty for a pure number."""
    return "" if text == "1" else plain(normalise(text))


def identifier(text: str) -> str:
    """A name for functions, from the name of a file."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_").lower()
    return name if re.match("[a-z]", name) else f"sensor_{name}".rstrip("_")


def upwards(value: float, digits: int = 2) -> str:
    """A bound in few digits, never smaller than it is.

    Examples
    --------
    >>> upwards(1.231e-13), upwards(0.0)
    ('1.3e-13', '0')
    """
    if value == 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - digits + 1)
    return f"{(math.floor(value / step) + 1) * step:.{digits}g}"


def sensor_name(c: Calibration) -> str:
    """Model and serial number, as far as they are declared."""
    sensor = c.fit.rig.sensor
    return " ".join(filter(None, (sensor.model, sensor.serial))) or "an accelerometer without a declared name"


def equation(c: Calibration) -> str:
    """The forward model in symbols."""
    terms = [STATIC[name] for name in c.own.coefficients]
    written = sorted(terms, key=lambda term: (term.power, term.mirrored, term.thermal))
    return "output = " + " + ".join(term.text for term in written)


def reading(c: Calibration) -> str:
    """The relation of reading and output."""
    sensor = c.fit.rig.sensor
    if sensor.scale is None:
        return "the reading is the output, m/s^2"
    u = c.unit
    return f"reading = {sensor.zero or 0.0:.10g} {u} + {sensor.scale:.10g} {u}/(m/s^2) x output"


def validity(c: Calibration) -> str:
    """Where the bounds hold."""
    low, high = c.domain.acceleration
    text = f"{low:.6g} m/s^2 to {high:.6g} m/s^2 (readings {c.double.inverse.low:.6g} to {c.double.inverse.high:.6g} "
    text += f"{unit(c.unit)}"
    w = c.double.inverse.warmth
    if w is None:
        return f"{text})"
    return f"{text} at {w.centre:.4g} degC), {w.centre - w.half:.4g} degC to {w.centre + w.half:.4g} degC"


def left_out(c: Calibration) -> list[str]:
    """One sentence for each effect that is not applied."""
    return [f"{effect.effect} {effect.why}" for effect in c.left_out] or ["nothing"]


def sentences(c: Calibration) -> Iterator[tuple[str, list[str]]]:
    """Headings and the sentences under them."""
    yield (
        "",
        [
            f"From a reading of {sensor_name(c)} ({c.unit}) to specific force along its input axis (m/s^2), gravity "
            "included.",
            f"Written by accelcal {__version__} from {c.source or 'a fit'}; the model is in forward sense (IEEE 1293)"
            f"{f', T from {c.own.reference:.6g} degC' if c.own.needs_temperature else ''}:",
            f"{equation(c)}; {reading(c)}.",
        ],
    )
    yield (
        "Parameters, with standard uncertainties from the fit",
        [
            f"{e.symbol} = {e.value:.9g} {unit(e.unit)}".rstrip()
            + (f", {e.std:.2g}" if e.std > 0.0 else ", held")
            + f" ({e.name})"
            for e in c.estimates
        ],
    )
    least, most = c.std
    yield "Valid for", [validity(c)]
    yield (
        "Error inside that range",
        [
            f"Distance from the exact inverse of the model, proven: at most {upwards(c.double.bound)} m/s^2 in double, "
            f"{upwards(c.single.bound)} m/s^2 in float, rounding included, for the number that is passed in, with "
            "IEEE 754 arithmetic, fused or not.",
            f"Of the calibration itself: standard uncertainty from the fit {least:.2g} m/s^2 to {most:.2g} m/s^2 "
            f"(expanded uncertainty, coverage factor 2: {COVERAGE_FACTOR * most:.2g} m/s^2); noise of the reading and "
            "declared uncertainties of the rig come on top.",
        ],
    )
    beyond = "Beyond the range of readings acceleration is extrapolated in a straight line and a flag is returned."
    if c.double.inverse.warmth is not None:
        beyond += " Beyond the range of temperature the bias is extrapolated in a straight line, the scale factor is "
        beyond += "held, and another flag is returned."
    yield "Outside", [beyond]
    yield "Not applied", left_out(c)
    yield "Note", list(c.remarks) or ["nothing"]
    yield (
        "Fitted to",
        [f"{name}, SHA-256 {digest}" for name, digest in c.fit.sources],
    )


def comment(c: Calibration) -> list[str]:
    """All of that as lines of text without comment marks."""
    lines: list[str] = []
    for heading, texts in sentences(c):
        lines += ["", f"{heading}:"] if heading else []
        for text in texts:
            indent = "  " if heading else ""
            lines += textwrap.wrap(
                plain(text), WIDTH, initial_indent=indent, subsequent_indent=indent + ("  " if heading else "")
            )
    return lines
