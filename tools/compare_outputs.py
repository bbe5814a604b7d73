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
from collections.abc import Iterator, Mapping
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
        for i, (one, two) in enumerate(zip(a, b, strict=True)):
            yield from differences(one, two, rtol, f"{at}[{i}]")
    elif isinstance(a, float) and isinstance(b, float):
        tiny = TINY if rtol and ("p_value" in at or "p_raw" in at or ".h[" in at) else 0.0
        same = a == b or abs(a - b) <= max(rtol * max(abs(a), abs(b)), tiny) or (math.isnan(a) and math.isnan(b))
        if not same:
            yield f"{at}: {a!r} -> {b!r}"
    elif a != b:
        yield f"{at}: {a!r} -> {b!r}"


COMPARED = (
    *("one_step_rms_m one_step_rms", "nis nis", "coast_rms_m coast_rms", "coast_frozen_rms_m coast_frozen_rms"),
    *("coast_floor_m coast_floor", "coast_starts coast_starts", "accel_rms_m_per_s2 accel_rms", "band_hz band"),
    *("simulated_rms_m simulated_rms", "where_it_fails.low worst_regions.low", "where_it_fails.p worst_regions.p"),
)
KEYS: Mapping[str, tuple[str, ...]] = {
    "accelcal/model/2": (
        *(f"parameters.{key} estimates.{key}" for key in ("name", "value", "std", "unit", "run")),
        *(f"shapes.{key} shapes.{key}" for key in ("name", "value", "std")),
        *(f"run_to_run.{key} spreads.{key}" for key in ("name", "value", "low", "high", "p_value", "runs")),
        *(f"noise_effects.{key} noise_effects.{key}" for key in ("name", "value", "std", "p_value")),
        *("covariance.matrix covariance", "method method", "validity validity", "tilt_deg tilt", "rig rig"),
        *("noise.q runs.noise.noise.q", "noise.r runs.noise.noise.r", "noise.crossover_hz runs.noise.crossover"),
        *(f"noise.{part}.density_m_per_s2_rthz runs.noise.{part}.density" for part in ("all", "rest", "motion")),
        *("data.sha256 runs.digest", "data.readings runs.readings", "data.log_likelihood runs.log_likelihood"),
    ),
    "accelcal/diagnosis/1": (
        *(
            "verdict verdict",
            "effects effects",
            "breaks breaks",
            "used used",
            "alpha alpha",
            "remarks.code remarks.code",
        ),
        *(f"candidates.{key} scan.candidates.{key}" for key in ("effect", "estimate", "std", "p_value", "p_raw")),
        *("candidates.class scan.candidates.members", "classes.members classes.members"),
        *(f"channels.{key} channels.{key}" for key in ("effect", "estimate", "std")),
        *("candidates_examined scan.examined", "detection_limits scan.detection_limits"),
        *("where.regions.sigma where.worst_regions.sigma", "parameters.value fit.estimates.value"),
    ),
    "accelcal/improve/2": (
        *("verdict verdict", "effects effects", "classes.members classes.members", "candidates_examined examined"),
        *(f"found.{key} found.{key}" for key in ("estimate", "std", "sigma")),
        *(f"steps.change.{key} changes.{key}" for key in ("before", "after", "stretches")),
        *(
            f"steps.{part}.{old} steps.{part}.{new}"
            for part in ("train", "heldout")
            for old, new in map(str.split, COMPARED)
        ),
        *("parameters.value diagnosis.fit.estimates.value", "parameters.std diagnosis.fit.estimates.std"),
    ),
    "accelcal/power/1": (
        *("candidates_examined examined", "blocks blocks", "alpha alpha", "ties.members ties.members"),
        *("effects.effect detectabilities.effect", "effects.d_per_unit detectabilities.d"),
        *("effects.smallest_detectable detectabilities.smallest", "ties.correlation ties.correlation"),
        "effects.largest_contribution detectabilities.largest",
    ),
}
"""Paths of the schemas before 3, each beside the path of the same values since, by the name of the schema before."""
NOT_FINITE = ("NaN", "Infinity", "-Infinity")


def values_at(content: Any, path: str) -> list[Any]:
    """Values at a path through objects and lists, one after the other; what is not finite is None."""
    key, _, rest = path.partition(".")
    if isinstance(content, list):
        return [value for part in content for value in values_at(part, path)]
    if not path:
        parts = [*content.values()] if isinstance(content, dict) else [None if content in NOT_FINITE else content]
        return [value for part in parts for value in values_at(part, path)] if isinstance(content, dict) else parts
    return values_at(content[key], rest) if isinstance(content, dict) and key in content else []


def by_keys(one: Any, two: Any) -> tuple[Any, Any]:
    """Two contents; where only the first has an earlier schema, the values that both hold, by paths of the second."""
    schemas = [content.get("schema") if isinstance(content, dict) else None for content in (one, two)]
    pairs = [pair.split() for pair in KEYS.get(str(schemas[0]), ())]
    if not pairs or schemas[0] == schemas[1]:
        return one, two
    return {new: values_at(one, old) for old, new in pairs}, {new: values_at(two, new) for _, new in pairs}


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


def diff(one: Path, two: Path, rtol: float) -> int:
    """Compare two folders made by `run`, recording by recording; the number of those that differ."""
    names, same = [*REAL, *SIMULATED], 0
    for name in names:
        files = sorted(
            {p.name for folder in (one, two) for p in folder.glob(f"{name}.*") if p.suffix in (".json", ".h")}
        )
        found = []
        for file in files:
            if not ((one / file).is_file() and (two / file).is_file()):
                found.append(f"{file}: only in one of the two")
                continue
            found += [f"{file}{line}" for line in differences(*by_keys(read(one / file), read(two / file)), rtol)]
        same += not found
        print(f"{name}: {len(files)} files, {'equal' if not found else f'{len(found)} differences'}")
        for line in found[:8]:
            print(f"    {line}")
    print(f"{same} of {len(names)} recordings equal (numbers to {rtol:g} relative, sentences aside)")
    return len(names) - same


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    commands = parser.add_subparsers(dest="command", required=True)
    made = commands.add_parser("run")
    made.add_argument("folder", type=Path)
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
