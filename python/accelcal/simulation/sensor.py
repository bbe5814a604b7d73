"""Simulated rig: outputs of sensor and encoder for a motion that is known exactly.

Chain of the accelerometer (paper II-A, II-B, II-F): carriage acceleration and gravity -> mount -> vibration -> sensor
model (4), (7) -> white noise -> RC low-pass -> sampling -> converter. Chain of the encoder: position -> noise ->
resolution. The two have clocks of their own.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import ClassVar

import numpy as np
import scipy

from accelcal._support.arguments import checked
from accelcal._support.errors import AccelcalError
from accelcal._support.result import Result
from accelcal._support.values import immutable
from accelcal.data import (
    POSITION_ORDER,
    STANDARD_GRAVITY,
    UNITS,
    Array,
    Channel,
    ChannelFilter,
    LowPass,
    Recording,
    Reference,
    Rig,
    Sensor,
    batches,
    integrated,
)
from accelcal.data.recording import ORDERS
from accelcal.signals.processing import applied, memory, response
from accelcal.simulation.motion import Motion, motion as planned

FINE = 4
"""Steps of the grid of an analog low-pass within one sample: what lies above its Nyquist frequency is not simulated."""


def filtered_samples(
    signal: Callable[[Array], Array],
    t: Array,
    rate: float,
    filters: Sequence[ChannelFilter],
    density: float = 0.0,
    rng: np.random.Generator | None = None,
) -> Array:
    """Samples (n,) of a signal and its noise behind a chain of filters.

    Analog low-passes act on a grid `FINE` times as fine as the samples, every other filter on the samples; the chain
    begins earlier by what it remembers.

    Parameters
    ----------
    signal : its value at instants (m,) s.
    t : (n,) s, at `rate`.
    rate : Hz, of the channel.
    filters : in the order of the signal; they commute.
    density : one-sided density of white noise in front of the filters, unit of the signal per sqrt(Hz).
    rng : where the noise comes from; None = there is none.
    """
    analog = [f for f in filters if f.passes == "lowpass" and not f.digital]
    others = [f for f in filters if f not in analog]
    lead = math.ceil(memory(filters, rate) * rate)
    fine = FINE if analog else 1
    step = 1.0 / (rate * fine)
    at = t[0] - lead / rate + step * np.arange((len(t) + lead) * fine)
    y = signal(at)
    if rng is not None:
        y = y + density * math.sqrt(0.5 / step) * rng.standard_normal(len(at))
    y = applied(y, step, response(analog, rate), memory(analog, rate))[::fine]
    return applied(y, 1.0 / rate, response(others, rate), memory(others, rate))[lead:]


__all__ = ["ADXL105_RIG", "CXL02_RIG", "PARAMETERS", "Simulated", "Truth", "Vibration", "simulate"]


_MICRO_G = 1e-6 * STANDARD_GRAVITY

ADXL105_RIG = Rig(
    sensor=Sensor(model="ADXL105", noise=225 * _MICRO_G, range=5 * STANDARD_GRAVITY),
    lowpass=LowPass(cutoff=159.0),
    resolution=1e-6,
)
"""The paper's low-cost sensor (225 ug/sqrt(Hz), ±5 g) behind its RC filter, and its encoder (II-A)."""

CXL02_RIG = Rig(
    sensor=Sensor(model="CXL02TG3", noise=20 * _MICRO_G, range=2 * STANDARD_GRAVITY),
    lowpass=LowPass(cutoff=159.0),
    resolution=1e-6,
)
"""The paper's low-noise sensor (20 ug/sqrt(Hz), ±2 g) behind the same filter, and its encoder (II-A)."""

PARAMETERS: Mapping[str, str] = MappingProxyType(
    {
        "bias": "m/s²",
        "scale_factor": "",
        "time_offset": "s",
        "quadratic": "(m/s²)⁻¹",
        "cubic": "(m/s²)⁻²",
        "cross_axis_gravity": "(m/s²)⁻¹",
        "misalignment": "rad",
    }
)
"""What a simulated sensor may be given, with units: K0, k, delay (positive = output late), K2, K3, Kin of (7), and the
angle by which the input axis leans towards the vertical."""

