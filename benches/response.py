"""Sensitivity by frequency held to exact simulated shakers: errors, and how often the stated intervals hold.

Run from the top of the repository: python -m benches.response [--runs N]
A laser vibrometer on a resonant sensor (magnitude 0.1 %, phase 0.1 degree, f0 0.5 %, Q 5 %), and a sensor with the
published response of an MPU-9250 (0.5 %, 0.3 degrees); then a sweep and random motion, whose coverage alone is held.
Intervals of k = 2 must hold the truth in 93 to 97 of 100. Exit code 1 where a bar is missed.
"""

from __future__ import annotations

import argparse
import math
import sys
from dataclasses import dataclass, field

import numpy as np

from accelcal.data.recording import Recording
from accelcal.response import FrequencyResponse, frequency_response
from accelcal.simulation.sensor import ADXL105_RIG, simulate
from tests.worlds.shaker import SecondOrder, Step, published_sensor, run

REST = 0.1
"""Between steps, s."""
COVERED = (0.93, 0.97)


@dataclass(frozen=True)
class Setup:
    """A shaker's run."""

    steps: tuple[Step, ...]
    sensor: SecondOrder
    rate: float
    """Of the output, Hz."""
    reading_rate: float
    """Of the displacement, Hz."""
    noise: float
    """Standard deviation of the output, m/s²."""
    reading_noise: float
    """Standard deviation of the displacement, m."""

    def recording(self, rng: np.random.Generator) -> Recording:
        """One run with its own noise and clocks."""
        seconds = sum(s.seconds for s in self.steps) + REST * (len(self.steps) + 1)
        t = np.arange(0.0, seconds, 1.0 / self.rate) + rng.uniform(0.0, 1.0 / self.rate)
        tz = np.arange(0.0, seconds, 1.0 / self.reading_rate) + rng.uniform(0.0, 1.0 / self.reading_rate)
        output, displacement = run(self.steps, self.sensor, t, tz, REST)
        output += self.noise * rng.standard_normal(len(t))
        displacement += self.reading_noise * rng.standard_normal(len(tz))
        units = {"t": "s", "accel": "m/s^2", "position": "m"}
        return Recording.from_arrays(t, output, displacement, position_t=tz, units=units, name="shaker")


def vibrometer(rng: np.random.Generator) -> Setup:
    """A resonance drawn between 300 and 700 Hz, a delay of up to 100 us; 14 steps of 20 m/s² from 10 to 800 Hz."""
    sensor = SecondOrder(
        rng.uniform(0.95, 1.05), rng.uniform(300.0, 700.0), math.exp(rng.uniform(0.0, 3.0)), rng.uniform(0.0, 1e-4)
    )
    steps = tuple(Step(float(f), 20.0, 0.8 + 8.0 / float(f)) for f in np.geomspace(10.0, 800.0, 14))
    return Setup(steps, sensor, 5000.0, 5000.0, 0.02, 1e-9)


def mpu9250() -> Setup:
    """The published response as the truth; 13 steps from 1 to 60 Hz of at most 5 m/s² and 20 mm, read to 1 um."""
    frequencies = (1.0, 1.5, 2.5, 4.0, 6.0, 8.0, 10.0, 14.0, 20.0, 28.0, 40.0, 50.0, 60.0)
    steps = tuple(Step(f, min(5.0, 0.02 * (2 * math.pi * f) ** 2), 12.0 + 8.0 / f) for f in frequencies)
    return Setup(steps, published_sensor()[0], 500.0, 1000.0, 0.047, 1e-6)


