"""What the tests run of the Python code, by folder; and how many of some random changes in it they notice.

make coverage       # build/.coverage, and the share of the lines by folder
make mutants        # or: python tools/mutants.py --count 200 --seed 1 --out build/mutants.jsonl

Each mutant changes one operator, comparison, condition or number in a line of `estimation` or `diagnosis` that a test
runs, by a coverage file with a context for each test. It is run against 100 tests at most that reach the line, those of
its folder first, and against the figures of tests/workflow, in a copy of the tree: half a minute. A line of the output
is one mutant; an interrupted run goes on where it stopped. The exit code is 1 where fewer than 85 % are noticed.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import shutil
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import coverage

ROOT = Path(__file__).resolve().parent.parent
FOLDERS = ("estimation", "diagnosis")
MOST_TESTS, SECONDS = 100, 240.0
FIGURES = "tests/workflow/test_figures.py"
LEAST_NOTICED = 0.85
OPERATORS: dict[type[ast.AST], type[ast.AST]] = {
    ast.Add: ast.Sub,
    ast.Sub: ast.Add,
    ast.Mult: ast.Div,
    ast.Div: ast.Mult,
    ast.Pow: ast.Mult,
    ast.Lt: ast.GtE,
    ast.GtE: ast.Lt,
    ast.Gt: ast.LtE,
    ast.LtE: ast.Gt,
    ast.Eq: ast.NotEq,
    ast.NotEq: ast.Eq,
    ast.And: ast.Or,
    ast.Or: ast.And,
    ast.Is: ast.IsNot,
    ast.IsNot: ast.Is,
}


def changed(node: ast.AST) -> str | None:
    """Source of an expression with one thing changed; None where nothing is."""
    before = ast.unparse(node)
    if isinstance(node, ast.BinOp) and type(node.op) in OPERATORS:
        node.op = OPERATORS[type(node.op)]()  # type: ignore[assignment]
    elif isinstance(node, ast.Compare) and len(node.ops) == 1 and type(node.ops[0]) in OPERATORS:
        node.ops = [OPERATORS[type(node.ops[0])]()]  # type: ignore[list-item]
    elif isinstance(node, ast.BoolOp):
        node.op = OPERATORS[type(node.op)]()  # type: ignore[assignment]
    elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.Not | ast.USub):
        return f"({ast.unparse(node.operand)})"
    elif isinstance(node, ast.Constant) and isinstance(node.value, bool):
        return str(not node.value)
    elif isinstance(node, ast.Constant) and isinstance(node.value, int | float):
        return f"({node.value + 1})" if isinstance(node.value, int) else f"({node.value or 1.0} * 1.5)"
    after = ast.unparse(node)
    return None if after == before else f"({after})"


def places(tree: ast.AST) -> Iterator[ast.expr]:
    """Expressions of a module inside of functions, annotations left out."""
    for function in ast.walk(tree):
        if isinstance(function, ast.FunctionDef):
            for statement in function.body:
                for node in ast.walk(statement):
                    if isinstance(node, ast.AnnAssign):
                        node.annotation = ast.Constant(None)
                    if isinstance(node, ast.expr) and hasattr(node, "end_col_offset"):
                        yield node


def is_whole(text: str, node: ast.expr) -> bool:
    """Whether a text is an expression: inside of f-strings older Pythons know no places."""
    try:
        return ast.dump(ast.parse(text, mode="eval").body) == ast.dump(node)
    except SyntaxError:
        return False


def mutants(data: coverage.CoverageData, count: int, seed: int) -> list[dict[str, object]]:
    """Random ones in lines that tests reach: file, line, what was and what is there, the file's source, its tests."""
    rng, drawn = random.Random(seed), list[dict[str, object]]()
    reached, offered = dict[str, dict[int, list[str]]](), []
    for path in sorted(data.measured_files()):
        if not any(f"/accelcal/{folder}/" in Path(path).as_posix() for folder in FOLDERS):
            continue
        reached[path] = data.contexts_by_lineno(path)
        source = Path(path).read_text(encoding="utf-8")
        for node in places(ast.parse(source)):
            if any("::" in name for name in reached[path].get(node.lineno, ())):
                offered.append((path, source, node))
    while len(drawn) < count and offered:
        path, source, node = offered[rng.randrange(len(offered))]
        lines = source.encode().splitlines(keepends=True)
        first, last = node.lineno - 1, (node.end_lineno or node.lineno) - 1
        before = ast.get_source_segment(source, node) or ""
        after = changed(ast.parse(before, mode="eval").body) if first == last and is_whole(before, node) else None
        named = Path(path).as_posix().split("/python/", 1)[1]
        key = f"{named}:{node.lineno}:{node.col_offset} {before} -> {after}"
        if after is None or any(mutant["key"] == key for mutant in drawn):
            continue
        line = lines[first]
        lines[first] = line[: node.col_offset] + after.encode() + line[node.end_col_offset :]
        tests = sorted({name.rsplit("|", 1)[0] for name in reached[path][node.lineno] if "::" in name})
        rng.shuffle(tests)
        beside = f"tests/{named.split('/')[1]}/"  # of its own folder first
        tests.sort(key=lambda name: not name.startswith(beside))
        drawn.append(
            {
                "key": key,
                "file": named,
                "source": b"".join(lines).decode(),
                "tests": tests[:MOST_TESTS],
            }
        )
    return drawn


