"""One record of one regime: it is written to files, and the product is run on the files."""

from __future__ import annotations

import signal
import tempfile
import time
import traceback
import zlib
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from accelcal import verbs
from accelcal.estimation.gauss_newton import NotIdentifiable
from accelcal.io import load

from .hidden import PLANTED, OutOfReach, plant
from .regimes import FAILING, TABLE, Regime
from .rig import Planted

Outcome = dict[str, Any]
"""What a trial found, as plain values for a line of JSON."""
LONGEST = 200.0
"""Processor time after which a trial is stopped, s."""


@dataclass(frozen=True, slots=True)
class Trial:
    """One record; the same trial always gives the same record."""

    regime: str
    number: int
    seed: int
    hidden: str = ""
    """Effect that is planted."""

    @property
    def key(self) -> str:
        """Identifier under which its outcome is kept."""
        return f"{self.seed}/{self.regime}/{self.number}/{self.hidden}"

    @property
    def record_seed(self) -> int:
        """Seed of everything that is drawn."""
        return int(np.random.default_rng([self.seed, self.number, zlib.crc32(self.regime.encode())]).integers(2**31))


def plan(names: Sequence[str], records: int | None, seed: int) -> Iterator[Trial]:
    """Null trials; without a number 12 of each regime, and 40 of those that carried false names at first."""
    for name in names:
        for number in range(records or (40 if name.startswith(FAILING) else 12)):
            yield Trial(name, number, seed)


def plan_hidden(names: Sequence[str], records: int | None, seed: int) -> Iterator[Trial]:
    """Trials with one planted effect each; `records` of each pair, one by default."""
    for name in names:
        for effect in PLANTED:
            for number in range(records or 1):
                yield Trial(name, 10_000 + number, seed, effect)


def run(trial: Trial) -> Outcome:
    """Build, write, load, improve; whatever happens is an outcome."""
    outcome: Outcome = {"key": trial.key, **asdict(trial)}
    regime = without_delay(TABLE[trial.regime]) if trial.hidden == "sensor_lag" else TABLE[trial.regime]
    try:
        planted = plant(regime, trial.hidden, trial.record_seed) if trial.hidden else Planted()
    except OutOfReach as reason:
        return {**outcome, "skipped": str(reason)}
    record = regime.build(trial.record_seed, planted)
    with tempfile.TemporaryDirectory() as folder:
        path = record.write(folder)
        begin = time.process_time()
        _alarm(LONGEST)
        try:
            improvement = verbs.improve(load(path))
            outcome |= summary(improvement, record.truth)
        except NotIdentifiable as refused:
            outcome["refused"] = str(refused)
        except Exception:
            outcome["error"] = traceback.format_exc(limit=-4)
        finally:
            _alarm(0.0)
    return {**outcome, "seconds": time.process_time() - begin}


def without_delay(regime: Regime) -> Regime:
    """Return the regime with clocks that agree and are declared to: a lag within a tolerance is rightly not named."""
    return replace(regime, rig=replace(regime.rig, clocks=replace(regime.rig.clocks, tolerance=0.0, offset=0.0)))


def _alarm(seconds: float) -> None:
    signal.signal(signal.SIGPROF, _stop)
    signal.setitimer(signal.ITIMER_PROF, seconds)


def _stop(number: int, frame: object) -> None:
    raise TimeoutError(f"stopped after {LONGEST:g} s of processor time")


def summary(result: verbs.Improvement, truth: Mapping[str, float]) -> Outcome:
    """Names, classes, verdict and estimates beside the truth."""
    free = {e.name: e for e in result.steps[-1].fit.estimates if e.std > 0.0}
    return {
        "effects": list(result.effects),
        "classes": [[tie.effect, *(m for m in tie.members if m != tie.effect)] for tie in result.classes],
        "verdict": result.diagnosis.verdict,
        "sentence": result.diagnosis.sentence,
        "estimates": {n: [free[n].value, free[n].std, true] for n, true in truth.items() if n in free},
    }
