"""Campaigns: one task over many seeds or files, on any executor, its results kept in one SQLite file.

The answer depends on task, parameters and items alone, never on the executor: a seed is a child of
`numpy.random.SeedSequence`, a record travels by its path, and a worker imports the task by name. A batch of runs is one
transaction, so a campaign that was interrupted goes on where it stopped.

Examples
--------
>>> from accelcal.fleet import campaign
>>> [campaign.label(seed) for seed in campaign.seeds(2007, 2)]
['2007:0', '2007:1']
"""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import math
import os
import sqlite3
import traceback
from collections import Counter
from collections.abc import Callable, Generator, Iterable, Iterator, Mapping, Sequence
from concurrent.futures import FIRST_COMPLETED, Executor, Future, ThreadPoolExecutor, wait
from contextlib import closing, contextmanager, nullcontext
from dataclasses import dataclass
from itertools import islice
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from accelcal._core import __version__
from accelcal._support.errors import AccelcalError, visible
from accelcal._support.values import listing

SCHEMA = "accelcal/campaign/1"
TABLES = (
    "CREATE TABLE campaign (key TEXT PRIMARY KEY, value TEXT NOT NULL) WITHOUT ROWID",
    "CREATE TABLE run (run INTEGER PRIMARY KEY, item TEXT NOT NULL, error TEXT)",
    "CREATE TABLE value (run INTEGER NOT NULL REFERENCES run, name TEXT NOT NULL, value REAL, PRIMARY KEY (run, name)) "
    "WITHOUT ROWID",
)
PATIENCE = 60.0
"""Seconds to wait for another process that reads the file."""


