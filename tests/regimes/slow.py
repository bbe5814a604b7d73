"""Records whose noise is slow: 1/f noise of the sensor, an undeclared AC coupling, references that drift."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from tests.worlds.numerics import stream

from .noise import coupled, ornstein_uhlenbeck, power_law
from .regimes import ADXL105, CXL02, Regime
from .rig import NOTHING, Clocks, Planted, Record, Reference, Rig, measure

PROFILES = ("mixed", "smooth", "hand", "s_curve", "random")
RIGS = (
    Rig(CXL02),
    Rig(replace(ADXL105, rate=1000.0)),
    Rig(replace(ADXL105, density=150.0, rate=200.0, corner=None), Reference(2e-4, None, 120.0), Clocks(5e-3)),
)


def white(record: Record, rng: np.random.Generator) -> Record:
    """Return the record as it is."""
    return record


def flicker(record: Record, rng: np.random.Generator) -> Record:
    """Return the record with power-law noise of the output, 0.3 to 10 times its white noise below 1 Hz."""
    t, n = record.t_accel, len(record.t_accel)
    ratio, exponent = 10.0 ** rng.uniform(-0.5, 1.0), rng.uniform(0.8, 1.8)
    deviation = ratio * record.rig.sensor.density * 9.80665e-6
    added = power_law(n, float(np.median(np.diff(t))), exponent, deviation, rng)
    return replace(record, accel=record.accel + added)


def coupling(record: Record, rng: np.random.Generator) -> Record:
    """Return the record behind an AC coupling of 3 to 30 mHz that nobody declared."""
    corner = 10.0 ** rng.uniform(-2.5, -1.5)
    dt = float(np.median(np.diff(record.t_accel)))
    return replace(record, accel=coupled(record.accel, dt, corner))


def drifting(record: Record, rng: np.random.Generator) -> Record:
    """Return the record with a reference that wanders as 1/f to random walk, by 1 to 100 of its white noise."""
    t, n = record.t_position, len(record.t_position)
    deviation = record.rig.reference.sigma * 10.0 ** rng.uniform(0.0, 2.0)
    added = power_law(n, float(np.median(np.diff(t))), rng.uniform(1.0, 2.0), deviation, rng)
    return replace(record, position=record.position + added)


def multipath(record: Record, rng: np.random.Generator) -> Record:
    """Return the record with Gauss-Markov noise of the reference, 0.3 to 30 s, by 1 to 30 of its white noise."""
    t = record.t_position
    deviation = record.rig.reference.sigma * 10.0 ** rng.uniform(0.0, 1.5)
    added = ornstein_uhlenbeck(t, deviation, 10.0 ** rng.uniform(-0.5, 1.5), rng.standard_normal(len(t)))
    return replace(record, position=record.position + added)


KINDS: dict[str, Callable[[Record, np.random.Generator], Record]] = {
    "white": white,
    "flicker": flicker,
    "coupling": coupling,
    "drifting": drifting,
    "multipath": multipath,
}
"""What is slow in a record, by name."""
HONEST: dict[str, frozenset[str]] = {
    "white": frozenset(),
    "flicker": frozenset({"bias_gauss_markov", "bias_random_walk", "shape_of_time"}),
    "coupling": frozenset({"ac_coupling", "creep"}),
    "drifting": frozenset(),
    "multipath": frozenset(),
}
"""Names that are right beside it."""


def build(kind: str, seed: int, seconds: float, planted: Planted = NOTHING) -> Record:
    """Return a record of one kind; the same arguments give the same record."""
    rng = stream(seed, 9)
    rig, profile = RIGS[int(rng.integers(len(RIGS)))], PROFILES[int(rng.integers(len(PROFILES)))]
    motion = Regime(kind, profile, rig).motion(seed, seconds)
    return KINDS[kind](measure(motion, rig, seconds, seed, planted), rng)
