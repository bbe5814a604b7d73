"""A world: motion, sensor, hidden effects and nuisances, turned into a record that knows its own truth."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.signal import lfilter

from .beyond import BEYOND
from .catalogue import CATALOGUE, Effect
from .numerics import Array, interpolate, lag, stream
from .outside import FAULTS, OUTSIDE
from .scene import G0, Scene, scene, thermometer
from .writer import write

EFFECTS: dict[str, Effect] = CATALOGUE | OUTSIDE | BEYOND | FAULTS
"""Every effect by name."""

Mount = Literal["normal", "reversed", "rolled"]
Reference = Literal["position", "velocity", "reference_acceleration"]
REFERENCE_UNITS: dict[Reference, str] = {"position": "m", "velocity": "m/s", "reference_acceleration": "m/s^2"}


@dataclass(frozen=True, slots=True)
class Sensor:
    """What the data sheet says."""

    name: str
    noise: float
    """One-sided density, m/s²/√Hz."""
    range: float
    """m/s²"""
    widest_bias: float
    """m/s²; zero-g output may be this far from its nominal value."""
    declared_noise: str
    declared_range: str


SENSORS = {
    "ADXL105": Sensor("ADXL105", 225e-6 * G0, 5 * G0, 0.625 / 0.25 * G0, "225 ug/sqrt(Hz)", "5 g"),
    "CXL02": Sensor("CXL02", 20e-6 * G0, 2 * G0, 0.03 * G0, "20 ug/sqrt(Hz)", "2 g"),
}
"""ADXL105 data sheet, rev. A: 250 mV/g, zero-g level ±625 mV; CXL02 as in Stakkeland et al. 2007."""

ACCEL_RATE = 1667.03
"""Hz. The two clocks are free-running: this is not twice the encoder's rate."""
ENCODER_RATE = 833.47
LATERAL_RATE = 500.09
CUTOFF = 159.0
"""Hz; the low-pass as declared."""
RESOLUTION = 1e-6
"""m"""
ENCODER_NOISE = 1e-6
"""Standard deviation of white noise before the encoder rounds, m."""


@dataclass(frozen=True, slots=True)
class Hidden:
    """One hidden effect: its magnitude, and shape parameters where they should not be drawn."""

    name: str
    magnitude: float
    shape: Mapping[str, float] = field(default_factory=dict)

    def __post_init__(self) -> None:
        if self.name not in EFFECTS:
            raise ValueError(f"there is no effect {self.name!r}; known: {', '.join(EFFECTS)}")

    @property
    def effect(self) -> Effect:
        return EFFECTS[self.name]


@dataclass(frozen=True, slots=True)
class Nuisances:
    """What is wrong with every record and must not be taken for an effect."""

    missing: float = 0.0
    """Share of encoder readings that are missing."""
    missing_accel: float = 0.0
    vibration: float = 0.0
    """Bearing vibration at the highest speed, m/s²; amplitude ~ v²."""
    lowpass_error: float = 0.0
    """Relative error of the true time constant."""
    lowpass_tolerance: float = 0.0
    """As declared."""
    clock_offset: float = 0.0
    """s; positive when the accelerometer is late."""
    clock_tolerance: float = 0.0
    """As declared, s."""
    level_error: float = 0.0
    """Inclination of the whole rig, rad."""
    converter_bits: int = 16
    """Of the converter that spans ±range."""
    wide_bias: bool = False
    """Draws the bias over all that the data sheet allows, without the band that looks like a vertical axis."""

    @staticmethod
    def draw(rng: np.random.Generator) -> Nuisances:
        """Return an ordinary bad day, everything within its declared tolerance."""
        return Nuisances(
            missing=float(rng.choice([0.0, 0.1])),
            vibration=float(rng.choice([0.0, rng.uniform(0, 1)])),
            lowpass_error=float(rng.uniform(-0.05, 0.05)),
            lowpass_tolerance=0.05,
            clock_offset=float(rng.uniform(-20e-6, 20e-6)),
            clock_tolerance=20e-6,
            level_error=float(rng.uniform(-1e-3, 1e-3)),
            converter_bits=int(rng.choice([14, 16])),
            wide_bias=bool(rng.random() < 0.3),
        )


