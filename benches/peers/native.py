"""Compiled programs: our fused kernels, their dense nalgebra twin, adskalman; Eigen and generated code in C++.

The Rust crate `benches/peers/rust` and `benches/peers/eigen/main.cpp` are built into target/peers for x86-64-v3, which
suits the dense peers better than AVX-512 does; our kernels have the instructions that the product chooses.
"""

from __future__ import annotations

import json
import os
import re
import shutil
import subprocess
import tempfile
import tomllib
from collections.abc import Callable
from functools import cache
from pathlib import Path

import numpy as np

from benches.peers.workload import Data, Ended, Missing, Workload

HERE = Path(__file__).parent
TARGET = Path("target/peers")
EIGEN = Path(os.environ.get("EIGEN3_INCLUDE", "/usr/include/eigen3"))
ROUNDS = 3
"""Runs of each call, the least of which counts."""


def rust(kernel: str) -> Callable[[Workload, Data], Callable[[], Ended]]:
    """A kernel of the Rust program."""

    def prepare(workload: Workload, data: Data) -> Callable[[], Ended]:
        return run([_rust_program(), kernel, str(workload.number)], data)

    return prepare


def eigen(workload: Workload, data: Data) -> Callable[[], Ended]:
    """The C++ program."""
    return run([_eigen_program(), str(workload.number)], data)


def rust_version(crate: str) -> str:
    """Version of a crate that the Rust program is built with."""
    packages = tomllib.loads((HERE / "rust/Cargo.lock").read_text(encoding="utf-8"))["package"]
    return str(next(package["version"] for package in packages if package["name"] == crate))


def eigen_version() -> str:
    """Version that Eigen's headers state."""
    header = EIGEN / "Eigen/src/Core/util/Macros.h"
    if not header.exists():
        raise Missing(f"no Eigen at {EIGEN}; install libeigen3-dev, or set EIGEN3_INCLUDE")
    numbers = dict(re.findall(r"#define EIGEN_(\w+)_VERSION (\d+)", header.read_text(encoding="utf-8")))
    return ".".join(numbers[part] for part in ("WORLD", "MAJOR", "MINOR"))


@cache
def _rust_program() -> str:
    if shutil.which("cargo") is None:
        raise Missing("no cargo")
    command = ["cargo", "build", "--release", "--quiet", "--locked", "--target-dir", str(TARGET)]
    wide = {"WORKLOADS_FOR_AVX512VL": "1"} if has_avx512vl() else {}
    _build([*command, "--manifest-path", str(HERE / "rust/Cargo.toml")], RUSTFLAGS="-C target-cpu=x86-64-v3", **wide)
    return str(TARGET / "release/peers")


@cache
def _eigen_program() -> str:
    eigen_version()
    return cpp("eigen", HERE / "eigen/main.cpp", "x86-64-v3", "-isystem", str(EIGEN))


def has_avx512vl() -> bool:
    """Whether the processor has AVX-512 on short vectors, with 32 registers."""
    return re.search(r"\bavx512vl\b", Path("/proc/cpuinfo").read_text(encoding="utf-8")) is not None


def cpp(name: str, source: Path, march: str, *flags: str) -> str:
    """A C++ program in target/peers, built for the processors `march`."""
    compiler = shutil.which(os.environ.get("CXX", "c++"))
    if compiler is None:
        raise Missing("no C++ compiler")
    TARGET.mkdir(parents=True, exist_ok=True)
    built = str(TARGET / name)
    _build([compiler, "-std=c++17", "-O3", f"-march={march}", "-DNDEBUG", *flags, str(source), "-o", built])
    return built


def _build(command: list[str], **environment: str) -> None:
    done = subprocess.run(command, capture_output=True, text=True, env=os.environ | environment)
    if done.returncode != 0:
        raise Missing(f"{command[0]} failed: {json.dumps(done.stderr.strip()[-300:])}")


def run(command: list[str], data: Data) -> Callable[[], Ended]:
    """Calls of a program on a record in a file."""
    folder = tempfile.TemporaryDirectory()
    file = Path(folder.name) / "record.f64"
    file.write_bytes(np.concatenate([data.u.ravel(), data.z.ravel()]).tobytes())
    runs = 1 if data.u.ndim == 1 else len(data.u)

    def once() -> Ended:
        assert folder.name  # lives as long as the calls do
        done = subprocess.run([*command, str(file), str(ROUNDS)], capture_output=True, text=True, check=True)
        seconds, x, variances = (np.array(line.split(), dtype=float) for line in done.stdout.splitlines())
        shape = (runs, -1) if runs > 1 else (-1,)
        return Ended(float(seconds[0]), x.reshape(shape), variances.reshape(shape))

    return once
