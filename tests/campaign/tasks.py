"""Tasks of campaigns: importable by any worker, and noting their calls where they are asked to."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelcal.filters.choice import FilterChoice
from accelcal.filters.record import run_batch
from accelcal.validation.consistency import nees

Array = NDArray[np.float64]

CALLS = "ACCELCAL_CALLS"
"""Environment variable: the file in which calls are noted, one label a line."""

W2 = FilterChoice("aci", "cubic", form="inverse", interpolation="cubic", integrator="rk4", order=2)
DT = 1.0 / 1667.0
TONES = ((5.0, 7.3), (3.0, 19.1), (2.0, 41.7))
"""Amplitudes, m/s², and angular frequencies, rad/s."""
PRIOR = np.array([1e-5, 0.1, 1e-2, 0.1, 1e-3, 1e-4])
"""Standard deviations of p, v, k, K0, K2, K3, SI."""
OUTPUT_NOISE, POSITION_NOISE = 1e-2, 1e-6


def w2(rng: np.random.Generator, *, seconds: float) -> dict[str, float]:
    """One run of a cubic second-order ACI filter on a record of three tones; errors in sigma, and their NEES."""
    note(rng)
    truth = PRIOR * rng.standard_normal(6)
    a, v, p = tones(rng, seconds)
    u = output(a, *truth[2:]) + OUTPUT_NOISE * rng.standard_normal(len(a))
    z = p + POSITION_NOISE * rng.standard_normal(len(p))
    z[1::2] = np.nan
    result = run_batch(
        W2,
        u,
        z,
        dt=DT,
        q=OUTPUT_NOISE**2 * DT,
        r_position=POSITION_NOISE**2,
        x0=[p[0] - truth[0], v[0] - truth[1], 0.0, 0.0, 0.0, 0.0],
        P0=np.diag(PRIOR**2),
    )
    error, covariance = result.states[0, 2:] - truth[2:], result.covariances[0, 2:, 2:]
    deviates = error / np.sqrt(np.diag(covariance))
    return {
        **dict(zip(result.names[2:], deviates.tolist(), strict=True)),
        "nees": float(nees(error, covariance)),
        "log_likelihood": float(result.log_likelihoods[0]),
    }


def tones(rng: np.random.Generator, seconds: float) -> tuple[Array, Array, Array]:
    """Acceleration, velocity and position (n,) of tones with drawn phases."""
    t = np.arange(round(seconds / DT) + 1) * DT
    a, v, p = np.zeros((3, len(t)))
    for amplitude, w in TONES:
        phase = w * t + rng.uniform(0.0, 2.0 * np.pi)
        a += amplitude * np.sin(phase)
        v -= amplitude / w * np.cos(phase)
        p -= amplitude / w**2 * np.sin(phase)
    return a, v, p


def output(a: Array, k: float, K0: float, K2: float, K3: float) -> Array:
    """Output that the inverse sensor model (6) turns into acceleration `a`, by Newton's method."""
    w = a
    for _ in range(5):
        w = w - ((1.0 - k) * w + K2 * w**2 + K3 * w**3 - a) / (1.0 - k + 2.0 * K2 * w + 3.0 * K3 * w**2)
    return w + K0


def draw(rng: np.random.Generator, *, scale: float = 1.0) -> dict[str, float]:
    """A number, at no cost."""
    note(rng)
    return {"x": scale * rng.standard_normal()}


def sometimes(rng: np.random.Generator) -> dict[str, float]:
    """A number; every third run raises, and every third of the others has a second number."""
    note(rng)
    (key,) = rng.bit_generator.seed_seq.spawn_key
    if key % 3 == 2:
        raise ValueError(f"run {key} has had enough")
    return {"x": float(key), **({"y": np.inf} if key % 3 == 1 else {})}


def wrong(rng: np.random.Generator) -> list[float]:
    """Not a dict."""
    return [rng.standard_normal()]


def read(path: Path, *, factor: float) -> dict[str, float]:
    """The number that stands in a file."""
    return {"number": factor * float(path.read_text())}


def note(rng: np.random.Generator) -> None:
    """Append the label of this run to the file of calls, if there is one."""
    if CALLS in os.environ:
        (key,) = rng.bit_generator.seed_seq.spawn_key
        file = os.open(os.environ[CALLS], os.O_APPEND | os.O_CREAT | os.O_WRONLY)
        os.write(file, f"{rng.bit_generator.seed_seq.entropy}:{key}\n".encode())
        os.close(file)
