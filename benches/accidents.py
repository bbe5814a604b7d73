"""Accidents of a laboratory: `python -m benches.accidents [--records 20] [--kind touched] [--out FILE.jsonl]`.

Each kind of `tests/field/accidents.py` is planted into honest records, written as a file and read again. Right is: the
accident is told, nothing is named that is not there, bias and scale factor are within 4 standard deviations. Records
without an accident, and shocks beside a reference accelerometer, accompany them. An interrupted run goes on where it
stopped.
"""

from __future__ import annotations

import argparse
import re
import sys
import tempfile
from collections import defaultdict
from pathlib import Path

import accelcal as ac
from accelcal.verbs import improve
from benches.outcomes import Outcome, Trial, run_all
from tests.field.accidents import ACCIDENTS, honest, shocks

SIGMA = 4.0
MOST_OFF = 2
"""Parameters beyond it, of all."""
LEAST_MENTIONED = 0.98


def outcome(trial: Trial) -> Outcome:
    """What is said of a record, errors in standard deviations, false names."""
    seed = 1000 * trial.seed + trial.number
    record = shocks(seed) if trial.kind == "shocks" else honest(seed)
    if trial.kind in ACCIDENTS:
        ACCIDENTS[trial.kind].plant(record)
    result: Outcome = {"key": trial.key, "kind": trial.kind, "errors": {}, "effects": [], "verdict": "refused"}
    with tempfile.TemporaryDirectory() as folder:
        path = record.write(Path(folder) / "run.csv")
        try:
            recording = ac.load(path)
            improvement = improve(recording)
        except ac.AccelcalError as error:
            messages = [str(error)]
        else:
            fit, last = improvement.best, improvement.diagnosis
            messages = [
                *(note.text for note in recording.findings),
                *(remark.sentence for remark in last.remarks),
                last.sentence,
            ]
            truth = {"bias": record.bias, "scale_factor": record.scale_factor}
            if record.quadratic and "quadratic" not in improvement.effects:
                truth.pop("scale_factor")  # over few shocks of one shape it takes up what is not named
            errors = {name: (fit[name].value - value) / fit[name].std for name, value in truth.items()}
            if any("implausible" in text for text in messages):
                errors = {}  # they are not the sensor's, and that is said
            result |= {"errors": errors, "effects": list(improvement.effects), "verdict": last.verdict}
            if trial.kind == "shocks":
                result["classes"] = {group.effect: list(group.members) for group in improvement.classes}
    result["said"] = [text.replace(folder, "") for text in messages]
    return result


def accused(case: Outcome) -> list[str]:
    """Names that are not in the record; a time offset is a matter of clocks. Shocks to one side do not tell a K2 from
    what else bends a scale factor: there its class counts."""
    names = {"none": (), "shocks": ("quadratic", "odd_quadratic", "scale_asymmetry", "cubic")}
    right = ("time_offset", *(names[case["kind"]] if case["kind"] in names else ACCIDENTS[case["kind"]].names))
    classes = case.get("classes", {})
    return [name for name in case["effects"] if not {name, *classes.get(name, ())}.intersection(right)]


def mentioned(case: Outcome) -> bool:
    """Whether the accident is told; of a record without any, whether none is."""
    if case["kind"] not in ACCIDENTS:
        return not any("left out" in text or "suspect" in text for text in case["said"])
    return any(re.search(ACCIDENTS[case["kind"]].message, text) for text in case["said"])


def main() -> int:
    """Print a line per record, then counts by kind; 1 where a bar is missed."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=20)
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--kind", choices=("none", "shocks", *ACCIDENTS), action="append")
    parser.add_argument("--out", type=Path, default=Path("build/accidents.jsonl"))
    parser.add_argument("--workers", type=int, default=1)
    options = parser.parse_args()
    kinds = options.kind or ("none", "shocks", *ACCIDENTS)
    trials = [Trial(kind, number, options.seed) for number in range(options.records) for kind in kinds]
    outcomes = run_all(outcome, trials, options.out, options.workers)
    groups: dict[str, list[Outcome]] = defaultdict(list)
    for case in sorted(outcomes, key=lambda case: str(case["key"])):
        groups[case["kind"]].append(case)
        errors = ", ".join(f"{name} {error:+.1f}" for name, error in case["errors"].items())
        print(f"{case['key']}: {case['verdict']} {'+'.join(case['effects'])} [{errors}] mentioned {mentioned(case)}")
        if not mentioned(case) or accused(case) or any(abs(e) > SIGMA for e in case["errors"].values()):
            print(*(f"    {text}" for text in case["said"]), sep="\n")
    off = false = silent = total = 0
    for kind, members in groups.items():
        beyond = sum(abs(e) > SIGMA for case in members for e in case["errors"].values())
        names, mute = sum(bool(accused(case)) for case in members), sum(not mentioned(case) for case in members)
        print(
            f"{kind:16s} records {len(members):3d}  beyond {SIGMA:g} sigma {beyond:3d}  "
            f"falsely named {names:3d}  silent {mute:3d}"
        )
        off, total, silent = off + beyond, total + len(members), silent + mute
        false += names > 1
    print(f"beyond {SIGMA:g} sigma: {off} (at most {MOST_OFF}); kinds with more than one false name: {false} (0)")
    print(f"mentioned: {total - silent} of {total} (at least {LEAST_MENTIONED:.0%})")
    return int(off > MOST_OFF or false > 0 or total - silent < LEAST_MENTIONED * total)


if __name__ == "__main__":
    sys.exit(main())
