"""Sizes that keep the code readable: classes of estimation, functions and their parameters, files."""

from __future__ import annotations

import ast
import re
import runpy
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path
from statistics import median

import accelcal

SIZE = Path(__file__).parents[2] / "tools" / "size.py"

PACKAGE = Path(accelcal.__file__).parent
CRATES = Path(__file__).parents[2] / "crates"
PATHS = [*PACKAGE.rglob("*.py"), *(Path(__file__).parents[2] / "papers").rglob("*.py")]
MOST_LINES = 250
"""Of a class in `estimation`."""
MOST_PARAMETERS = 10
"""Of a function, outside commands (an option each) and bindings (a keyword each)."""
SETTINGS = {
    "registry.py:effect": 12,
    "record.py:run": 13,
    "record.py:run_batch": 12,
    "live_model.py:__init__": 13,
    "stream.py:fixed_rate_with_effects": 11,
    "sensor.py:simulate": 17,
}
"""Public functions whose settings are keywords with defaults, one each: more than the limit, and no more than today."""
MOST_FUNCTION_LINES, MOST_VERDICT_LINES = 80, 30
"""Of any function, its docstring and signature included, and of the one that judges."""
MOST_FILES, LEAST_MEDIAN = 262, 180
"""Files of package and papers, and lines of the one in the middle."""
RUST_FUNCTION = re.compile(r"\bfn (\w+)\s*(?:<[^{(]*>)?\s*\(([^{]*?)\)\s*(?:->|\{|where|;)", re.DOTALL)


def class_lengths(source: str) -> dict[str, int]:
    """Lines of each class of a Python source."""
    nodes = [node for node in ast.walk(ast.parse(source)) if isinstance(node, ast.ClassDef)]
    return {node.name: (node.end_lineno or node.lineno) - node.lineno + 1 for node in nodes}


def function_lengths(source: str) -> dict[str, int]:
    """Lines of each function and method of a Python source; of those with one name the longest."""
    results: dict[str, int] = {}
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            lines = (node.end_lineno or node.lineno) - node.lineno + 1
            results[node.name] = max(lines, results.get(node.name, 0))
    return results


def parameters_of_python(source: str) -> Iterator[tuple[str, int]]:
    """Functions and methods with the number of their parameters, `self` and `cls` aside."""
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.FunctionDef | ast.AsyncFunctionDef):
            names = [a.arg for a in (*node.args.posonlyargs, *node.args.args, *node.args.kwonlyargs)]
            yield node.name, len([name for name in names if name not in ("self", "cls")])


def parameters_of_rust(source: str) -> Iterator[tuple[str, int]]:
    """Functions with the number of their parameters, the receiver aside: colons that are no paths."""
    for name, inside in RUST_FUNCTION.findall(source):
        flat = re.sub(r"<[^<>]*>|\([^()]*\)|\[[^\[\]]*\]", "", re.sub(r"<[^<>]*>", "", inside))
        yield name, len(re.findall(r"(?<!:):(?!:)", flat))


def test_classes_of_estimation_are_short() -> None:
    results = {
        f"{path.name}:{name}": lines
        for path in (PACKAGE / "estimation").glob("*.py")
        for name, lines in class_lengths(path.read_text(encoding="utf-8")).items()
    }
    longest = max(results, key=results.__getitem__)
    print(f"longest class of estimation: {longest}, {results[longest]} lines (at most {MOST_LINES})")
    assert results[longest] <= MOST_LINES


def test_functions_are_short() -> None:
    results = {
        f"{path.name}:{name}": lines
        for path in PATHS
        for name, lines in function_lengths(path.read_text(encoding="utf-8")).items()
    }
    longest = max(results, key=results.__getitem__)
    print(f"longest of {len(results)} functions: {longest}, {results[longest]} lines (at most {MOST_FUNCTION_LINES})")
    assert results[longest] <= MOST_FUNCTION_LINES
    assert results["verdict.py:verdict_on"] <= MOST_VERDICT_LINES


