"""A sensor on an arm about an axle, simulated in closed form: frames are turned and differentiated, no formula of the
product."""

from __future__ import annotations

from dataclasses import dataclass, field
from itertools import pairwise
from pathlib import Path

import numpy as np
from scipy.signal import lfilter

import accelcal as ac
from accelcal import io

G = 9.80665
FINE = 16
"""Instants between two samples of the output at which the truth is worked out."""


@dataclass(frozen=True)
class Rigged:
    """An arm, what it does, and the sensor on it."""

    seed: int = 1
    arm: float = 0.2
    axle: str = "horizontal"
    input_axis: str = "radial"
    motion: str = "swing"
    """swing, turns, steps or dwells."""
    seconds: float = 30.0
    rate: float = 400.0
    every: int = 2
    """Samples of the output between two readings of the angle."""
    density: float = 0.002
    angle_std: float = 1e-5
    count: float = 0.0
    """Of the angle, rad; 0 = not rounded."""
    bias: float = 0.08
    k: float = 0.01
    delay: float = 0.004
    arm_error: float = 0.0
    across: float = 0.0
    zero: float = 0.0
    """True angle where the encoder reads 0, rad."""
    tilt: float = 0.0
    """Of a vertical axle, rad."""
    quadratic: float = 0.0
    cubic: float = 0.0
    lag: float = 0.0
    """Second pole of the sensor, s."""
    eccentricity: float = 0.0
    bending: float = 0.0
    wobble: float = 0.0
    """Of a vertical axle, against the turn, rad."""
    unit: str = "deg"
    wrap: bool = False
    keys: dict[str, str] = field(default_factory=dict)


def angle_of(rig: Rigged, t: np.ndarray) -> np.ndarray:
    """The true angle, rad: smooth everywhere."""
    rng = np.random.default_rng(1000 + rig.seed)
    if rig.motion == "swing":
        tones = zip((0.35, 0.8, 1.5), (0.9, 0.5, 0.25), rng.uniform(0.0, 2.0 * np.pi, 3), strict=True)
        return sum(a * np.sin(2.0 * np.pi * f * rng.uniform(0.95, 1.05) * t + p) for f, a, p in tones)
    if rig.motion == "turns":  # whole turns whose rate wanders
        tones = [(f, rng.uniform(0.0, 2.0 * np.pi)) for f in (0.05, 0.13, 0.31)]
        return 6.0 * t + sum(2.5 / (2.0 * np.pi * f) * np.sin(2.0 * np.pi * f * t + p) for f, p in tones)
    if rig.motion == "dwells":  # 30 degrees every 2 s
        return sum(np.pi / 6.0 * risen((t - 2.0 * n - 1.5) / 0.5) for n in range(1, int(rig.seconds / 2.0)))
    speeds = np.linspace(2.0, 14.0, 12)  # a centrifuge
    plateau = rig.seconds / len(speeds)
    rate = np.full_like(t, speeds[0])
    for n, (low, high) in enumerate(pairwise(speeds)):
        rate += (high - low) * risen((t - (n + 0.7) * plateau) / (0.6 * plateau))
    step = t[1] - t[0]
    return np.concatenate([[0.0], np.cumsum(0.5 * step * (rate[1:] + rate[:-1]))])


def risen(x: np.ndarray) -> np.ndarray:
    """From 0 to 1 between 0 and 1, smoothly."""
    x = np.clip(x, 0.0, 1.0)
    return x**4 * (35.0 - 84.0 * x + 70.0 * x**2 - 20.0 * x**3)


def columns(rig: Rigged) -> dict[str, np.ndarray]:
    """Stamps, output and angle as a logger writes them; the angle is NaN where the encoder is not read."""
    rng, h = np.random.default_rng(rig.seed), 1.0 / (FINE * rig.rate)
    t = np.arange(-1.0, rig.seconds + 0.5, h)
    theta = angle_of(rig, t)
    rate = np.gradient(theta, h)
    reach = (rig.arm + rig.arm_error) * (1.0 + rig.bending * rate**2)
    outward = np.column_stack([np.cos(theta), np.sin(theta)])
    forward = np.column_stack([-np.sin(theta), np.cos(theta)])
    place = reach[:, None] * outward + rig.across * forward
    acceleration = np.gradient(np.gradient(place, h, axis=0), h, axis=0)
    cone = rig.wobble * np.column_stack([np.sin(theta + 0.7), np.cos(theta + 0.7)])
    up = np.array([0.0, 1.0]) if rig.axle == "horizontal" else np.array([0.0, np.sin(rig.tilt)]) + cone
    axis = {"radial": outward, "tangential": forward}.get(rig.input_axis, np.zeros_like(outward))
    force = np.einsum("ni,ni->n", axis, acceleration + G * up)  # an axis along the axle: gravity is in the bias
    late = np.interp(t - rig.delay, t, force)
    if rig.lag:
        decay = np.exp(-h / rig.lag)
        late = lfilter([1.0 - decay], [1.0, -decay], late, zi=[decay * late[0]])[0]
    n = np.arange(int(rig.seconds * rig.rate))
    at = n * FINE + round(1.0 / h)
    a = late[at]
    y = rig.bias + (1.0 + rig.k) * a + rig.quadratic * a**2 + rig.cubic * a**3
    y += rig.density * np.sqrt(rig.rate / 2.0) * rng.standard_normal(len(a))
    read = theta[at] - rig.zero
    read = read - rig.eccentricity * np.sin(read + 0.7) + rig.angle_std * rng.standard_normal(len(a))
    read = rig.count * np.rint(read / rig.count) if rig.count else read
    turn = {"deg": 360.0, "rad": 2.0 * np.pi, "rev": 1.0, "count": 4.0e6}[rig.unit]
    read = read / (2.0 * np.pi) * turn
    read = read % turn if rig.wrap else read
    read = np.rint(read) if rig.unit == "count" else read
    return {"t": n / rig.rate, "acc": y, "angle": np.where(n % rig.every == 0, read, np.nan)}


def sidecar(rig: Rigged) -> str:
    """What is declared of the rig."""
    axis = rig.input_axis if rig.input_axis.startswith("[") else f'"{rig.input_axis}"'
    keys = {"arm": f'"{rig.arm} m"', "arm_std": '"1 mm"', "axle": f'"{rig.axle}"', "input_axis": axis}
    lines = "".join(f"{key} = {value}\n" for key, value in (keys | rig.keys).items())
    scale = ', scale = "4e6 count/rev"' if rig.unit == "count" else ""
    return (
        f'[sensor]\nnoise = "{rig.density} m/s^2/sqrt(Hz)"\nrange = "100 g"\n[rig]\n{lines}[channels]\n'
        'time = { column = "t", unit = "s" }\naccel = { column = "acc", unit = "m/s^2" }\n'
        f'angle = {{ column = "angle", unit = "{rig.unit}"{scale} }}\n'
    )


def record(rig: Rigged, folder: Path, name: str = "arm") -> ac.Recording:
    """The recording of a rig, written and read."""
    table = columns(rig)
    rows = np.column_stack(list(table.values()))
    lines = [",".join("" if np.isnan(x) else f"{x:.10g}" for x in row) for row in rows]
    path = folder / f"{name}.csv"
    path.write_text("\n".join([",".join(table), *lines]) + "\n")
    path.with_suffix(".toml").write_text(sidecar(rig))
    return io.load(path)
