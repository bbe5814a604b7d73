"""Live and batch filters on ordinary setups drawn at random: is every negative variance and every NaN an error?

From the top of the repository: python -m benches.live_filters [--draws 1000000] [--models 100000] [--seed 1]
Prints kind by kind draws, errors and losses, then figure, count and threshold of every claim; exit code 1 where one is
missed. An error is a sentence with rate, prior and next step, the filter unchanged; a loss is a number without one.
"""

from __future__ import annotations

import argparse
import math
import multiprocessing
import os
from collections.abc import Sequence

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

from tests.filters.positivity import KINDS, Tally, live_model, tally

LOST = 0
"""Draws that may show a negative variance or a NaN that is no error."""
REFUSED = 0.01
"""Share of the draws of `LiveModel` that may end in an error: a first-order filter can diverge under its wide prior."""
PART = 20_000
"""Draws of a task, so that workers share them evenly; of `LiveModel` a twentieth."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw, and print what became of the draws."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--draws", type=int, default=1_000_000, help="of live and batch filters")
    parser.add_argument("--models", type=int, default=100_000, help="of LiveModel, 10 Hz to 10 kHz")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args(arguments)
    tasks = [
        task for name, (_, share) in KINDS.items() for task in parts(name, math.ceil(share * chosen.draws), PART)
    ] + parts("LiveModel", chosen.models, PART // 20)
    results = {name: Tally() for name, _, _ in tasks}
    with multiprocessing.Pool(chosen.workers) as pool:
        seeded = [(name, draws, (chosen.seed, at)) for at, (name, draws, _) in enumerate(tasks)]
        for name, part in pool.imap_unordered(run, seeded):
            results[name].add(part)
    print(f"{'kind':16}{'draws':>10}{'errors':>10}{'lost':>8}")
    for name, total in results.items():
        print(f"{name:16}{total.draws:10}{total.refused:10}{total.lost:8}")
    errors = sum((total.kinds for total in results.values()), start=Tally().kinds)
    for kind, count in errors.most_common():
        print(f"  {count} times {kind}")
    models = results.pop("LiveModel", Tally())
    draws, lost = sum(total.draws for total in results.values()), sum(total.lost for total in results.values())
    print()
    return max(
        verdict("live and batch filters: negative variance or NaN without an error", lost, draws, LOST),
        verdict("LiveModel, 10 Hz to 10 kHz: the same", models.lost, models.draws, LOST),
        verdict("LiveModel, 10 Hz to 10 kHz: ended in an error", models.refused, models.draws, REFUSED * models.draws),
    )


def parts(name: str, draws: int, part: int) -> list[tuple[str, int, int]]:
    """The draws of one kind in tasks."""
    return [(name, min(part, draws - begin), begin) for begin in range(0, draws, part)]


def run(task: tuple[str, int, tuple[int, int]]) -> tuple[str, Tally]:
    """One task, with a seed of its own."""
    name, draws, (seed, at) = task
    work = live_model if name == "LiveModel" else KINDS[name][0]
    return name, tally(work, draws, seed * 1_000_003 + at)


def verdict(claim: str, result: int, count: int, limit: float) -> int:
    """Print figure, count and threshold of a claim; 1 where it is missed."""
    print(f"{claim}: {result} of {count} draws, limit {limit:g}: {'ok' if result <= limit else 'MISSED'}")
    return int(result > limit)


if __name__ == "__main__":
    raise SystemExit(main())
