"""Outputs of one revision of accelcal on ten recordings, and how those of two revisions differ.

    python tools/compare_outputs.py run FOLDER     fit, diagnose, improve, power and the exported C of ten recordings
    python tools/compare_outputs.py diff A B       exit 1 where they differ; sentences are left out of the comparison

`tools/compare_outputs.sh REV` does both for the checkout and another revision.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import re
import subprocess
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

RIGS = Path(__file__).resolve().parent.parent / "tests" / "real"
REAL = (
    "broad_trial10",
    "broad_trial15",
    "cyberdiver_15npmm_6mps_trial1",
    "cyberdiver_ext_ret_trial1",
    "cyberdiver_ext_ret_trial2",
    "rocket_gw1_airbrakes_bay",
    "rocket_gw1_nosecone",
    "rocket_jackpot4",
)
"""Real recordings under ACCELCAL_REAL_DATA, each with its sidecar in tests/real."""
SIMULATED = {
    "cubic": ["--seed", "11", "--motion", "fast", "--cubic", "1e-3"],
    "nothing": ["--seed", "12", "--motion", "moves"],
}
"""Simulated recordings by the effect that is hidden in them, with the arguments of `accelcal simulate`."""
TINY = 1e-12
"""p values and constants of C, bounds of rounding among them, closer than this are equal where a tolerance is given."""
SENTENCE = re.compile(r"\s")
COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)


def accelcal(folder: Path, *arguments: str) -> str:
    """Standard output of one command, or its exit code where it is not zero; the time it took goes to stderr."""
    begin = time.perf_counter()
    command = [sys.executable, "-m", "accelcal", *arguments]
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, check=False)
    print(f"{time.perf_counter() - begin:7.1f} s  {' '.join(arguments)[:100]}", file=sys.stderr)
    return done.stdout if done.returncode == 0 else f"exit {done.returncode}\n{done.stderr}"


def run_one(name: str, recording: str, rig: list[str], folder: Path) -> None:
    """Every command on one recording, each output a file `NAME.COMMAND.json`."""
    model = f"{name}.model.json"
    for command, arguments in (
        ("fit", ["fit", recording, *rig, "-o", model, "--json"]),
        ("diagnose", ["diagnose", model, recording, *rig, "--json"]),
        ("improve", ["improve", recording, *rig, "--json"]),
        ("power", ["power", recording, *rig, "--json"]),
        ("export", ["export", model, "--c", f"{name}.h"]),
    ):
        (folder / f"{name}.{command}.json").write_text(accelcal(folder, *arguments), encoding="utf-8")


def run(folder: Path) -> None:
    """Outputs of the accelcal that this interpreter imports, in `folder`."""
    folder.mkdir(parents=True, exist_ok=True)
    real = os.environ.get("ACCELCAL_REAL_DATA")
    if real is None:
        raise SystemExit("ACCELCAL_REAL_DATA names no folder: eight of the ten recordings are real ones")
    jobs = []
    for name in REAL:
        [path] = Path(real).rglob(f"{name}.csv")
        jobs.append((name, str(path), ["--rig", str(RIGS / f"{name}.toml")]))
    for name, arguments in SIMULATED.items():
        accelcal(folder, "simulate", "-o", f"{name}.csv", *arguments)
        jobs.append((name, f"{name}.csv", []))
    with ThreadPoolExecutor(int(os.environ.get("JOBS", "2"))) as pool:
        list(pool.map(lambda job: run_one(*job, folder), jobs))


def masked(content: Any) -> Any:
    """A JSON value whose sentences are left out: only words, numbers and names stay."""
    if isinstance(content, dict):
        return {key: masked(value) for key, value in content.items()}
    if isinstance(content, list):
        return [masked(value) for value in content]
    return "<sentence>" if isinstance(content, str) and SENTENCE.search(content) else content


def differences(a: Any, b: Any, rtol: float, at: str = "") -> Iterator[str]:
    """Where two JSON values differ by more than `rtol` relative, one line each."""
    if isinstance(a, dict) and isinstance(b, dict):
        for key in [*a, *(key for key in b if key not in a)]:
            yield from differences(a.get(key, "<absent>"), b.get(key, "<absent>"), rtol, f"{at}.{key}")
    elif isinstance(a, list) and isinstance(b, list) and len(a) == len(b):
        for i, (left, two) in enumerate(zip(a, b, strict=True)):
            yield from differences(left, two, rtol, f"{at}[{i}]")
    elif isinstance(a, float) and isinstance(b, float):
        tiny = TINY if rtol and ("p_value" in at or "p_raw" in at or ".h[" in at) else 0.0
        same = a == b or abs(a - b) <= max(rtol * max(abs(a), abs(b)), tiny) or (math.isnan(a) and math.isnan(b))
        if not same:
            yield f"{at}: {a!r} -> {b!r}"
    elif a != b:
        yield f"{at}: {a!r} -> {b!r}"


def number(token: str) -> float | str:
    """A hexadecimal constant of C as a number; any other token as it is."""
    try:
        return float.fromhex(token.removesuffix("f")) if "0x" in token else token
    except ValueError:
        return token


def read(path: Path) -> Any:
    """A JSON file with its sentences masked; code as tokens without comments; a refusal by its exit code."""
    text = path.read_text(encoding="utf-8")
    if path.suffix == ".h":
        return [number(token) for token in re.findall(r"[^\s(),;{}]+", COMMENT.sub("", text))]
    try:
        return masked(json.loads(text))
    except json.JSONDecodeError:
        return text.splitlines()[0] if text.startswith("exit") else None


def diff(path: Path, two: Path, rtol: float) -> int:
    """Compare two folders made by `run`, recording by recording; the number of those that differ."""
    names, same = [*REAL, *SIMULATED], 0
    for name in names:
        files = sorted(
            {p.name for folder in (path, two) for p in folder.glob(f"{name}.*") if p.suffix in (".json", ".h")}
        )
        results = []
        for file in files:
            if not ((path / file).is_file() and (two / file).is_file()):
                results.append(f"{file}: only in one of the two")
                continue
            results += [f"{file}{line}" for line in differences(read(path / file), read(two / file), rtol)]
        same += not results
        print(f"{name}: {len(files)} files, {'equal' if not results else f'{len(results)} differences'}")
        for line in results[:8]:
            print(f"    {line}")
    print(f"{same} of {len(names)} recordings equal (numbers to {rtol:g} relative, sentences aside)")
    return len(names) - same


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    run_parser = commands.add_parser("run")
    run_parser.add_argument("folder", type=Path)
    compared = commands.add_parser("diff")
    compared.add_argument("one", type=Path)
    compared.add_argument("two", type=Path)
    compared.add_argument("--rtol", type=float, default=0.0)
    given = parser.parse_args()
    if given.command == "run":
        run(given.folder)
    else:
        raise SystemExit(min(1, diff(given.one, given.two, given.rtol)))


if __name__ == "__main__":
    main()
