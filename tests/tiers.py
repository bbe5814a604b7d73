"""Tiers of the tests: what a case costs in processor seconds, by measurement, and which cases `make test` runs.

`make test` runs what is neither `slow` (a case above half a second, or what takes its function there), nor `outside`,
nor `statistics`. `make test-durations` runs every test with `ACCELCAL_DURATIONS` naming a folder, into which each
worker writes a line per case: its time, and from Python 3.12 on the lines of the package that it reaches. `python -m
tests.tiers FOLDER` makes `tests/durations.json` of them, with a guard for each slow test, and prints how many tests
and lines `make test` reaches. A case that is not listed is fast.
"""

from __future__ import annotations

import json
import math
import os
import sys
from collections import Counter, defaultdict
from collections.abc import Generator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from statistics import mean
from types import CodeType
from typing import Any

import pytest

from tests.commands import PARENT

FILE = Path(__file__).with_name("durations.json")
ROOT = Path(__file__).parents[1]
PACKAGE = f"{ROOT / 'python' / 'accelcal'}{os.sep}"
JUDGED = ("estimation/", "diagnosis/", "data/", "io/", "validation/")
"""Folders of the package whose lines `make test` should reach nearly as well as `make test-all`."""
SLOW = 0.5
"""Processor seconds above which a case is slow; of a test function above it, every second or third case stays.

`ACCELCAL_SLOW=0/8` runs every eighth of the slow cases, from the first; 1/8 to 7/8 the others."""
LISTED = 0.3
"""Processor seconds above which a case is listed in `durations.json`."""
OUTSIDE = {"browser", "device_tools", "host_tools"}
"""Fixtures that start a browser, an emulator or a compiler; where a test starts one itself it is marked by hand."""


@dataclass
class Spent:
    """Processor seconds at the last look, and those of what had ended before it with no parent that waited."""

    last: float = 0.0
    lost: float = 0.0

    def now(self, seconds: float) -> float:
        """Return all seconds, where `seconds` are those that the system still knows of."""
        self.lost += max(self.last - seconds, 0.0)
        self.last = seconds
        return seconds + self.lost


SPENT = Spent()


def processor() -> float:
    """Return the processor seconds of this process, of its ended children, of the commands that it had forked, and of
    what it has started that still runs: browsers, servers."""
    return SPENT.now(sum(os.times()[:4]) + PARENT.spent + living(os.getpid(), PARENT.pid))


def living(process: int, but: int | None = None) -> float:
    """Return the processor seconds of all living descendants of a process and of their ended children, but of one
    child with its own; 0 without /proc."""
    parents, spent = {}, {}
    for path in Path("/proc").glob("[0-9]*/stat"):
        try:
            numbers = path.read_text().rpartition(")")[2].split()
        except OSError:  # it has ended
            continue
        name = int(path.parent.name)
        parents[name], spent[name] = int(numbers[1]), sum(map(int, numbers[11:15]))
    generation, total = {process}, 0
    while generation:
        generation = {name for name, parent in parents.items() if parent in generation and name != but}
        total += sum(spent[name] for name in generation)
    return total / os.sysconf("SC_CLK_TCK")


def stored() -> tuple[dict[str, float], dict[str, str]]:
    """Return the processor seconds of the listed cases, and the guard of each slow test."""
    content = json.loads(FILE.read_text())
    files = content["seconds"].items()
    return {f"{file}::{case}": seconds for file, cases in files for case, seconds in cases.items()}, content["guards"]


def function(case: str) -> str:
    return case.partition("[")[0]


def slow_cases(seconds: Mapping[str, float]) -> set[str]:
    """Return the cases above `SLOW`, and of each test function what takes it there, evenly spread."""
    slow = {case for case, spent in seconds.items() if spent > SLOW}
    functions: dict[str, list[str]] = defaultdict(list)
    for case, spent in sorted(seconds.items()):
        if LISTED < spent <= SLOW:
            functions[function(case)].append(case)
    for cases in functions.values():
        step = math.ceil(sum(seconds[case] for case in cases) / SLOW)
        slow |= set(cases) - set(cases[::step])
    return slow


