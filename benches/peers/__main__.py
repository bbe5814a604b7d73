"""Every peer beside the product on W1 to W5: agreement first, then processor time.

Run from the top of the repository: python -m benches.peers [--rounds 5] [--only W1] [--write]
The peers come with `pip install "accelcal[peers]"`, Eigen and a C++ compiler from the system; what is not here is
skipped with a reason. Exit code 1 when a peer disagrees or a bar is missed.
"""

from __future__ import annotations

import argparse
from collections.abc import Sequence

from benches.peers.comparison import compare_peers
from benches.peers.table import BARS, bars, markdown, write
from benches.peers.workload import WORKLOADS


def main(arguments: Sequence[str] | None = None) -> int:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--rounds", type=int, default=5, help="interleaved rounds, the least of which counts")
    parser.add_argument("--only", default="", help="the workload with this name")
    parser.add_argument("--write", action="store_true", help="put the table into docs/benchmarks.md")
    chosen = parser.parse_args(arguments)
    results = compare_peers([w for w in WORKLOADS if chosen.only in w.name], chosen.rounds)
    text = markdown(results)
    print("\n" + text)
    if chosen.write:
        write(text)
    agreed = all(result.agrees for result in results.results)
    return 0 if agreed and all(bar.met for bar in bars(results, BARS)) else 1


if __name__ == "__main__":
    raise SystemExit(main())
