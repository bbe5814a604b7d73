"""Noise that is not white and references that are not encoders, put on a record of a world that has nothing hidden."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from .numerics import Array, stream
from .world import ACCEL_RATE, ENCODER_NOISE, ENCODER_RATE, Record


def power_law(n: int, rate: float, density: float, exponent: float, rng: np.random.Generator) -> Array:
    """Return noise (n,) of one-sided power density `density`² f^-exponent at f in Hz, from 1/8 of the record up."""
    m = 8 * n
    f = np.fft.rfftfreq(m, 1 / rate)
    power = np.zeros_like(f)
    power[1:] = density**2 * f[1:] ** -exponent
    shocks = rng.standard_normal((2, len(f)))
    return np.asarray(np.fft.irfft(np.sqrt(power * m * rate / 4) * (shocks[0] + 1j * shocks[1]), m)[:n])


def flicker_output(record: Record, rng: np.random.Generator) -> Record:
    """1/f noise of the sensor with a knee of 1 to 20 Hz above its white noise."""
    knee = float(np.exp(rng.uniform(np.log(1.0), np.log(20.0))))
    slow = power_law(len(record.accel), ACCEL_RATE, record.noise * np.sqrt(knee), 1.0, rng)
    return replace(record, accel=record.accel + slow)


def steep_output(record: Record, rng: np.random.Generator) -> Record:
    """Noise of the sensor that falls as f^-1.5, with a knee of 0.5 to 5 Hz."""
    knee = float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
    slow = power_law(len(record.accel), ACCEL_RATE, record.noise * knee**0.75, 1.5, rng)
    return replace(record, accel=record.accel + slow)


def ac_coupled(record: Record, rng: np.random.Generator) -> Record:
    """The output behind a capacitor: first-order high-pass of 0.05 to 0.5 Hz, its noise included."""
    corner = float(np.exp(rng.uniform(np.log(0.05), np.log(0.5))))
    passing = butter(1, corner, "highpass", fs=ACCEL_RATE, output="sos")
    return replace(record, accel=np.asarray(sosfilt(passing, record.accel - record.accel[0])))


def drifting_reference(record: Record, rng: np.random.Generator) -> Record:
    """A frame that creeps: the position walks at random, by 0.1 to 10 mm in the whole record."""
    reach = float(np.exp(rng.uniform(np.log(1e-4), np.log(1e-2))))
    n = len(record.position)
    return replace(record, position=record.position + np.cumsum(rng.standard_normal(n)) * reach / np.sqrt(n))


def flicker_reference(record: Record, rng: np.random.Generator) -> Record:
    """1/f noise of the position with a knee of 50 Hz to 5 kHz above its white noise."""
    knee = float(np.exp(rng.uniform(np.log(50.0), np.log(5e3))))
    white = ENCODER_NOISE * np.sqrt(2 / ENCODER_RATE)
    slow = power_law(len(record.position), ENCODER_RATE, white * np.sqrt(knee), 1.0, rng)
    return replace(record, position=record.position + slow)


def integrated_reference(record: Record, rng: np.random.Generator) -> Record:
    """The position is a second accelerometer, integrated twice: its noise is 1/f and below 0.1 Hz all is cut off."""
    knee = float(np.exp(rng.uniform(np.log(0.5), np.log(5.0))))
    n, rate = len(record.position), ENCODER_RATE
    noise = float(rng.uniform(0.3, 1.0)) * record.noise
    noise_of_reference = noise * np.sqrt(rate / 2) * rng.standard_normal(n) + power_law(
        n, rate, noise * np.sqrt(knee), 1.0, rng
    )
    drift = np.cumsum(np.cumsum(noise_of_reference)) / rate**2
    t = np.linspace(-1.0, 1.0, n)
    drift -= np.polynomial.legendre.legval(t, np.polynomial.legendre.legfit(t, drift, 4))
    passing = butter(2, 0.1, "highpass", fs=rate, output="sos")
    return replace(record, position=record.position + sosfiltfilt(passing, drift))


def smoothed_reference(record: Record, rng: np.random.Generator) -> Record:
    """A reference that was low-passed afterwards, forwards and backwards, at 25 to 60 Hz."""
    passing = butter(2, float(rng.uniform(25.0, 60.0)), fs=ENCODER_RATE, output="sos")
    read = np.isfinite(record.position)
    filled = np.interp(record.t_position, record.t_position[read], record.position[read])
    return replace(record, position=np.where(read, sosfiltfilt(passing, filled), np.nan))


COLOURED: dict[str, Callable[[Record, np.random.Generator], Record]] = {
    "flicker_output": flicker_output,
    "steep_output": steep_output,
    "ac_coupled": ac_coupled,
    "drifting_reference": drifting_reference,
    "flicker_reference": flicker_reference,
    "integrated_reference": integrated_reference,
    "smoothed_reference": smoothed_reference,
}

HONEST: dict[str, frozenset[str]] = {
    "flicker_output": frozenset({"bias_random_walk", "bias_gauss_markov"}),
    "steep_output": frozenset({"bias_random_walk", "bias_gauss_markov"}),
    "ac_coupled": frozenset({"ac_coupling", "creep"}),
    "integrated_reference": frozenset({"bias_random_walk", "bias_gauss_markov"}),
}
"""Names that a kind of noise earns: a random process is slow noise, an AC coupling is one of the catalogue."""


def coloured(record: Record, kind: str) -> Record:
    """Return a record with noise of one kind; the same record gives the same noise."""
    return COLOURED[kind](record, stream(record.world.seed, 9))
