"""Pairs of recorders whose clocks run at different rates: whether the rate is found, within its stated deviation.

Run from the top of the repository: python -m benches.rates [--records 200] [--seed 1] [--workers 2] [--out build/rates]
Outcomes are kept line by line in OUT/rates.jsonl; an interrupted run goes on where it stopped. The last record is 20
minutes at 1 kHz, for the processor time.
"""

from __future__ import annotations

import argparse
import os
import time
from collections.abc import Sequence
from functools import partial
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from accelcal.data import Channel, RecordingError
from accelcal.data.clocks import align
from benches.outcomes import Outcome, Trial, guarded, run_all
from tests.field.two_clocks import pair

LONGEST = 10.0
"""Processor time for 20 minutes at 1 kHz, s."""
SLIP = 0.5
"""Periods of the fastest motion by which clocks may slip over a record, or be off in its middle, where all is right."""


def outcome_of(trial: Trial) -> Outcome:
    """Rate that the alignment gives beside the true one."""
    seed = 1000 * trial.seed + trial.number
    if trial.kind == "long":
        both = pair(seed, skew=0.013, seconds=1200.0, rates=(1000.0, 1000.0), tones=False)
    else:
        both = pair(seed, related=trial.kind == "related")
    begin = time.process_time()
    outcome = {"key": trial.key, "kind": trial.kind, "skew": both.skew, "length": both.seconds}
    try:
        alignment = align(
            Channel("accel", both.accel_t, both.accel, "m/s^2"),
            Channel("position", both.position_t, both.position, "m"),
        )
    except RecordingError as error:
        return {**outcome, "refused": str(error), "seconds": time.process_time() - begin}
    rate = alignment.rate
    skew, std = (alignment.skew, alignment.skew_std) if rate is None else (rate.skew, rate.std)
    middle = 0.5 * both.seconds
    late = alignment.instants(np.array([(1.0 + both.skew) * (both.shift + middle)]), 0.0)[0] - middle
    return {
        **outcome,
        "seconds": time.process_time() - begin,
        "searched": rate is not None,
        "rate": float(skew),
        "std": float(std),
        "correlation": float(alignment.correlation),
        "late": float(late),
        "wrong": bool(max(abs(skew - both.skew) * both.seconds, abs(late)) > SLIP / both.fastest),
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print how many rates are found, and how far off they are."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=200, help="of related and unrelated pairs each")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/rates"))
    chosen = parser.parse_args(arguments)
    trials = [Trial(kind, number, chosen.seed) for kind in ("related", "unrelated") for number in range(chosen.records)]
    trials.append(Trial("long", 0, chosen.seed))
    outcomes = run_all(partial(guarded, outcome_of), trials, chosen.out / "rates.jsonl", chosen.workers)
    related = [outcome for outcome in outcomes if outcome["kind"] == "related"]
    accepted = [outcome for outcome in related if "rate" in outcome]
    z = np.array([(outcome["rate"] - outcome["skew"]) / outcome["std"] for outcome in accepted])
    for outcome, score in zip(accepted, z, strict=True):
        if abs(score) > 4.0 or outcome["wrong"]:
            print(f"{score:+.1f} std off: {outcome}")
    for outcome in related:
        if "rate" not in outcome:
            print(f"refused: {outcome}")
    wrong = sum(outcome["wrong"] for outcome in accepted)
    rms, searched = float(np.sqrt(np.mean(z**2))), np.array([outcome["searched"] for outcome in accepted])
    print(
        f"accepted {len(accepted)} of {len(related)}, rate or shift wrong in {wrong}; rms {rms:.2f} standard deviations"
    )
    print(f"of {np.count_nonzero(searched)} that were searched: rms {float(np.sqrt(np.mean(z[searched] ** 2))):.2f}")
    unrelated = [outcome for outcome in outcomes if outcome["kind"] == "unrelated"]
    taken = [outcome for outcome in unrelated if "rate" in outcome]
    for outcome in taken:
        print(f"unrelated, accepted: {outcome}")
    print(f"unrelated pairs accepted: {len(taken)} of {len(unrelated)}")
    longest = next(outcome for outcome in outcomes if outcome["kind"] == "long")
    print(f"20 minutes at 1 kHz: {longest['seconds']:.1f} s of processor time, at most {LONGEST:g}")
    few = max(1, len(unrelated) // 200)
    held = wrong == 0 and 0.8 <= rms <= 1.2 and len(taken) <= few and longest["seconds"] <= LONGEST
    return 0 if held else 1


if __name__ == "__main__":
    raise SystemExit(main())