READING_NOISE: Mapping[str, float] = MappingProxyType(
    {"position": 1e-6, "velocity": 1e-4, "reference_acceleration": 1e-2}
)
"""Noise of one reading of an encoder, m, a laser vibrometer, m/s, and a reference accelerometer, m/s²."""
MOST_SAMPLES = 20_000_000
"""Largest number of samples of one channel."""
_FINE_RATE = 1e4
"""Least rate at which the sensed acceleration is evaluated, Hz."""
_LEAST_NODES = 5
"""Gauss-Legendre nodes per sample interval: exact through degree 9."""
_BAND_TONES = 64
"""Tones of a band: a kurtosis of 3 - 1.5/n; it never repeats, since no two frequencies are commensurate."""
_BLOCK = 100_000
"""Output samples whose fine grid is held in memory at a time."""
_SETTLING = 25.0
"""Time constants by which the low-pass is started ahead of the first sample; exp(-25) = 1e-11."""


@dataclass(frozen=True, slots=True)
class Vibration:
    """Vibration from the ball bearings, growing with speed squared (paper II-F, III-A2): a line or a band.

    A band is noise of the mean square that the line has, flat between its edges.
    """

    amplitude: float
    """Amplitude A of the line at the top speed of the motion, m/s²; of a band sqrt(2) of its rms there."""
    frequency: float = 200.0
    """Hz; of a band its lower edge."""
    width: float = 0.0
    """Width of the band, Hz; 0 for a line."""

    def drawn(self, rng: np.random.Generator) -> tuple[Array, Array]:
        """Frequencies (n,) Hz and phases (n,) rad: of the line, or of one tone in each of n parts of the band."""
        if self.width == 0.0:
            return np.array([self.frequency]), np.zeros(1)
        parts = (np.arange(_BAND_TONES) + rng.random(_BAND_TONES)) / _BAND_TONES
        return self.frequency + self.width * parts, 2.0 * math.pi * rng.random(_BAND_TONES)


@immutable
@dataclass(frozen=True, slots=True)
class Truth:
    """What was put into a simulated record."""

    motion: Motion
    """The carriage, exactly, at any instant of the encoder's clock."""
    parameters: Mapping[str, float]
    """Value of every name in `PARAMETERS`."""
    noise: float
    """One-sided noise density of the sensor, (m/s²)/sqrt(Hz)."""
    position_noise: float
    """Standard deviation of the white noise of the encoder before rounding, m; of another reference in its unit."""

    def __repr__(self) -> str:
        hidden = ", ".join(f"{name} {value:g}" for name, value in self.parameters.items() if value)
        return f"Truth({hidden or 'a perfect sensor'}; {self.motion.seconds:g} s)"


@immutable
@dataclass(frozen=True, slots=True)
class Simulated(Result):
    """A record and its truth."""

    tables_in: ClassVar[str] = "results.experiments"

    recording: Recording
    truth: Truth

    def __repr__(self) -> str:
        return f"Simulated({self.recording!r}, {self.truth!r})"