class CampaignError(AccelcalError):
    """A campaign that cannot be run, or a file that holds none or another. The text states what to do."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """One run, computed."""

    run: int
    item: str
    values: dict[str, float]
    error: str | None


@dataclass(frozen=True, slots=True, eq=False)
class Results:
    """What a file holds: n runs in the order of the items, whether the campaign is complete or not."""

    runs: NDArray[np.intp]
    """(n,) positions in the list of items."""
    items: tuple[str, ...]
    """(n,) as `label` names them."""
    values: dict[str, NDArray[np.float64]]
    """By name, (n,); NaN where the run failed or did not return this value."""
    errors: dict[str, str]
    """By item, what its task raised."""


@contextmanager
def opened(path: str | Path, mode: str = "rwc") -> Iterator[sqlite3.Connection]:
    """The file at `path`; transactions are begun and committed by hand.

    Raises
    ------
    CampaignError
        If it cannot be opened, or is no SQLite file.
    """
    try:
        with closing(
            sqlite3.connect(
                f"{Path(path).absolute().as_uri()}?mode={mode}", uri=True, timeout=PATIENCE, isolation_level=None
            )
        ) as connection:
            yield connection
    except sqlite3.OperationalError as error:
        raise CampaignError(
            f"{path}: {error}. Check that the folder exists and that no other process writes the file."
        ) from None
    except sqlite3.DatabaseError as error:
        raise CampaignError(
            f"{path}: {error}; expected a file that accelcal.fleet.campaign made, or none yet."
        ) from None


def begin(
    connection: sqlite3.Connection, path: str | Path, identity: Mapping[str, str], items: Sequence[str]
) -> set[int]:
    """Make a new file a campaign, or check that it is this one; return the runs it holds.

    Raises
    ------
    CampaignError
        If the file belongs to another campaign.
    """
    for item in items:
        if item.encode(errors="ignore").decode() != item:
            raise CampaignError(f"{visible(item)}: this name is not UTF-8, expected one that is; rename the file.")
    connection.execute("BEGIN IMMEDIATE")
    if not connection.execute("SELECT count(*) FROM sqlite_master").fetchone()[0]:
        for table in TABLES:
            connection.execute(table)
        connection.executemany("INSERT INTO campaign VALUES (?, ?)", [("schema", SCHEMA), *identity.items()])
    connection.execute("COMMIT")
    stored = _identity(connection, path)
    for key, value in identity.items():
        if stored.get(key) != value:
            raise CampaignError(
                f"{path} holds another campaign: its {key} is {_short(stored.get(key))}, requested is {_short(value)}. "
                "Name another file, or delete this one."
            )
    done = dict(connection.execute("SELECT run, item FROM run"))
    for run, item in done.items():
        requested = items[run] if run < len(items) else None
        if requested != item:
            raise CampaignError(
                f"{path} holds another campaign: its run {run} is {item!r}, requested is {requested!r}. Items may only "
                "be appended; otherwise name another file, or delete this one."
            )
    return set(done)


def keep(connection: sqlite3.Connection, path: str | Path, outcomes: Sequence[Outcome]) -> None:
    """Write some runs in one transaction.

    Raises
    ------
    CampaignError
        If one of them is there already: two processes work on one file.
    """
    try:
        connection.execute("BEGIN IMMEDIATE")
        connection.executemany("INSERT INTO run VALUES (?, ?, ?)", [(o.run, o.item, o.error) for o in outcomes])
        connection.executemany(
            "INSERT INTO value VALUES (?, ?, ?)",
            [(o.run, name, value) for o in outcomes for name, value in o.values.items()],
        )
        connection.execute("COMMIT")
    except sqlite3.IntegrityError:
        connection.execute("ROLLBACK")
        raise CampaignError(
            f"{path}: another process has written run {outcomes[0].run} or one after it meanwhile. Let one process "
            "work on the file."
        ) from None


def items(path: str | Path) -> dict[int, str]:
    """Item of each run that a file holds, by the number of the run."""
    with opened(path, "rw") as connection:
        _identity(connection, path)
        return dict(connection.execute("SELECT run, item FROM run ORDER BY run"))


def forget(path: str | Path, items: Iterable[str]) -> None:
    """Remove the runs of some items, so that the next call computes them again.

    Raises
    ------
    CampaignError
        If the file holds no campaign.
    """
    with opened(path, "rw") as connection:
        _identity(connection, path)
        connection.execute("BEGIN IMMEDIATE")
        for item in items:
            connection.execute("DELETE FROM value WHERE run IN (SELECT run FROM run WHERE item = ?)", (item,))
            connection.execute("DELETE FROM run WHERE item = ?", (item,))
        connection.execute("COMMIT")


def load(path: str | Path) -> Results:
    """Read what a campaign has found so far, while it runs or afterwards.

    Raises
    ------
    CampaignError
        If there is no such file, or it holds no campaign.
    """
    if not Path(path).exists():
        raise CampaignError(
            f"{path}: no such file; make one with accelcal.fleet.campaign.run(..., store={str(path)!r})."
        )
    with opened(path, "rw") as connection:
        connection.execute("BEGIN")
        _identity(connection, path)
        rows = connection.execute("SELECT run, item, error FROM run ORDER BY run").fetchall()
        stored = connection.execute("SELECT name, run, value FROM value").fetchall()
    place = {run: i for i, (run, _, _) in enumerate(rows)}
    values = {name: np.full(len(rows), math.nan) for name in sorted({name for name, _, _ in stored})}
    for name, run, value in stored:
        values[name][place[run]] = math.nan if value is None else value
    return Results(
        runs=np.array([run for run, _, _ in rows], dtype=np.intp),
        items=tuple(item for _, item, _ in rows),
        values=values,
        errors={item: error for _, item, error in rows if error is not None},
    )


def _identity(connection: sqlite3.Connection, path: str | Path) -> dict[str, str]:
    """Identity of the campaign in a file."""
    stored: dict[str, str] = {}
    if connection.execute("SELECT 1 FROM sqlite_master WHERE name = 'campaign'").fetchone():
        stored = dict(connection.execute("SELECT key, value FROM campaign"))
    if stored.get("schema") != SCHEMA:
        raise CampaignError(f"{path}: expected schema {SCHEMA!r}, found {stored.get('schema')!r}. Name another file.")
    return stored


def _short(text: str | None) -> str:
    """A value for a sentence."""
    return repr(text) if text is None or len(text) <= 60 else f"'{text[:60]}…'"


Item = np.random.SeedSequence | str | os.PathLike[str]

PARAMETERS_LIMIT = 65_536
"""Characters of JSON; parameters beyond that are data."""


@dataclass(frozen=True, slots=True)
class Task:
    """What every run of a campaign does; a few lines of text, so it costs nothing to send."""

    function: str
    """`module:name`."""
    source: str
    """SHA-256 of the function's source."""
    parameters: str
    """JSON, keys sorted."""

    @classmethod
    def of(cls, function: Callable[..., Any], parameters: Mapping[str, Any]) -> Task:
        """Describe a function and its parameters.

        Raises
        ------
        CampaignError
            If another process could not import the function, or the parameters are not small JSON.
        """
        module, name = (getattr(function, part, None) for part in ("__module__", "__qualname__"))
        if module in (None, "__main__") or name is None or not name.isidentifier():
            raise CampaignError(
                f"{name or function!r} of {module} cannot be imported by a worker. Write the task as a function at the "
                "top of a file of its own, and import it from there."
            )
        try:
            text = json.dumps(dict(parameters), sort_keys=True, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise CampaignError(
                f"parameters: {error}. Expected finite numbers, text, lists and dicts; write data to a file and "
                "pass its path."
            ) from None
        if len(text) > PARAMETERS_LIMIT:
            raise CampaignError(
                f"parameters: {len(text)} characters of JSON, {PARAMETERS_LIMIT} are allowed. Write data to a file and "
                "pass its path."
            )
        return cls(f"{module}:{name}", _digest(function), text)

    @property
    def identity(self) -> dict[str, str]:
        """What must be equal for results in one file."""
        return {
            "function": self.function,
            "source": self.source,
            "parameters": self.parameters,
            "version": __version__,
        }

    def imported(self) -> Callable[..., Mapping[str, float]]:
        """The function, imported here.

        Raises
        ------
        CampaignError
            If its source is not the one that the campaign was started with.
        """
        module, _, name = self.function.partition(":")
        function: Callable[..., Mapping[str, float]] = getattr(importlib.import_module(module), name)
        if _digest(function) != self.source:
            raise CampaignError(
                f"{self.function} in process {os.getpid()} is not the function that the campaign was started with. "
                "Start the workers again, with the same files."
            )
        return function


def compute(task: Task, batch: Sequence[tuple[int, Item]]) -> list[Outcome]:
    """Outcomes of some runs, in this process."""
    function, parameters = task.imported(), json.loads(task.parameters)
    return [_outcome(function, parameters, run, item) for run, item in batch]


def label(item: Item) -> str:
    """An item as text: `entropy:key` of a seed, a path as it was given."""
    if not isinstance(item, np.random.SeedSequence):
        return os.fspath(item)
    return f"{item.entropy}:{'.'.join(map(str, item.spawn_key))}"


def _outcome(
    function: Callable[..., Mapping[str, float]], parameters: Mapping[str, Any], run: int, item: Item
) -> Outcome:
    given = np.random.default_rng(item) if isinstance(item, np.random.SeedSequence) else Path(item)
    try:
        values = {str(name): float(value) for name, value in function(given, **parameters).items()}
    except Exception as error:
        return Outcome(run, label(item), {}, "".join(traceback.format_exception_only(error)).strip())
    return Outcome(run, label(item), values, None)


def _digest(function: Callable[..., Any]) -> str:
    """SHA-256 of a function's source; of nothing where it is compiled."""
    try:
        source = inspect.getsource(function)
    except (OSError, TypeError):
        source = ""
    return hashlib.sha256(source.encode()).hexdigest()


__all__ = ["CampaignError", "Count", "Results", "forget", "items", "label", "load", "run", "seeds"]

AHEAD = 64
"""Batches that wait at the executor at most; more would only take memory."""


@dataclass(frozen=True, slots=True)
class Count:
    """What a call of `run` did."""

    computed: int
    """Runs of this call."""
    stored: int
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
        finished = begin(connection, store, work.identity, labels)
        missing = [(run, item) for run, item in enumerate(items) if run not in finished]
        batches = (missing[i : i + batch] for i in range(0, len(missing), batch))
        done = len(finished)
        workers = ThreadPoolExecutor(os.cpu_count()) if executor is None else nullcontext(executor)
        with workers as pool, closing(_completed(pool, work, batches)) as stream:
            for outcomes in stream:
                keep(connection, store, outcomes)
                done += len(outcomes)
                if progress is not None:
                    progress(done, len(items))
        (failed,) = connection.execute("SELECT count(error) FROM run").fetchone()
    return Count(len(missing), len(finished), failed)


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
