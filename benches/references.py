"""Hidden effects and nulls through a velocity and an acceleration: what is named, and how right the estimates are.

From the top of the repository: python -m benches.references [--records 60] [--seed 1] [--out build/references]
Each record comes from `tests/worlds`, whose stage is read by a laser vibrometer or by an accelerometer. Outcomes are
kept in OUT, and an interrupted run continues.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

from accelcal import verbs
from accelcal.io import load
from benches.outcomes import run_all
from tests.hidden.trials import VISIBLE, Outcome, Trial, draw, improved
from tests.hidden.verdicts import falsely_named, in_class
from tests.worlds import CATALOGUE
from tests.worlds.world import Reference

REFERENCES: tuple[Reference, ...] = ("velocity", "reference_acceleration")
AT_OUTPUT = [
    name for name in VISIBLE if CATALOGUE[name].place not in ("scale", "encoder") and not name.startswith("encoder")
]
"""Effects of the sensor and of its clock: those of an encoder need one."""
D = 20.0
NULLS, LEAST_IN_CLASS = 0.01, 0.97
"""Share of nulls in which something may be named, and of hidden effects that must be in a reported class."""


@dataclass(frozen=True, slots=True)
class Referred:
    """A trial with another reference."""

    trial: Trial
    reference: Reference

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.reference}/{self.trial.key}"


def run(referred: Referred) -> Outcome:
    """Draw, write, load, improve."""
    trial = referred.trial
    outcome: Outcome = {"key": referred.key, "names": list(trial.names), "reference": referred.reference}
    try:
        world = replace(draw(trial), reference=referred.reference)
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    begin = time.process_time()
    try:
        with tempfile.TemporaryDirectory() as folder:
            recording = load(world.record().write(folder))
        improvement = improved(verbs.improve(recording, holdout=recording), world.settled())
    except Exception:
        return {**outcome, "error": traceback.format_exc()}
    nuisances = {"vibration": world.nuisances.vibration, "converter_bits": world.nuisances.converter_bits}
    return {**outcome, **improvement, "nuisances": nuisances, "seconds": time.process_time() - begin}


def plan(records: int, seed: int) -> list[Referred]:
    """As many nulls as records with one hidden effect, for either reference."""
    return [
        Referred(trial, reference)
        for n in range(records)
        for reference in REFERENCES
        for trial in (Trial(1, n, seed), Trial(2, n, seed, (AT_OUTPUT[n % len(AT_OUTPUT)],), D))
    ]


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    honest = not outcome["names"] and "effects" in outcome
    return ("references", outcome["reference"], falsely_named(outcome)) if honest else None


def report(outcomes: Sequence[Outcome]) -> bool:
    """Print figure, count and threshold of every claim; whether all hold."""
    holds = True
    failed = [outcome for outcome in outcomes if "error" in outcome]
    for reference in REFERENCES:
        scored = [o for o in outcomes if o["reference"] == reference and not {"error", "skipped"} & o.keys()]
        nulls, hidden = ([o for o in scored if bool(o["names"]) is wanted] for wanted in (False, True))
        wrong = [o for o in nulls if falsely_named(o)]
        most = int(binom.ppf(0.975, max(1, len(nulls)), NULLS))
        results = [o for o in hidden if in_class(o, o["names"][0])]
        least = int(binom.ppf(0.025, max(1, len(hidden)), LEAST_IN_CLASS))
        print(f"{reference}: {len(wrong)} of {len(nulls)} nulls named something (at most {most})")
        print(
            f"{reference}: {len(results)} of {len(hidden)} effects at d = {D:g} in a reported class (at least {least})"
        )
        for o in wrong:
            print(f"  {o['key']}: {o['effects']}")
        for o in hidden:
            if o not in results:
                print(f"  {o['key']}: {o['effects']}, {o['verdict']}")
        values = [o["estimates"]["scale_factor"] for o in nulls if "scale_factor" in o["estimates"]]
        z = np.array([(value - truth) / std for value, std, truth in values])
        print(f"{reference}: rms z of the scale factor {np.sqrt(np.mean(z**2)) if len(z) else np.nan:.3f} of {len(z)}")
        holds &= len(wrong) <= most and len(results) >= least
    for o in failed:
        print(f"{o['key']}: {o['error'].splitlines()[-1]}")
    return holds and not failed


def main() -> int:
    """Run what is missing, and report."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--records", type=int, default=60, help="nulls, and hidden effects, for either reference")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--workers", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/references"))
    wanted = parser.parse_args()
    trials = plan(wanted.records, wanted.seed)
    outcomes = run_all(run, trials, wanted.out / f"seed{wanted.seed}.jsonl", wanted.workers, null)
    return 0 if report(outcomes) else 1


if __name__ == "__main__":
    raise SystemExit(main())
