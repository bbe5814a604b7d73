"""What a streaming step costs from Python: W1 to W4, beside a call that does nothing.

Run from the top of the repository: python -m benches.streaming
The loop's own time is taken off both; the least of nine rounds counts. Prints figure and threshold; exit code 1 when
one is missed.
"""

from __future__ import annotations

from tests.twin.workloads import WORKLOADS, cost

RATIO = 3.5
"""Most that a step of W2 may cost, in empty calls."""


def main() -> int:
    """Four workloads, one threshold."""
    ratios = {}
    for name, choice in WORKLOADS.items():
        result = cost(choice)
        ratios[name] = result.ratio
        print(
            f"{name}: step {result.step:.0f} ns = {result.ratio:.2f} empty calls of {result.empty:.0f} ns; "
            f"run {result.run:.0f} ns; LiveFilter.step {result.stamped:.0f} ns",
            flush=True,
        )
    ratio = ratios["W2"]
    print(f"W2, empty calls per step: {ratio:.2f}, limit {RATIO:g}: {'ok' if ratio <= RATIO else 'MISSED'}")
    return 0 if ratio <= RATIO else 1


if __name__ == "__main__":
    raise SystemExit(main())
