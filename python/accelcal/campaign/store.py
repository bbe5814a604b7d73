"""The SQLite file of a campaign: what it is, one row for each run, one for each value.

A rollback journal, not WAL: the file alone is the campaign, also on a network share, and what a kill left half-written
is undone when it is opened next. All tables are ordered by their keys, so the contents do not depend on the order
in which runs completed.
"""

from __future__ import annotations

import math
import sqlite3
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from accelcal._support.errors import AccelcalError

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
        raise CampaignError(f"{path}: {error}; expected a file that accelcal.campaign made, or none yet.") from None


def begin(
    connection: sqlite3.Connection, path: str | Path, identity: Mapping[str, str], items: Sequence[str]
) -> set[int]:
    """Make a new file a campaign, or check that it is this one; return the runs it holds.

    Raises
    ------
    CampaignError
        If the file belongs to another campaign.
    """
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
    known = dict(connection.execute("SELECT run, item FROM run"))
    for run, item in known.items():
        requested = items[run] if run < len(items) else None
        if requested != item:
            raise CampaignError(
                f"{path} holds another campaign: its run {run} is {item!r}, requested is {requested!r}. Items may only "
                "be appended; otherwise name another file, or delete this one."
            )
    return set(known)


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


def forget_failures(path: str | Path) -> None:
    """Remove runs whose task raised, so that the next call computes them again.

    Raises
    ------
    CampaignError
        If the file holds no campaign.
    """
    with opened(path, "rw") as connection:
        _identity(connection, path)
        connection.execute("BEGIN IMMEDIATE")
        connection.execute("DELETE FROM run WHERE error IS NOT NULL")
        connection.execute("COMMIT")


def load(path: str | Path) -> Results:
    """Read what a campaign has found so far, while it runs or afterwards.

    Raises
    ------
    CampaignError
        If there is no such file, or it holds no campaign.
    """
    if not Path(path).exists():
        raise CampaignError(f"{path}: no such file; make one with accelcal.campaign.run(..., store={str(path)!r}).")
    with opened(path, "rw") as connection:
        connection.execute("BEGIN")
        _identity(connection, path)
        rows = connection.execute("SELECT run, item, error FROM run ORDER BY run").fetchall()
        found = connection.execute("SELECT name, run, value FROM value").fetchall()
    place = {run: i for i, (run, _, _) in enumerate(rows)}
    values = {name: np.full(len(rows), math.nan) for name in sorted({name for name, _, _ in found})}
    for name, run, value in found:
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
