"""Records with saturated bursts: `python -m benches.left_out [--records 20] [--seed 1] [--out build/left_out.jsonl]`.

A slow motion of five tones and bursts of 8 to 20 Hz beyond the declared range, of a simulator of its own: sensors
without a low-pass, with an RC behind the element that clips, and with one before the converter that does. Right is a
scale factor and a bias within 3.5 standard deviations, saturation told, no tilt and no name. Prints how many are, and
exits with 1 where more than one in twenty is not; an interrupted run goes on where it stopped.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accelcal.data.arrays import Array
from accelcal.data.recording import Recording
from accelcal.data.rig import STANDARD_GRAVITY, LowPass, Rig, Sensor
from accelcal.estimation.estimate import estimate
from accelcal.model import Model
from accelcal.verbs import improve
from benches.outcomes import Outcome, run_all

SECONDS, RATE, FINER = 40.0, 500, 20
"""s; Hz; steps of the simulation in a sample."""
CLIPS = ("no low-pass", "element clips", "converter clips")
TRUTH = {"bias": 0.1, "scale_factor": 0.01}
MOST_SIGMA = 3.5
"""Two parameters of 20 records exceed it once in 50 benches by chance."""
LEAST_RIGHT = 0.95


@dataclass(frozen=True, slots=True)
class Trial:
    """One record."""

    number: int
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.number}"


def motion(t: Array, rng: np.random.Generator, peak: float) -> tuple[Array, Array]:
    """Position (m) and acceleration (m/s²) at times (n,), s: five tones, and bursts of a peak acceleration."""
    size, w = np.array([0.03, 8e-3, 3e-3, 1e-3, 5e-4]), 2.0 * np.pi * np.array([0.31, 0.87, 1.9, 3.7, 5.3])
    phase = rng.uniform(0.0, 2.0 * np.pi, 5)
    p, a = np.zeros_like(t), np.zeros_like(t)
    for amplitude, radians, shift in zip(size, w, phase, strict=True):
        tone = amplitude * np.sin(radians * t + shift)
        p, a = p + tone, a - radians**2 * tone
    for middle in rng.uniform(3.0, SECONDS - 3.0, int(rng.integers(2, 8))):
        radians, width = 2.0 * np.pi * rng.uniform(8.0, 20.0), rng.uniform(0.1, 0.5)
        x = (t - middle) / width
        tone, slope = np.sin(radians * (t - middle)), np.cos(radians * (t - middle))
        envelope = peak / radians**2 * np.exp(-0.5 * x**2)
        p = p + envelope * tone
        bent = (x**2 - 1.0) / width**2 - radians**2
        a = a + envelope * (bent * tone - 2.0 * x / width * radians * slope)
    return p, a


def record(trial: Trial) -> Recording:
    """The recording of a trial."""
    rng = np.random.default_rng([trial.seed, trial.number])
    clips, limit = CLIPS[trial.number % len(CLIPS)], STANDARD_GRAVITY
    begin = 0.5
    fine = np.arange(-begin, SECONDS, 1.0 / (RATE * FINER))
    p, a = motion(fine, rng, rng.uniform(1.2, 2.0) * limit)
    u = TRUTH["bias"] + (1.0 + TRUTH["scale_factor"]) * a
    lowpass = None if clips == "no low-pass" else LowPass(float(rng.uniform(40.0, 120.0)), 0.0)
    if clips == "element clips":
        u = np.clip(u, -limit, limit)
    if lowpass is not None:  # of straight lines between the steps, but for the start, which is forgotten
        decay = float(np.exp(-1.0 / (RATE * FINER * lowpass.tau)))
        middle, lagged, state = 0.5 * (u[1:] + u[:-1]), np.empty_like(u), float(u[0])
        lagged[0] = state
        for k, value in enumerate(middle.tolist(), start=1):
            state = decay * state + (1.0 - decay) * value
            lagged[k] = state
        u = lagged
    noise, count = float(10.0 ** rng.uniform(-3.0, -2.0)), 2.0 * limit / 2**16
    rows = slice(int(begin * RATE * FINER), None, FINER)
    u = np.clip(u[rows] + noise * rng.standard_normal(len(u[rows])), -limit, limit)
    z = p[rows] + 1e-6 * rng.standard_normal(len(p[rows]))
    rig = Rig(sensor=Sensor(range=limit), lowpass=lowpass)
    units = {"accel": "m/s^2", "position": "m"}
    return Recording.from_arrays(fine[rows], count * np.rint(u / count), z, units=units, rig=rig, name=trial.key)


def outcome(trial: Trial) -> Outcome:
    """Errors in standard deviations, the scale factor with the saturated readings, and what is said."""
    recording = record(trial)
    step = improve(recording)
    base, last = step.steps[0].fit, step.diagnosis
    errors = {name: (base[name].value - value) / base[name].std for name, value in TRUTH.items()}
    messages = [remark for remark in last.remarks if remark.code == "saturated"]
    codes = [remark.code for remark in last.remarks]
    right = bool(messages) and not step.effects and last.verdict == "adequate" and "turning_sensor" not in codes
    return {
        "key": trial.key,
        "clips": CLIPS[trial.number % len(CLIPS)],
        "share": sum(float(remark.values["share"]) for remark in messages),
        "errors": errors,
        "with_them": estimate(Model.linear(), recording)["scale_factor"].value,
        "effects": list(step.effects),
        "verdict": last.verdict,
        "remarks": codes,
        "right": right and all(abs(error) < MOST_SIGMA for error in errors.values()),
    }


def main() -> int:
    """Print each outcome and the number that are right."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=Path("build/left_out.jsonl"))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    trials = [Trial(number, options.seed) for number in range(options.records)]
    outcomes = run_all(outcome, trials, options.out, options.workers)
    for row in outcomes:
        errors = ", ".join(f"{name} {error:+.1f}" for name, error in row["errors"].items())
        text = " ".join((*row["effects"], row["verdict"], *row["remarks"]))
        left_out, raw = row["share"], row["with_them"]
        print(
            f"{row['key']} {row['clips']}: {left_out:.1f} % left out; {errors} sigma (k {raw:+.4f} with them); {text}"
        )
    right = sum(row["right"] for row in outcomes)
    print(f"right: {right} of {len(outcomes)}")
    return int(right < LEAST_RIGHT * len(outcomes))


if __name__ == "__main__":
    sys.exit(main())
