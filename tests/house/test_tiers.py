"""What `make test` leaves out is guarded by what it runs, and a forked command does what a command does."""

from __future__ import annotations

import ast
import functools
import json
import os
import re
import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import pytest

from tests import tiers
from tests.commands import accelcal, python

pytestmark = pytest.mark.always

ROOT = Path(__file__).parents[2]


@functools.cache
def functions(file: str) -> set[str]:
    """Names of the functions of a file; none where there is no such file."""
    path = ROOT / file
    body = ast.parse(path.read_text(encoding="utf-8")).body if path.exists() else []
    return {node.name for node in body if isinstance(node, ast.FunctionDef)}


def exists(test: str) -> bool:
    """Whether a file has a test function."""
    file, _, name = test.partition("::")
    return name in functions(file)


def shared_generators(source: str) -> list[int]:
    """Lines of a module at which a generator gets a name that its tests share: what they draw hangs on their order."""
    assigned = (node for node in ast.parse(source).body if isinstance(node, ast.Assign | ast.AnnAssign))
    calls = ((node.lineno, node.value.func) for node in assigned if isinstance(node.value, ast.Call))
    return [line for line, call in calls if ast.unparse(call) in ("np.random.default_rng", "random.Random")]


def test_no_generator_is_shared_by_tests() -> None:
    paths = [path for folder in ("tests", "benches") for path in sorted((ROOT / folder).rglob("*.py"))]
    assert not [path.name for path in paths if shared_generators(path.read_text(encoding="utf-8"))]
    assert shared_generators("import numpy as np\nRNG = np.random.default_rng(3)\n") == [2]
    assert not shared_generators("Y = np.random.default_rng(3).normal(size=9)\n")


def test_every_slow_test_has_a_fast_case_or_a_guard(pytestconfig: pytest.Config) -> None:
    assert pytestconfig.unguarded == set()  # type: ignore[attr-defined]


def test_every_listed_case_is_a_case_of_its_function(pytestconfig: pytest.Config) -> None:
    assert pytestconfig.dropped == set()  # type: ignore[attr-defined]
    named = next(case for case in tiers.stored()[0] if "[" in case)
    assert named in tiers.dropped([SimpleNamespace(nodeid=f"{tiers.function(named)}[another]")])  # type: ignore[list-item]


def test_tests_and_guards_exist_and_no_guard_is_slow() -> None:
    seconds, guards = tiers.stored()
    named = {tiers.function(case) for case in seconds} | guards.keys() | set(guards.values())
    assert {test for test in named if not exists(test)} == set()
    assert not set(guards.values()) & guards.keys()


def test_what_a_test_has_started_counts_while_it_runs() -> None:
    work = "for _ in range(10 ** 7): pass\nprint(flush=True)\ninput()"
    before = tiers.processor()
    with subprocess.Popen([sys.executable, "-c", work], stdin=subprocess.PIPE, stdout=subprocess.PIPE) as child:
        assert child.stdout is not None
        child.stdout.readline()
        spent = tiers.processor() - before
        assert spent > 0.1
        assert tiers.living(os.getpid()) - tiers.living(os.getpid(), child.pid) > 0.1
        child.communicate(b"\n")
    assert 0.9 * spent < tiers.processor() - before < spent + 0.5  # counted once, ended too


def test_what_ends_with_nobody_waiting_has_still_counted() -> None:
    spent = tiers.Spent()
    assert [spent.now(seconds) for seconds in (1.0, 6.0, 2.0, 2.5)] == [1.0, 6.0, 6.0, 6.5]


def test_shares_of_the_slow_cases_are_apart_and_make_up_all() -> None:
    seconds, _ = tiers.stored()
    slow = sorted(case for case, spent in seconds.items() if spent > tiers.SLOW)
    items = [SimpleNamespace(nodeid=case, get_closest_marker=lambda name: None) for case in (*slow, "a.py::fast")]
    shares = [f"{part}/4" for part in range(4)]
    left_out = [{item.nodeid for item in tiers.left_out(items, share)} for share in shares]  # type: ignore[arg-type]
    remaining = [case for absent in left_out for case in slow if case not in absent]
    assert sorted(remaining) == slow
    assert not any("a.py::fast" in absent for absent in left_out)
    assert min(len(slow) - len(absent) for absent in left_out) > 50


