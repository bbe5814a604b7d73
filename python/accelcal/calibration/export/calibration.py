"""What is exported of a fit: the inverse in both number formats, its bounds, its test vector, and what is left out; and
the comment of an exported file, in plain ASCII and equal in every language."""

from __future__ import annotations

import math
import re
import textwrap
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from pathlib import Path
from typing import ClassVar
from urllib.parse import urlsplit

import numpy as np
from numpy.typing import ArrayLike

from accelcal._core import __version__
from accelcal._support.errors import AccelcalError, optional
from accelcal._support.result import Storable
from accelcal._support.values import leaves
from accelcal.calibration.characteristic import COVERAGE_FACTOR, STATIC, Characteristic, LeftOut, characteristic
from accelcal.calibration.export.approximate import (
    DOUBLE,
    SINGLE,
    Domain,
    Inverse,
    NotInvertible,
    Proven,
    evaluate,
    invert,
)
from accelcal.data import Array, normalise
from accelcal.data.arrays import VANISHING
from accelcal.estimation.estimate import Fit, tied_sum
from accelcal.model import Estimate


class NotExportable(AccelcalError):
    """A model that cannot become a function of one reading. The text names the effects and the next step."""


def require_finite(parts: Mapping[str, object]) -> None:
    """Refuse NaN and infinity anywhere in what is exported.

    Parameters
    ----------
    parts : by the words that name each in a sentence: numbers, arrays, or objects that hold some.

    Raises
    ------
    NotExportable
        Naming the first part with a number that is not finite.
    """
    for words, part in parts.items():
        for _, _, value in leaves(part):
            if isinstance(value, float) and not math.isfinite(value):
                raise NotExportable(
                    f"{words} {'is not a number' if math.isnan(value) else 'is infinite'}, so nothing is exported; fit "
                    "the model again: accelcal fit RUN.csv -o MODEL.json"
                )


def require_covariance(P: np.ndarray[tuple[int, ...], np.dtype[np.float64]]) -> None:
    """Refuse a covariance that gives some combination of parameters a negative variance.

    Raises
    ------
    NotExportable
        If it has a negative eigenvalue beyond rounding.
    """
    if not len(P):
        return
    size = np.sqrt(np.maximum(np.diag(P), 0.0))
    C = P / np.outer(size, size).clip(min=1e-300)
    if np.any(np.diag(P) < 0.0) or float(np.linalg.eigvalsh(0.5 * (C + C.T))[0]) < -VANISHING * len(P):
        raise NotExportable(
            "the covariance of the parameters is not positive semi-definite, so no uncertainty follows from it and "
            "nothing is exported; fit the model again: accelcal fit RUN.csv -o MODEL.json"
        )


MOST_ERRORS = 3
"""Errors that are spelled out."""


class SchemaError(AccelcalError):
    """A certificate does not follow the schema, or the schema cannot be read. The text states where."""


def require_valid(text: str, schema: Path) -> None:
    """Check a certificate against a local schema.

    Parameters
    ----------
    text : the certificate.
    schema : dcc.xsd; what it imports (SI_Format.xsd, xmldsig-core-schema.xsd) is read from the same folder.

    Raises
    ------
    MissingExtra
        If xmlschema is not installed.
    SchemaError
        If the schema is not usable, or the certificate does not follow it.
    """
    xmlschema = optional("xmlschema", "--schema needs", "dcc")
    if not schema.is_file():
        raise SchemaError(f"{schema}: there is no such file; get dcc.xsd from https://ptb.de/dcc, version 3.2.1")

    def beside(address: str) -> str:
        """An imported schema is the file of its name in the same folder."""
        return str(schema.parent.absolute() / Path(urlsplit(address).path).name)

    try:
        rules = xmlschema.XMLSchema(str(schema.absolute()), uri_mapper=beside, allow="local")
    except (xmlschema.XMLSchemaException, OSError, ValueError) as error:
        reason = " ".join(str(error).split())[:300]
        raise SchemaError(
            f"{schema}: cannot be used as a schema ({reason}); put what it imports, SI_Format.xsd and "
            "xmldsig-core-schema.xsd, beside it"
        ) from None
    errors = [f"{error.path}: {error.reason}" for error in rules.iter_errors(text)]
    if errors:
        more = f" and {len(errors) - MOST_ERRORS} more" if len(errors) > MOST_ERRORS else ""
        raise SchemaError(f"the certificate does not follow {schema}: {'; '.join(errors[:MOST_ERRORS])}{more}")