def drawn(count: int) -> pytest.MarkDecorator:
    """Cases of a statistical test with an argument `draws`: a tenth of them, and all beside `make test`."""
    every = pytest.param(count, marks=pytest.mark.statistics)
    return pytest.mark.parametrize("draws", [max(1, count // 10), every])


def mark(items: Sequence[pytest.Item]) -> set[str]:
    """Mark cases that are slow by the file of durations, and those whose fixtures start programs of others.

    Returns
    -------
    The slow tests among them that have neither a fast case nor a guard.
    """
    seconds, guards = stored()
    listed, slow, fast = slow_cases(seconds), set[str](), set[str]()
    for item in items:
        if item.nodeid in listed and not item.get_closest_marker("always"):
            item.add_marker("slow")
        if OUTSIDE.intersection(getattr(item, "fixturenames", ())):
            item.add_marker("outside")
        (slow if item.get_closest_marker("slow") else fast).add(function(item.nodeid))
    return slow - fast - guards.keys()


def dropped(items: Sequence[pytest.Item]) -> set[str]:
    """Return the listed cases of the collected test functions that are no cases of them; all cases are in `items`."""
    cases = {item.nodeid for item in items}
    functions = set(map(function, cases))
    return {case for case in stored()[0] if function(case) in functions} - cases


def left_out(items: Sequence[pytest.Item], share: str) -> list[pytest.Item]:
    """Return the slow cases that are not in a share, such as "0/2"; another share has them."""
    part, of = map(int, share.split("/"))
    seconds, _ = stored()
    slow = [item for item in items if seconds.get(item.nodeid, 0.0) > SLOW]
    slow = sorted((item for item in slow if not item.get_closest_marker("always")), key=lambda item: item.nodeid)
    return [item for place, item in enumerate(slow) if place % of != part]


class Reach:
    """Lines of the package that have run since they were last taken; none before Python 3.12."""

    def __init__(self) -> None:
        self.lines: dict[str, set[int]] = defaultdict(set)
        self.watch: Any = getattr(sys, "monitoring", None)
        if self.watch:
            watch, tool = self.watch, self.watch.COVERAGE_ID
            watch.use_tool_id(tool, "reach")
            watch.register_callback(tool, watch.events.PY_START, self.begin)
            watch.register_callback(tool, watch.events.LINE, self.pass_line)
            watch.set_events(tool, watch.events.PY_START)

    def begin(self, code: CodeType, _: int) -> object:
        if code.co_filename.startswith(PACKAGE):
            self.watch.set_local_events(self.watch.COVERAGE_ID, code, self.watch.events.LINE)
        return self.watch.DISABLE

    def pass_line(self, code: CodeType, line: int) -> object:
        self.lines[code.co_filename.removeprefix(PACKAGE)].add(line)
        return self.watch.DISABLE

    def take(self) -> dict[str, list[int]]:
        lines = {file: sorted(lines) for file, lines in self.lines.items()}
        self.lines.clear()
        if self.watch:
            self.watch.restart_events()
        return lines


class Stopwatch:
    """Times of every case: its own, and those of each fixture that it shares with others; and the lines it reaches."""

    def __init__(self, folder: Path) -> None:
        folder.mkdir(parents=True, exist_ok=True)
        self.file = (folder / f"{os.getpid()}.jsonl").open("a")
        self.shared = 0.0  # spent on shared fixtures in the present case
        self.reach = Reach()

    def write(self, **line: object) -> None:
        self.file.write(json.dumps(line) + "\n")
        self.file.flush()

    def pytest_unconfigure(self) -> None:
        if watch := self.reach.watch:
            watch.set_events(watch.COVERAGE_ID, 0)
            watch.register_callback(watch.COVERAGE_ID, watch.events.LINE, None)

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

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_teardown(self) -> None:
        processor()  # while servers and browsers still run

    @pytest.hookimpl(wrapper=True)
    def pytest_runtest_protocol(self, item: Any) -> Generator[None, object, object]:
        self.reach.take()
        begin, self.shared = processor(), 0.0
        try:
            return (yield)
        finally:
            seconds = processor() - begin - self.shared
            info = item._fixtureinfo.name2fixturedefs
            uses = [f"{used[-1].baseid}::{name}" for name, used in info.items() if used[-1].scope != "function"]
            self.write(
                case=item.nodeid,
                seconds=seconds,
                uses=uses,
                marks=[mark.name for mark in item.iter_markers()],
                lines=self.reach.take(),
            )


class Measured:
    """What the workers wrote into a folder: by case its seconds, and by test function the lines that it reaches."""

    def __init__(self, folder: Path) -> None:
        durations: dict[str, list[float]] = defaultdict(list)
        fixtures: dict[str, list[float]] = defaultdict(list)
        uses: dict[str, list[str]] = {}
        self.beside: set[str] = set()
        self.always: set[str] = set()
        self.lines: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for path in sorted(folder.glob("*.jsonl")):
            for line in map(json.loads, path.read_text().splitlines()):
                if "fixture" in line:
                    fixtures[line["fixture"]].append(line["seconds"])
                    continue
                case = line["case"]
                durations[case].append(line["seconds"])
                uses[case] = line["uses"]
                self.beside |= {case} if {"outside", "statistics"}.intersection(line["marks"]) else set()
                self.always |= {case} if "always" in line["marks"] else set()
                self.lines[case] |= {(file, number) for file, numbers in line["lines"].items() for number in numbers}
        users = Counter(name for names in uses.values() for name in names)
        share = {name: mean(spent) / max(users[name], 1) for name, spent in fixtures.items()}
        self.seconds = {
            case: mean(spent) + sum(share.get(name, 0.0) for name in uses[case]) for case, spent in durations.items()
        }
        self.fast = (self.seconds.keys() - slow_cases(self.seconds) | self.always) - self.beside

    def guards(self) -> dict[str, str]:
        """Return, for each test without a fast case, the fast test whose lines are most like its own, rare ones first.

        The likeness is a cosine; where the lines run in another process, it is a fast test of the same file or folder.
        """
        reached: dict[str, set[tuple[str, int]]] = defaultdict(set)
        for case, lines in self.lines.items():
            reached[function(case)] |= lines
        fast = sorted({function(case) for case in self.fast})
        rarity = Counter(line for lines in reached.values() for line in lines)

        def weight(lines: set[tuple[str, int]]) -> float:
            return sum(1.0 / rarity[line] for line in lines)

        size = {other: math.sqrt(weight(reached[other]) or 1.0) for other in fast}
        chosen = {}
        for test in sorted(reached.keys() - fast):
            file = test.partition("::")[0]
            near = {
                other: (
                    weight(reached[test] & reached[other]) / size[other],
                    other.startswith(file),
                    other.startswith(os.path.dirname(file)),
                )
                for other in fast
            }
            guard = max(fast, key=near.__getitem__, default="")
            if guard and any(near[guard]):
                chosen[test] = guard
        return chosen

    def summary(self) -> str:
        """Say how many test functions and lines `make test` reaches."""
        functions = {function(case) for case in self.seconds}
        fast = {function(case) for case in self.fast}
        every, ours = (
            {line for case in cases for line in self.lines[case] if line[0].startswith(JUDGED)}
            for cases in (self.seconds, self.fast)
        )
        spent = sum(self.seconds[case] for case in self.fast)
        return (
            f"make test: {len(self.fast)} of {len(self.seconds)} cases, {spent:.0f} of "
            f"{sum(self.seconds.values()):.0f} s of processor time\n"
            f"{len(fast)} of {len(functions)} functions ({100.0 * len(fast) / len(functions):.1f} %, at least 80)\n"
            f"{len(ours)} of {len(every)} lines ({100.0 * len(ours) / max(len(every), 1):.1f} %, at least 95)"
        )


def write(measured: Measured) -> None:
    """Write the file of durations; without lines, from a Python before 3.12, guards that still hold stay."""
    files: dict[str, dict[str, float]] = defaultdict(dict)
    for case, seconds in sorted(measured.seconds.items()):
        if seconds > LISTED:
            file, _, name = case.partition("::")
            files[file][name] = round(seconds, 1)
    guards = measured.guards()
    if not any(measured.lines.values()):
        fast = {function(case) for case in measured.fast}
        guards |= {test: guard for test, guard in stored()[1].items() if test in guards and guard in fast}
    FILE.write_text(json.dumps({"seconds": files, "guards": guards}, indent=1, ensure_ascii=False) + "\n")


if __name__ == "__main__":
    measured = Measured(Path(sys.argv[1]))
    write(measured)
    print(measured.summary())
