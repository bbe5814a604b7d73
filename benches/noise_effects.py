"""Effects that act on noise, added: intervals of their coefficients, flat noise, log score on held-out data.

Independent worlds in which the effect is hidden, 60 s each: the model is fitted to the first 70 %, the effect is added,
and the rest is held out. `--hidden-off` is the twin: nothing is hidden, and `add` must refuse.

python -m benches.noise_effects --seed 1801 --count 60
"""

from __future__ import annotations

import argparse
import math
import tempfile
from pathlib import Path

import numpy as np
from scipy import stats

import accelcal as ac
from accelcal.diagnosis.clean_fit import outliers_found, run_noise_tests, without_outliers
from accelcal.diagnosis.noise.growing import flatness
from accelcal.estimation.estimate import Fit, state_at
from accelcal.estimation.run import prepare
from accelcal.estimation.run_state import RunState
from tests.worlds import Hidden, World
from tests.worlds.world import Chain, pass_through

SIZES = {
    "vibration": 0.3,
    "timing_jitter": 3e-4,
    "accelerometer_outliers": 1.5,
    "encoder_outliers": 3e-5,
    "quantisation": 0.15,
}
"""What is hidden: amplitude at top speed m/s², s, m/s², m, step m/s²."""
MOTIONS = ("interleaved", "tones")
TRAINING = 0.7
"""Share of the record that is fitted."""


def truth(name: str, size: float, chain: Chain) -> float:
    """The coefficient that is hidden, in the unit of the effect."""
    if name == "vibration":
        return float((size / np.max(np.abs(chain.scene.v)) ** 2) ** 2)
    return size**2 * chain.shapes[0].get("share", 1.0)


def flat_innovations(fit: Fit, train: ac.Recording) -> float:
    """Probability of innovations as uneven over the speed of the stage."""
    run = fit.runs[0]

    def state_of(recording: ac.Recording) -> RunState:
        return state_at(fit, 0, prepare(recording, fit.origins, start=run.start, end=run.end))

    state = state_of(train)
    for test in outliers_found(run_noise_tests(state)):  # the fit has rejected them
        train = without_outliers(train, test)
    state = state_of(train)
    speed = np.abs(np.interp(state.run.t, state.signals.t + state.run.origins.t, state.signals.v))
    limit = 5.0 * float(np.median(np.abs(state.whitened[state.counts]))) / 0.6745
    return flatness(np.minimum(np.abs(state.whitened[state.counts]), limit) ** 2, speed[state.counts])


def records(
    name: str, hidden: bool, seed: int, count: int, sensor: str, folder: Path
) -> list[tuple[World, ac.Recording]]:
    """Worlds and what was measured in them."""
    results = []
    for k in range(count):
        effects = (Hidden(name, SIZES[name], {}),) if hidden else ()
        world = World(MOTIONS[k % 2], sensor, effects, seed=1000 * seed + k).settled()
        results.append((world, ac.load(world.record().write(folder, f"{name}-{k}"))))
    return results


def main() -> None:
    """Print counts and figures beside their bars."""
    asked = argparse.ArgumentParser(description=__doc__)
    asked.add_argument("--seed", type=int, default=1801)
    asked.add_argument("--count", type=int, default=60)
    asked.add_argument("--sensor", default="ADXL105")
    asked.add_argument("--effects", nargs="*", default=list(SIZES))
    asked.add_argument("--hidden-off", action="store_true")
    given = asked.parse_args()
    least = int(stats.binom.ppf(0.025, given.count, 0.95))
    inside = [int(stats.binom.ppf(q, given.count, 0.95)) for q in (0.005, 0.995)]
    for name in given.effects:
        added = flat = even = gained = 0
        z: list[float] = []
        with tempfile.TemporaryDirectory() as folder:
            for world, run in records(name, not given.hidden_off, given.seed, given.count, given.sensor, Path(folder)):
                last = float(run.position.t[-1])
                train, held = run.part(0.0, TRAINING * last), run.part(TRAINING * last, last)
                base = ac.fit(train)
                try:
                    fit = ac.add(base, train, name)
                except ValueError as refused:
                    if not given.hidden_off:
                        print(f"{name} {world.seed}: {refused}", flush=True)
                    continue
                effect, score = fit.noise_effects[0], ac.compare(fit, held)[0].noise_scores[0]
                added += 1
                flat += effect.particulars.get("flat", 1.0) > 0.01
                even += flat_innovations(fit, train) > 0.01
                gained += score.gained
                line = f"{name} {world.motion} {world.seed}: {score.sentence}"
                if not given.hidden_off:
                    expected = truth(name, SIZES[name], pass_through(world))
                    z.append((effect.value - expected) / max(effect.std, 1e-6 * expected))
                    line += f"; {effect.value / expected:.3f} of what is hidden, z {z[-1]:.2f}"
                print(line, flush=True)
        print(f"{name}: added {added} of {given.count}")
        if given.hidden_off:
            continue
        cover = sum(abs(effect) < 1.96 for effect in z)
        rms = math.sqrt(np.mean(np.square(z)))
        print(
            f"{name}: output flat {flat}, innovations flat {even}, log score gained {gained} of {given.count} (least "
            f"{least}); intervals cover {cover} ({inside[0]} to {inside[1]}), rms z {rms:.2f}",
            flush=True,
        )


if __name__ == "__main__":
    main()
