"""The loop of the demo: `python -m benches.loop [--seeds 20] [--first 101] [--out FILE.jsonl]`.

Right is: the hidden effect or one of its class on that record is named, the systematic error on the other recording
falls threefold or more, and what is left is below the limit of detection or within its interval of it.
"""

from __future__ import annotations

import argparse
import sys
import time
from dataclasses import dataclass
from pathlib import Path

from accelcal.demo import loop
from benches.outcomes import Outcome, run_all


@dataclass(frozen=True, slots=True)
class Seed:
    """One run of the demo."""

    number: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return str(self.number)


def outcome(seed: Seed) -> Outcome:
    """What was hidden, what was named, and the errors before and after, m/s²."""
    began = time.process_time()
    steps = loop(seed=seed.number)
    before, after = (evaluation.systematic for evaluation in (steps.comparison[0], steps.comparison[-1]))
    assert before is not None
    assert after is not None
    members = {name for group in steps.diagnosis.classes for name in group.members}
    return {
        "key": seed.key,
        "hidden": steps.hidden.effect,
        "named": steps.named,
        "in_class": steps.hidden.effect in {steps.named, *members},
        "before": before.rms,
        "after": after.rms if after.detected else after.high,
        "low": after.low,
        "limit": after.detection_limit,
        "seconds": time.process_time() - began,
    }


def main() -> int:
    """Print a line per seed, then counts; 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--seeds", type=int, default=20)
    parser.add_argument("--first", type=int, default=101)
    parser.add_argument("--out", type=Path, default=Path("build/loop.jsonl"))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    cases = run_all(outcome, [Seed(options.first + n) for n in range(options.seeds)], options.out, options.workers)
    for case in cases:
        ratio = case["before"] / case["after"]
        print(
            f"{case['key']}: {case['hidden']} named {case['named'] or 'nothing'}, {1e3 * case['before']:.3g} -> "
            f"{1e3 * case['after']:.3g} mm/s² ({ratio:.1f}), {case['seconds']:.1f} s"
        )
    named = sum(case["in_class"] for case in cases)
    fallen = sum(case["before"] >= 3.0 * case["after"] for case in cases)
    reached = sum(case["low"] <= case["limit"] for case in cases)
    print(f"named in class {named}, threefold {fallen} (all of {len(cases)}), at the limit {reached} (all but one)")
    return int(min(named, fallen) < len(cases) or reached < len(cases) - 1)


if __name__ == "__main__":
    sys.exit(main())