@checked
@np.errstate(over="ignore", invalid="ignore")
def simulate(
    motion: Motion | str,
    *,
    seconds: float,
    rig: Rig,
    parameters: Mapping[str, float],
    rng: np.random.Generator,
    a_rms: float | None = None,
    v_max: float | None = None,
    accel_rate: float = 1667.0,
    position_rate: float = 833.5,
    accel_phase: float = 0.0,
    position_phase: float = 0.0,
    position_noise: float | None = None,
    reference: Reference = "position",
    missing: float = 0.0,
    vibration: Vibration | None = None,
    lsb: float | None = None,
    full_scale: float | None = None,
) -> Simulated:
    """A record of the rig with its truth, by the model that `_sensed` and `_output` say.

    Parameters
    ----------
    motion : a motion, or the name of a profile of `accelcal.simulation.motion.planned`, which takes `a_rms` (m/s²) and
        `v_max` (m/s).
    seconds : length of the record, s.
    rig : noise density, filters, mount, gravity and encoder resolution; no filter or resolution means there is none.
    parameters : any of `PARAMETERS`; the others are zero.
    rng : same state, same record. Motion, sensor noise, encoder noise and losses have streams of their own.
    accel_rate, position_rate : Hz.
    accel_phase, position_phase : time of the first sample of either clock, s.
    position_noise : standard deviation of white noise on the readings of the reference, before those of a position are
        rounded to the resolution, in its unit; by default `READING_NOISE`.
    reference : "velocity" or "reference_acceleration" in place of an encoder, behind the filters of the position.
    missing : probability that a sample is absent, on either channel.
    vibration : by default the rails are smooth.
    lsb, full_scale : step and limit of the converter in output units, m/s².

    Raises
    ------
    ValueError
        Unknown parameter or one that is not finite, a channel that overflows, undeclared noise density, probability
        outside [0, 1), more than `MOST_SAMPLES` samples, or what `planned` says.

    Examples
    --------
    >>> run = simulate("tones", seconds=2.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(7))
    >>> len(run.recording.accel), len(run.recording.position)
    (3334, 1667)
    """
    theta, density = _complete(parameters), _declared_density(rig)
    if not 0.0 <= missing < 1.0:
        raise AccelcalError(f"missing is the probability that a sample is absent: {missing} is outside [0, 1).")
    t_accel = _clock("accel", seconds, accel_rate, accel_phase)
    t_position = _clock("position", seconds, position_rate, position_phase)
    motion_rng, sensor_rng, encoder_rng, missing_rng = rng.spawn(4)
    if isinstance(motion, str):
        motion = planned(motion, seconds, motion_rng, a_rms=a_rms, v_max=v_max)
    elif a_rms is not None or v_max is not None:
        raise AccelcalError("a_rms and v_max size a profile given by name; scale a Motion with its `scaled`.")
    # streams of a band are drawn only for one: other records keep theirs
    tones = None if vibration is None else vibration.drawn(rng.spawn(1)[0] if vibration.width else rng)
    output = _output(_sensed(motion, rig, theta, vibration, tones), t_accel, accel_rate, rig, density, sensor_rng)
    if reference != "position":
        rig = replace(rig, resolution=None)  # that of an encoder
    noise = READING_NOISE[reference] if position_noise is None else position_noise
    rig = replace(rig, reading_noise=noise or None)
    reading = _readings(_read(motion, reference), t_position, position_rate, rig, noise, encoder_rng)
    accel = _channel("accel", t_accel, _converted(output, lsb, full_scale), "m/s²", missing, missing_rng)
    read = _channel(reference, t_position, reading, UNITS[reference], missing, missing_rng)
    recording = Recording(
        accel=accel,
        position=read if reference == "position" else integrated(read),
        rig=rig,
        name=f"simulated {motion.name}".strip(),
        reference=None if reference == "position" else read,
    )
    return Simulated(recording, Truth(motion, theta, density, noise))


def _declared_density(rig: Rig) -> float:
    """Noise density of the sensor, (m/s²)/sqrt(Hz)."""
    if rig.sensor.noise is None:
        raise AccelcalError(
            "rig.sensor.noise is not declared: a simulated sensor needs its noise density (0 for none)."
        )
    return rig.sensor.noise


