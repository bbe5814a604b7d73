"""A resonance that nothing declares: what a diagnosis says of it, and what declaring it leaves.

    python -m benches.resonances [--seed N] [--records N] [--others]

Each record is a world of another motion with a resonance of mount or element, 15 to 150 Hz, Q of 2 to 30; with
`--others` one with another effect of the catalogue at d = 12 instead, of which no resonance may be said. A line per
record: what is said, its frequency against the truth, and the error of the scale factor without and with it.
"""

from __future__ import annotations

import argparse
import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np

import accelcal as ac
from accelcal.data import ChannelFilter, Recording
from accelcal.io import load
from tests.worlds.catalogue import CATALOGUE
from tests.worlds.strength import at_d
from tests.worlds.world import Hidden, Nuisances, World, pass_through

MOTIONS = ("bursts", "moves", "interleaved", "tones", "fast", "chirp")
FREQUENCY, QUALITY = (15.0, 150.0), (2.0, 30.0)


def drawn(seed: int, others: bool) -> tuple[World, str, float]:
    """A world, what is hidden in it, and the frequency of its resonance, Hz; 0 without one."""
    rng = np.random.default_rng(seed)
    motion, nuisances = str(rng.choice(MOTIONS)), Nuisances.draw(rng)
    if others:
        others_of_mean = {effect.name for effect in CATALOGUE.values() if effect.kind == "mean"} - {"sensor_resonance"}
        name = str(rng.choice(sorted(others_of_mean)))
        world = World(motion=motion, hidden=(Hidden(name, CATALOGUE[name].typical),), seed=seed, nuisances=nuisances)
        return at_d(world, 12.0), name, 0.0
    f0, q = (float(np.exp(rng.uniform(*np.log(span)))) for span in (FREQUENCY, QUALITY))
    hidden = Hidden("sensor_resonance", 1.0 / (2.0 * math.pi * q * f0), {"quality": q})
    return World(motion=motion, hidden=(hidden,), seed=seed, nuisances=nuisances), f"{f0:.2f} Hz, Q {q:.1f}", f0


def behind(recording: Recording, f0: float, q: float, tolerance: float) -> Recording:
    """The recording with a resonance declared before its low-pass."""
    rig = recording.rig
    filters = (ChannelFilter("resonance", cutoff=f0, quality=q, tolerance=tolerance), *rig.passed_by_output)
    return replace(recording, rig=replace(rig, lowpass=None, output_filters=filters))


def main() -> None:
    """Print a line per record, then the counts."""
    options = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    options.add_argument("--seed", type=int, default=62000)
    options.add_argument("--records", type=int, default=30)
    options.add_argument("--others", action="store_true")
    chosen = options.parse_args()
    counts: dict[str, int] = {}
    apart, errors, sigmas = list[float](), list[tuple[float, float]](), list[float]()
    for seed in range(chosen.seed, chosen.seed + chosen.records):
        world, hidden, f0 = drawn(seed, chosen.others)
        with tempfile.TemporaryDirectory() as folder:
            recording = load(world.record().write(Path(folder)))
        k = pass_through(world).scale_factor
        fit = ac.fit(recording)
        diagnosis = ac.diagnose(fit, recording)
        note = next((r for r in diagnosis.remarks if r.code == "undeclared_resonance"), None)
        if note is None:
            kind = "named" if "sensor_resonance" in diagnosis.effects else diagnosis.verdict
            detail = ", ".join(diagnosis.effects)
        else:
            stated, std = float(note.values["f0"]), float(note.values["f0_std"])
            with_it = ac.fit(behind(recording, stated, float(note.values["q"]), std / stated))
            sigmas.append((with_it["scale_factor"].value - k) / with_it["scale_factor"].std)
            errors.append((fit["scale_factor"].value - k, with_it["scale_factor"].value - k))
            apart.append((stated - f0) / std)
            kind = "said"
            detail = (
                f"{stated:.2f} ± {std:.2f} Hz; error of k {100 * errors[-1][0]:.3f} % -> {100 * errors[-1][1]:.3f} %"
            )
            detail += f", {sigmas[-1]:.1f} std"
        counts[kind] = counts.get(kind, 0) + 1
        print(f"{seed} {world.motion}, {hidden}: {kind}, {detail}", flush=True)
    print(f"of {chosen.records}: {', '.join(f'{count} {kind}' for kind, count in sorted(counts.items()))}")
    if errors:
        before, after = np.sqrt(np.mean(np.square(errors), axis=0))
        print(f"frequency: rms {np.sqrt(np.mean(np.square(apart))):.2f}, most {np.max(np.abs(apart)):.1f} std")
        print(f"k, rms error: {100 * before:.3f} % without, {100 * after:.3f} % with the resonance")
        print(f"... over its standard deviation: rms {np.sqrt(np.mean(np.square(sigmas))):.1f}")


if __name__ == "__main__":
    main()
