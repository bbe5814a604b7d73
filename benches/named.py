"""What `improve` names, with effects of all kinds hidden at d = 20, and with none.

From the top of the repository: python -m benches.named [--records 40] [--nulls 20] [--seed 39601] [--d 20]
Each record comes from `tests/worlds`; another motion of the same rig is held out. Right is: the hidden effect is in one
of the classes, no other effect is named beside it, and every effect that is named is in the last model (a jump of the
encoder is accounted for: every fit begins anew behind it). Honest records stay without names.
"""

from __future__ import annotations

import argparse
import os
import tempfile
import time
import traceback
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from scipy.stats import binom

from accelcal import verbs
from accelcal.diagnosis.noise.noise_test import POSITION_JUMPS
from accelcal.io import load
from benches.outcomes import Outcome, run_all
from tests.hidden.trials import VISIBLE, Trial, draw, improved
from tests.hidden.verdicts import falsely_named, in_class, members, named
from tests.regimes.judge import FALSE_RATE, SURE
from tests.worlds import MOTIONS

MOST_MISSED, MOST_EXTRA = 0.03, 0.025
"""Shares of the records in whose classes the hidden effect is not, and that have a further name."""
LOST = "no_single_size", "contradicted"
"""Remarks on an effect that has no one size, and on one that another recording contradicts."""


def run(trial: Trial) -> Outcome:
    """Draw, write, load, improve; whatever happens is an outcome."""
    outcome: Outcome = {"key": trial.key, "names": list(trial.names), "d": trial.d}
    try:
        world = draw(trial)
    except ValueError as refused:
        return {**outcome, "skipped": str(refused)}
    try:
        settled = world.settled()
        other = next(m for m in (*MOTIONS, *MOTIONS) if m != world.motion and m not in ("tones", "long_rest"))
        begin = time.process_time()
        with tempfile.TemporaryDirectory() as folder:
            recording = load(world.record().write(folder))
            unseen = load(settled.again(other, world.seed + 1).record().write(Path(folder), "unseen"))
            improvement = verbs.improve(recording, holdout=unseen)
        outcome |= {"motion": world.motion, "sensor": world.sensor, "nuisances": asdict(world.nuisances)}
        outcome |= improved(improvement, settled) | {"seconds": time.process_time() - begin}
        in_model = {"time_offset", POSITION_JUMPS, *improvement.best.model.effects}
        outcome["outside_model"] = [name for name in improvement.effects if name not in in_model]
        outcome["steps"] = [list(step.effects) for step in improvement.steps]
        outcome["remarks"] = [[note.code, note.sentence] for note in improvement.diagnosis.remarks]
        outcome["refused"] = [
            note.values.get("effect", "") for note in improvement.diagnosis.remarks if note.code in LOST
        ]
        return outcome
    except Exception:
        return {**outcome, "error": traceback.format_exc(limit=-3)}


def extra(outcome: Outcome) -> list[str]:
    """Names beside the hidden effects and their classes."""
    hidden = set(outcome["names"])
    classes = [tie for tie in members(outcome) if not tie & hidden]
    return [name for name in named(outcome) if name not in hidden and any(name in tie for tie in classes)]


def null(outcome: Outcome) -> tuple[str, str, Sequence[str]] | None:
    """Bench, regime and false names for the ledger, where nothing was hidden."""
    honest = not outcome["names"] and "effects" in outcome
    return ("named", "worlds", falsely_named(outcome)) if honest else None


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print each record that is wrong, then figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=40, help="records with an effect, evenly over the catalogue")
    parser.add_argument("--nulls", type=int, default=20, help="records with nothing hidden")
    parser.add_argument("--d", type=float, default=20.0)
    parser.add_argument("--effects", default="", help="only these, separated by commas")
    parser.add_argument("--seed", type=int, default=39601)
    parser.add_argument("--out", type=Path, default=Path("build/named.jsonl"))
    parser.add_argument("--workers", type=int, default=1)
    chosen = parser.parse_args(arguments)
    effects = [name for name in chosen.effects.split(",") if name] or VISIBLE
    order = np.random.default_rng(chosen.seed).permutation(len(effects))
    hidden = [(effects[order[n % len(effects)]],) for n in range(chosen.records)]
    trials = [Trial(2, n, chosen.seed, names, chosen.d) for n, names in enumerate(hidden)]
    trials += [Trial(1, n, chosen.seed) for n in range(chosen.nulls)]
    outcomes = run_all(run, trials, chosen.out, chosen.workers, null)
    errors = [outcome for outcome in outcomes if "error" in outcome]
    ran = [outcome for outcome in outcomes if "effects" in outcome]
    full, honest = [o for o in ran if o["names"]], [o for o in ran if not o["names"]]
    wrong = {
        "missed": [o for o in full if not in_class(o, o["names"][0])],
        "further name": [o for o in full if extra(o)],
        "outside the model": [o for o in ran if o["outside_model"]],
        "refused": [o for o in full if set(o["refused"]) & set(o["names"])],
        "honest record named": [o for o in honest if falsely_named(o)],
    }
    for what, several in wrong.items():
        for o in several:
            print(f"{what}: {o['key']} ({o['motion']}, {o['sensor']}): {o['classes']}: {o['sentence']}")
    for outcome in errors:
        print(f"{outcome['key']}: {outcome['error']}")
    most = {
        "missed": int(MOST_MISSED * len(full)),
        "further name": int(MOST_EXTRA * len(full)),
        "outside the model": 0,
        "refused": int(MOST_EXTRA * len(full)),
        "honest record named": int(binom.ppf(SURE, len(honest), FALSE_RATE)),
    }
    for what, several in wrong.items():
        print(f"{what}: {len(several)} of {len(honest if 'honest' in what else full)}, at most {most[what]}")
    print(f"{len(outcomes) - len(ran) - len(errors)} out of reach, {len(errors)} ended in an error, none expected")
    return int(bool(errors) or any(len(several) > most[what] for what, several in wrong.items()))


if __name__ == "__main__":
    raise SystemExit(main())