def _output(
    sensed: Callable[[Array], Array], t: Array, rate: float, rig: Rig, density: float, rng: np.random.Generator
) -> Array:
    """Output before the converter, (n,) m/s²: RC[ f(s(t)) + noise ].

    One RC low-pass is solved exactly: Gauss-Legendre over each sample interval for the smooth part, the
    Ornstein-Uhlenbeck law for the noise. Other declared filters act as `filtered_samples` says.
    """
    if rig.output_filters:
        return filtered_samples(sensed, t, rate, rig.passed_by_output, density, rng)
    lowpass, dt = rig.lowpass, 1.0 / rate
    output = sensed(t) if lowpass is None else _low_passed(sensed, t, dt, lowpass.tau)
    return output + _sensor_noise(len(t), dt, density, lowpass, rng)


def _readings(
    true: Callable[[Array], Array], t: Array, rate: float, rig: Rig, noise: float, rng: np.random.Generator
) -> Array:
    """Readings of a reference behind the filters of the position, with noise, rounded to the resolution, (n,)."""
    reading = filtered_samples(true, t, rate, rig.position_filters) if rig.position_filters else true(t)
    reading = reading + noise * rng.standard_normal(len(t))
    return reading if rig.resolution is None else _rounded(reading, rig.resolution)


def _read(motion: Motion, reference: Reference) -> Callable[[Array], Array]:
    """What a reference without noise reads at instants (n,) s."""
    if reference == "position":
        return motion.position
    order = POSITION_ORDER - ORDERS[reference][0]
    return lambda t: np.asarray(motion.derivatives(t)[order])


def _complete(parameters: Mapping[str, float]) -> dict[str, float]:
    """Every parameter by name; those not given are zero."""
    unknown = sorted(set(parameters) - set(PARAMETERS))
    if unknown:
        raise AccelcalError(f"no sensor parameter is called {', '.join(unknown)}. Known: {', '.join(PARAMETERS)}.")
    for name, value in parameters.items():
        if not math.isfinite(value):
            raise AccelcalError(f"{name} = {value}: expected a finite number.")
    return {name: float(parameters.get(name, 0.0)) for name in PARAMETERS}


def _clock(name: str, seconds: float, rate: float, phase: float) -> Array:
    """Sample instants phase, phase + 1/rate, ... before phase + seconds; (n,) s.

    Raises
    ------
    ValueError
        For a clock that is none, and for more samples than are simulated.
    """
    if not (0.0 < seconds < math.inf and 0.0 < rate < math.inf and math.isfinite(phase)):
        raise AccelcalError(
            f"{name}: {seconds:g} s at {rate:g} Hz from {phase:g} s; expected a finite length and rate above 0."
        )
    if seconds * rate > MOST_SAMPLES:
        raise AccelcalError(
            f"{name}: {seconds:g} s at {rate:g} Hz are {seconds * rate:.3g} samples; at most {MOST_SAMPLES} are "
            "simulated. Take a shorter length or a lower rate."
        )
    return phase + np.arange(max(1, math.floor(seconds * rate + 1e-9))) / rate


def _sensed(
    motion: Motion,
    rig: Rig,
    theta: Mapping[str, float],
    vibration: Vibration | None,
    tones: tuple[Array, Array] | None,
) -> Callable[[Array], Array]:
    """Noise-free output in front of the filters of the channel, at instants (n,) s: f(s(t)).

    s(t) = polarity (a(t - time_offset) + gravity) + vibration(t),
    f(s) = K0 + (1 + k + Kin g_n) s + K2 s² + K3 s³ + misalignment g_n, where g_n is gravity across the input axis; it
    changes sign when the sensor is rolled by 180 degrees.
    """
    top_speed = motion.top_speed if vibration is not None else 0.0

    def shaking(t: Array) -> Array:
        assert tones is not None
        waves = (np.sin(2.0 * math.pi * f * t + phase) for f, phase in zip(*tones, strict=True))
        return np.asarray(sum(waves, np.zeros(len(t))) / math.sqrt(len(tones[0])))

    def sensed(t: Array) -> Array:
        _, v, a, _ = motion.derivatives(t - theta["time_offset"])
        s = rig.polarity * (a + rig.gravity)
        if vibration is not None and top_speed > 0.0:
            s += vibration.amplitude * (v / top_speed) ** 2 * shaking(t)
        return _model(s, rig, theta)

    return sensed