@dataclass(frozen=True, slots=True)
class World:
    """Everything that determines a record; the same world gives the same record, bit by bit."""

    motion: str = "interleaved"
    sensor: str = "ADXL105"
    hidden: tuple[Hidden, ...] = ()
    seconds: float = 60.0
    seed: int = 0
    nuisances: Nuisances = Nuisances()
    mount: Mount = "normal"
    unit: int | None = None
    """Seed of the individual sensor and its effects; None = `seed`. Two records of one rig share it."""
    bias: float | None = None
    """K0, m/s²; None = drawn."""
    scale_factor: float | None = None
    """k; None = drawn."""
    reference: Reference = "position"
    """What tells the motion: an encoder, a laser vibrometer or an accelerometer."""
    encoder_rate: float = ENCODER_RATE
    """Hz"""
    encoder_noise: float = ENCODER_NOISE
    """Standard deviation of white noise before the encoder rounds, m."""
    resolution: float = RESOLUTION
    """m"""
    accel_rate: float = ACCEL_RATE
    """Hz"""
    lateral_rate: float = LATERAL_RATE
    """Hz"""

    def settled(self) -> World:
        """Return this world with bias, scale factor and every shape parameter fixed as they were drawn."""
        chain = pass_through(self)
        hidden = tuple(replace(h, shape=shape) for h, shape in zip(self.hidden, chain.shapes, strict=True))
        return replace(self, hidden=hidden, bias=chain.bias, scale_factor=chain.scale_factor, unit=self._unit)

    def again(self, motion: str, seed: int) -> World:
        """Return the same rig with the same hidden effects on another motion and another day."""
        return replace(self.settled(), motion=motion, seed=seed)

    @property
    def _unit(self) -> int:
        return self.seed if self.unit is None else self.unit

    def record(self) -> Record:
        """Measure."""
        return _measure(self, pass_through(self))


@dataclass(frozen=True, slots=True)
class Contribution:
    """What one hidden effect adds on the fine grid; None where it adds nothing, or only to single samples."""

    output: Array | None
    """(n,) m/s², before the low-pass."""
    encoder: Array | None
    """(n,) m"""


@dataclass(frozen=True, slots=True, eq=False)
class Chain:
    """The signals on the fine grid, before noise."""

    scene: Scene
    output: Array
    """(n,) m/s², before the low-pass."""
    encoder: Array
    """(n,) m"""
    contributions: tuple[Contribution, ...]
    """In the order of `World.hidden`: the increment when effects act in the order of the chain."""
    shapes: tuple[dict[str, float], ...]
    bias: float
    scale_factor: float


def pass_through(world: World) -> Chain:
    """Send the true motion through the chain of `catalogue`."""
    truth = scene(world.motion, world.seed, world.seconds)
    bias, k = _individual(world)
    gravity = -G0 if world.mount == "rolled" else G0
    shapes = [h.effect.draw(truth, stream(world._unit, 7, j, 0)) | dict(h.shape) for j, h in enumerate(world.hidden)]
    shapes = [shape | {"gravity": gravity} if "gravity" in shape else shape for shape in shapes]
    results: list[Contribution] = [Contribution(None, None)] * len(world.hidden)

    def added(place: str, signal: Array, factor: float = 1.0, parallel: bool = False) -> Array:
        """Return the signal after the effects of one place; parallel ones all see the signal that entered."""
        result = signal
        for j, hidden in enumerate(world.hidden):
            if hidden.effect.place != place:
                continue
            rng = _effect_stream(world, j)
            grown = hidden.effect.add(truth, signal if parallel else result, hidden.magnitude, shapes[j], rng)
            results[j] = (
                Contribution(None, grown) if place in ("scale", "encoder") else Contribution(factor * grown, None)
            )
            result = result + grown
        return result

    sign = -1.0 if world.mount == "reversed" else 1.0
    force = sign * added("force", truth.a + G0 * np.sin(world.nuisances.level_error), sign * (1 + k), parallel=True)
    felt = added("dynamics", force + _shaking(world, truth, shapes), 1 + k)
    output = (1 + k) * felt + bias + (added("response", felt, parallel=True) - felt)
    output = added("clip", output)
    output = added("clock", output)
    if world.nuisances.clock_offset:
        output = interpolate(truth.t[0], output, truth.t - world.nuisances.clock_offset)
    encoder = added("scale", truth.p, parallel=True) + added("encoder", truth.p, parallel=True) - truth.p
    if any(h.name == "saturation" for h in world.hidden):
        _fix_levels(world, shapes, output)
    return Chain(truth, output, encoder, tuple(results), tuple(shapes), bias, k)


def _effect_stream(world: World, index: int) -> np.random.Generator:
    """Return the generator of what is random in one effect: another one for each rig, effect and day."""
    return stream(world._unit, 7, index, 1, world.seed)


def _fix_levels(world: World, shapes: list[dict[str, float]], output: Array) -> None:
    for hidden, shape in zip(world.hidden, shapes, strict=True):
        if hidden.name == "saturation":
            shape.setdefault("level", float(np.max(np.abs(output))))


