"""Records of a triaxial sensor in gravity, and of one on a vertical axis: sines, and white noise of both channels."""

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import accelcal as ac

G = 9.80665
"""m/s²"""
POWERS = {"quadratic": 2, "cubic": 3}


@dataclass(frozen=True)
class Hidden:
    """A recording with what was planted in it."""

    recording: ac.Recording
    truth: dict[str, float]
    """Bias, scale factor and the effect that is hidden, if any, SI."""


def sines(rng: np.random.Generator, t: np.ndarray, f: Sequence[float], a: Sequence[float]) -> tuple[np.ndarray, ...]:
    """Position (n,) m and acceleration (n,) m/s² of sines of frequencies f, Hz, and acceleration amplitudes a, m/s²."""
    w, phase = 2.0 * np.pi * np.asarray(f)[:, None], rng.uniform(0.0, 2.0 * np.pi, (len(f), 1))
    waves = np.asarray(a)[:, None] * np.sin(w * t + phase)
    return -np.sum(waves / w**2, axis=0), np.sum(waves, axis=0)


def sideways(seed: int, folder: Path, *, hidden: str = "cross_axis", constant: float | None = None) -> Hidden:
    """A level stage with two transverse channels, one of which feels gravity; `hidden` follows that one.

    Parameters
    ----------
    seed : of motion, noise and sizes.
    folder : where the recording is written.
    hidden : cross_axis, cross_axis_z, or "" for nothing.
    constant : of the channel, m/s²; by default up to gravity, of either sign.
    """
    rng = np.random.default_rng(seed)
    rate, seconds = rng.choice([50.0, 100.0, 200.0]), rng.uniform(20.0, 40.0)
    t = np.arange(0.0, seconds, 1.0 / rate)
    f = rng.uniform(1.5, 5.0, 3)
    p, a = sines(rng, t, f, rng.uniform(20e-6, 60e-6, 3) * (2.0 * np.pi * f) ** 2)
    drawn = rng.choice([-1.0, 1.0]) * rng.uniform(0.5, 1.0) * G
    most = 0.3 * np.sqrt(rate / 100.0)  # with more the base model takes all motion for noise
    side = {name: rng.uniform(0.1, 1.0) * most * rng.standard_normal(len(t)) for name in ("a_y", "a_z")}
    across = "a_z" if hidden.endswith("_z") else "a_y"
    side[across] += drawn if constant is None else constant
    truth = {"bias": rng.uniform(-0.1, 0.1), "scale_factor": rng.uniform(-0.02, 0.02)}
    u = truth["bias"] + (1.0 + truth["scale_factor"]) * a + 5e-4 * rng.standard_normal(len(t))
    if hidden:
        truth[hidden] = rng.choice([-1.0, 1.0]) * rng.uniform(0.01, 0.03)
        u += truth[hidden] * side[across]
    columns = {"a_y_m_per_s2": side["a_y"], "a_z_m_per_s2": side["a_z"]}
    return Hidden(written(folder / f"{seed}{hidden}.csv", t, p + 2e-8 * rng.standard_normal(len(t)), u, columns), truth)


def vertical(seed: int, folder: Path, *, hidden: str = "quadratic", shaker: bool = False, d: float = 40.0) -> Hidden:
    """A lift (0.5 to 2 m/s² below 4 Hz) or a shaker (2 to 8 m/s² up to 20 Hz) on a vertical axis.

    Parameters
    ----------
    seed : of motion, noise and sizes.
    folder : where the recording is written.
    hidden : a power of the specific force, or "" for nothing.
    shaker : whether it is one.
    d : size of what is hidden beyond bias and scale factor, in standard deviations of a known motion.
    """
    rng = np.random.default_rng(seed)
    rate = 1000.0 if shaker else 500.0
    t = np.arange(0.0, 30.0 if shaker else 60.0, 1.0 / rate)
    f = rng.uniform(3.0, 20.0, 4) if shaker else np.array([0.3, 0.9, 1.9, 3.7]) * rng.uniform(0.9, 1.1, 4)
    peak = rng.uniform(2.0, 8.0) if shaker else rng.uniform(0.5, 2.0)
    p, a = sines(rng, t, f, peak * rng.dirichlet(np.ones(4)))
    sign = rng.choice([-1.0, 1.0])
    force = a + sign * G
    truth = {"bias": rng.uniform(-0.1, 0.1), "scale_factor": rng.uniform(-0.02, 0.02)}
    u = truth["bias"] + (1.0 + truth["scale_factor"]) * force
    if hidden:
        column = force ** POWERS[hidden]
        line = np.column_stack([np.ones_like(a), a])
        beyond = column - line @ np.linalg.lstsq(line, column, rcond=None)[0]
        truth[hidden] = rng.choice([-1.0, 1.0]) * d * 1e-3 / float(np.linalg.norm(beyond))
        u += truth[hidden] * column
    u += 1e-3 * rng.standard_normal(len(t))
    z = p + 3e-7 * rng.standard_normal(len(t))
    name = f"{seed}{hidden}{'shaker' if shaker else 'lift'}.csv"
    return Hidden(written(folder / name, t, z, u, {}, "up" if sign > 0.0 else "down"), truth)


def written(
    path: Path, t: np.ndarray, z: np.ndarray, u: np.ndarray, side: dict[str, np.ndarray], axis: str = "level"
) -> ac.Recording:
    """The recording of a text table with its sidecar, as a user has them."""
    columns = {"t_s": t, "position_m": z, "accel_m_per_s2": u, **side}
    np.savetxt(path, np.column_stack(list(columns.values())), "%.10g", ",", header=",".join(columns), comments="")
    path.with_suffix(".toml").write_text(f'[rig]\naxis = "{axis}"\n', encoding="utf-8")
    return ac.load(path)
