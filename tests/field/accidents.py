"""Accidents of a laboratory, planted into honest records by analytic motion: files as a logger would have written them.

The simulator shares no code with the package: five tones, an output with a bias and a scale factor, white noise.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
STANDARD_GRAVITY = 9.80665
SIZES = np.array([0.03, 8e-3, 3e-3, 1e-3, 5e-4])
"""m"""
FREQUENCIES = np.array([0.31, 0.87, 1.9, 3.7, 5.3])
"""Hz"""


@dataclass
class Record:
    """What a logger writes of one run, changed in place by an accident."""

    rng: np.random.Generator
    rate: float
    """Hz"""
    t: Array
    """True instants of both channels, s."""
    p: Array
    """True position, m."""
    a: Array
    """True acceleration, m/s²."""
    u: Array
    z: Array
    bias: float
    scale_factor: float
    t_u: Array = field(default_factory=lambda: np.empty(0))
    """Stamps of the output, s."""
    t_z: Array = field(default_factory=lambda: np.empty(0))
    stamped: bool = True
    """The output has stamps; otherwise a rate is declared for it."""
    clocks: int = 1
    """Columns of stamps."""
    range: float | None = None
    """Declared, m/s²."""
    reference: str = 'position = { column = "pos", unit = "m"'
    """Line of the sidecar, but for its end."""
    delay: float = 0.0
    """Of the output, s."""
    quadratic: float = 0.0
    """(m/s²)⁻¹"""

    def write(self, path: Path) -> Path:
        """Write CSV and sidecar; the path of the CSV."""
        accel = 'accel = { column = "out", unit = "m/s^2"'
        columns = {"out": self.u, "pos": self.z}
        if self.clocks == 1 and self.stamped:
            columns = {"sec": self.t_u, **columns}
            time = 'time = { column = "sec", unit = "s" }\n'
            accel, position = accel + " }\n", self.reference + " }\n"
        elif self.clocks == 1:
            time = f'time = {{ rate = "{self.rate:.9g} Hz" }}\n'
            accel, position = accel + " }\n", self.reference + " }\n"
        else:
            columns = {"t1": self.t_u, "out": self.u, "t2": self.t_z, "pos": self.z}
            clock = '{ column = "t1", unit = "s" }' if self.stamped else f'{{ rate = "{self.rate:.9g} Hz" }}'
            time = ""
            accel += f", time = {clock} }}\n"
            position = self.reference + ', time = { column = "t2", unit = "s" } }\n'
        rows = max(map(len, columns.values()))
        lines = [",".join(columns)]
        for i in range(rows):
            lines.append(",".join(f"{y[i]:.10g}" if i < len(y) else "" for y in columns.values()))
        path.write_text("\n".join(lines) + "\n")
        sensor = f'[sensor]\nrange = "{self.range:.9g} m/s^2"\n' if self.range else ""
        path.with_suffix(".toml").write_text(f'{sensor}[rig]\naxis = "level"\n[channels]\n{time}{accel}{position}')
        return path

    def middle(self, first: float = 0.3, last: float = 0.7) -> int:
        """Index of an instant in this part of the record."""
        return int(len(self.t) * self.rng.uniform(first, last))


def honest(seed: int) -> Record:
    """A record without an accident."""
    rng = np.random.default_rng([38, seed])
    rate, seconds = float(rng.choice([250.0, 500.0, 1000.0])), float(rng.uniform(40.0, 70.0))
    t = np.arange(0.0, seconds, 1.0 / rate)
    w = 2.0 * np.pi * FREQUENCIES * rng.uniform(0.85, 1.15)
    tones = np.sin(np.outer(w, t) + rng.uniform(0.0, 2.0 * np.pi, (5, 1)))
    size = SIZES * rng.uniform(0.7, 1.4)
    p, a = size @ tones, -(size * w**2) @ tones
    bias, scale = float(rng.uniform(-0.3, 0.3)), float(rng.uniform(-0.03, 0.03))
    u = bias + (1.0 + scale) * a + 10.0 ** rng.uniform(-3.0, -2.3) * rng.standard_normal(len(t))
    z = p + 1e-6 * rng.standard_normal(len(t))
    return Record(rng, rate, t, p, a, u, z, bias, scale, t.copy(), t.copy())


def shocks(seed: int) -> Record:
    """Half-sine-squared shocks with long rests beside a reference accelerometer (ISO 16063-13), with a delay and a
    quadratic term in two records of three."""
    rng = np.random.default_rng([39, seed])
    rate, rest = float(rng.choice([5000.0, 10000.0, 20000.0])), float(rng.uniform(0.4, 0.9))
    count, width = int(rng.integers(6, 13)), float(rng.uniform(1.5e-3, 5e-3))
    peaks = STANDARD_GRAVITY * np.sort(rng.uniform(12.0, 45.0, count))
    t = np.arange(0.0, (count + 0.5) * rest, 1.0 / rate)
    begins = (np.arange(count) + 0.7) * rest + rng.uniform(0.0, 1.0 / rate, count)
    bias, scale = float(rng.uniform(-0.8, 0.8)), float(rng.uniform(-0.03, 0.03))
    delay = float(rng.uniform(15e-6, 60e-6)) if seed % 3 else 0.0
    quadratic = float(rng.uniform(-2e-5, 2e-5)) if seed % 3 else 0.0

    def motion(at: Array) -> Array:
        x = (at[:, None] - begins) / width
        return np.sum(np.where((x > 0.0) & (x < 1.0), peaks * np.sin(np.pi * x) ** 2, 0.0), axis=1)

    a, late = motion(t), motion(t - delay)
    sigma, reference = 10.0 ** rng.uniform(-1.2, -0.4), 10.0 ** rng.uniform(-1.6, -0.8)
    u = bias + (1.0 + scale) * late + quadratic * late**2 + sigma * rng.standard_normal(len(t))
    z = a + reference * rng.standard_normal(len(t))
    line = 'reference_acceleration = { column = "pos", unit = "m/s^2"'
    record = Record(rng, rate, t, t, a, np.round(u, 2), np.round(z, 2), bias, scale, t.copy(), t.copy())
    record.reference, record.delay, record.quadratic = line, delay, quadratic
    return record


def _touched(r: Record) -> None:
    r.u += 0.5 * np.exp(-0.5 * ((r.t - r.t[r.middle()]) / 0.4) ** 2)


def _range_changed(first: float, last: float) -> Callable[[Record], None]:
    def change(r: Record) -> None:
        k = r.middle(first, last)
        r.u[:k] *= 0.5 if first < 0.5 else 1.0
        r.u[k:] *= 1.0 if first < 0.5 else 0.5

    return change


def _range_for_a_while(r: Record) -> None:
    k = r.middle(0.3, 0.6)
    r.u[k : k + len(r.u) // 7] *= 0.5


def _clock_stepped(r: Record) -> None:
    r.clocks = 2
    r.t_u[r.middle() :] += 0.25


def _clock_slewed(r: Record) -> None:
    r.clocks = 2
    third = r.t[-1] / 3.0
    r.t_u += 5e-4 * np.clip(r.t - third, 0.0, third)


def _encoder_zeroed(r: Record) -> None:
    r.z[r.middle() :] += 0.005


def _encoder_hung(r: Record) -> None:
    k = r.middle()
    r.z[k : k + int(1.5 * r.rate)] = r.z[k]


def _repeated(stamped: bool) -> Callable[[Record], None]:
    def repeat(r: Record) -> None:
        k, n = r.middle(), int(0.2 * r.rate)
        order = np.concatenate([np.arange(k + n), np.arange(k, len(r.t))])
        r.u, r.z = r.u[order], r.z[order]
        r.t_u = r.t_u[order]
        r.t_z = r.t_z[order]
        r.stamped = stamped

    return repeat


def _swapped(r: Record) -> None:
    k = r.middle(0.5, 0.7)
    r.u[k:], r.z[k:] = r.z[k:].copy(), r.u[k:].copy()


def _saturated(r: Record) -> None:
    r.range = STANDARD_GRAVITY
    for middle in r.rng.uniform(5.0, r.t[-1] - 5.0, 4):
        x, w = (r.t - middle) / 0.3, 2.0 * np.pi * r.rng.uniform(8.0, 14.0)
        size = 14.0 / w**2 * np.exp(-0.5 * x**2)
        s, c = np.sin(w * (r.t - middle)), np.cos(w * (r.t - middle))
        a = size * (((x**2 - 1.0) / 0.09 - w**2) * s - 2.0 * x / 0.3 * w * c)
        r.z += size * s
        r.u += (1.0 + r.scale_factor) * a
    r.u = np.clip(r.u, -STANDARD_GRAVITY, STANDARD_GRAVITY)


def _idle(r: Record) -> None:
    k = r.middle()
    r.u[k : k + int(r.rng.uniform(2.0, 5.0) * r.rate)] = 0.0


def _absurd(r: Record) -> None:
    rows = r.rng.choice(len(r.t), 3, replace=False)
    r.u[rows] = r.rng.choice([-1.0, 1.0], 3) * 10.0 ** r.rng.uniform(5.0, 8.0, 3)


def _warming(r: Record) -> None:
    r.u += 0.05 * r.t / r.t[-1]


def _hum(r: Record) -> None:
    r.u += 0.02 * np.sin(2.0 * np.pi * 50.02 * r.t) + 0.006 * np.sin(2.0 * np.pi * 100.04 * r.t)


def _aliased(r: Record) -> None:
    r.u += 0.05 * np.sin(2.0 * np.pi * (r.rate - 17.3) * r.t)


def _lost(stamped: bool) -> Callable[[Record], None]:
    def lose(r: Record) -> None:
        left = np.arange(len(r.t)) % 64 != int(r.rng.integers(64))
        r.u, r.t_u = r.u[left], r.t_u[left]
        r.clocks, r.stamped = 2, stamped

    return lose


def _daylight_saving(r: Record) -> None:
    k = r.middle()
    r.t_u += 7200.0
    r.t_u[k:] += 3600.0 if r.rng.random() < 0.5 else -3600.0


def _other_rate(r: Record) -> None:
    k = r.middle(0.2, 0.4)
    left = np.concatenate([np.arange(0, k, 4), np.arange(k, len(r.t))])
    r.u, r.z, r.t_u, r.t_z = r.u[left], r.z[left], r.t_u[left], r.t_z[left]


def _junk(r: Record) -> None:
    n = int(r.rng.integers(5, 60))
    r.u[:n] = r.rng.uniform(-20.0, 20.0, n)


def _fifo(r: Record) -> None:
    r.clocks = 2
    last = np.minimum((np.arange(len(r.t)) // 16 + 1) * 16 - 1, len(r.t) - 1)
    arrival = r.t[last] + np.repeat(r.rng.exponential(2e-4, len(r.t) // 16 + 1), 16)[: len(r.t)]
    r.t_u = arrival - (last - np.arange(len(r.t))) / r.rate


def _jitter(r: Record) -> None:
    r.clocks = 2
    r.t_u = np.sort(r.t + r.rng.exponential(0.3 / r.rate, len(r.t)))


def _reversed(r: Record) -> None:
    r.u = -r.u


def _misread(r: Record) -> None:
    if r.rng.random() < 0.5:
        r.z = r.z * 1000.0
    else:
        r.u = r.u / STANDARD_GRAVITY


@dataclass(frozen=True)
class Accident:
    """One kind of accident."""

    plant: Callable[[Record], None]
    message: str
    """What `check`, a fit, a verdict or a refusal must say, a regular expression over all sentences."""
    names: tuple[str, ...] = ()
    """Effects that are right."""


ACCIDENTS = {
    "touched": Accident(_touched, "disturbed the record between"),
    "range_early": Accident(_range_changed(0.1, 0.2), "left out"),
    "range_late": Accident(_range_changed(0.85, 0.93), "left out"),
    "range_while": Accident(_range_for_a_while, "left out"),
    "clock_stepped": Accident(_clock_stepped, "clock|delay|relation|no readings|gap"),
    "clock_slewed": Accident(_clock_slewed, "clock|delay|rate", ("clock_skew", "time_offset_drift")),
    "encoder_zeroed": Accident(_encoder_zeroed, "position jumps|lost or gained|zeroed", ("encoder_step",)),
    "encoder_hung": Accident(_encoder_hung, "left out"),
    "repeated_stamps": Accident(_repeated(True), "row|repeat"),
    "repeated_rows": Accident(_repeated(False), "repeat"),
    "swapped": Accident(_swapped, "relation"),
    "saturated": Accident(_saturated, "left out"),
    "idle": Accident(_idle, "left out"),
    "absurd": Accident(_absurd, "left out"),
    "warming": Accident(_warming, "drift|slow|tilt|bias", ("bias_drift", "bias_random_walk", "bias_trend", "warm_up")),
    "hum": Accident(_hum, "50", ("tone",)),
    "aliased": Accident(_aliased, "17", ("tone",)),
    "lost_stamps": Accident(_lost(True), "gap|lost|no readings"),
    "lost_rows": Accident(_lost(False), "rate|clock|lost"),
    "daylight": Accident(_daylight_saving, "clock|no readings|gap|restart"),
    "other_rate": Accident(_other_rate, "sampled at"),
    "junk": Accident(_junk, "left out"),
    "fifo": Accident(_fifo, "burst|packet|arriv|stamp"),
    "jitter": Accident(_jitter, "jitter|arriv|stamp"),
    "reversed": Accident(_reversed, "mount"),
    "misread": Accident(_misread, "1000|9.80665|unit"),
}