SHARES = (0.05, 0.25, 0.5, 0.8, 0.95)
"""Places inside the range at which the exported code is tested."""
BEYOND = 0.1
"""Share of the range beyond it at which the straight line is tested."""
NEAR = 0.01
"""Share of the range to both sides of a joint at which it is tested that each side has its own polynomial."""
STEADY = 4
"""Roundings of the test against those of the proof: both evaluations round, beyond the range a little more."""


@dataclass(frozen=True, slots=True)
class Entry:
    """One line of the test vector, in one number format."""

    reading: float
    temperature: float
    acceleration: float
    outside: int
    """Sum of the flags."""


@dataclass(frozen=True, slots=True)
class Code(Storable):
    """The calibration in one number format."""

    derived: ClassVar[tuple[str, ...]] = ("bound", "tolerance")

    proven: Proven
    vector: tuple[Entry, ...]

    @property
    def inverse(self) -> Inverse:
        """The function."""
        return self.proven.inverse

    @property
    def bound(self) -> float:
        """Bound on the distance from the exact inverse inside the range, m/s²."""
        return self.proven.bound

    @property
    def tolerance(self) -> float:
        """What the test vector may be missed by, m/s²."""
        return STEADY * self.proven.rounding


@dataclass(frozen=True, slots=True)
class Calibration(Storable):
    """Everything that the files of an export are written from."""

    derived: ClassVar[tuple[str, ...]] = ("equation", "unit", "std", "remarks")

    fit: Fit
    characteristic: Characteristic
    domain: Domain
    double: Code
    single: Code
    left_out: tuple[LeftOut, ...]
    source: str = ""
    """Name of the model file."""

    @property
    def equation(self) -> str:
        """The model in words."""
        return equation(self)

    @property
    def codes(self) -> tuple[Code, Code]:
        """Both number formats."""
        return self.double, self.single

    @property
    def unit(self) -> str:
        """What the reading is counted in."""
        sensor = self.fit.rig.sensor
        return "m/s²" if sensor.scale is None else sensor.scale_unit or "V"

    def acceleration(self, reading: ArrayLike, temperature: ArrayLike | None = None) -> tuple[Array, Array]:
        """Specific force of readings as the exported code gives it in double, and what lies outside its range.

        Parameters
        ----------
        reading : (n,) in `unit`: V, counts or m/s². Those of a recording are in m/s², whatever the unit here.
        temperature : (n,) or one for all, degC; needed where a coefficient of the model depends on it.

        Returns
        -------
        Acceleration (n,), m/s², and flags (n,): 0 inside, else the sum of `READING_OUTSIDE` and `TEMPERATURE_OUTSIDE`.

        Raises
        ------
        AccelcalError
            If the temperature is missing, or neither one nor as many as the readings.

        Examples
        --------
        >>> import accelcal as ac
        >>> import numpy as np
        >>> rng = np.random.default_rng(1)
        >>> rig = ac.Rig(sensor=ac.Sensor(noise=0.002))
        >>> run = ac.simulate("tones", seconds=12.0, rig=rig, parameters={"bias": 0.05}, rng=rng).recording
        >>> force, outside = calibrate(ac.fit(run)).acceleration(run.accel.y[:3])
        >>> np.round(run.accel.y[:3] - force, 2), outside.any()
        (array([0.05, 0.05, 0.05]), np.False_)
        """
        if self.double.inverse.warmth is not None and temperature is None:
            raise AccelcalError("the model depends on temperature; give it beside the readings, in degC")
        if temperature is not None and np.shape(temperature) not in ((), np.shape(reading)):
            shapes = f"readings of shape {np.shape(reading)}, temperatures of shape {np.shape(temperature)}"
            raise AccelcalError(f"{shapes}; expected one temperature for all, or one for each reading")
        return evaluate(self.double.inverse, reading, 0.0 if temperature is None else temperature)

    @property
    def estimates(self) -> tuple[Estimate, ...]:
        """The parameters that are applied."""
        return tuple(e for e in self.fit.estimates if e.name in self.characteristic.coefficients)

    @property
    def covariance(self) -> Array:
        """Of those among them that are free, in their order, (m, m) SI."""
        rows = [i for i, e in enumerate(self.fit.free) if e.name in self.characteristic.coefficients]
        return self.fit.covariance[np.ix_(rows, rows)]

    @property
    def std(self) -> tuple[float, float]:
        """Least and largest standard uncertainty from the fit over the range, at the reference temperature, m/s²."""
        spread = [self.characteristic.std(self.fit, float(a)) for a in np.linspace(*self.domain.acceleration, 101)]
        return min(spread), max(spread)

    @property
    def remarks(self) -> tuple[str, ...]:
        """Limitations that a user of the calibration must know."""
        notes = [
            f"{name} is {lumped}: one mount and one encoder show only this sum"
            for name in ("bias", "scale_factor")
            if " + " in (lumped := tied_sum(self.fit, self.fit[name]))
        ]
        lowpass = self.fit.rig.lowpass
        if lowpass is not None:
            notes.append(f"the low-pass of {lowpass.cutoff:.6g} Hz that was declared is not undone")
        notes += [
            f"the {channel_filter.name} that was declared is not undone"
            for channel_filter in self.fit.rig.output_filters
        ]
        if not self.fit.rig.coupled:
            notes.append("no constant passed the declared high-pass: the bias is not known and is taken as 0")
        if self.characteristic.clip is not None:
            notes.append(f"the range ends where the output saturates, at {self.characteristic.clip:.5g} m/s²")
        return tuple(notes)