def outcome(tree: Path, mutant: dict[str, object]) -> str:
    """What tests say of a mutant: killed, timeout, survived; "not run" where pytest could not run them."""
    target = tree / "python" / str(mutant["file"])
    whole = target.read_text(encoding="utf-8")
    target.write_text(str(mutant["source"]), encoding="utf-8")
    command = [sys.executable, "-m", "pytest", "-x", "-q", "-p", "no:randomly", "-p", "no:cacheprovider"]
    environment = os.environ | {"PYTHONPATH": str(tree / "python"), "PYTHONDONTWRITEBYTECODE": "1"}
    try:
        done = subprocess.run(
            [*command, FIGURES, *mutant["tests"]],  # type: ignore[misc]
            cwd=tree,
            env=environment,
            capture_output=True,
            timeout=SECONDS,
            check=False,
        )
    except subprocess.TimeoutExpired:
        return "timeout"
    finally:
        target.write_text(whole, encoding="utf-8")
    return {0: "survived", 1: "killed", 2: "killed"}.get(done.returncode, "not run")


def print_folders(path: Path) -> None:
    """Print how many statements of each folder of the package the tests of a coverage file run."""
    measured = coverage.Coverage(data_file=str(path))
    measured.load()
    package, folders = ROOT / "python" / "accelcal", dict[str, list[int]]()
    for file in sorted(package.rglob("*.py")):
        _, statements, _, missing, _ = measured.analysis2(str(file))
        counts = folders.setdefault(file.relative_to(package).parts[0].removesuffix(".py"), [0, 0])
        counts[0] += len(statements) - len(missing)
        counts[1] += len(statements)
    for folder, (run, every) in [*folders.items(), ("all", [sum(n) for n in zip(*folders.values(), strict=True)])]:
        if every:
            print(f"{folder:16} {run:6} of {every:6}  {run / every:.1%}")


def main() -> int:
    """Run what is missing; print the survivors and the share that is noticed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--coverage", type=Path, default=ROOT / "build" / ".coverage")
    parser.add_argument("--count", type=int, default=200)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--out", type=Path, default=ROOT / "build" / "mutants.jsonl")
    parser.add_argument("--folders", action="store_true", help="print the coverage, and end")
    chosen = parser.parse_args()
    if chosen.folders:
        print_folders(chosen.coverage)
        return 0
    data = coverage.CoverageData(str(chosen.coverage))
    data.read()
    tree = ROOT / "build" / f"mutants-{chosen.seed}"
    if not tree.exists():
        subprocess.run(["git", "worktree", "add", "-q", "--detach", str(tree)], cwd=ROOT, check=True)
    head = subprocess.run(["git", "rev-parse", "HEAD"], cwd=ROOT, check=True, capture_output=True, text=True).stdout
    subprocess.run(["git", "checkout", "-q", "--force", "--detach", head.strip()], cwd=tree, check=True)
    for library in (ROOT / "python" / "accelcal").glob("_core*.so"):
        shutil.copy(library, tree / "python" / "accelcal")
    unchanged = {
        "file": "accelcal/__init__.py",
        "source": (tree / "python/accelcal/__init__.py").read_text(),
        "tests": [],
    }
    if outcome(tree, unchanged) != "survived":
        raise SystemExit(f"{FIGURES} fails before anything is changed")
    chosen.out.parent.mkdir(exist_ok=True)
    ran = [json.loads(line) for line in chosen.out.read_text().splitlines()] if chosen.out.exists() else []
    earlier = {row["key"] for row in ran}
    for mutant in mutants(data, chosen.count, chosen.seed):
        if mutant["key"] not in earlier:
            ran.append({"key": mutant["key"], "outcome": outcome(tree, mutant), "tests": len(mutant["tests"])})  # type: ignore[arg-type]
            with chosen.out.open("a") as out:
                out.write(json.dumps(ran[-1]) + "\n")
    others = [f"{row['outcome']}: {row['key']}" for row in ran if row["outcome"] != "killed"]
    print("\n".join(others))
    print(f"killed: {len(ran) - len(others)} of {len(ran)} (at least {LEAST_NOTICED:.0%})")
    return 0 if len(ran) - len(others) >= LEAST_NOTICED * len(ran) else 1


if __name__ == "__main__":
    raise SystemExit(main())
