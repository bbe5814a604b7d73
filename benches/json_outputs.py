"""`--json` of fit, diagnose, improve and compare on 30 records of every verdict: does each validate against its schema?

From the top of the repository: python -m benches.json_outputs [--records 30] [--seed 35001] [--out build/json.jsonl]
Records of `tests/regimes`, with and without a hidden effect, beside too short ones and a nonlinearity that is no
effect of the catalogue. Schemas are those that `accelcal schema` prints, the validator is jsonschema.
"""

from __future__ import annotations

import argparse
import json
import os
import tempfile
from collections import Counter
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, get_args

os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import numpy as np
from typer.testing import CliRunner

import accelcal as ac
from accelcal import cli
from accelcal.diagnosis.search.scan import Verdict
from benches.outcomes import run_all
from tests.regimes import trials as regimes
from tests.regimes.hidden import plant
from tests.regimes.regimes import TABLE
from tests.regimes.rig import Planted
from tests.schemas import validator

RECORDS = (
    *((name, "") for name in ("a-trap-adxl105", "a-seg7-servo", "a-cosine-cxl02", "a-random-adxl105", "n-bare")),
    *((name, "cubic") for name in ("a-trap-adxl105", "a-chirp-servo", "a-mixed-cxl02", "a-hand-adxl105")),
    *((name, "quadratic") for name in ("a-smooth-adxl105", "a-minjerk-servo", "a-random-cxl02")),
    *((name, "bias_step") for name in ("a-trap-cxl02", "a-mixed-adxl105", "j-20s")),
    *((name, "sensor_lag") for name in ("a-chirp-adxl105", "a-random-servo")),
    *((name, "accelerometer_outliers") for name in ("a-trap-servo", "a-seg7-cxl02")),
    *(
        (name, "")
        for name in ("c-phone-turning", "s-held-phone", "d-structure", "r-lost-counts", "l-creep", "q-100Hz-1Hz")
    ),
    *(("short", str(seconds)) for seconds in (0.2, 0.5)),
    *(("steps", str(size)) for size in (0.02, 0.05, 0.1)),
)
"""Regime and hidden effect; or a simulated record of so many seconds, or with steps of the output of a size, m/s²."""
COMMANDS = (
    ("fit", "{run}", "-o", "m.json", "--json"),
    ("diagnose", "m.json", "{run}", "--json"),
    ("improve", "{run}", "--json"),
    ("compare", "m.json", "{run}", "--json"),
)


@dataclass(frozen=True, slots=True)
class Trial:
    """One record."""

    name: str
    hidden: str
    seed: int

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.name}/{self.hidden}"


def written(trial: Trial, folder: Path) -> Path:
    """File of a record."""
    if trial.name in TABLE:
        plain = regimes.Trial(trial.name, 0, trial.seed, trial.hidden)
        planted = plant(TABLE[trial.name], trial.hidden, plain.record_seed) if trial.hidden else Planted()
        return Path(TABLE[trial.name].build(plain.record_seed, planted).write(folder))
    path, short = folder / "run.csv", trial.name == "short"
    seconds = float(trial.hidden) if short else 60.0
    rng = np.random.default_rng(trial.seed)
    simulated = ac.simulate("interleaved", seconds=seconds, rig=ac.simulation.ADXL105_RIG, rng=rng)
    y, size = simulated.recording.output.y, 0.0 if short else float(trial.hidden)
    rows = np.full((len(simulated.recording.output.t), 2), np.nan)
    rows[:, 0], rows[:, 1] = simulated.recording.output.t, y + size * np.sign(np.sin(3.0 * y))
    position = np.interp(rows[:, 0], simulated.recording.position.t, simulated.recording.position.y)
    np.savetxt(
        path, np.column_stack([rows, position]), delimiter=",", header="t [s],output [m/s²],position [m]", comments=""
    )
    return path


def run(trial: Trial) -> dict[str, Any]:
    """Run every command on one record; its outcome holds the verdict and what did not validate."""
    outcome: dict[str, Any] = {"key": trial.key, "wrong": [], "verdicts": [], "valid": 0}
    with tempfile.TemporaryDirectory() as folder:
        path, before = written(trial, Path(folder)), Path.cwd()
        os.chdir(folder)
        try:
            for command in COMMANDS:
                done = CliRunner().invoke(cli.app, [word.format(run=path) for word in command])
                for content in contents(done.stdout):
                    errors = [error.message[:200] for error in validator(content["schema"]).iter_errors(content)]
                    outcome["wrong"] += [f"{command[0]}: {error}" for error in errors]
                    outcome["valid"] += not errors
                    outcome["verdicts"] += [content["verdict"]] if "verdict" in content else []
                if done.exit_code not in (0, 3, 4):
                    outcome["wrong"].append(f"{command[0]}: exit {done.exit_code}: {done.output[-300:]}")
        finally:
            os.chdir(before)
    return outcome


def contents(text: str) -> Iterator[dict[str, Any]]:
    """Each JSON document of an output."""
    decoder, rest = json.JSONDecoder(), text.strip()
    while rest:
        content, end = decoder.raw_decode(rest)
        yield content
        rest = rest[end:].strip()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run what is missing; print each violation, then figure, count and threshold."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--records", type=int, default=len(RECORDS))
    parser.add_argument("--seed", type=int, default=35001)
    parser.add_argument("--out", type=Path, default=Path("build/json.jsonl"))
    parser.add_argument("--workers", type=int, default=2)
    chosen = parser.parse_args(arguments)
    trials = [Trial(*record, chosen.seed) for record in RECORDS[: chosen.records]]
    outcomes = run_all(run, trials, chosen.out.resolve(), chosen.workers)
    for outcome in outcomes:
        for line in outcome["wrong"]:
            print(f"{outcome['key']}: {line}")
    verdicts = Counter(verdict for outcome in outcomes for verdict in outcome["verdicts"])
    absent = [verdict for verdict in get_args(Verdict) if verdict not in verdicts]
    wrong = sum(bool(outcome["wrong"]) for outcome in outcomes)
    print(f"records with an output that is not valid: {wrong} of {len(outcomes)}, at most 0")
    valid = sum(outcome["valid"] for outcome in outcomes)
    print(f"outputs that are valid: {valid}; verdicts: {dict(verdicts)}; verdicts without a record: {absent}")
    return 0 if not wrong and not absent else 1


if __name__ == "__main__":
    raise SystemExit(main())