def calibrate(fit: Fit, *, without: Sequence[str] = (), source: str = "") -> Calibration:
    """Make the function that applies a calibration, with its proof.

    Parameters
    ----------
    fit : as a model file holds it.
    without : effects of the sensor that are left out knowingly, among those that cannot be exported.
    source : name of the model file.

    Raises
    ------
    NotExportable
        If effects of the sensor have no place in a function of one reading, or the model cannot be inverted.
    """
    require_finite({f"the estimate of {e.name}": e for e in fit.estimates} | {"the covariance": fit.covariance})
    fit = fit.given_choice
    require_finite({"the declared rig": fit.rig, "the range of the fit": fit.validity, "an origin": fit.origins})
    require_covariance(fit.covariance)
    curve = characteristic(fit)
    possible = [effect.effect for effect in curve.left_out if effect.needed]
    for name in without:
        if name not in possible:
            raise NotExportable(
                f"{name!r} is not among what cannot be exported ({', '.join(possible) or 'nothing here'}); to take an "
                "effect out of the model, use accelcal drop"
            )
    left_out = tuple(
        replace(effect, why=f"{effect.why}; left out by request", needed=False) if effect.effect in without else effect
        for effect in curve.left_out
    )
    refused = [effect for effect in left_out if effect.needed]
    if refused:
        reasons = "; ".join(f"{effect.effect} {effect.why}" for effect in refused)
        names = " ".join(f"--without {effect.effect}" for effect in refused)
        raise NotExportable(
            f"{reasons}. It is part of the sensor's output, so nothing is exported; fit a model without it, or "
            f"leave it out knowingly: {names}"
        )
    domain = _domain(fit, curve)
    try:
        double, single = (invert(curve, fit.rig.sensor, domain, fmt) for fmt in (DOUBLE, SINGLE))
    except NotInvertible as error:
        raise NotExportable(str(error)) from None
    codes = [Code(proven, tuple(_vector(proven.inverse))) for proven in (double, single)]
    calibration = Calibration(fit, curve, domain, codes[0], codes[1], left_out, source)
    require_finite({"the exported code": calibration.codes, "the standard uncertainty over the range": calibration.std})
    return calibration


