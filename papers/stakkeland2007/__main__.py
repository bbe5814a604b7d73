"""Command line of the reproduction: `python -m papers.stakkeland2007 [--full] [-o FOLDER] [--seed N] [--json]`."""

from __future__ import annotations

import argparse
import json
import sys
from dataclasses import asdict
from pathlib import Path

from papers.stakkeland2007 import reproduce


def main() -> None:
    """Print measured next to expected values; figures go into a folder, progress to stderr."""
    parser = argparse.ArgumentParser(prog="python -m papers.stakkeland2007", description=main.__doc__)
    parser.add_argument("--full", action="store_true", help="all runs of the paper; minutes instead of seconds")
    parser.add_argument("-o", "--output", type=Path, help="folder for the figures")
    parser.add_argument("--seed", type=int, default=2007, help="random seed")
    parser.add_argument("--json", action="store_true", help="print JSON")
    asked = parser.parse_args()
    reproduction = reproduce(
        quick=not asked.full,
        seed=asked.seed,
        out=asked.output,
        progress=lambda name, share: print(f"{share:4.0%}  {name}", file=sys.stderr),
    )
    print(json.dumps(asdict(reproduction), default=str) if asked.json else reproduction.to_text())
    for path in reproduction.figures:
        print(f"wrote {path}", file=sys.stderr)


if __name__ == "__main__":
    main()
