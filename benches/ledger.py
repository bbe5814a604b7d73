"""The ledger of nulls, `benches/nulls.csv`: a line for every honest record that a bench ran, and what it named falsely.

From the top of the repository: python -m benches.ledger [--last 2000]
Benches append to it; the command counts false names in its last lines, by bench, and holds them to 1 %.
"""

from __future__ import annotations

import argparse
import csv
import subprocess
from collections import Counter
from collections.abc import Sequence
from dataclasses import astuple, dataclass, fields
from functools import cache
from pathlib import Path

from scipy.stats import binom

from tests.regimes.judge import FALSE_RATE, SURE

LEDGER = Path(__file__).with_name("nulls.csv")


@dataclass(frozen=True, slots=True)
class Null:
    """One honest record."""

    bench: str
    regime: str
    """Kind of rig, motion and clock."""
    seed: str
    """Key from which the bench draws the record again."""
    commit: str
    """Revision that ran it; with -dirty where files were changed."""
    named: str
    """False names, joined by +; "" where there is none."""


@cache
def commit() -> str:
    """Abbreviated revision of the checkout, with -dirty where a file other than the ledger differs from it."""
    git = ["git", "-C", str(LEDGER.parent)]
    head = subprocess.run([*git, "rev-parse", "--short", "HEAD"], capture_output=True, text=True, check=True).stdout
    changed = subprocess.run([*git, "diff", "--quiet", "HEAD", "--", ":/", f":(exclude){LEDGER.name}"]).returncode
    return head.strip() + "-dirty" * changed


def enter(bench: str, regime: str, seed: object, named: Sequence[str], path: Path = LEDGER) -> None:
    """Append one honest record."""
    fresh = not path.exists()
    with path.open("a", encoding="utf-8", newline="") as file:
        rows = csv.writer(file, lineterminator="\n")
        if fresh:
            rows.writerow(field.name for field in fields(Null))
        rows.writerow(astuple(Null(bench, regime, str(seed), commit(), "+".join(named))))


def entries(path: Path = LEDGER) -> list[Null]:
    """Every line, oldest first."""
    with path.open(encoding="utf-8", newline="") as file:
        return [Null(**row) for row in csv.DictReader(file)]


def main(arguments: Sequence[str] | None = None, path: Path = LEDGER) -> int:
    """Print the false names of the last lines and their count beside its threshold; 1 where there are more."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--last", type=int, default=2000)
    last = entries(path)[-parser.parse_args(arguments).last :]
    false = [null for null in last if null.named]
    for null in false:
        print(f"{null.bench} {null.regime} {null.seed} {null.commit}: {null.named}")
    wrong = Counter(null.bench for null in false)
    for bench, count in sorted(Counter(null.bench for null in last).items()):
        print(f"{bench}: {wrong[bench]} of {count}")
    most = int(binom.ppf(SURE, max(1, len(last)), FALSE_RATE))
    print(f"records with a false name: {len(false)} of the last {len(last)}, at most {most}")
    return 0 if len(false) <= most else 1


if __name__ == "__main__":
    raise SystemExit(main())