@dataclass
class Tally:
    """Errors and intervals of many runs."""

    magnitude: list[float] = field(default_factory=list)
    """Relative."""
    phase: list[float] = field(default_factory=list)
    """Degrees."""
    parameters: dict[str, list[float]] = field(default_factory=dict)
    """Relative errors by name."""
    scores: list[float] = field(default_factory=list)
    """Errors in expanded uncertainties."""
    z: list[float] = field(default_factory=list)
    """Errors of points in standard uncertainties."""
    structures: dict[str, int] = field(default_factory=dict)
    lost: int = 0
    """Steps that were not found."""

    def add(self, result: FrequencyResponse, setup: Setup) -> None:
        """Count one run."""
        for point in result.points:
            truth = complex(setup.sensor.response(np.array([point.frequency]))[0])
            ratio = point.value / truth
            self.magnitude.append(abs(ratio) - 1.0)
            self.phase.append(math.degrees(math.atan2(ratio.imag, ratio.real)))
            self.scores.append((point.magnitude - abs(truth)) / point.expanded)
            self.scores.append(math.radians(self.phase[-1]) / point.expanded_phase)
            self.z += [
                (point.magnitude - abs(truth)) / point.std,
                math.radians(self.phase[-1]) * point.magnitude / point.std,
            ]
        self.lost += len(setup.steps) - len(result.points)
        assert result.model is not None
        name = result.model.best.structure.name
        self.structures[name] = self.structures.get(name, 0) + 1
        if name == "second order and delay":
            for key in ("k", "f0", "Q", "delay"):
                truth, estimate = getattr(setup.sensor, key), result.model.best[key]
                self.parameters.setdefault(key, []).append(estimate.value / truth - 1.0)
                self.scores.append((estimate.value - truth) / estimate.expanded)

    @property
    def covered(self) -> float:
        """Share of intervals that hold the truth."""
        return float(np.mean(np.abs(self.scores) < 1.0))

    def text(self) -> str:
        """Figures."""
        parameters = ", ".join(f"{k} {100 * largest(v):.3g} %" for k, v in self.parameters.items())
        return (
            f"{len(self.magnitude)} points ({self.lost} steps lost): magnitude within "
            f"{100 * largest(self.magnitude):.3g} %, phase within {largest(self.phase):.3g} deg; {parameters}; "
            f"{100 * self.covered:.2f} % of {len(self.scores)} intervals hold the truth, rms z of points "
            f"{np.sqrt(np.mean(np.square(self.z))):.3f}; {self.structures}"
        )


def largest(errors: list[float]) -> float:
    """Largest absolute value."""
    return max(map(abs, errors))


def vibrometer_runs(count: int, seed: int = 1) -> Tally:
    """Resonant sensors on the laser vibrometer."""
    tally = Tally()
    for i in range(count):
        rng = np.random.default_rng((seed, i))
        setup = vibrometer(rng)
        tally.add(frequency_response(setup.recording(rng), method="sine", check=False), setup)
    return tally


def mpu9250_runs(count: int, seed: int = 2) -> Tally:
    """The published response."""
    tally = Tally()
    setup = mpu9250()
    for i in range(count):
        recording = setup.recording(np.random.default_rng((seed, i)))
        tally.add(frequency_response(recording, method="sine", check=False), setup)
    return tally


@dataclass
class Coverage:
    """Errors of magnitude and phase in expanded uncertainties."""

    scores: list[float] = field(default_factory=list)

    def text(self) -> str:
        """Figures."""
        return f"{100 * float(np.mean(np.abs(self.scores) < 1.0)):.2f} % of {len(self.scores)} intervals hold the truth"


def broadband_runs(motion: str, count: int, seed: int = 3) -> Coverage:
    """The paper's sensor behind its low-pass, with a delay of 1 ms, in 60 s of a motion of its stage."""
    result = Coverage()
    for i in range(count):
        rng = np.random.default_rng((seed, i))
        truth = {"scale_factor": 0.01, "time_offset": 1e-3}
        simulation = simulate(motion, seconds=60.0, rig=ADXL105_RIG, parameters=truth, rng=rng)
        for point in frequency_response(simulation.recording, method="broadband", check=False).points:
            f = point.frequency
            ratio = point.value / (1.01 / (1.0 + 1j * f / 159.0) * np.exp(-2j * math.pi * f * 1e-3))
            result.scores.append((abs(ratio) - 1.0) * point.magnitude / point.expanded)
            result.scores.append(math.atan2(ratio.imag, ratio.real) / point.expanded_phase)
    return result


def within(tally: Tally, magnitude: float, phase: float) -> bool:
    """Whether every point and every interval count keeps its bar: relative, degrees."""
    return (
        largest(tally.magnitude) < magnitude
        and largest(tally.phase) < phase
        and COVERED[0] <= tally.covered <= COVERED[1]
    )


def main() -> int:
    """Count, print, compare with the bars."""
    options = argparse.ArgumentParser(description=__doc__)
    options.add_argument("--runs", type=int, default=60)
    runs = options.parse_args().runs
    sensor, residual = published_sensor()
    print(f"MPU-9250: {sensor}; residual of the published points {np.array2string(residual, precision=3)}")
    shaken, published = vibrometer_runs(runs), mpu9250_runs(runs)
    print(f"laser vibrometer: {shaken.text()}\nMPU-9250: {published.text()}")
    fine = within(shaken, 1e-3, 0.1) and within(published, 5e-3, 0.3)
    fine &= largest(shaken.parameters["f0"]) < 0.005 and largest(shaken.parameters["Q"]) < 0.05
    for motion in ("sweep", "tones", "interleaved"):
        print(f"broadband, {motion}: {broadband_runs(motion, max(runs // 3, 1)).text()}")
    print("all bars kept" if fine else "a bar is missed")
    return 0 if fine else 1


if __name__ == "__main__":
    sys.exit(main())