def _domain(fit: Fit, curve: Characteristic) -> Domain:
    """Accelerations and temperatures of the trained range, as far as the output does not saturate."""
    if "a" not in fit.validity:
        raise NotExportable(
            "the model does not state the range of accelerations of its fit; fit it again: "
            "accelcal fit RUN.csv -o m.json"
        )
    low, high = fit.validity["a"]
    if curve.clip is not None:
        ends = sorted((sign * curve.clip - curve.forward(0.0)) / curve.scale for sign in (-1.0, 1.0))
        low, high = max(low, ends[0]), min(high, ends[1])
    if not low < high:
        raise NotExportable(
            f"the range of acceleration is empty ({low:.4g} to {high:.4g} m/s²); fit a record that moves"
        )
    if not curve.needs_temperature:
        return Domain((low, high), None)
    if "temperature" not in fit.validity:
        raise NotExportable("the model depends on temperature but its fit had none; fit a record with a temperature")
    return Domain((low, high), fit.validity["temperature"])


def _vector(inverse: Inverse) -> Iterator[Entry]:
    """Readings inside, at the ends, beyond them and on both sides of every joint, with what must come out."""
    fmt, w = inverse.format, inverse.warmth
    centre = w.centre if w else 0.0
    length = Fraction(inverse.high) - Fraction(inverse.low)
    places = [fmt.nearest(Fraction(inverse.low) + Fraction(share) * length) for share in SHARES]
    for end, way in ((inverse.low, -1.0), (inverse.high, 1.0)):
        places += [end, fmt.next(end, way), fmt.nearest(Fraction(end) + Fraction(way * BEYOND) * length)]
    for segment in inverse.segments[1:]:
        near = Fraction(NEAR) * length
        places += [segment.low, fmt.next(segment.low, -1.0)]
        places += [fmt.nearest(Fraction(segment.low) + way * near) for way in (-1, 1)]
    yield from _entries(inverse, sorted(places), centre)
    if w is not None:
        for T in (centre - w.half, centre + w.half, centre - 1.5 * w.half, centre + 1.5 * w.half):
            yield from _entries(inverse, places[: len(SHARES)], fmt.nearest(T))


def _entries(inverse: Inverse, readings: Sequence[float], temperature: float) -> Iterator[Entry]:
    a, outside = evaluate(inverse, np.array(readings), np.full(len(readings), temperature))
    for reading, at, flags in zip(readings, a, outside, strict=True):
        yield Entry(reading, temperature, float(at), int(flags))


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


RESERVED = re.compile(
    "abstract|as|async|await|become|box|break|const|continue|core|crate|do|dyn|else|enum|extern|false|final|fn|for|gen|if"
    "|impl|in|let|loop|macro|match|mod|move|mut|override|parameters|priv|pub|ref|return|self|static|struct|super|trait|true|try|type"
    "|typeof|unsafe|unsized|use|virtual|where|while|yield"
    r"|assert|complex|ctype|errno|fenv|float|inttypes|iso646|limits|locale|math|setjmp|signal|std\w*|string|tgmath|time"
    "|wchar|wctype"
)
"""Words that no module of Rust is called by, and headers of C, which a file of their name beside a program replaces."""


def identifier(text: str) -> str:
    """A name for functions, from the name of a file."""
    name = re.sub(r"\W+", "_", text, flags=re.ASCII).strip("_").lower()
    return name if re.match("[a-z]", name) and not RESERVED.fullmatch(name) else f"sensor_{name}".rstrip("_")


def strict(lost: str) -> str:
    """Guard of C against -ffast-math and the parts of it, with which NaN is taken for a number or sums change."""
    parts = "defined(__ASSOCIATIVE_MATH__) || defined(__RECIPROCAL_MATH__) || defined(_M_FP_FAST)"
    return f"""\
#if defined(__FAST_MATH__) || (defined(__FINITE_MATH_ONLY__) && __FINITE_MATH_ONLY__) \\
    || {parts}
#error "compile without -ffast-math and its parts, or {lost} do not hold"
#endif"""


