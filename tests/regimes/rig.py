"""A rig: sensor, reference, clocks and faults; it turns a motion into a record that knows its own truth."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tests.worlds.numerics import Array, stream
from tests.worlds.writer import write

from .filters import Declared, analog, behind, keys, position as filtered_position, sampled, without_constant
from .motion import Motion, Piecewise, rc
from .noise import behind_poles, flicker, held, holes, ornstein_uhlenbeck, stamps, student
from .profiles import band_noise

G0 = 9.80665
UG = 1e-6 * G0


@dataclass(frozen=True, slots=True)
class Sensor:
    """An accelerometer with its low-pass."""

    density: float = 225.0
    """True one-sided noise density, ug/sqrt(Hz)."""
    declared: float | None = None
    """As declared; None = the true one."""
    range: float = 5.0
    """g"""
    rate: float = 1667.03
    corner: float | None = 159.0
    """Of the declared RC, Hz; None = there is none."""
    corner_error: float = 0.0
    """Relative error of the true time constant is drawn within this, and this is declared as tolerance."""
    undeclared: tuple[complex, ...] = ()
    """Poles that nobody declared."""
    filters: tuple[Declared, ...] = ()
    """Declared ones, in place of the RC."""
    freedom: float | None = None
    """Of Student-t noise; None = Gaussian."""
    instability: float = 0.0
    """Floor of the Allan deviation of 1/f noise, ug."""
    tilt: float = 0.0
    """Rms angle by which the sensor turns, degrees, below 0.5 Hz."""


@dataclass(frozen=True, slots=True)
class Reference:
    """A position sensor."""

    sigma: float = 1e-6
    """White noise before rounding, m."""
    resolution: float | None = 1e-6
    """Step to which readings are rounded, declared, m; None = neither."""
    rate: float = 833.47
    lag: float = 0.0
    """Time constant of its own low-pass, s."""
    filters: tuple[Declared, ...] = ()
    """Declared ones."""
    multipath: tuple[float, float] | None = None
    """Standard deviation, m, and time constant, s, of Gauss-Markov noise."""
    zeroed: bool = False
    """Whether the reading is set to zero once: at rest, or after a gap."""
    lost: float = 0.0
    """Position that is lost at one instant, while the stage moves, m."""


@dataclass(frozen=True, slots=True)
class Clocks:
    """Stamps, holes and delays."""

    tolerance: float = 20e-6
    """Declared; the true offset is drawn inside it, s."""
    offset: float = 0.0
    """Largest offset that nobody declared; drawn between half of it and all of it, s."""
    skew: float = 0.0
    """Relative error of the accelerometer's clock."""
    rounding: float = 0.0
    """Of the stamps of both channels, s."""
    irregular: float = 0.0
    """Standard deviation of sampling instants that the stamps follow, as a share of the period."""
    jitter: float = 0.0
    """Standard deviation of sampling instants that the stamps do not follow, s."""
    held: float | None = None
    """Rate at which the sensor renews its value, Hz."""
    gap: float = 0.0
    """For this long nothing is recorded at all, after 40 % of the record, s."""
    missing_accel: tuple[float, int] = (0.0, 1)
    """Share, and mean length of a block in samples."""
    missing_position: tuple[float, int] = (0.0, 1)


@dataclass(frozen=True, slots=True)
class Rig:
    """Everything but the motion."""

    sensor: Sensor = Sensor()
    reference: Reference = Reference()
    clocks: Clocks = Clocks()
    temperature: str = ""
    """A side channel: "constant", "noisy" or "ramp"; none if empty."""
    bare: bool = False
    """Whether nothing is declared but the columns."""


@dataclass(frozen=True, slots=True)
class Planted:
    """What is hidden in a record on purpose; each part adds to what the rig measures."""

    output: Callable[[Motion], Piecewise] | None = None
    """What is added to the output before the low-pass, m/s^2."""
    poles: tuple[complex, ...] = ()
    """Of the sensing element, beside those of the rig."""
    wrong: int = 0
    """Number of wrong samples."""
    wrong_size: float = 0.0
    """m/s^2"""
    jitter: float = 0.0
    """s"""


