"""Comparison with peers: which filters run, whether all reach one state, and the time each takes."""

from __future__ import annotations

import importlib
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import cache, partial

import numpy as np

from benches.peers import native, ours, plain
from benches.peers.workload import Array, Data, Ended, Missing, Workload, draw

Prepare = Callable[[Workload, Data], Callable[[], Ended]]

TOLERANCE = 1e-6
"""Of states in sigma and of variances relative: far above rounding over 20 000 steps, far below another filter."""
FUSED = "accelcal, fused Rust"
DENSE = "accelcal, dense nalgebra twin"
STEPS = 20_000
"""Of peers that are fast."""
PYTHON = (
    "generated",
    "numba_block",
    "numba_dense",
    "jax_scan",
    "plain",
    "filterpy_loop",
    "stonesoup_loop",
    "pykalman_loop",
)
"""Modules with a NAME, the STEPS of each workload that they can run, and `prepare`."""


@dataclass(frozen=True, slots=True)
class Peer:
    """A way to run workloads."""

    name: str
    steps: dict[str, int]
    """By workload that it can run, length of the record that it is given."""
    prepare: Prepare
    public: bool = False
    """Takes the workload as the product's Python interface has it."""


@dataclass(slots=True)
class Result:
    """One peer on one workload."""

    peer: str
    workload: str
    deviation: float
    """Largest difference from the reference: states in sigma, variances relative."""
    nanoseconds: float = math.inf
    """Least processor time per step (and run)."""

    @property
    def agrees(self) -> bool:
        """Whether its time counts."""
        return self.deviation < TOLERANCE


@dataclass(slots=True)
class Found:
    """All results, and the peers that could not run, with the reason."""

    results: list[Result] = field(default_factory=list)
    missing: dict[str, str] = field(default_factory=dict)

    def of(self, peer: str, workload: str) -> Result | None:
        """One of them."""
        return next((r for r in self.results if (r.peer, r.workload) == (peer, workload)), None)


def peers() -> tuple[list[Peer], dict[str, str]]:
    """Peers that are installed, and for each of the others why it is not."""
    four = dict.fromkeys(("W1", "W2", "W3", "W4"), STEPS)
    results = [
        Peer(FUSED, four, native.rust("fused")),
        Peer("accelcal, lanes from Rust", {"W5": 2000}, native.rust("batch")),
        Peer("accelcal, Python run_batch", {**four, "W5": 2000}, ours.record, public=True),
        Peer("accelcal, Python LiveFilter.step", four, ours.stream, public=True),
        Peer(DENSE, four, native.rust("dense")),
    ]
    missing = {}
    for name, version, steps, prepare in (
        ("Eigen {}, dense", native.eigen_version, four, native.eigen),
        ("adskalman Joseph form {}", partial(native.rust_version, "adskalman"), {"W3": STEPS}, native.rust("joseph")),
        ("adskalman short form {}", partial(native.rust_version, "adskalman"), {"W3": STEPS}, native.rust("optimal")),
    ):
        try:
            results.append(Peer(name.format(version()), steps, prepare))
        except Missing as why:
            missing[name.partition(" ")[0]] = str(why)
    for module in PYTHON:
        try:
            loaded = importlib.import_module(f"benches.peers.{module}")
            results.append(Peer(loaded.NAME, loaded.STEPS, loaded.prepare))
        except ImportError as why:
            missing[module.partition("_")[0]] = f'{why}; pip install "accelcal[peers]"'
    return results, missing


def compare_peers(workloads: Sequence[Workload], rounds: int) -> Found:
    """Run every peer on every workload, rounds of all peers in turn."""
    installed, missing = peers()
    results = Found(missing=missing)
    for workload in workloads:
        longest = draw(workload, max(peer.steps.get(workload.name, 0) for peer in installed))

        @cache
        def reference(given: Workload, steps: int, longest: Data = longest) -> tuple[Array, Array]:
            return plain.follow(given, longest.cut(steps))

        running: list[tuple[Result, Callable[[], Ended], int]] = []
        for peer in installed:
            steps = peer.steps.get(workload.name)
            if steps is None:
                continue
            given = workload.as_published if peer.public else workload
            try:
                once = peer.prepare(given, longest.cut(steps))
                result = Result(peer.name, workload.name, deviation(once(), *reference(given, steps)))
            except Missing as why:
                missing[peer.name] = str(why)
                continue
            print(f"{workload.name} {peer.name}: {result.deviation:.1e} from the reference", flush=True)
            results.results.append(result)
            running.append((result, once, steps * workload.runs))
        for _ in range(rounds):
            for result, once, steps in running:
                result.nanoseconds = min(result.nanoseconds, once().seconds / steps * 1e9)
    return results


def deviation(ended: Ended, x: Array, variances: Array) -> float:
    """Largest difference of states in sigma and of variances relative."""
    off = np.max(np.abs(ended.x - x) / np.sqrt(variances)), np.max(np.abs(ended.variances / variances - 1.0))
    return float(max(off))
