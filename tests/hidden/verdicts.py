"""Judgement of the outcomes: figure, count and threshold of every claim of a group."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass

import numpy as np

from tests.hidden.trials import INVISIBLE, STRENGTHS, Outcome
from tests.worlds import CATALOGUE, OUTSIDE

DELAY_CLASS = ("time_offset", "sensor_lag", "sensor_resonance")
MANY = 0.97
"""Correlation with a rival beyond which the first place is arbitrary."""
LEAST_EXPLAINED = "shape_of_", "shape_since_", "encoder_shape_of_"


@dataclass(frozen=True, slots=True)
class Line:
    """One claim of one group."""

    group: int
    claim: str
    figure: str
    count: str
    threshold: str
    holds: bool

    @property
    def text(self) -> str:
        """The line for the terminal."""
        state = "ok" if self.holds else "MISSED"
        return f"group {self.group}: {self.claim}: {self.figure} ({self.count}), threshold {self.threshold}: {state}"


def share(group: int, claim: str, flags: Sequence[bool], least: float) -> Line:
    """At least this share must be good."""
    rate = float(np.mean(flags)) if flags else float("nan")
    return Line(group, claim, f"{rate:.1%}", f"{sum(flags)} of {len(flags)}", f">= {least:.0%}", bool(rate >= least))


def at_most(group: int, claim: str, flags: Sequence[bool], most: float) -> Line:
    """At most this share may be bad."""
    rate = float(np.mean(flags)) if flags else float("nan")
    return Line(group, claim, f"{rate:.1%}", f"{sum(flags)} of {len(flags)}", f"<= {most:.1%}", bool(rate <= most))


def injected(outcome: Outcome) -> set[str]:
    """Nuisances of a record that have a name in the catalogue, and the vibration that a rectified one depends on."""
    vibrates = outcome["nuisances"]["vibration"] > 0.0 or "vibration_rectification" in outcome["names"]
    result = {"vibration"} if vibrates else set()
    return result | ({"quantisation"} if outcome["nuisances"]["converter_bits"] < 16 else set())


def falsely_named(outcome: Outcome) -> list[str]:
    """Effects that were named although only nuisances were hidden."""
    return [name for name in outcome["effects"] if name not in injected(outcome)]


def members(outcome: Outcome) -> list[set[str]]:
    """Reported classes; the delay class counts as one."""
    return [
        set(reported) | (set(DELAY_CLASS) if set(reported) & set(DELAY_CLASS) else set())
        for reported in outcome["classes"]
    ]


def injected_only(name: str, outcome: Outcome) -> bool:
    """Whether an effect is no more than a nuisance of this record."""
    return name in injected(outcome) and name not in outcome["names"]


def named(outcome: Outcome) -> list[str]:
    """Effects that entered, beyond the nuisances."""
    return [name for name in outcome["effects"] if not injected_only(name, outcome)]


def channel(name: str) -> str:
    """Whether an effect changes the mean or the scatter of the samples."""
    effect = CATALOGUE.get(name)
    return "scatter" if effect is not None and effect.kind == "variance" else "mean"


def detected(outcome: Outcome, name: str) -> bool:
    """Whether an effect or curve on the channel of `name` entered."""
    return any(channel(entered) == channel(name) for entered in named(outcome))


def in_class(outcome: Outcome, name: str) -> bool:
    """Whether an effect is in one of the reported classes."""
    return any(name in tie for tie in members(outcome))


def first(outcome: Outcome, name: str) -> bool:
    """Whether an effect was named first; of the delays any counts."""
    entered = named(outcome)
    accepted = DELAY_CLASS if name in DELAY_CLASS else (name,)
    return bool(entered) and entered[0] in accepted


def certain(outcome: Outcome) -> bool:
    """Whether some effect, beyond the nuisances, was named with a class of its own."""
    alone = [next(iter(tie)) for tie in members(outcome) if len(tie) == 1]
    return any(not _family(name) and not injected_only(name, outcome) for name in alone)


def _family(name: str) -> bool:
    return name.startswith(LEAST_EXPLAINED)


FOLLOWED = {"abs_a": "acceleration", "a2": "acceleration", "abs_v": "velocity", "v2": "velocity"}
CARRIED = {"bias": set[str](), "scale_factor": {"acceleration"}, "time_offset": {"jerk"}, "velocity": {"velocity"}}
"""Variables of the drivers and of the carriers of mechanisms, where they are not their names."""


def variables(name: str) -> set[str]:
    """Variables of an effect or a curve."""
    carrier, follows, driver = name.partition("_follows_")
    if follows:
        return CARRIED[carrier] | {FOLLOWED.get(driver, driver)}
    if name.startswith("encoder_shape_of_"):
        return {"encoder_position"}
    for head in LEAST_EXPLAINED:
        if name.startswith(head):
            result = name.removeprefix(head).split("_and_")
            return {"since_reversal" if variable == "reversal" else variable for variable in result}
    effect = (CATALOGUE | OUTSIDE).get(name)
    return set(effect.explains) if effect is not None else {name}


def good_outcomes(outcomes: Iterable[Outcome]) -> list[Outcome]:
    """Those that could be drawn at all and ran to the end."""
    return [o for o in outcomes if "skipped" not in o and "error" not in o]


def lines(group: int, outcomes: Sequence[Outcome]) -> list[Line]:
    """Figures of a group."""
    ran = good_outcomes(outcomes)
    failed = [o for o in outcomes if "error" in o]
    tried = len(ran) + len(failed)
    result = JUDGES[group](ran)
    if failed:
        result.append(Line(group, "runs to the end", f"{len(ran)}", f"{len(ran)} of {tried}", "all", False))
    return result


def _null(ran: list[Outcome]) -> list[Line]:
    return [at_most(1, "falsely named", [bool(falsely_named(o)) for o in ran], 9 / 500)]


def _single(ran: list[Outcome]) -> list[Line]:
    groups = dict(zip(STRENGTHS, ((0.98, 0.95, 0.75), (1.0, 0.99, 0.90), (1.0, 0.99, 0.97)), strict=True))
    results = []
    for d, (least_detected, least_class, least_first) in groups.items():
        these = [o for o in ran if o["d"] == d]
        clear = [o for o in these if o["rival"] < MANY]
        results += [
            share(2, f"d = {d:g}: detected", [detected(o, o["names"][0]) for o in these], least_detected),
            share(2, f"d = {d:g}: in a class", [in_class(o, o["names"][0]) for o in these], least_class),
            share(2, f"d = {d:g}: first", [first(o, o["names"][0]) for o in clear], least_first),
        ]
    sizes = [len(tie) for o in ran for tie in o["classes"] if o["names"][0] in tie]
    size = float(np.median(sizes)) if sizes else float("nan")
    results.append(Line(2, "median class size", f"{size:g}", f"{len(sizes)} classes", "<= 3", size <= 3))
    return results


def _weak(ran: list[Outcome]) -> list[Line]:
    return [
        at_most(3, "d = 3: named", [bool(named(o)) for o in ran], 0.30),
        at_most(3, "d = 3: certain", [certain(o) for o in ran], 0.01),
    ]


def _several(ran: list[Outcome]) -> list[Line]:
    pairs, triples = ([o for o in ran if len(o["names"]) == n] for n in (2, 3))
    return [
        share(4, "pairs: both in the classes", [all(in_class(o, n) for n in o["names"]) for o in pairs], 0.90),
        at_most(4, "pairs: a third effect", [len(named(o)) > 2 for o in pairs], 0.05),
        share(4, "triples: all in the classes", [all(in_class(o, n) for n in o["names"]) for o in triples], 0.80),
    ]


def _invisible(ran: list[Outcome]) -> list[Line]:
    listed = [all(any(name in tie for tie in o["inseparable"]) for name in INVISIBLE) for o in ran]
    return [
        at_most(5, "an invisible effect named", [bool(named(o)) for o in ran], 0.01),
        share(5, "class and experiment given", listed, 1.0),
    ]


def right_variable(outcome: Outcome) -> bool:
    """Whether the first effect, or a member of its class, is a function of the right variable; or none is named."""
    entered = named(outcome)
    if not entered:
        return bool(outcome["verdict"] == "unexplained")
    truth = set(OUTSIDE[outcome["names"][0]].explains)
    candidates = next((tie for tie in members(outcome) if entered[0] in tie), {entered[0]})
    return any(variables(name) <= truth if "_and_" in name else truth & variables(name) for name in candidates)


SUMS = {"rail_two_waves": {"rail_wave", "rail_second_wave"}}
"""Sums of effects of the catalogue: to name them all is as right as to report their curve."""


def right_shape(outcome: Outcome) -> bool:
    """Whether the curve of the right variables entered, or what is a product of them."""
    if right_product(outcome):
        return True
    truth = set(OUTSIDE[outcome["names"][0]].explains)
    if SUMS.get(outcome["names"][0], {""}) <= set(named(outcome)):
        return True
    return any(_family(name) and variables(name) == truth for name in named(outcome))


def right_product(outcome: Outcome) -> bool:
    """Whether a coefficient that follows the right variable entered."""
    truth = set(OUTSIDE[outcome["names"][0]].explains)
    return any("_follows_" in name and variables(name) == truth for name in named(outcome))


SHAPED = ("acceleration", "position", "velocity", "time", "temperature", "since_reversal", "jerk", "encoder_position")


def _outside(ran: list[Outcome]) -> list[Line]:
    single = [o for o in ran if OUTSIDE[o["names"][0]].explains[0] in SHAPED]
    single = [o for o in single if len(OUTSIDE[o["names"][0]].explains) == 1]
    return [
        share(6, "right variable or unexplained", [right_variable(o) for o in ran], 0.97),
        share(6, "right shape", [right_shape(o) for o in single], 0.80),
        at_most(6, "a wrong name as certain", [certain(o) and not right_product(o) for o in ran], 0.01),
    ]


def _estimates(ran: list[Outcome]) -> list[Line]:
    right_effects = [o for o in ran if set(o["effects"]) <= set(o["names"])]
    effects = [(v - t) / s for o in right_effects for n, (v, s, t) in o["estimates"].items() if n in o["names"]]
    all_errors = [(v - t) / s for o in right_effects for v, s, t in o["estimates"].values()]
    rms = float(np.sqrt(np.mean(np.square(effects)))) if effects else float("nan")
    covered = float(np.mean(np.abs(all_errors) < 1.96)) if all_errors else float("nan")
    return [
        Line(7, "normalised error, rms", f"{rms:.3f}", f"{len(effects)} fits", "0.9 to 1.1", 0.9 <= rms <= 1.1),
        Line(7, "95 % intervals", f"{covered:.1%}", f"{len(all_errors)}", "93 % to 97 %", 0.93 <= covered <= 0.97),
    ]


def near_oracle(outcome: Outcome, key: str) -> bool:
    """Whether the found model errs no more than the oracle and its own parameters explain."""
    result, oracle, more = outcome["found"][key], outcome["oracle"][key], outcome["allowed"][key]
    return bool(result <= 1.05 * np.hypot(oracle, more))


def _held_out(ran: list[Outcome]) -> list[Line]:
    results = []
    for key in ("one_step", "1 s", "5 s", "10 s"):
        scored = [o for o in ran if o["oracle"].get(key) is not None]
        results.append(share(8, f"{key}: within 5 % of the oracle", [near_oracle(o, key) for o in scored], 1.0))
        if key != "one_step":
            worth = [o for o in scored if o["base"][key] >= 2.5 * o["oracle"][key]]
            halves = [o["base"][key] >= 2.0 * o["found"][key] for o in worth]
            results.append(share(8, f"{key}: falls twofold", halves, 1.0))
    return results


JUDGES: dict[int, Callable[[list[Outcome]], list[Line]]] = {
    1: _null,
    2: _single,
    3: _weak,
    4: _several,
    5: _invisible,
    6: _outside,
    7: _estimates,
    8: _held_out,
}
