"""Campaigns: one task over many seeds or files, on any executor, its results kept in one SQLite file.

The answer depends on task, parameters and items alone, never on the executor: a seed is a child of
`numpy.random.SeedSequence`, a record travels by its path, and a worker imports the task by name. A batch of runs is one
transaction, so a campaign that was interrupted goes on where it stopped.

Examples
--------
>>> from accelcal import campaign
>>> [campaign.label(seed) for seed in campaign.seeds(2007, 2)]
['2007:0', '2007:1']
"""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Generator, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import closing, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np

from accelcal._support.values import listing
from accelcal.campaign.store import CampaignError, Outcome, Results, begin, forget_failures, items, keep, load, opened
from accelcal.campaign.task import Item, Task, compute, label

__all__ = ["CampaignError", "Count", "Results", "forget_failures", "items", "label", "load", "run", "seeds"]

AHEAD = 64
"""Batches that wait at the executor at most; more would only take memory."""


@dataclass(frozen=True, slots=True)
class Count:
    """What a call of `run` did."""

    computed: int
    """Runs of this call."""
    kept: int
    """Runs that the file held before; none of them was computed again."""
    failed: int
    """Runs in the file whose task raised."""


def seeds(entropy: int, count: int) -> list[np.random.SeedSequence]:
    """Independent seeds: the first `count` children of `SeedSequence(entropy)`, independent of `count`."""
    return np.random.SeedSequence(entropy).spawn(count)


def run(
    task: Callable[..., Mapping[str, float]],
    items: Sequence[Item],
    *,
    store: str | Path,
    parameters: Mapping[str, Any] | None = None,
    executor: Executor | None = None,
    batch: int = 16,
    progress: Callable[[int, int], None] | None = None,
) -> Count:
    """Compute what the file does not hold yet.

    Parameters
    ----------
    task : callable
        A function of a module, `task(rng, **parameters)` for a seed or `task(path, **parameters)` for a file, returning
        a dict of floats. `rng` is a `numpy.random.Generator`, `path` a `pathlib.Path`. A run that raises is kept with
        its error; the others go on.
    items : sequence of numpy.random.SeedSequence or path
        One per run, all different. A later call may append items to those of an earlier one.
    store : path
        The SQLite file, made if it is not there.
    parameters : mapping of str
        What JSON can hold; data go by path. Part of what identifies the campaign.
    executor : concurrent.futures.Executor, optional
        Threads, one per processor, by default. Processes and dask's `client.get_executor()` serve as well; whoever
        made the executor closes it.
    batch : int
        Runs that travel together and are written in one transaction. What a kill may cost is the batches under way.
    progress : callable, optional
        Called as `progress(done, total)` after each transaction, with runs kept earlier among those done.

    Raises
    ------
    CampaignError
        If task, parameters or items cannot travel, or if the file holds another campaign.
    """
    if batch < 1:
        raise CampaignError(f"batch = {batch}: a batch holds one run or more.")
    work = Task.of(task, parameters or {})
    labels = [label(item) for item in items]
    twice = [item for item, times in Counter(labels).items() if times > 1]
    if twice:
        raise CampaignError(f"items: {twice[0]!r} is given more than once; every run needs an item of its own.")
    with opened(store) as connection:
        known = begin(connection, store, work.identity, labels)
        missing = [(run, item) for run, item in enumerate(items) if run not in known]
        batches = (missing[i : i + batch] for i in range(0, len(missing), batch))
        done = len(known)
        own = ThreadPoolExecutor(os.cpu_count()) if executor is None else nullcontext(executor)
        with own as pool, closing(_completed(pool, work, batches)) as stream:
            for outcomes in stream:
                keep(connection, store, outcomes)
                done += len(outcomes)
                if progress is not None:
                    progress(done, len(items))
        (failed,) = connection.execute("SELECT count(error) FROM run").fetchone()
    return Count(len(missing), len(known), failed)


def _completed(pool: Executor, task: Task, batches: Iterator[list[tuple[int, Item]]]) -> Generator[list[Outcome]]:
    """Outcomes of each batch as it completes; batches that nobody waits for any more are cancelled."""

    def submit(count: int) -> set[Future[list[Outcome]]]:
        return {pool.submit(compute, task, batch) for batch in islice(batches, count)}

    pending = submit(AHEAD)
    try:
        while pending:
            done, pending = wait(pending, return_when=FIRST_COMPLETED)
            pending |= submit(len(done))
            for future in done:
                yield future.result()
    finally:
        for future in pending:
            future.cancel()


__dir__ = listing(globals())