def _model(s: Array, rig: Rig, theta: Mapping[str, float]) -> Array:
    """Sensor model (4), with the cross-axis product of (7) and the share of gravity along a tilted input axis."""
    across = rig.roll * math.sqrt(max(0.0, STANDARD_GRAVITY**2 - rig.gravity**2))
    slope = 1.0 + theta["scale_factor"] + theta["cross_axis_gravity"] * across
    constant = theta["bias"] + theta["misalignment"] * across
    return constant + s * (slope + s * (theta["quadratic"] + s * theta["cubic"]))


def _low_passed(sensed: Callable[[Array], Array], t: Array, dt: float, tau: float) -> Array:
    """x' = (sensed - x)/tau at t (n,) with spacing dt.

    x(t) = exp(-dt/tau) x(t - dt) + integral over the interval of exp(-(t - s)/tau)/tau sensed(s) ds.
    """
    ahead = math.ceil(_SETTLING * tau / dt)
    starts = t[0] - dt * np.arange(ahead, 0, -1)
    starts = np.concatenate([starts, t[:-1]])

    count = max(_LEAST_NODES, math.ceil(_FINE_RATE * dt))
    x, w = np.polynomial.legendre.leggauss(count)
    nodes, weights = 0.5 * dt * (1.0 + x), 0.5 * dt * w
    weights = weights * np.exp(-(dt - nodes) / tau) / tau

    blocks = [starts[rows] for rows in batches(len(starts), _BLOCK)]
    drive = np.concatenate([sensed((b[:, None] + nodes).ravel()).reshape(len(b), count) @ weights for b in blocks])
    decay = math.exp(-dt / tau)
    drive[0] += decay * sensed(starts[:1])[0]  # at rest before that, in equilibrium
    return _recursion(drive, decay)[ahead - 1 :]


def _recursion(drive: Array, decay: float) -> Array:
    """x_n = decay x_(n-1) + drive_n from x_(-1) = 0: a bidiagonal system, solved without the weight of scipy.signal."""
    bands = np.ones((2, len(drive)))
    bands[1] = -decay
    return np.asarray(scipy.linalg.solve_banded((1, 0), bands, drive, overwrite_ab=True, check_finite=False))


def _sensor_noise(n: int, dt: float, density: float, lowpass: LowPass | None, rng: np.random.Generator) -> Array:
    """White noise of one-sided density N as the sampled output shows it; (n,) m/s².

    Without a low-pass the samples are independent, variance N²/(2 dt); behind an RC they are Ornstein-Uhlenbeck with
    variance N²/(4 tau) and correlation exp(-dt/tau). Either way the density at low frequency is N.
    """
    white = rng.standard_normal(n)
    if lowpass is None:
        return density * math.sqrt(0.5 / dt) * white
    decay = math.exp(-dt / lowpass.tau)
    white[1:] *= math.sqrt(1.0 - decay**2)
    return density * math.sqrt(0.25 / lowpass.tau) * _recursion(white, decay)


def _converted(output: Array, lsb: float | None, full_scale: float | None) -> Array:
    """What a converter of step `lsb` and limit `full_scale` reports."""
    if full_scale is not None:
        output = np.clip(output, -full_scale, full_scale)
    return output if lsb is None else _rounded(output, lsb)


def _rounded(y: Array, step: float) -> Array:
    """The nearest multiple of `step`."""
    return step * np.round(y / step)


def _channel(name: str, t: Array, y: Array, unit: str, missing: float, rng: np.random.Generator) -> Channel:
    """A channel without the samples that were lost.

    Raises
    ------
    ValueError
        If a sample is beyond the range of a double.
    """
    if not np.all(np.isfinite(y)):
        raise AccelcalError(f"the simulated {name} overflows; take a smaller motion or smaller parameters.")
    present = rng.random(len(t)) >= missing
    return Channel(name, t[present], y[present], unit)
