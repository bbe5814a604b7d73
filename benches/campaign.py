"""A campaign at full size: the same file from threads and from dask, and after a kill.

Run from the top of the repository: python -m benches.campaign [--runs 10000] [--seconds 12]
Exit code 1 when contents differ or a run that was stored is computed again.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from distributed import Client, LocalCluster

from accelcal.fleet import campaign
from tests.campaign.child import SEED
from tests.campaign.contents import contents, counted, killed
from tests.campaign.tasks import CALLS, w2


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the campaign three times and compare what the files hold."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=10_000)
    parser.add_argument("--seconds", type=float, default=12.0, help="length of each record")
    chosen = parser.parse_args(arguments)
    runs, parameters = chosen.runs, {"seconds": chosen.seconds}
    seeds = campaign.seeds(SEED, runs)
    with tempfile.TemporaryDirectory() as folder:
        threads, dask, resumed, calls = (Path(folder) / name for name in ("threads", "dask", "resumed", "calls"))

        began = time.perf_counter()
        with ThreadPoolExecutor(2) as pool:
            campaign.run(w2, seeds, store=threads, parameters=parameters, executor=pool)
        print(
            f"two threads:        {runs} runs of {chosen.seconds:g} s in {time.perf_counter() - began:.0f} s",
            flush=True,
        )

        cluster = LocalCluster(n_workers=2, threads_per_worker=1, host="127.0.0.1", dashboard_address=None)
        with cluster, Client(cluster) as client, client.get_executor() as executor:
            began = time.perf_counter()
            campaign.run(w2, seeds, store=dask, parameters=parameters, executor=executor)
        print(f"two dask processes: {runs} runs in {time.perf_counter() - began:.0f} s", flush=True)

        killed(resumed, calls, runs=runs, seconds=chosen.seconds, after=runs // 2)
        stored = campaign.load(resumed).items
        os.environ[CALLS] = str(calls)
        count = campaign.run(w2, seeds, store=resumed, parameters=parameters)
        times = counted(calls)
        again = sum(times[item] > 1 for item in stored)
        lost = sum(times.values()) - runs
        print(
            f"killed: {len(stored)} runs stored, {count.computed} computed after; stored runs computed twice: {again}; "
            f"lost with the kill: {lost}"
        )

        same = contents(threads) == contents(dask) == contents(resumed)
        nees = campaign.load(threads).values["nees"].mean()
        print(
            f"contents {'identical' if same else 'DIFFER'}, {threads.stat().st_size / 1e6:.1f} MB; mean NEES {nees:.2f}"
        )
    good = same and again == 0 and count.stored + count.computed == runs
    print("all bars hold" if good else "A BAR IS MISSED")
    return 0 if good else 1


if __name__ == "__main__":
    raise SystemExit(main())
