"""What outcomes say: false names, errors in sigma, time, crashes; each as figure, count and threshold."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.stats import binom, chi2

from .regimes import TABLE, Regime

Outcome = Mapping[str, Any]
FALSE_RATE, BEYOND_RATE = 0.01, 0.001
SURE = 0.975
"""A count may be as high as a binomial draw at the claimed rate is with this probability."""
FAR = 4.0
POOLED = (0.95, 1.05)
FAMILY = 1e-3
"""Rate at which some regime leaves its interval by chance."""
BUDGET = 30.0
"""Processor time for a record of up to 60 s or 100 000 samples, s."""
FOUND = 0.97
JUDGED = ("bias", "scale_factor")
DELAYS = frozenset({"time_offset", "sensor_lag", "sensor_resonance"})
SCATTER = ("accelerometer_outliers", "timing_jitter")


@dataclass(frozen=True, slots=True)
class Line:
    """One claim."""

    claim: str
    figure: str
    count: str
    threshold: str
    holds: bool

    @property
    def text(self) -> str:
        """The line for the terminal."""
        return f"{self.claim}: {self.figure} ({self.count}), threshold {self.threshold}: " + self.state

    @property
    def state(self) -> str:
        """In one word."""
        return "ok" if self.holds else "MISSED"


def named(outcome: Outcome) -> list[str]:
    """Effects that were named."""
    return list(outcome.get("effects", ()))


def class_of(outcome: Outcome, name: str) -> set[str]:
    """Return a name with all that it is said to be confounded with; the delays are one class."""
    together = {name}.union(*(tie for tie in outcome.get("classes", ()) if tie[0] == name))
    return together | DELAYS if together & DELAYS and outcome["hidden"] in DELAYS else together


def false_names(outcome: Outcome) -> list[str]:
    """Names whose class holds nothing of what is in the record."""
    honest = TABLE[outcome["regime"]].honest | {outcome["hidden"]}
    return [name for name in named(outcome) if not class_of(outcome, name) & honest]


def in_class(outcome: Outcome) -> bool:
    """Whether the planted effect stands in a named class."""
    return any(outcome["hidden"] in class_of(outcome, name) for name in named(outcome))


def errors(outcome: Outcome, parameters: Iterable[str] | None = None) -> list[float]:
    """Errors of the comparable parameters over their standard deviations."""
    remaining = [p for p in TABLE[outcome["regime"]].compare if parameters is None or p in parameters]
    result = outcome.get("estimates", {})
    return [(result[p][0] - result[p][2]) / result[p][1] for p in remaining if p in result]


def budget(regime: Regime) -> float:
    """Return the processor time that a record of a regime may take, s."""
    samples = regime.seconds * regime.rig.sensor.rate
    return BUDGET * max(1.0, samples / 1e5 if regime.seconds > 60 else 1.0)


def rarely(claim: str, bad: Sequence[bool], rate: float) -> Line:
    """A rate that a count must be compatible with."""
    n = len(bad)
    most = int(binom.ppf(SURE, n, rate)) if n else 0
    figure = f"{np.mean(bad):.2%}" if n else "nothing ran"
    return Line(claim, figure, f"{sum(bad)} of {n}", f"<= {most} (at {rate:.1%})", bool(n) and sum(bad) <= most)


def often(claim: str, good: Sequence[bool], least: float) -> Line:
    """A share that must be reached."""
    n = len(good)
    figure = f"{np.mean(good):.1%}" if n else "nothing ran"
    return Line(claim, figure, f"{sum(good)} of {n}", f">= {least:.0%}", bool(n) and float(np.mean(good)) >= least)


def never(claim: str, bad: Sequence[bool]) -> Line:
    """What must not happen at all."""
    return Line(claim, str(sum(bad)), f"of {len(bad)}", "0", not any(bad))


def lines(outcomes: Sequence[Outcome]) -> list[Line]:
    """Claims on records with nothing hidden."""
    ran = [o for o in outcomes if "effects" in o]
    beyond = [abs(z) > FAR for o in ran for z in errors(o)]
    blamed = [o["verdict"] == "unexplained" for o in ran if not TABLE[o["regime"]].unexplained]
    met = [o["verdict"] == TABLE[o["regime"]].expected for o in ran if TABLE[o["regime"]].expected]
    results = [
        rarely("records with a false name", [bool(false_names(o)) for o in ran], FALSE_RATE),
        rarely("parameters beyond 4 sigma", beyond, BEYOND_RATE),
        *(_pooled(p, [z for o in ran for z in errors(o, [p])]) for p in JUDGED),
        _regimes_inside(ran),
        rarely("residual laid on the sensor", blamed, FALSE_RATE),
        *([often("expected verdict", met, 1.0)] if met else []),
        *common(outcomes),
    ]
    at_rest = [o for o in outcomes if TABLE[o["regime"]].profile == "rest"]
    if at_rest:
        kinds = {o.get("verdict", "refused") for o in at_rest}
        results.append(Line("verdicts at rest", ", ".join(sorted(kinds)), f"of {len(at_rest)}", "one", len(kinds) == 1))
    return results


def common(outcomes: Sequence[Outcome]) -> Iterator[Line]:
    """Claims on every trial that ran."""
    tried = [o for o in outcomes if "skipped" not in o]
    yield never("crashes", ["error" in o for o in tried])
    yield never("refusals that are not right", ["refused" in o and not TABLE[o["regime"]].refusal for o in tried])
    late = [o["seconds"] > budget(TABLE[o["regime"]]) for o in tried]
    longest = max((o["seconds"] for o in tried), default=0.0)
    yield Line(
        "processor time", f"longest {longest:.1f} s", f"{sum(late)} late of {len(late)}", "<= 30 s", not any(late)
    )


def _pooled(parameter: str, z: Sequence[float]) -> Line:
    rms = float(np.sqrt(np.mean(np.square(z)))) if z else float("nan")
    low, high = POOLED
    return Line(f"rms z of {parameter}, pooled", f"{rms:.3f}", f"{len(z)}", f"{low} to {high}", low <= rms <= high)


def interval(n: int, tests: int) -> tuple[float, float]:
    """Return where the rms of n unit normal errors lies, at FAMILY over so many tests."""
    tail = FAMILY / max(tests, 1) / 2
    return float(np.sqrt(chi2.ppf(tail, n) / n)), float(np.sqrt(chi2.isf(tail, n) / n))


def _regimes_inside(ran: Sequence[Outcome]) -> Line:
    groups = {(r, p): [z for o in ran if o["regime"] == r for z in errors(o, [p])] for r in names(ran) for p in JUDGED}
    groups = {key: z for key, z in groups.items() if z}
    outside = []
    for (regime, parameter), z in groups.items():
        low, high = interval(len(z), len(groups))
        rms = float(np.sqrt(np.mean(np.square(z))))
        if not low <= rms <= high:
            outside.append(f"{regime} {parameter} {rms:.2f} ({low:.2f} to {high:.2f})")
    return Line("rms z, regime by regime", "; ".join(outside) or "all inside", f"{len(groups)}", "99.9 %", not outside)


def hidden_lines(outcomes: Sequence[Outcome]) -> list[Line]:
    """Claims on records with a planted effect."""
    tried = [o for o in outcomes if "skipped" not in o]
    ran = [o for o in tried if "effects" in o]
    mean, scatter = ([o for o in ran if (o["hidden"] in SCATTER) == s] for s in (False, True))
    return [
        often("d = 20: in a named class", [in_class(o) for o in mean], FOUND),
        *(often(f"{name}: found", [in_class(o) for o in scatter if o["hidden"] == name], FOUND) for name in SCATTER),
        rarely("planted: a false extra name", [bool(false_names(o)) for o in ran], FALSE_RATE),
        *common(outcomes),
    ]


def unreachable(outcomes: Sequence[Outcome]) -> list[str]:
    """Pairs of regime and effect that have no trial, with the reason."""
    return sorted(f"{o['regime']} + {o['hidden']}: {o['skipped']}" for o in outcomes if "skipped" in o)


def names(outcomes: Sequence[Outcome]) -> list[str]:
    """Regimes in the order of the table."""
    present = {o["regime"] for o in outcomes}
    return [name for name in TABLE if name in present]


def rows(outcomes: Sequence[Outcome]) -> Iterator[str]:
    """The table, regime by regime."""
    yield "| regime | records | false | > 4 sigma | crash, refusal | rms z K0, k, t0 | cpu s | false names (records) |"
    yield "|---|---|---|---|---|---|---|---|"
    for name in names(outcomes):
        ours = [o for o in outcomes if o["regime"] == name and "skipped" not in o]
        if not ours:
            continue
        false = [false_names(o) for o in ours]
        count = {n: sum(n in verdict for verdict in false) for verdict in false for n in verdict}
        shown = ", ".join(f"{n} {c}" for n, c in sorted(count.items(), key=lambda item: -item[1]))
        far = sum(any(abs(z) > FAR for z in errors(o)) for o in ours)
        failed = f"{sum('error' in o for o in ours)}, {sum('refused' in o for o in ours)}"
        rms = ", ".join(_rms([z for o in ours for z in errors(o, [p])]) for p in (*JUDGED, "time_offset"))
        seconds = max(o["seconds"] for o in ours)
        yield f"| {name} | {len(ours)} | {sum(map(bool, false))} | {far} | {failed} | {rms} | {seconds:.1f} | {shown} |"


def _rms(z: Sequence[float]) -> str:
    return f"{np.sqrt(np.mean(np.square(z))):.1f}" if z else "-"
