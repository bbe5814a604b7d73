"""Rigs of analytic motion with their files, and the mistakes that people make when they declare them.

Nothing here comes from the package: motion is a sum of sines, so position, velocity and acceleration are exact.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

G = 9.80665
Array = NDArray[np.float64]

MOTIONS = {
    "stage": (500.0, 40.0, np.array([0.31, 0.87, 1.9, 3.7, 5.3]), 3.0),
    "shaker": (2000.0, 20.0, np.array([7.3, 19.0, 33.0, 57.0, 91.0]), 20.0),
    "lift": (200.0, 60.0, np.array([0.11, 0.27, 0.63, 1.4, 2.9]), 1.5),
}
"""Rate in Hz, length in s, tones in Hz, and acceleration in m/s² rms, by kind of rig."""


@dataclass
class Rig:
    """One run, in SI, and what its file and sidecar say."""

    t: Array
    p: Array
    v: Array
    a: Array
    k: float
    bias: float
    rng: np.random.Generator
    columns: dict[str, Array] = field(default_factory=dict)
    """What the file holds, by name of the column."""
    lines: dict[str, str] = field(default_factory=dict)
    """Tables of the sidecar by name."""

    def noise(self, std: float) -> Array:
        """White noise, (n,)."""
        return std * self.rng.standard_normal(len(self.t))

    def output(self, gravity: float = 0.0) -> Array:
        """What the sensor reads, m/s²."""
        return self.bias + (1.0 + self.k) * (self.a + gravity) + self.noise(3e-4 * float(np.std(self.a)) + 1e-3)

    def read(self) -> Array:
        """What an encoder reads, m."""
        return self.p + self.noise(2e-6 * float(np.std(self.p)) / 1e-2 + 1e-8)

    def declare(self, *channels: str, rig: str = 'axis = "level"', sensor: str = "") -> None:
        """Set the sidecar."""
        self.lines = {"sensor": sensor, "rig": rig, "channels": "\n".join(channels)}

    def write(self, folder: Path, name: str = "run") -> Path:
        """Write file and sidecar."""
        path = folder / f"{name}.csv"
        rows = np.column_stack(list(self.columns.values()))
        np.savetxt(path, rows, delimiter=",", header=",".join(self.columns), comments="", fmt="%.10g")
        text = "\n".join(f"[{table}]\n{lines}" for table, lines in self.lines.items() if lines)
        path.with_suffix(".toml").write_text(text + "\n", encoding="utf-8")
        return path


def moved(seed: int, kind: str = "stage", k: float | None = None) -> Rig:
    """A rig of one kind that moves, its scale factor drawn unless it is given."""
    rng = np.random.default_rng(seed)
    rate, seconds, tones, rms = MOTIONS[kind]
    rate, seconds = rate * rng.uniform(0.7, 1.4), seconds * rng.uniform(0.8, 1.3)
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi * tones * rng.uniform(0.9, 1.1, len(tones))
    size = rng.uniform(0.5, 1.5, len(w)) * rms
    phase = rng.uniform(0.0, 2.0 * np.pi, len(w))
    x = np.outer(t, w) + phase
    k = rng.uniform(-0.25, 0.35) if k is None else k
    a, v, p = np.sin(x) @ size, -np.cos(x) @ (size / w), -np.sin(x) @ (size / w**2)
    return Rig(t, p, v, a, float(k), float(rng.uniform(-0.3, 0.3)), rng)


TIME = 'time = { column = "t", unit = "s" }'
ACCEL = 'accel = { column = "acc", unit = "m/s^2" }'
POSITION = 'position = { column = "pos", unit = "m" }'


def honest(seed: int, kind: str, k: float | None = None) -> Rig:
    """A rig that is declared as it is."""
    record = moved(seed, kind, k)
    record.columns = {"t": record.t, "pos": record.read(), "acc": record.output()}
    record.declare(TIME, ACCEL, POSITION)
    return record


UNITS = {
    "accel g": ("acc", 1.0 / G, "m/s^2", "g", "accel"),
    "accel m/s^2": ("acc", 1.0, "g", "m/s^2", "accel"),
    "accel mg": ("acc", 1e3 / G, "g", "mg", "accel"),
    "accel mm/s^2": ("acc", 1e3, "m/s^2", "mm/s^2", "accel"),
    "position mm": ("pos", 1e3, "m", "mm", "position"),
    "position m": ("pos", 1.0, "mm", "m", "position"),
    "position um": ("pos", 1e6, "mm", "um", "position"),
    "position cm": ("pos", 1e2, "m", "cm", "position"),
    "position in": ("pos", 1.0 / 0.0254, "mm", "in", "position"),
    "time ms": ("t", 1e3, "s", "ms", "time"),
    "time s": ("t", 1.0, "ms", "s", "time"),
    "time us": ("t", 1e6, "ms", "us", "time"),
    "time min": ("t", 1.0 / 60.0, "s", "min", "time"),
}
"""Column, its values over SI, the unit that is declared, the true one, and the channel."""


def wrong_unit(seed: int, kind: str, mistake: str) -> tuple[Rig, str]:
    """A rig one of whose units is mistaken, and the line that mends it."""
    recording = honest(seed, kind, float(np.random.default_rng(seed).uniform(-0.15, 0.2)))
    column, factor, declared, true, channel = UNITS[mistake]
    recording.columns[column] = recording.columns[column] * factor
    lines = {"time": TIME, "accel": ACCEL, "position": POSITION}
    lines[channel] = f'{channel} = {{ column = "{column}", unit = "{declared}" }}'
    recording.declare(*lines.values())
    return recording, f'{channel} = {{ column = "{column}", unit = "{true}" }}'


def wrong_range(seed: int, kind: str, power: int) -> tuple[Rig, str]:
    """A rig whose counts are off by a power of two, and the line that mends it."""
    recording = honest(seed, kind, float(np.random.default_rng(seed).uniform(-0.1, 0.1)))
    recording.columns["acc"] = np.rint(recording.columns["acc"] / G * 16384.0 * 2.0**power)
    recording.declare(TIME, ACCEL.replace("m/s^2", "count"), POSITION, sensor='scale = "16384 count/g"')
    return recording, f'scale = "{16384.0 * 2.0**power:.6g} count/g"'


def wrong_sensitivity(seed: int, kind: str) -> tuple[Rig, str]:
    """A sensitivity in V/(m/s²) that is one in V/g."""
    recording = honest(seed, kind, float(np.random.default_rng(seed).uniform(-0.1, 0.1)))
    recording.columns["acc"] = recording.columns["acc"] / G * 0.1 + 1.2
    sensor = 'scale = "0.1 V/(m/s^2)"\nzero = "1.2 V"'
    recording.declare(TIME, ACCEL.replace("m/s^2", "V"), POSITION, sensor=sensor)
    return recording, 'scale = "0.1 V/g"'


def wrong_axis(seed: int, kind: str, sign: float, declared: bool) -> tuple[Rig, str]:
    """A triaxial sensor whose motion is along y with a sign; x is taken. The lines of y that mend it."""
    record = moved(seed, kind, float(np.random.default_rng(seed).uniform(-0.1, 0.1)))
    y = sign * record.output() / G
    x = 0.01 * y + record.noise(3e-4) + 0.02
    z = 1.0 + 0.005 * y + record.noise(3e-4)
    record.columns = {"t": record.t, "ax": x, "ay": y, "az": z, "pos": record.read()}
    side = ['a_y = { column = "ay", unit = "g" }', 'a_z = { column = "az", unit = "g" }'] if declared else []
    record.declare(TIME, 'accel = { column = "ax", unit = "g" }', POSITION, *side)
    return record, 'accel = { column = "ay", unit = "g" }'


GRAVITY = {
    "removed": ('axis = "up"', 0.0, 'gravity_along_axis = "0 m/s^2"'),
    "removed down": ('axis = "down"', 0.0, 'gravity_along_axis = "0 m/s^2"'),
    "other way": ('axis = "up"', -G, 'axis = "down"'),
    "left in": ('axis = "level"', G, 'axis = "up"'),
    "left in down": ('axis = "level"', -G, 'axis = "down"'),
}
"""What is declared, gravity along the axis in the output, and the line that mends it."""


def wrong_gravity(seed: int, kind: str, mistake: str) -> tuple[Rig, str]:
    """A rig whose gravity is declared wrongly, and the line that mends it."""
    recording = honest(seed, kind, float(np.random.default_rng(seed).uniform(-0.1, 0.1)))
    declared, gravity, line = GRAVITY[mistake]
    recording.columns["acc"] = recording.output(gravity)
    recording.declare(TIME, ACCEL, POSITION, rig=declared)
    return recording, line


def wrong_sign(seed: int, kind: str) -> tuple[Rig, str]:
    """A sensor that is mounted the other way round."""
    recording = honest(seed, kind)
    recording.columns["acc"] = -recording.columns["acc"]
    return recording, 'mount = "reversed"'


def mistaken(number: int, seed: int) -> tuple[str, Rig, str]:
    """One of the mistakes by its number: its name, the rig, and a part of the sentence that must come."""
    kind, at = list(MOTIONS)[number % len(MOTIONS)], 1000 * seed + number
    makers = [(f"unit: {name}", lambda name=name: wrong_unit(at, kind, name)) for name in UNITS]
    makers += [(f"range: 2^{n}", lambda n=n: wrong_range(at, kind, n)) for n in (-2, -1, 1, 2)]
    makers += [("sensitivity", lambda: wrong_sensitivity(at, kind)), ("sign", lambda: wrong_sign(at, kind))]
    makers += [
        (f"axis: {sign:+g}, {declared}", lambda sign=sign, declared=declared: wrong_axis(at, kind, sign, declared))
        for sign in (1.0, -1.0)
        for declared in (False, True)
    ]
    makers += [(f"gravity: {name}", lambda name=name: wrong_gravity(at, kind, name)) for name in GRAVITY]
    name, make = makers[number % len(makers)]
    return f"{name}, {kind}", *make()