def _shaking(world: World, truth: Scene, shapes: list[dict[str, float]]) -> Array | float:
    """Return the vibration that is no effect of its own: a nuisance, or what a rectified vibration lives on."""
    amplitudes = [(world.nuisances.vibration, 2.0)] + [
        (shape["amplitude"], shape["exponent"])
        for hidden, shape in zip(world.hidden, shapes, strict=True)
        if hidden.name == "vibration_rectification"
    ]
    return sum(truth.bearing(amplitude, exponent) for amplitude, exponent in amplitudes if amplitude)


def _individual(world: World) -> tuple[float, float]:
    """Return bias and scale factor of this sensor."""
    rng = stream(world._unit, 6)
    widest = SENSORS[world.sensor].widest_bias if world.nuisances.wide_bias else 0.3
    bias, k = float(rng.uniform(-widest, widest)), float(rng.uniform(-0.02, 0.02))
    if 0.7 * G0 < abs(bias) < 1.3 * G0:
        bias *= 0.5
    return (bias if world.bias is None else world.bias, k if world.scale_factor is None else world.scale_factor)


@dataclass(frozen=True, slots=True, eq=False)
class Record:
    """What was measured, each channel on its own clock, and what is true."""

    world: World
    """Settled: with every drawn parameter."""
    t_accel: Array
    """(n,) s, as stamped."""
    accel: Array
    """(n,) m/s²; nan where it was not sampled."""
    t_position: Array
    """(m,) s, as stamped."""
    position: Array
    """(m,) m; nan where it was not sampled."""
    side_channels: dict[str, tuple[Array, Array, str]]
    """Name -> stamps, readings, unit."""
    chain: Chain
    noise: float
    """One-sided density of the sensor's own noise, m/s²/√Hz."""
    encoder_noise: float
    """Standard deviation of the encoder's white noise before it rounds, m."""

    @property
    def truth(self) -> Scene:
        """True p, v, a, jerk, temperature and a_y on the fine grid `truth.t`."""
        return self.chain.scene

    @property
    def contributions(self) -> dict[str, Contribution]:
        """What each hidden effect adds on the fine grid, by name."""
        return {h.name: c for h, c in zip(self.world.hidden, self.chain.contributions, strict=True)}

    def write(self, directory: Path | str, name: str = "run", digits: int | None = None) -> Path:
        """Write NAME.csv and its sidecar NAME.toml; return the path of the CSV.

        By default `digits` is 9, and 13 where the reference resolves less than a nanometre.
        """
        sensor, nuisances = SENSORS[self.world.sensor], self.world.nuisances
        channels = {
            "accel": (self.t_accel, self.accel, "m/s^2"),
            self.world.reference: (self.t_position, self.position, REFERENCE_UNITS[self.world.reference]),
            **self.side_channels,
        }
        extra = {
            "accel": f'lowpass = {{ kind = "RC", fc = "{CUTOFF:g} Hz", tolerance = {nuisances.lowpass_tolerance!r} }}',
            "position": f'resolution = "{self.world.resolution * 1e6:g} um"',
        }
        tables = {
            "sensor": {"model": sensor.name, "noise": sensor.declared_noise, "range": sensor.declared_range},
            "rig": {"axis": "level", "mount": self.world.mount, "gravity_along_axis": "0 m/s^2"},
            "clock": {"offset_tolerance": f"{nuisances.clock_tolerance * 1e6:g} us"},
        }
        whole = 9 if self.world.resolution >= 1e-9 else 13  # of an interferometer nothing may be lost
        return write(Path(directory), name, channels, extra, tables, digits or whole)


def _measure(world: World, chain: Chain) -> Record:
    """Sample, add noise, quantise."""
    truth, nuisances = chain.scene, world.nuisances
    accel_rng, encoder_rng, side_rng = (stream(world.seed, key) for key in (4, 5, 8))
    t_accel, accel = _read_accelerometer(world, chain, accel_rng)
    if world.reference == "position":
        t_position, position = _read_encoder(world, chain, encoder_rng)
    else:
        t_position, position = _read_rate(world, chain, encoder_rng)
    accel[accel_rng.random(len(accel)) < nuisances.missing_accel] = np.nan
    position[encoder_rng.random(len(position)) < nuisances.missing] = np.nan
    t_side = _stamps(world.lateral_rate, world.seconds, side_rng)
    a_y = interpolate(truth.t[0], truth.a_y, t_side)
    a_y += SENSORS["CXL02"].noise * np.sqrt(world.lateral_rate / 2) * side_rng.standard_normal(len(t_side))
    side = {"temperature": (*thermometer(truth, side_rng), "degC"), "a_y": (t_side, a_y, "m/s^2")}
    hidden = tuple(replace(h, shape=shape) for h, shape in zip(world.hidden, chain.shapes, strict=True))
    settled = replace(world, hidden=hidden, bias=chain.bias, scale_factor=chain.scale_factor, unit=world._unit)
    noise = SENSORS[world.sensor].noise
    return Record(settled, t_accel, accel, t_position, position, side, chain, noise, world.encoder_noise)