NOTHING = Planted()


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What was measured, and what is true."""

    t_accel: Array
    accel: Array
    """(n,) m/s^2; nan where it was not sampled."""
    t_position: Array
    position: Array
    """(m,) m"""
    motion: Motion
    rig: Rig
    truth: Mapping[str, float]
    """bias, m/s^2; scale_factor; time_offset, s."""
    side: Mapping[str, tuple[Array, Array, str]] = field(default_factory=dict)

    def write(self, directory: Path | str, name: str = "run") -> Path:
        """Write NAME.csv and its sidecar NAME.toml; return the path of the CSV."""
        sensor, reference = self.rig.sensor, self.rig.reference
        channels = {
            "accel": (self.t_accel, self.accel, "m/s^2"),
            "position": (self.t_position, self.position, "m"),
            **self.side,
        }
        if self.rig.bare:
            return write(Path(directory), name, channels, {}, {})
        extra = {}
        if sensor.filters:
            extra["accel"] = ", ".join(keys(sensor.filters))
        elif sensor.corner is not None:
            tolerance = f"{sensor.corner_error!r}"
            extra["accel"] = f'lowpass = {{ kind = "RC", fc = "{sensor.corner:g} Hz", tolerance = {tolerance} }}'
        declared_step = reference.resolution is not None
        step = [f'resolution = "{reference.resolution * 1e6:.9g} um"'] if declared_step else []
        if step or reference.filters:
            extra["position"] = ", ".join([*step, *keys(reference.filters)])
        declared = sensor.density if sensor.declared is None else sensor.declared
        tables = {
            "sensor": {"noise": f"{declared:g} ug/sqrt(Hz)", "range": f"{sensor.range:g} g"},
            "rig": {"axis": "level", "mount": "normal", "gravity_along_axis": "0 m/s^2"},
            "clock": {"offset_tolerance": f"{self.rig.clocks.tolerance * 1e6:g} us"},
        }
        return write(Path(directory), name, channels, extra, tables)


def measure(motion: Motion, rig: Rig, seconds: float, seed: int, planted: Planted = NOTHING) -> Record:
    """Sample a motion with a rig; the same arguments give the same record."""
    unit = stream(seed, 2)
    bias, k = unit.uniform(-0.3, 0.3), unit.uniform(-0.02, 0.02)
    clocks = rig.clocks
    offset = float(unit.uniform(-clocks.tolerance, clocks.tolerance))
    if clocks.offset:
        offset = float(unit.choice([-1.0, 1.0]) * unit.uniform(0.5, 1.0) * clocks.offset)
    corner_error = float(unit.uniform(-1, 1) * rig.sensor.corner_error)
    poles = lowpass(rig.sensor, corner_error)
    t_accel, accel = _accelerometer(motion, rig, seconds, seed, planted, (bias, k, offset), poles)
    t_position, position = _position(motion, rig, seconds, stream(seed, 4))
    side = _thermometer(rig.temperature, seconds, stream(seed, 5))
    truth = {"bias": float(bias), "scale_factor": float(k), "time_offset": offset}
    return Record(t_accel, accel, t_position, position, motion, rig, truth, side)


def lowpass(sensor: Sensor, corner_error: float = 0.0) -> list[complex]:
    """Return the true poles between sensing element and converter."""
    if sensor.filters:
        return [*analog(sensor.filters), *sensor.undeclared]
    declared = [] if sensor.corner is None else rc(sensor.corner / (1 + corner_error))
    return [*declared, *sensor.undeclared]


def _accelerometer(
    motion: Motion,
    rig: Rig,
    seconds: float,
    seed: int,
    planted: Planted,
    parameters: tuple[float, float, float],
    poles: Sequence[complex],
) -> tuple[Array, Array]:
    (bias, k, offset), clocks, sensor = parameters, rig.clocks, rig.sensor
    rng = stream(seed, 3)
    t = stamps(sensor.rate, seconds, rng)
    if clocks.irregular:
        t = np.sort(t + clocks.irregular / sensor.rate * np.clip(rng.standard_normal(len(t)), -2, 2))
        t = t[(t > 0) & (t < seconds)]
    instants = t if clocks.held is None else held(t, clocks.held, rng)
    instants = (instants - offset) / (1 + clocks.skew)
    instants = instants + np.hypot(clocks.jitter, planted.jitter) * rng.standard_normal(len(t))
    blocked = any(f.high for f in sensor.filters)
    y = (1 + k) * behind(motion.a, sensor.filters, [*poles, *planted.poles])(instants) + (0.0 if blocked else bias)
    if planted.output is not None:
        y = y + behind(planted.output(motion), sensor.filters, poles)(instants)
    if sensor.tilt:
        y = y + _turning(motion, sensor.tilt, rng, instants)
    y += without_constant(_sensor_noise(instants, sensor, poles, rng), sensor.rate, sensor.filters)
    y = sampled(y, sensor.filters)
    for i in rng.choice(len(t), planted.wrong, replace=False):
        y[i] += planted.wrong_size * rng.choice([-1.0, 1.0])
    y = np.clip(y, -sensor.range * G0, sensor.range * G0)
    y[holes(len(y), *clocks.missing_accel, rng)] = np.nan
    remaining = _recorded(t, clocks, seconds)
    return _rounded(t[remaining], clocks.rounding), y[remaining]


def _recorded(t: Array, clocks: Clocks, seconds: float) -> NDArray[np.bool_]:
    return (t < 0.4 * seconds) | (t >= 0.4 * seconds + clocks.gap)


def _turning(motion: Motion, rms: float, rng: np.random.Generator, instants: Array) -> Array:
    """Return g0 sin(angle) along the axis while the sensor turns by an angle below 0.5 Hz."""
    step = 1e-2
    begin, end = motion.a.knots[[0, -1]]
    n = int((end - begin) / step) + 2
    angle = np.radians(rms) * band_noise(n, step, 0.05, 0.5, rng)
    return G0 * np.sin(np.interp(instants, begin + step * np.arange(float(n)), angle))


def _sensor_noise(t: Array, sensor: Sensor, poles: Sequence[complex], rng: np.random.Generator) -> Array:
    density, n = sensor.density * UG, len(t)
    shocks = rng.standard_normal(n) if sensor.freedom is None else student(n, sensor.freedom, rng)
    if not poles:
        _, value = np.unique(t, return_inverse=True)  # a held value keeps its noise
        y = density * np.sqrt(sensor.rate / 2) * shocks[value]
    elif len(poles) == 1:
        tau = -1 / np.real(poles[0])
        y = ornstein_uhlenbeck(t, density / np.sqrt(4 * tau), float(tau), shocks)
    else:
        y = behind_poles(n, 1 / sensor.rate, density, poles, rng)
    if sensor.instability:
        y = y + flicker(n, 1 / sensor.rate, sensor.instability * UG, rng)
    return y


def _position(motion: Motion, rig: Rig, seconds: float, rng: np.random.Generator) -> tuple[Array, Array]:
    reference, clocks = rig.reference, rig.clocks
    t = stamps(reference.rate, seconds, rng)
    z = motion.lagged_position(t, reference.lag) if reference.lag else filtered_position(motion, t, reference.filters)
    z += reference.sigma * rng.standard_normal(len(t))
    if reference.multipath is not None:
        z += ornstein_uhlenbeck(t, *reference.multipath, rng.standard_normal(len(t)))
    if reference.zeroed or reference.lost:
        speed = np.abs(motion.velocity(t))
        middle = (t > 0.3 * seconds) & (t < 0.5 * seconds)
        fits = middle & ((speed > 0.02) if reference.lost else (speed < 1e-6))
        at = rng.choice(np.flatnonzero(fits if np.any(fits) else middle))
        if clocks.gap:
            at = int(np.searchsorted(t, 0.4 * seconds + clocks.gap))
        z[at:] += rng.choice([-1.0, 1.0]) * reference.lost if reference.lost else -z[at]
    if reference.resolution is not None:
        z = reference.resolution * np.rint(z / reference.resolution)
    z[holes(len(z), *clocks.missing_position, rng)] = np.nan
    remaining = _recorded(t, clocks, seconds)
    return _rounded(t[remaining], clocks.rounding), z[remaining]


def _rounded(t: Array, step: float) -> Array:
    return np.asarray(step * np.rint(t / step)) if step else t


def _thermometer(kind: str, seconds: float, rng: np.random.Generator) -> dict[str, tuple[Array, Array, str]]:
    if not kind:
        return {}
    t = stamps(10.003, seconds, rng)
    course = {"constant": 0.0 * t, "noisy": 0.05 * rng.standard_normal(len(t)), "ramp": 3.0 * t / seconds}
    return {"temperature": (t, np.round(24.0 + course[kind], 3), "degC")}
