"""A campaign of W2 runs that tells after each transaction how many are stored: python -m tests.campaign.child."""

from __future__ import annotations

import sys

from accelcal.fleet import campaign
from tests.campaign.tasks import w2

SEED = 2007


def main() -> None:
    """Run STORE RUNS SECONDS."""
    store, runs, seconds = sys.argv[1:]
    campaign.run(
        w2,
        campaign.seeds(SEED, int(runs)),
        store=store,
        parameters={"seconds": float(seconds)},
        progress=lambda done, total: print(done, flush=True),
    )


if __name__ == "__main__":
    main()
