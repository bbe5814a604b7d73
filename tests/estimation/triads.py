"""Turning triads of an independent simulator: place and attitude by sums of sines, three outputs of one body."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from accelcal.data import Array

G = 9.80665
STEP = 2e-3
"""Of the differences that give the acceleration of a point of the body, s."""


@dataclass
class Triad:
    """Truth of three outputs on a body that turns."""

    seed: int
    seconds: float = 60.0
    rate: float = 200.0
    turning: float = 0.5
    """Amplitude of the angles, rad."""
    noise: float = 100e-6 * G
    """(m/s²)/sqrt(Hz)"""
    place_noise: float = 3e-5
    """m"""
    attitude_noise: float = 0.0
    """rad"""
    law: Callable[[Array, Array, Array], Array] | None = None
    """What the output of axis `hidden` gains, of time, s, its specific force, m/s², and temperature, degC."""
    hidden: int = 0
    warms: bool = False
    """Whether the temperature is recorded."""
    every: int = 1
    """Of so many rows one has place and attitude."""
    gap: tuple[float, float] = (0.0, 0.0)
    """Between these times the attitude is not read, s."""
    gyroscope: float | None = None
    """Noise of a sample, rad/s; None = there is no gyroscope."""
    motion: int = 0
    """Which of the motions of one sensor it is."""
    truth: dict[str, Array] = field(init=False)

    def __post_init__(self) -> None:
        r = np.random.default_rng(self.seed)
        self.truth = {
            "bias": r.normal(0.0, 0.05, 3),
            "matrix": np.eye(3) + r.normal(0.0, 0.005, (3, 3)),
            "lever": r.normal(0.0, 0.02, (3, 3)),
            "up": r.normal(0.0, 0.003, 2),
            "delay": np.array(r.uniform(0.0, 5e-3)),
        }
        r = np.random.default_rng([self.seed, self.motion]) if self.motion else r
        self.waves = [
            (np.array([0.13, 0.31, 0.57, 1.1, 1.9]) * r.uniform(0.9, 1.1, 5), size * r.uniform(0.5, 1.5, 5), phase)
            for size, phase in (
                *((np.array([0.2, 0.15, 0.08, 0.03, 0.012]), r.uniform(0.0, 6.3, 5)) for _ in range(3)),
                *((self.turning * np.array([1.0, 0.7, 0.4, 0.15, 0.05]), r.uniform(0.0, 6.3, 5)) for _ in range(3)),
            )
        ]
        self.random = r

    def series(self, t: Array) -> tuple[Array, Rotation]:
        """Place (n, 3), m, and attitude, sensor to ENU."""
        x = np.column_stack([np.sin(2 * np.pi * np.outer(t, f) + phase) @ size for f, size, phase in self.waves])
        return x[:, :3], Rotation.from_rotvec(x[:, 3:])

    def force(self, t: Array, lever: Array) -> Array:
        """Specific force of a point of the body in its axes, (n, 3) m/s²."""
        weights = zip((-2, -1, 0, 1, 2), np.array([-1.0, 16.0, -30.0, 16.0, -1.0]) / (12.0 * STEP**2), strict=True)
        acceleration = np.zeros((len(t), 3))
        for k, weight in weights:
            place, attitude = self.series(t + k * STEP)
            acceleration += weight * (place + attitude.apply(lever))
        up = np.array([*self.truth["up"], 1.0])
        return np.asarray(self.series(t)[1].inv().apply(acceleration + G * up))

    def true_values(self) -> dict[tuple[str, str], float]:
        """The parameters by name and axis, as the product calls them."""
        values = {("time_offset", ""): float(self.truth["delay"])}
        values |= dict(zip((("world_tilt.e", ""), ("world_tilt.n", "")), self.truth["up"].tolist(), strict=True))
        for i, axis in enumerate("xyz"):
            row = np.roll(self.truth["matrix"][i], -i)
            values |= {("bias", axis): self.truth["bias"][i], ("scale_factor", axis): row[0] - 1.0}
            values |= {("body_misalignment.1", axis): row[1], ("body_misalignment.2", axis): row[2]}
            values |= {(f"lever_arm.{j}", axis): r for j, r in zip("xyz", self.truth["lever"][i], strict=True)}
        return values

    def write(self, folder: Path) -> Path:
        """The record as a file with its sidecar."""
        t, r = np.arange(0.0, self.seconds, 1.0 / self.rate), self.random
        late = t - self.truth["delay"]
        warm = 25.0 + 8.0 * (1.0 - np.exp(-t / 20.0)) + 2.0 * np.sin(0.35 * t)
        y = np.empty((len(t), 3))
        for i in range(3):
            force = self.force(late, self.truth["lever"][i])
            y[:, i] = self.truth["bias"][i] + force @ self.truth["matrix"][i]
            if self.law is not None and i == self.hidden:
                y[:, i] += self.law(late, force[:, i], warm)
        y += self.noise * np.sqrt(self.rate / 2.0) * r.standard_normal(y.shape)
        place, attitude = self.series(t)
        place = place + self.place_noise * r.standard_normal(place.shape)
        attitude = attitude * Rotation.from_rotvec(self.attitude_noise * r.standard_normal(place.shape))
        q = attitude.as_quat(scalar_first=True)
        q[(t > self.gap[0]) & (t < self.gap[1])] = np.nan
        unread = np.arange(len(t)) % self.every != 0
        place[unread] = q[unread] = np.nan
        table, names = [t, y, place, q, warm], "t,accel_x,accel_y,accel_z,e,n,u,q_w,q_x,q_y,q_z,warm"
        rates = ""
        if self.gyroscope is not None:
            error = np.random.default_rng([self.seed, 7]).normal(0.0, 0.01, (4, 3))
            turning = (self.series(late - STEP)[1].inv() * self.series(late + STEP)[1]).as_rotvec() / (2.0 * STEP)
            table.append(turning @ (np.eye(3) + error[:3]) + error[3] + self.gyroscope * r.standard_normal((len(t), 3)))
            names += ",gyr_x,gyr_y,gyr_z"
            rates = "".join(f'gyr_{a} = {{ column = "gyr_{a}", unit = "rad/s" }}\n' for a in "xyz")
        path = folder / f"triad_{self.seed}{f'_{self.motion}' if self.motion else ''}.csv"
        rows = (",".join("" if np.isnan(x) else f"{x:.9g}" for x in row) for row in np.column_stack(table).tolist())
        path.write_text("\n".join([names, *rows]) + "\n")
        outputs = "".join(f'accel_{a} = {{ column = "accel_{a}", unit = "m/s^2" }}\n' for a in "xyz")
        places = "".join(f'position_{a} = {{ column = "{a}", unit = "m" }}\n' for a in "enu")
        places += 'temperature = { column = "warm", unit = "degC" }\n' if self.warms else ""
        path.with_suffix(".toml").write_text(
            f'[sensor]\nnoise = "{self.noise / G * 1e6:.6g} ug/sqrt(Hz)"\n[channels]\n'
            f'time = {{ column = "t", unit = "s" }}\n{outputs}{places}{rates}'
            'attitude = { columns = ["q_w", "q_x", "q_y", "q_z"], maps = "sensor to ENU" }\n'
        )
        return path
