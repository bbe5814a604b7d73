"""Effects that no catalogue entry has, and faults of the data; each says of which variable it is a function."""

from __future__ import annotations

import numpy as np

from .catalogue import Effect, Shape, between, declare, instant, read_late
from .numerics import Array
from .scene import Scene

OUTSIDE: dict[str, Effect] = {}
FAULTS: dict[str, Effect] = {}


@declare(OUTSIDE, "m/s²", "response", "acceleration", 1e-2, draw=between(period=(0.8, 1.6), phase=(0, 6)))
def micro_nonlinearity(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A ripple in the transfer curve, periodic in force (data sheet ADXL313, "micro-nonlinearity")."""
    return m * np.sin(2 * np.pi * f / shape["period"] + shape["phase"])


@declare(OUTSIDE, "(m/s²)⁻⁴", "response", "acceleration", 1e-4)
def quintic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Fifth-order stiffening of a clamped beam (Nayfeh, Mook 1979, Nonlinear Oscillations, section 7.1)."""
    return m * f**5


def _gate(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {"threshold": float(rng.uniform(0.35, 0.6) * np.max(np.abs(scene.a)))}


@declare(OUTSIDE, "m/s²", "response", "acceleration", 1e-2, draw=_gate)
def force_gate(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The bias shifts while the force exceeds a threshold on one side: a contact that opens (logistic switch)."""
    return m / (1 + np.exp(-(f - shape["threshold"]) / (0.05 * shape["threshold"])))


def _bump_on_rail(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    low, high = np.quantile(scene.p, (0.2, 0.8))
    return {"centre": float(rng.uniform(low, high)), "width": float((high - low) * rng.uniform(0.12, 0.25))}


@declare(OUTSIDE, "m/s²", "force", "position", 1e-2, draw=_bump_on_rail)
def rail_bump(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A magnet beside the rail pulls on the element where the stage passes it (dipole field, Gaussian profile)."""
    return m * np.exp(-0.5 * ((scene.p - shape["centre"]) / shape["width"]) ** 2)


@declare(OUTSIDE, "m/s²", "force", "position", 5e-3, draw=between(first=(0.02, 0.03), second=(0.011, 0.016)))
def rail_two_waves(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Two cogging periods of a linear motor together (Gieras 2000, Linear Synchronous Motors, section 3.6)."""
    w1, w2 = 2 * np.pi / shape["first"], 2 * np.pi / shape["second"]
    return m * (np.sin(w1 * scene.p + 0.4) + 0.7 * np.sin(w2 * scene.p + 1.9))


@declare(OUTSIDE, "(m/s²)/√(m/s)", "force", "velocity", 1e-2)
def root_friction(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A drag that grows with the square root of speed: mixed lubrication (Stribeck 1902; Hersey number)."""
    return m * scene.v / (scene.v**2 + 1e-8) ** 0.25


@declare(OUTSIDE, "s⁻¹ per m", "force", "position velocity", 1.0)
def drag_along_rail(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Viscous drag of a rail that is greased unevenly, proportional to v p (Reynolds 1886, lubrication)."""
    return m * scene.v * scene.p


def _bump_in_time(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {
        "centre": float(scene.seconds * rng.uniform(0.3, 0.7)),
        "width": float(scene.seconds * rng.uniform(0.03, 0.08)),
    }


@declare(OUTSIDE, "m/s²", "response", "time", 1e-2, draw=_bump_in_time)
def passing_disturbance(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The bias rises and falls once: someone leans on the table (Gaussian pulse)."""
    return m * np.exp(-0.5 * ((scene.t - shape["centre"]) / shape["width"]) ** 2)


def _warm(scene: Scene, rng: np.random.Generator) -> dict[str, float]:
    return {"begins": float(np.quantile(scene.temperature, rng.uniform(0.3, 0.5)))}


@declare(OUTSIDE, "m/s²/K²", "response", "temperature", 1e-2, draw=_warm)
def temperature_threshold(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Package stress sets in above a temperature and grows with its square (Senturia 2001, Microsystem Design)."""
    return m * np.maximum(scene.temperature - shape["begins"], 0) ** 2


@declare(OUTSIDE, "m/s²", "response", "since_reversal", 3e-3)
def settling_after_reversal(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """Logarithmic creep of a contact, restarted by each reversal (Dieterich 1979, rate and state friction)."""
    return m * np.log1p(scene.since_reversal / 0.05)


@declare(OUTSIDE, "m/s² per (m/s³)³", "response", "jerk", 1e-8)
def jerk_cubed(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """An amplifier that falls behind on steep signals (slew-rate distortion, Jung 1977): odd in the rate of change."""
    return m * scene.jerk**3


@declare(OUTSIDE, "(m/s²)⁻²", "response", "a_y", 3e-3)
def lateral_cubic(scene: Scene, f: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """The element touches its side stop softly under lateral force (Hertz contact, odd in a_y)."""
    return m * scene.a_y**3


@declare(OUTSIDE, "m", "scale", "encoder_position", 2e-6, draw=_bump_on_rail)
def scratch_on_scale(scene: Scene, p: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """A dent in the scale shifts the reading around one place (ISO 230-2, local positioning deviation)."""
    return m * np.exp(-0.5 * ((p - shape["centre"]) / shape["width"]) ** 2)


@declare(FAULTS, "1", "clock", "time", 3.0, draw=instant)
def dropped_samples(scene: Scene, y: Array, m: float, shape: Shape, rng: np.random.Generator) -> Array:
    """m samples are lost, and stamps that are only counted fall behind by m/1667 s (sequence-number gaps, RFC 3550)."""
    return read_late(scene, y, np.where(scene.t >= shape["instant"], -m / 1667.0, 0.0))