def _stamps(rate: float, seconds: float, rng: np.random.Generator) -> Array:
    """Return the stamps of a free-running clock that starts at an arbitrary phase."""
    begin = rng.uniform(0, 1 / rate)
    return begin + np.arange(float(int((seconds - begin) * rate))) / rate


def time_constant(world: World) -> float:
    """Return the true time constant of the low-pass, s."""
    return (1 + world.nuisances.lowpass_error) / (2 * np.pi * CUTOFF)


def low_passed_noise(n: int, rate: float, density: float, tau: float, rng: np.random.Generator) -> Array:
    """Return white noise of a one-sided density behind an RC, exactly at n stamps: an Ornstein-Uhlenbeck process.

    Variance N²/(4 tau), correlation exp(−dt/tau) from stamp to stamp (Papoulis 1991, section 10.2).
    """
    keep = np.exp(-1 / (rate * tau))
    shocks = rng.standard_normal(n) * np.sqrt(1 - keep**2)
    shocks[0] /= np.sqrt(1 - keep**2)
    return np.asarray(lfilter([density / np.sqrt(4 * tau)], [1.0, -keep], shocks))


def _on_samples(world: World, chain: Chain, name: str, y: Array) -> Array:
    """Return what the effects of one name, which act on single samples, add to readings y (n,)."""
    total = np.zeros_like(y)
    for j, hidden in enumerate(world.hidden):
        if hidden.name == name:
            rng = _effect_stream(world, j)
            total += hidden.effect.add(chain.scene, y + total, hidden.magnitude, chain.shapes[j], rng)
    return total


def _read_accelerometer(world: World, chain: Chain, rng: np.random.Generator) -> tuple[Array, Array]:
    sensor = SENSORS[world.sensor]
    stamps = _stamps(world.accel_rate, world.seconds, rng)
    tau = time_constant(world)
    behind = lag(chain.output, tau)
    instants = stamps + _on_samples(world, chain, "timing_jitter", np.zeros_like(stamps))
    y = interpolate(chain.scene.t[0], behind, instants)
    y += low_passed_noise(len(stamps), world.accel_rate, sensor.noise, tau, rng)
    y += _on_samples(world, chain, "accelerometer_outliers", y)
    y = np.clip(y, -sensor.range, sensor.range)
    code = sensor.range / 2 ** (world.nuisances.converter_bits - 1)
    y = code * np.rint(y / code)
    return stamps, y + _on_samples(world, chain, "quantisation", y)


def encoder_error(world: World, chain: Chain, index: int, at: Array) -> Array:
    """Return what one hidden effect adds to encoder readings at the instants `at`, (n,) m."""
    hidden, begin = world.hidden[index], chain.scene.t[0]
    if hidden.effect.place == "scale":
        p = interpolate(begin, chain.scene.p, at)
        rng = _effect_stream(world, index)
        return hidden.effect.add(chain.scene, p, hidden.magnitude, chain.shapes[index], rng)
    encoder = chain.contributions[index].encoder
    return np.zeros_like(at) if encoder is None else interpolate(begin, encoder, at)


def _read_encoder(world: World, chain: Chain, rng: np.random.Generator) -> tuple[Array, Array]:
    stamps = _stamps(world.encoder_rate, world.seconds, rng)
    z = interpolate(chain.scene.t[0], chain.scene.p, stamps) + world.encoder_noise * rng.standard_normal(len(stamps))
    z += sum(encoder_error(world, chain, j, stamps) for j in range(len(world.hidden)))
    z += _on_samples(world, chain, "encoder_outliers", z)
    return stamps, world.resolution * np.rint(z / world.resolution)


def _read_rate(world: World, chain: Chain, rng: np.random.Generator) -> tuple[Array, Array]:
    """Read velocity or acceleration of the stage, as good as the encoder where that is as good as the sensor.

    Where N is the sensor's density and s that of the encoder, 2 pi f_c = sqrt(N/s): the velocity has sqrt(N s), the
    acceleration N.
    """
    if any(hidden.effect.place in ("scale", "encoder") or hidden.name == "encoder_outliers" for hidden in world.hidden):
        raise ValueError("an effect of the encoder, where there is none")
    stamps = _stamps(world.encoder_rate, world.seconds, rng)
    sensor = SENSORS[world.sensor].noise
    encoder = np.sqrt((world.encoder_noise**2 + world.resolution**2 / 12) * 2 / world.encoder_rate)
    moving, density = (
        (chain.scene.v, np.sqrt(sensor * encoder)) if world.reference == "velocity" else (chain.scene.a, sensor)
    )
    noise = density * np.sqrt(world.encoder_rate / 2) * rng.standard_normal(len(stamps))
    return stamps, interpolate(chain.scene.t[0], moving, stamps) + noise
