"""Slow noise, processed references and worlds outside the catalogue: what names come out.

Run from the top of the repository: python -m benches.coloured [--part noise] [--records 6] [--seed 1] [--out build/c]
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import traceback
from collections.abc import Iterator, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np

from accelcal import verbs
from accelcal.effects import find
from accelcal.io import load
from benches.outcomes import run_all
from tests.hidden.trials import MIXES
from tests.hidden.verdicts import at_most, share
from tests.regimes.hidden import OutOfReach, plant
from tests.regimes.regimes import TABLE
from tests.worlds import BEYOND, Hidden, Nuisances, World, at_d
from tests.worlds.coloured import COLOURED, HONEST, coloured

PARTS = ("noise", "beyond", "tone")
STRENGTH = 30.0
HARMONIC = ("cubic", "quadratic")
"""Effects that make harmonics of a single tone."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record; the same trial always gives the same record."""

    part: str
    kind: str
    number: int
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.part}/{self.kind}/{self.number}"


def plan(part: str, records: int, seed: int) -> Iterator[Trial]:
    """Trials of a part, evenly over its kinds."""
    kinds = {"noise": tuple(COLOURED), "beyond": tuple(BEYOND), "tone": HARMONIC}[part]
    for number in range(records):
        for kind in kinds:
            yield Trial(part, kind, number, seed)


def world_of(trial: Trial) -> World:
    """The world of a trial.

    Raises
    ------
    ValueError
        If the effect leaves no trace on any motion that was tried.
    """
    seed = 100_000 * trial.seed + trial.number
    rng = np.random.default_rng([trial.seed, trial.number, len(trial.kind)])
    nuisances = Nuisances(missing=float(rng.choice([0.0, 0.1])))
    reason = ""
    for attempt in range(4):
        motion, sensor = MIXES[(trial.number + len(trial.kind) + 3 * attempt) % len(MIXES)]
        world = World(motion, sensor, seed=seed, nuisances=nuisances)
        if trial.part == "noise":
            return world
        hidden = (Hidden(trial.kind, BEYOND[trial.kind].typical),)
        try:
            return at_d(World(motion, sensor, hidden, seed=seed, nuisances=nuisances), STRENGTH)
        except ValueError as refused:
            reason = str(refused)
    raise ValueError(reason)


def run(trial: Trial) -> dict[str, Any]:
    """Draw, write, load, improve: what came out; an exception is an outcome."""
    outcome: dict[str, Any] = {"key": trial.key, **asdict(trial)}
    try:
        with tempfile.TemporaryDirectory() as folder:
            path = write(trial, folder)
            begin = time.process_time()
            improvement = verbs.improve(load(path))
    except (ValueError, OutOfReach) as refused:
        return {**outcome, "skipped": str(refused)}
    except Exception:
        return {**outcome, "error": traceback.format_exc(limit=-4)}
    return {
        **outcome,
        "effects": list(improvement.effects),
        "classes": [[tie.effect, *(m for m in tie.members if m != tie.effect)] for tie in improvement.classes],
        "verdict": improvement.diagnosis.verdict,
        "sentence": improvement.diagnosis.sentence,
        "remarks": [remark.code for remark in improvement.diagnosis.remarks],
        "seconds": time.process_time() - begin,
    }


def write(trial: Trial, folder: str) -> Path:
    """Write the record of a trial; return its path."""
    if trial.part == "tone":
        regime, seed = TABLE["f-shaker-tone"], 1000 * trial.seed + trial.number
        return Path(regime.build(seed, plant(regime, trial.kind, seed)).write(folder))
    record = world_of(trial).record()
    return (coloured(record, trial.kind) if trial.part == "noise" else record).write(folder)


def honest(outcome: dict[str, Any]) -> set[str]:
    """Names that the record earns."""
    part, kind = outcome["part"], outcome["kind"]
    if part == "noise":
        return set(HONEST.get(kind, ()))
    return set(HARMONIC) | {"odd_quadratic", "scale_asymmetry", "shape_of_acceleration"} if part == "tone" else set()


def variables(name: str) -> set[str]:
    """Variables of an effect or a curve of the product."""
    symbols = {"t": "time", "p": "position", "v": "velocity", "a": "acceleration", "jerk": "jerk"}
    if name.startswith("shape_of_"):
        return set(name.removeprefix("shape_of_").split("_and_"))
    if name.startswith("shape_since_reversal"):
        return {"since_reversal"}
    if find(name).port == "process":  # a random telegraph has the spectrum of a Gauss-Markov bias (Machlup 1954)
        return {"time"}
    function_of = find(name).function_of
    return {symbols.get(function_of, name)} if function_of else {name}


def right(outcome: dict[str, Any]) -> bool:
    """Whether the first name, or a member of its class, is a function of a right variable; or nothing is named."""
    if not outcome["classes"]:
        return bool(outcome["verdict"] == "unexplained")
    truth = set(BEYOND[outcome["kind"]].explains)
    return any(variables(name) & truth for name in outcome["classes"][0])


def alone(outcome: dict[str, Any]) -> list[str]:
    """Names with a class of their own that the record does not earn."""
    truth = set(BEYOND[outcome["kind"]].explains) if outcome["part"] == "beyond" else set()
    return [
        tie[0]
        for tie in outcome["classes"]
        if len(tie) == 1
        and not tie[0].startswith("shape_")
        and not variables(tie[0]) & truth
        and tie[0] not in honest(outcome)
    ]


def false_names(outcome: dict[str, Any]) -> list[str]:
    """Names whose class holds nothing that the record earns."""
    return [tie[0] for tie in outcome["classes"] if not set(tie) & honest(outcome)]


def null(outcome: dict[str, Any]) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where noise alone is in the record."""
    honest = outcome["part"] == "noise" and "effects" in outcome
    return ("coloured", outcome["kind"], false_names(outcome)) if honest else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing, then print figure, count and threshold of every claim."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--part", action="append", choices=PARTS)
    parser.add_argument("--kind", action="append", default=[])
    parser.add_argument("--records", type=int, default=6, help="records of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--processes", type=int, default=2)
    parser.add_argument("--out", type=Path, default=Path("build/coloured"))
    chosen = parser.parse_args(arguments)
    holds = True
    for part in chosen.part or PARTS:
        trials = [t for t in plan(part, chosen.records, chosen.seed) if not chosen.kind or t.kind in chosen.kind]
        outcomes = run_all(run, trials, chosen.out / f"{part}.jsonl", chosen.processes, null)
        for line in rows(outcomes):
            print(line)
        ran = [o for o in outcomes if "effects" in o]
        if part == "beyond":
            claims = [
                share(0, "beyond: right variable or unexplained", [right(o) for o in ran], 0.97),
                at_most(0, "beyond: a wrong name alone", [bool(alone(o)) for o in ran], 0.01),
            ]
        else:
            claims = [at_most(4, f"{part}: false names", [bool(false_names(o)) for o in ran], 0.01)]
        for claim in claims:
            print(claim.text, flush=True)
        holds = holds and all(claim.holds for claim in claims)
    return 0 if holds else 1


def rows(outcomes: Sequence[dict[str, Any]]) -> Iterator[str]:
    """What came out, record by record."""
    for o in sorted(outcomes, key=lambda o: (o["kind"], o["number"])):
        message = o.get("skipped") or o.get("error") or f"{o['verdict']}; {o['classes']}; {o['seconds']:.1f} s"
        yield f"{o['kind']} {o['number']}: {message}"


if __name__ == "__main__":
    raise SystemExit(main())
