"""One claim with its result in our runs, and the statistics that decide it."""

from __future__ import annotations

from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass
from typing import Literal, TypeVar
from zlib import crc32

import numpy as np
from scipy import special

from accelcal.data.arrays import Array

Result = TypeVar("Result")

ALPHA = 1e-3
"""False-alarm rate of every statistical row, two-sided."""
SIGMAS = 3.2905
"""Normal deviate of that rate."""


@dataclass(frozen=True, slots=True)
class Row:
    """A claim with its expected and measured values."""

    by: Literal["paper", "us"]
    """Source of the claim. A claim of the paper may fail in our runs, which is then the result; one of ours may not."""
    claim: str
    expected: str
    measured: str
    """With its unit."""
    value: float
    """The number behind `measured`."""
    n: int
    """Runs, or samples, that it rests on."""
    threshold: str
    """Criterion of the claim."""
    holds: bool
    remark: str = ""


@dataclass(frozen=True, slots=True)
class Item:
    """One table, figure or statement of the paper."""

    name: str
    """One word, for the command line and JSON."""
    title: str
    source: str
    """Where the paper says it."""
    rows: tuple[Row, ...]


@dataclass(frozen=True, slots=True)
class Plan:
    """How much to run: `quick` is a slice of the same experiments with fewer or shorter runs."""

    quick: bool
    seed: int
    workers: int = 2
    """Threads; the filters run outside Python's lock."""

    def runs(self, quick: int, full: int) -> int:
        """Number of runs (or seconds, or whatever is scaled)."""
        return quick if self.quick else full

    def repeat(self, name: str, count: int, once: Callable[[np.random.Generator], Result]) -> list[Result]:
        """`once` for `count` independent generators that depend on the seed and `name` alone, not on the threads."""
        generators = np.random.default_rng([self.seed, crc32(name.encode())]).spawn(count)
        with ThreadPoolExecutor(self.workers) as pool:
            return list(pool.map(once, generators))


@dataclass(frozen=True, slots=True)
class Paired:
    """Two error figures from the same records."""

    ratio: float
    """rms of the first over rms of the second."""
    deviate: float
    """Mean of log(first/second) over its standard error."""

    @property
    def verdict(self) -> str:
        """Which of the two is smaller; below 2 % the difference is irrelevant, significant or not."""
        if abs(self.deviate) < SIGMAS or abs(np.log(self.ratio)) < 0.02:
            return "no difference"
        return "smaller" if self.ratio < 1.0 else "larger"


def paired(first: Array, second: Array) -> Paired:
    """Compares errors (n,) and (n,) of two filters on the same n records."""
    log_ratio = np.log(first / second)
    spread = float(np.std(log_ratio, ddof=1)) / np.sqrt(len(first))
    ratio = float(np.sqrt(np.mean(first**2) / np.mean(second**2)))
    return Paired(ratio, float(np.mean(log_ratio) / max(spread, 1e-300)))


def sign_test(wins: int, losses: int) -> float:
    """Probability of at least `wins` of wins + losses fair coins."""
    return float(special.bdtrc(wins - 1, wins + losses, 0.5)) if wins else 1.0