def test_guards_are_chosen_by_the_lines_that_few_tests_reach(tmp_path: Path) -> None:
    common, rare = {"io/load.py": [1, 2, 3]}, {"io/load.py": [1], "io/csv.py": [7]}
    rows = [("a.py::slow", 3.0, rare), ("a.py::near", 0.1, rare), ("a.py::far[1]", 0.1, common)]
    rows += [("a.py::far[2]", 2.5, common)]
    text = "".join(
        f'{{"case": "{case}", "seconds": {seconds}, "uses": [], "marks": [], "lines": {lines}}}\n'
        for case, seconds, lines in rows
    ).replace("'", '"')
    (tmp_path / "1.jsonl").write_text(text)
    measured = tiers.Measured(tmp_path)
    assert measured.guards() == {"a.py::slow": "a.py::near"}
    assert "2 of 4 cases" in measured.summary()
    assert "2 of 3 functions" in measured.summary()
    assert "4 of 4 lines" in measured.summary()


def test_of_a_function_whose_cases_take_long_some_stay() -> None:
    seconds = {f"a.py::many[{k}]": 0.4 for k in range(9)} | {
        "a.py::many[x]": 0.1,
        "a.py::many[y]": 2.1,
        "a.py::two": 0.45,
    }
    assert tiers.slow_cases(seconds) == {f"a.py::many[{k}]" for k in (*range(1, 8), "y")}


def test_without_lines_guards_that_hold_stay(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    rows = [
        ("a/a.py::slow", 3.0),
        ("a/a.py::near", 0.1),
        ("b/b.py::far", 0.1),
        ("b/b.py::new", 3.0),
        ("c/c.py::lone", 3.0),
    ]
    lines = [{"case": case, "seconds": seconds, "uses": [], "marks": [], "lines": {}} for case, seconds in rows]
    (tmp_path / "1.jsonl").write_text("\n".join(map(json.dumps, lines)))
    file = tmp_path / "durations.json"
    file.write_text(json.dumps({"seconds": {}, "guards": {"a/a.py::slow": "b/b.py::far", "d.py::gone": "b/b.py::far"}}))
    monkeypatch.setattr(tiers, "FILE", file)
    tiers.write(tiers.Measured(tmp_path))
    seconds, guards = tiers.stored()
    assert seconds == {"a/a.py::slow": 3.0, "b/b.py::new": 3.0, "c/c.py::lone": 3.0}
    assert guards == {"a/a.py::slow": "b/b.py::far", "b/b.py::new": "b/b.py::far"}


def test_the_proof_runs_every_test_once() -> None:
    makefile, proof = (ROOT / "Makefile").read_text(), (ROOT / ".ci" / "run").read_text()
    assert '-m "not ($(BESIDE))"' in makefile
    assert '-m "$(BESIDE)"' in makefile
    assert "BESIDE := slow or outside or statistics\n" in makefile
    assert re.findall(r"^stage (test[\w-]*)", proof, re.M) == ["test", "test-rest"]
    assert "--ignore" not in proof


@pytest.mark.parametrize("words", [("--version",), ("fit",), ("fit", "absent.csv"), ("doctor", "--json")])
def test_a_forked_command_ends_and_says_what_a_started_one_does(tmp_path: Path, words: tuple[str, ...]) -> None:
    forked = accelcal(*words, cwd=tmp_path)
    started = subprocess.run(forked.args, cwd=tmp_path, stdin=subprocess.DEVNULL, capture_output=True, text=True)
    assert forked.args[0] == sys.executable
    for name in ("returncode", "stdout", "stderr"):
        assert getattr(forked, name) == getattr(started, name)


def test_a_command_that_hangs_is_ended() -> None:
    with pytest.raises(subprocess.TimeoutExpired):
        python("-c", "import time; time.sleep(600)", timeout=1.0)
    assert python("-c", "print(1)").stdout == "1\n"
