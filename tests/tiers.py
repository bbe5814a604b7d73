"""Tiers of the tests: what a case costs in processor seconds, by measurement, and which cases `make test` runs.

`make test` runs what is neither `slow`, nor `outside`, nor `statistics`. `make test-durations` runs every test with
`ACCELCAL_DURATIONS` naming a folder, into which each worker writes a line per case; `python -m tests.tiers FOLDER`
makes `tests/durations.json` of them. A case that is not listed there, a new one too, is fast.
"""

from __future__ import annotations

import json
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Generator, Sequence
from pathlib import Path
from statistics import mean
from typing import Any

import pytest

from tests.commands import PARENT

FILE = Path(__file__).with_name("durations.json")
SLOW = 2.0
"""Processor seconds above which a case is slow."""
LISTED = 0.5
"""Processor seconds above which a case is listed in `durations.json`."""
OUTSIDE = {"browser", "device_tools", "host_tools"}
"""Fixtures that start a browser, an emulator or a compiler; where a test starts one itself it is marked by hand."""


def processor() -> float:
    """Return the processor seconds of this process, of its ended children and of the commands that it had forked."""
    return sum(os.times()[:4]) + PARENT.spent


def stored() -> dict[str, float]:
    """Return the processor seconds of the listed cases."""
    files = json.loads(FILE.read_text()) if FILE.exists() else {}
    return {f"{file}::{case}": seconds for file, cases in files.items() for case, seconds in cases.items()}


def mark(items: Sequence[pytest.Item]) -> None:
    """Mark cases that are slow by the file of durations, and those whose fixtures start programs of others."""
    seconds = stored()
    for item in items:
        if seconds.get(item.nodeid, 0.0) > SLOW:
            item.add_marker("slow")
        if OUTSIDE.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("outside")


class Stopwatch:
    """Times of every case: its own, and those of each fixture that it shares with others."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.lines = (folder / f"{os.getpid()}.jsonl").open("a")
        self.shared = 0.0  # spent on shared fixtures in the present case

    def write(self, **line: object) -> None:
        self.lines.write(json.dumps(line) + "\n")
        self.lines.flush()

    @pytest.hookimpl(wrapper=True)
    def pytest_fixture_setup(self, fixturedef: Any) -> Generator[None, object, object]:
        begin, inner = processor(), self.shared
        try:
            return (yield)
        finally:
            if fixturedef.scope != "function":
                seconds = processor() - begin - (self.shared - inner)
                self.shared += seconds
                self.write(fixture=f"{fixturedef.baseid}::{fixturedef.argname}", seconds=seconds)

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, object, object]:
        begin, self.shared = processor(), 0.0
        try:
            return (yield)
        finally:
            info = item._fixtureinfo.name2fixturedefs
            uses = [f"{used[-1].baseid}::{name}" for name, used in info.items() if used[-1].scope != "function"]
            self.write(case=item.nodeid, seconds=processor() - begin - self.shared, uses=uses)


def collect(folder: Path) -> dict[str, float]:
    """Return the processor seconds of every case: its own, and an equal share of each fixture that others use too."""
    own: dict[str, list[float]] = defaultdict(list)
    uses: dict[str, list[str]] = {}
    fixtures: dict[str, list[float]] = defaultdict(list)
    for path in sorted(folder.glob("*.jsonl")):
        for line in map(json.loads, path.read_text().splitlines()):
            if "case" in line:
                own[line["case"]].append(line["seconds"])
                uses[line["case"]] = line["uses"]
            else:
                fixtures[line["fixture"]].append(line["seconds"])
    users = Counter(name for names in uses.values() for name in names)
    share = {name: mean(spent) / max(users[name], 1) for name, spent in fixtures.items()}
    return {case: mean(spent) + sum(share.get(name, 0.0) for name in uses[case]) for case, spent in own.items()}


if __name__ == "__main__":
    measured = collect(Path(sys.argv[1]))
    files: dict[str, dict[str, float]] = defaultdict(dict)
    for case, seconds in sorted(measured.items()):
        if seconds > LISTED:
            file, _, name = case.partition("::")
            files[file][name] = round(seconds, 1)
    FILE.write_text(json.dumps(files, indent=1, ensure_ascii=False) + "\n")
    print(f"{len(measured)} cases, {sum(measured.values()):.0f} s of processor time; in {FILE}: cases above {LISTED} s")
