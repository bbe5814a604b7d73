"""Consistency of the fit: NEES, interval coverage, and rms error over the Cramer-Rao bound.

Run from the top of the repository: python -m benches.consistency [--runs 100] [--only NAME]
Prints figure, count and threshold of every claim; exit code 1 when one is missed.
"""

from __future__ import annotations

import argparse
import multiprocessing
import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from accelcal.validation.consistency import consistency, coverage
from tests.consistency.campaign import BOUNDED, SETTINGS, Outcome, Setting, aci_or_none, bounds, collect, one_fit
from tests.consistency.toleranced import NAMES, normalised

BLOCK = 80
"""Runs whose bounds are computed together."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run everything and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--runs", type=int, default=100, help="runs of 60 s for each setting of the NEES")
    parser.add_argument("--aci", type=int, default=40, help="of these, runs that the paper's filter is given as well")
    parser.add_argument("--bounded", type=int, default=800, help="fits for each setting of the Cramer-Rao bound")
    parser.add_argument("--toleranced", type=int, default=400, help="fits for each low-pass that is off")
    parser.add_argument("--only", default="", help="settings whose name contains this")
    chosen = parser.parse_args(arguments)
    began, remaining, good = time.perf_counter(), [], True
    with multiprocessing.Pool(2) as pool:
        print(f"NEES of (bias, scale_factor), {chosen.runs} runs of 60 s, 99.9 % region")
        for setting in (s for s in SETTINGS if chosen.only in s.name):
            collection = collect(setting.names, pool.map(partial(one_fit, setting), range(chosen.runs), chunksize=5))
            aci = pool.map(partial(aci_or_none, setting), range(min(chosen.aci, chosen.runs)), chunksize=5)
            good &= print_nees(setting, collection, [fit for fit in aci if fit is not None])
            remaining.append(collection)
        print(f"rms of error over the Cramer-Rao bound, {chosen.bounded} fits of 30 s, 0.90 to 1.10")
        for setting in (s for s in BOUNDED if chosen.only in s.name):
            collection = collect(setting.names, pool.map(partial(one_fit, setting), range(chosen.bounded), chunksize=5))
            starts = range(0, chosen.bounded, BLOCK)
            blocks = [range(start, min(start + BLOCK, chosen.bounded)) for start in starts]
            bound = np.concatenate(pool.map(partial(bounds, setting), blocks, chunksize=1))
            good &= print_bound(setting, collection, bound)
            remaining.append(collection)
        print(f"low-pass off within its tolerance: rms of normalised error, {chosen.toleranced} fits, 0.90 to 1.10")
        for motion, tolerance in (("interleaved", 0.05), ("fast", 0.05), ("fast", 0.02)):
            if chosen.only in motion:
                task = partial(normalised, motion=motion, tolerance=tolerance)
                good &= print_toleranced(motion, tolerance, np.array(pool.map(task, range(chosen.toleranced), 5)))
    print("95 % intervals cover 93 % to 97 %")
    good &= print_coverage(remaining)
    print(f"{'all limits are met' if good else 'A LIMIT IS MISSED'}; {time.perf_counter() - began:.0f} s")
    return 0 if good else 1


def print_nees(setting: Setting, outcome: Outcome, aci: Sequence[tuple[np.ndarray, np.ndarray]]) -> bool:
    """One line of NEES: the default fit, and the paper's ACI filter beside it."""
    verdict = consistency(outcome.nees("bias", "scale_factor"), 2, 0.999)
    paper = collect(("bias", "scale_factor"), aci).nees("bias", "scale_factor").mean()
    print(
        f"  {setting.name:34s} NEES {verdict.mean:5.2f} in [{verdict.low:.2f}, {verdict.high:.2f}], "
        f"{verdict.runs} runs: {verdict.verdict}; ACI filter {paper:5.2f} ({len(aci)} runs)",
        flush=True,
    )
    return verdict.verdict == "consistent"


def print_bound(setting: Setting, outcome: Outcome, bound: np.ndarray) -> bool:
    """Rms error over the Cramer-Rao bound, one line for each parameter."""
    rms = np.sqrt(np.mean((outcome.error / bound) ** 2, axis=0))
    reported = np.mean(outcome.sigma / bound, axis=0)
    for name, ratio, stated in zip(setting.names, rms, reported, strict=True):
        print(
            f"  {setting.name:26s} {name:14s} rms(error/bound) {ratio:.3f}, reported sigma/bound {stated:.3f}, "
            f"{len(bound)} fits: {'ok' if 0.9 <= ratio <= 1.1 else 'MISSED'}",
            flush=True,
        )
    return bool(np.all((rms >= 0.9) & (rms <= 1.1)))


def print_toleranced(motion: str, tolerance: float, result: np.ndarray) -> bool:
    """One line for each parameter of fits whose low-pass is off by a draw from its tolerance."""
    rms = np.sqrt(np.mean(result**2, axis=0))
    for name, ratio in zip(NAMES, rms, strict=True):
        verdict = "ok" if 0.9 <= ratio <= 1.1 else "MISSED"
        print(
            f"  {motion:12s} {100 * tolerance:.0f} % {name:14s} {ratio:.3f}, {len(result)} fits: {verdict}", flush=True
        )
    return bool(np.all((rms >= 0.9) & (rms <= 1.1)))


def print_coverage(remaining: Sequence[Outcome]) -> bool:
    """One line for each parameter, over all settings."""
    good = True
    for name in dict.fromkeys(name for results in remaining for name in results.names):
        having = [results for results in remaining if name in results.names]
        error = np.concatenate([results.error[:, results.names.index(name)] for results in having])
        sigma = np.concatenate([results.sigma[:, results.names.index(name)] for results in having])
        result = coverage(error, sigma)
        held = 0.93 <= result.rate <= 0.97
        good &= held
        print(f"  {name:14s} {100 * result.rate:.1f} % of {result.count}: {'ok' if held else 'MISSED'}")
    return good


if __name__ == "__main__":
    raise SystemExit(main())