def upwards(value: float) -> str:
    """A bound in two digits, never smaller than it is.

    Examples
    --------
    >>> upwards(1.231e-13), upwards(0.0)
    ('1.3e-13', '0')
    """
    if value == 0.0:
        return "0"
    step = 10.0 ** (math.floor(math.log10(value)) - 1)
    return f"{(math.floor(value / step) + 1) * step:.2g}"


def sensor_name(c: Calibration) -> str:
    """Model and serial number, as far as they are declared."""
    sensor = c.fit.rig.sensor
    return " ".join(filter(None, (sensor.model, sensor.serial))) or "an accelerometer without a declared name"


def equation(c: Calibration) -> str:
    """The forward model in symbols."""
    terms = [STATIC[name] for name in c.characteristic.coefficients]
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
    readings = f"{c.double.inverse.low:.6g} to {c.double.inverse.high:.6g} {unit(c.unit)}"
    text = f"{low:.6g} m/s^2 to {high:.6g} m/s^2 (readings {readings}"
    w = c.double.inverse.warmth
    if w is None:
        return f"{text})"
    return f"{text} at {w.centre:.4g} degC), {w.centre - w.half:.4g} degC to {w.centre + w.half:.4g} degC"


def left_out(c: Calibration) -> list[str]:
    """One sentence for each effect that is not applied."""
    return [f"{effect.effect} {effect.why}" for effect in c.left_out] or ["nothing"]


def sentences(c: Calibration) -> dict[str, Sequence[str]]:
    """Sentences by the heading above them; the first ones have none."""
    least, most = c.std
    beyond = "Beyond the range of readings acceleration is extrapolated in a straight line and a flag is returned."
    if c.double.inverse.warmth is not None:
        beyond += (
            " Beyond the range of temperature the bias is extrapolated in a straight line, the scale factor is held, "
            "and another flag is returned."
        )
    return {
        "": [
            f"From a reading of {sensor_name(c)} ({c.unit}) to specific force along its input axis (m/s^2), gravity "
            "included.",
            f"Written by accelcal {__version__} from {c.source or 'a fit'}; the model is in forward sense (IEEE 1293)"
            f"{f', T from {c.characteristic.reference:.6g} degC' if c.characteristic.needs_temperature else ''}:",
            f"{equation(c)}; {reading(c)}.",
        ],
        "Parameters, with standard uncertainties from the fit": [
            f"{e.symbol} = {e.value:.9g} {unit(e.unit)}".rstrip()
            + (f", {e.std:.2g}" if e.std > 0.0 else ", held")
            + f" ({e.name})"
            for e in c.estimates
        ],
        "Valid for": [validity(c)],
        "Error inside that range": [
            f"Distance from the exact inverse of the model, proven: at most {upwards(c.double.bound)} m/s^2 in double, "
            f"{upwards(c.single.bound)} m/s^2 in float, rounding included, for the number that is passed in, with "
            "IEEE 754 arithmetic, fused or not.",
            f"Of the calibration itself: standard uncertainty from the fit {least:.2g} m/s^2 to {most:.2g} m/s^2 "
            f"(expanded uncertainty, coverage factor 2: {COVERAGE_FACTOR * most:.2g} m/s^2); noise of the reading and "
            "declared uncertainties of the rig come on top.",
        ],
        "Outside": [beyond],
        "Not applied": left_out(c),
        "Note": c.remarks or ["nothing"],
        "Fitted to": [f"{name}, SHA-256 {digest}" for name, digest in c.fit.sources],
    }


def comment(c: Calibration) -> list[str]:
    """All of that as lines of text without comment marks."""
    lines: list[str] = []
    for heading, texts in sentences(c).items():
        lines += ["", f"{heading}:"] if heading else []
        for text in texts:
            indent = "  " if heading else ""
            lines += textwrap.wrap(
                plain(text), WIDTH, initial_indent=indent, subsequent_indent=indent + ("  " if heading else "")
            )
    return lines