def test_files_are_few_and_not_short() -> None:
    lengths = [len(path.read_text(encoding="utf-8").splitlines()) for path in PATHS]
    print(f"{len(lengths)} files (at most {MOST_FILES}), median {median(lengths)} lines (at least {LEAST_MEDIAN})")
    assert len(lengths) <= MOST_FILES
    assert median(lengths) >= LEAST_MEDIAN


def test_functions_take_few_parameters() -> None:
    python = [path for path in PACKAGE.rglob("*.py") if path.relative_to(PACKAGE).parts[0] != "cli"]
    rust = [path for crate in ("ekf-core", "ekf-simd") for path in (CRATES / crate / "src").rglob("*.rs")]
    results = {
        f"{path.name}:{name}": count
        for read, paths in ((parameters_of_python, python), (parameters_of_rust, rust))
        for path in paths
        for name, count in read(path.read_text(encoding="utf-8"))
    }
    largest = max(results, key=results.__getitem__)
    print(f"most parameters: {largest}, {results[largest]} of {len(results)} functions (at most {MOST_PARAMETERS})")
    beyond = {name: count for name, count in results.items() if count > MOST_PARAMETERS}
    print(f"beyond the limit: {beyond}")
    assert not {name: count for name, count in beyond.items() if count > SETTINGS.get(name, 0)}
    assert set(SETTINGS) <= set(beyond)  # one that is fixed must leave the list


def test_a_long_class_and_a_long_list_are_caught() -> None:
    # The twin that must fail: the same counts on sources beyond the limits.
    long = "def long():\n" + "    x = 1\n" * MOST_FUNCTION_LINES
    assert function_lengths(long)["long"] > MOST_FUNCTION_LINES
    assert function_lengths(f"def short(): ...\nclass A:\n    def short(self):\n{' ' * 8}...\n") == {"short": 2}
    assert class_lengths("class Long:\n" + "    x = 1\n" * MOST_LINES)["Long"] > MOST_LINES
    eleven = ", ".join(f"a{i}: f64" for i in range(11))
    assert dict(parameters_of_rust(f"pub fn many<T>(&self, {eleven}) -> f64 {{ 0.0 }}")) == {"many": 11}
    assert dict(parameters_of_python(f"def many(self, {eleven}): ...")) == {"many": 11}


def test_size_counts_code_alone() -> None:
    size = runpy.run_path(str(SIZE))
    source = '"""Text."""\nx = 1  # comment\ndef f():\n    "Text."\n    f"{x}"\n    return f"{x}" "y"\n'
    assert size["statements"](source) == 3  # x = 1, def, return
    assert size["tokens"](source) == 3 + 5 + 1  # x = 1; def f ( ) :; return
    assert size["is_schema"]('{"$schema": "https://json-schema.org/draft/2020-12/schema"}')
    assert not size["is_schema"]('{"schema": "model/2"}')


def test_constants_are_numbers_with_names() -> None:
    size = runpy.run_path(str(SIZE))
    source = 'A = 1\n"""First.\nSecond."""\nB: float = -2.0 * 3\nC = A + 1\nD = "x"\nE = True\nF = (1, 2)\n'
    assert size["constants"](source) == [(1, "A", "1", "First."), (4, "B", "-2.0 * 3", "")]
    assert [name for _, name, _, _ in size["constants"]("A, B = 1, 2.0\n")] == ["A", "B"]


def test_size_prints_each_count() -> None:
    lines = subprocess.run([sys.executable, str(SIZE)], capture_output=True, text=True, check=True).stdout.splitlines()
    counts = {name: int(number) for number, name in (line.split(maxsplit=1) for line in lines)}
    print(counts)
    assert counts["names in accelcal.__all__"] == len(accelcal.__all__)
    assert counts["statements"] < counts["tokens"]
