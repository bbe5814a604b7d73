"""Texts of the page about a diagnosis; every number comes from the library."""

from __future__ import annotations

from dataclasses import dataclass

from accelcal.app.state import State
from accelcal.diagnosis.findings import Size
from accelcal.diagnosis.noise_tests.noise_test import WHITENESS
from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import find, spelled
from accelcal.plots.numbers import candidate_groups
from accelcal.results.diagnoses import VERDICTS, contribution
from accelcal.results.words import probability, readable, with_plain


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
    """Whether it explains most."""


def badge(found: Diagnosis) -> str:
    """The verdict in a few words."""
    return VERDICTS[found.verdict].capitalize()


def sentence(found: Diagnosis) -> str:
    """The verdict in a sentence, without the identifiers of the catalogue."""
    return readable(found.sentence)


def cards(found: Diagnosis, most: int = 8) -> list[Card]:
    """Candidates, best first, confounded ones together."""
    named = [f.effect for f in found.scan.found]
    flat = [c for group in candidate_groups(found, most) for c in group]
    return [card(found, c, named) for c in flat]


def card(found: Diagnosis, c: Candidate, named: list[str]) -> Card:
    """One candidate."""
    effect = find(c.effect)
    single = len(c.estimate) == 1
    size = with_plain(c.estimate[0], c.std[0], c.unit) if single else f"{len(c.estimate)} coefficients"
    significant = c.p_value < found.alpha and found.verdict not in ("adequate", "too_short")
    rivals = tuple(spelled(m) for m in c.members if m != c.effect) if significant else ()
    return Card(
        effect=c.effect,
        title=spelled(c.effect),
        about=" ".join(effect.card.split("\n\n")[0].split("\nEquation:")[0].split()),
        facts=(
            size,
            f"at most {contribution(Size(c.largest, effect.port == 'position'), found.fit.rig.sensor.range)}",
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


def limits(found: Diagnosis) -> list[tuple[str, ...]]:
    """Detection limits: effect, and the smallest coefficient of it that would have been detected."""
    return list(found.table("limits").cells[1])


def offered(found: Diagnosis) -> tuple[list[Card], list[Card], list[Card]]:
    """Candidates in three groups: the best one and its rivals; others that are significant; the rest.

    Where no effect is missing, all are in the last group.
    """
    every = cards(found)
    first = next((c for c in every if c.first), None)
    if first is None:
        return [], [c for c in every if c.significant], [c for c in every if not c.significant]
    near = [first, *(c for c in every if c.title in first.rivals and c.significant)]
    return near, [c for c in every if c.significant and c not in near], [c for c in every if not c.significant]


def remarks(state: State, found: Diagnosis) -> list[str]:
    """What must be read with the verdict; gaps that the user made are not mentioned."""
    cut = any(run.excluded or run.held_out for run in state.runs)
    seen = (r for r in found.remarks if r.place == "data" and not (cut and r.code == "dropout"))
    lines = [f"Suspect data: {r.sentence}" for r in seen]
    lines += [readable(text) for text in found.notes]
    lines += [f"{d.sentence}." for d in found.dropped]
    lines += [capitalised(test.sentence) for test in found.channels if test.effect == WHITENESS]
    if "time_offset" in found.effects:
        lines.append("The output lags by more than was declared; the model estimates the lag already (time offset).")
    return lines


def capitalised(text: str) -> str:
    """A sentence of its own."""
    text = text.rstrip(".")
    return f"{text[:1].upper()}{text[1:]}."


def of_noise(state: State, found: Diagnosis) -> list[tuple[str, str, str]]:
    """Effects that noise tests found and that can be added: name, title, sentence; one for each."""
    model = state.step.fit.model.effects if state.step else ()
    offered = {c.effect for c in found.scan.candidates if c.p_value < found.alpha}
    first = {test.effect: test for test in reversed(found.channels) if test.effect != WHITENESS}
    return [
        (name, spelled(name), capitalised(test.sentence))
        for name, test in reversed(first.items())
        if name not in model and name not in offered
    ]


def ties(found: Diagnosis) -> list[tuple[str, str]]:
    """Confounded effects, and the experiment that separates them."""
    several = [t for t in found.classes if len(t.members) > 1]
    return [(", ".join(spelled(m) for m in t.members), t.experiment) for t in (*several, *found.inseparable)]


def can_add(state: State, found: Diagnosis | None) -> bool:
    """Whether there is something to add: a candidate that is significant, or an effect on noise."""
    if state.step is None or found is None:
        return False
    return any(c.significant for c in cards(found)) or bool(of_noise(state, found))
