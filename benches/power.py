"""Predicted and observed probabilities of detection, on worlds that share no code with the prediction.

Run from the top of the repository: python -m benches.power [--records 50] [--only velocity] [--write]
Outcomes are kept line by line in OUT/*.jsonl; an interrupted run goes on where it stopped. Exit code 1 when a pair
lies outside its band, when all together differ by more than 5 points, or when planned motions detect less than
predicted.
"""

from __future__ import annotations

import argparse
import json
import multiprocessing
import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

from tests.experiment.trials import PAIRS, PLANS, Pair, Planned, Row

POOLED = 0.05
"""Largest allowed difference of all pairs together."""
INSIDE = 0.999
"""Probability of a band under the binomial distribution."""

PREFACE = """# Power: detection as predicted, detection as observed

Each record comes from `tests/worlds`, simulators that share no formula with the package, and was written to CSV and
sidecar and read back. The probability of detection was predicted from the motion and the fitted noise of the record
alone, by applying the rules of the search to drawn scores. An effect counts as found when any effect enters. `d` is
its distance from zero in standard deviations, with the base estimated; for a random-walk bias its intensity relative
to that which is found with 95 %, times the d at which one coefficient is. A band contains 99.9 % of the binomial
distribution at the prediction. The last rows are motions made by `plan`: their power was predicted from limits and
data sheet alone. `make bench` repeats the table.

"""


@dataclass(frozen=True, slots=True)
class Line:
    """One row of the table."""

    pair: str
    d: str
    predicted: float
    detections: int
    records: int

    @property
    def band(self) -> tuple[int, int]:
        """Counts that hold 99.9 % of the distribution at the prediction."""
        tail = 0.5 * (1.0 - INSIDE)
        low, high = binom.ppf([tail, 1.0 - tail], self.records, self.predicted)
        return int(low), int(high)

    @property
    def holds(self) -> bool:
        """Whether the count lies in its band."""
        low, high = self.band
        return low <= self.detections <= high

    @property
    def difference(self) -> float:
        """Observed less predicted share."""
        return self.detections / self.records - self.predicted

    @property
    def sentence(self) -> str:
        """Both shares and their difference."""
        return (
            f"All {self.pair} together: predicted {100 * self.predicted:.1f} %, observed "
            f"{100 * self.detections / self.records:.1f} % of {self.records} records, "
            f"{100 * self.difference:+.1f} points"
        )

    @property
    def text(self) -> str:
        """The row, in Markdown."""
        low, high = self.band
        return (
            f"| {self.pair} | {self.d} | {100 * self.predicted:.1f} % | {100 * self.detections / self.records:.0f} % | "
            f"{self.detections} of {self.records} | {low} to {high} | {'yes' if self.holds else '**no**'} |"
        )


HEAD = (
    "| effect, motion, sensor | d | predicted | observed | count | 99.9 % band | holds |\n|---|---|---|---|---|---|---|"
)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=50, help="records for each pair")
    parser.add_argument("--only", default="", help="pairs whose label contains this")
    parser.add_argument("--out", type=Path, default=Path("build/power"))
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--write", action="store_true", help="put the table into docs/power.md")
    chosen = parser.parse_args(arguments)
    chosen.out.mkdir(parents=True, exist_ok=True)
    pooled: list[Line] = []
    planned: list[Line] = []
    print(HEAD)
    with multiprocessing.Pool(chosen.processes) as pool:
        for kind, result in ((PAIRS, pooled), (PLANS, planned)):
            for pair in (p for p in kind if chosen.only in p.label):
                result.append(line(pair, rows(pair, chosen.records, chosen.out, pool)))
                print(result[-1].text, flush=True)
    verdict, good = summary(pooled, planned)
    print("\n" + verdict)
    if chosen.write:
        table = "\n".join([HEAD, *(item.text for item in (*pooled, *planned))])
        Path("docs/power.md").write_text(PREFACE + table + "\n\n" + verdict + "\n", encoding="utf-8")
    return 0 if good else 1


def rows(pair: Pair | Planned, records: int, out: Path, pool: multiprocessing.pool.Pool) -> list[Row]:
    """Prediction and outcome of each record of a pair; those kept by an earlier run are not repeated."""
    path = out / f"{pair.label.replace(', ', '-')}-{pair.d:g}.jsonl"
    by_seed: dict[int, Row] = {}
    if path.exists():
        for text in path.read_text(encoding="utf-8").splitlines():
            seed, predicted, hit = json.loads(text)
            by_seed[seed] = (predicted, hit)
    missing = [seed for seed in range(records) if seed not in by_seed]
    if missing:
        ready = pair.sized()
        with path.open("a", encoding="utf-8") as file:
            for seed, row in zip(missing, pool.imap(ready.row, missing), strict=True):
                by_seed[seed] = row
                file.write(json.dumps([seed, *row]) + "\n")
                file.flush()
    return [by_seed[seed] for seed in range(records)]


def line(pair: Pair | Planned, results: Sequence[Row]) -> Line:
    """Row of the table for the records of a pair."""
    predicted = float(np.mean([probability for probability, _ in results]))
    return Line(pair.label, f"{pair.d:g}", predicted, sum(hit for _, hit in results), len(results))


def summary(pooled: Sequence[Line], planned: Sequence[Line]) -> tuple[str, bool]:
    """All pairs together in one sentence, the planned motions in another, and whether every claim holds."""
    sentences, good = [], all(item.holds for item in (*pooled, *planned))
    if pooled:
        whole = together(pooled, f"{len(pooled)} pairs")
        good &= abs(whole.difference) <= POOLED
        outside = sum(not item.holds for item in pooled)
        sentences.append(
            f"{whole.sentence}; {100 * POOLED:g} are allowed. {outside} of the pairs lie outside their band."
        )
    if planned:
        whole = together(planned, f"{len(planned)} planned motions")
        good &= whole.holds
        low, high = whole.band
        sentences.append(f"{whole.sentence}; found {whole.detections}, band {low} to {high}.")
    return "\n".join(sentences), good


def together(lines: Sequence[Line], name: str) -> Line:
    """Several rows as one."""
    total = sum(item.records for item in lines)
    predicted = sum(item.predicted * item.records for item in lines) / total
    return Line(name, "", predicted, sum(item.detections for item in lines), total)


if __name__ == "__main__":
    raise SystemExit(main())
