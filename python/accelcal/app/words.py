"""What the page says of a diagnosis, in plain words; every number comes from the library."""

from __future__ import annotations

import math
from dataclasses import dataclass

from accelcal.app.state import State
from accelcal.diagnose import Candidate
from accelcal.effects import CATALOGUE, find
from accelcal.findings import sizes
from accelcal.fit import Estimate
from accelcal.importance import Size
from accelcal.loop import Diagnosis
from accelcal.plots.interactive.ranking import classes
from accelcal.report.view import VERDICTS, amount, number, probability, with_unit

LIMITS = 8
"""Detection limits that are spelled out when nothing is missing."""


@dataclass(frozen=True, slots=True)
class Card:
    """One candidate for the page."""

    effect: str
    title: str
    about: str
    """First sentence of its card."""
    facts: tuple[str, ...]
    """Size, evidence."""
    rivals: tuple[str, ...]
    experiment: str
    lines: tuple[tuple[str, str], ...]
    """Label and text of the rest of its card."""
    significant: bool
    """Whether it may be added."""
    first: bool
    """Whether it is what explains most."""


def title(name: str) -> str:
    """An effect's name as people write it."""
    return name.replace("_", " ")


def badge(found: Diagnosis) -> str:
    """The verdict in a few words."""
    return VERDICTS[found.verdict].capitalize()


def sentence(found: Diagnosis) -> str:
    """The verdict in a sentence, without the identifiers of the catalogue."""
    text = found.sentence
    for name in sorted((n for n in CATALOGUE if "_" in n), key=len, reverse=True):
        text = text.replace(name, title(name))
    return text.replace(" sigma", " σ")


def cards(found: Diagnosis, most: int = 8) -> list[Card]:
    """Candidates, best first, each class together."""
    named = [f.effect for f in found.scan.found]
    flat = [c for group in classes(found, most) for c in group]
    return [card(found, c, named) for c in flat]


def card(found: Diagnosis, c: Candidate, named: list[str]) -> Card:
    """One candidate."""
    effect = find(c.effect)
    single = len(c.estimate) == 1
    size = amount(c.estimate[0], c.std[0], c.unit) if single else f"{len(c.estimate)} coefficients"
    significant = c.p_value < found.alpha and found.verdict not in ("adequate", "too_short")
    rivals = tuple(title(m) for m in c.members if m != c.effect) if significant else ()
    return Card(
        effect=c.effect,
        title=title(c.effect),
        about=" ".join(effect.card.split("\n\n")[0].split("\nEquation:")[0].split()),
        facts=(
            size,
            f"at most {reach(found, Size(c.largest, effect.port == 'position'))}",
            f"{c.snr:.1f} σ, p {probability(c.p_value)}",
        ),
        rivals=rivals,
        experiment=effect.experiment,
        lines=tuple(
            (label, text)
            for label in ("Looks like", "Easily confused with", "Separate by", "Equation")
            if (text := effect.line(label))
        ),
        significant=significant,
        first=bool(named) and c.effect == named[0],
    )


def reach(found: Diagnosis, size: Size) -> str:
    """A largest contribution in m/s², mg and percent of full scale, or in µm at the encoder."""
    told = sizes(size, found.fit.rig.sensor.range)
    if told["m_per_s2"] is None:
        return f"{number(1e6 * (told['m'] or 0.0), 3)} µm"
    share = told["percent_of_full_scale"]
    full = "" if share is None else f", {number(share, 3)} %FS"
    return f"{number(told['m_per_s2'], 3)} m/s², {number(told['mg'] or 0.0, 3)} mg{full}"


def limits(found: Diagnosis) -> list[str]:
    """Nothing missing larger than: smallest coefficients of the sensor that would have been seen."""
    told = []
    for name, size in found.scan.detection_limits.items():
        effect = CATALOGUE.get(name)
        if effect is None or effect.owner != "sensor" or effect.port != "output" or effect.width != 1:
            continue
        if math.isfinite(size):
            told.append(f"{title(name)} {with_unit(number(size, 3), effect.unit)}")
    return told[:LIMITS]


def asides(found: Diagnosis) -> list[str]:
    """What must be read beside the verdict."""
    lines = [f"Suspect data: {text}" for text in found.suspect]
    lines += [f"{d.sentence}." for d in found.dropped]
    lines += [f"{test.sentence} It acts on noise, so it is not added to the model." for test in found.channels]
    if "time_offset" in found.effects:
        lines.append("The output is late by more than was declared; the model estimates that already (time offset).")
    return lines


def ties(found: Diagnosis) -> list[tuple[str, str]]:
    """Members that cannot be told apart, and the experiment that would."""
    several = [t for t in found.classes if len(t.members) > 1]
    return [(", ".join(title(m) for m in t.members), t.experiment) for t in (*several, *found.inseparable)]


def may_add(state: State, found: Diagnosis | None) -> bool:
    """Whether anything is offered."""
    return state.step is not None and found is not None and any(c.significant for c in cards(found))


def value(e: Estimate) -> str:
    """An estimate with its uncertainty and unit."""
    return amount(e.value, e.std, e.unit)
