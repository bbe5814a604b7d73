"""The catalogue as a page: docs/effects.md, which `make pages` writes."""

from __future__ import annotations

from collections.abc import Iterable

from accelcal.effects.registry import CARD, Effect

PORTS = {
    "output": "adds to the output",
    "position": "adds to the encoder reading",
    "noise": "adds variance",
    "process": "a random process of a parameter",
}


def cards(effects: Iterable[Effect]) -> str:
    """One Markdown page: a table of all effects, then the card of each."""
    effects = tuple(effects)
    lines = [
        "# Catalogue of effects",
        "",
        "Written by `make pages`; the text lives in `python/accelcal/effects/`.",
        "",
        "| effect | symbol | unit of the coefficient | acts by | owner | refined |",
        "|---|---|---|---|---|---|",
    ]
    lines += [
        f"| [{e.name}](#{e.name}) | {_cell(e.symbol)} | {e.unit} | {PORTS[e.port]} | {e.owner} | "
        + f"{', '.join(name for name, shape in e.shapes.items() if shape.refined) or '–'} |"
        for e in effects
    ]
    for e in effects:
        lines += ["", *card(e).splitlines()]
    return "\n".join(lines) + "\n"


def symptoms(effects: Iterable[Effect]) -> str:
    """Symptom of each physical effect, and what separates it from its rivals, as a Markdown table."""
    rows = [
        f"| {_cell(e.line('Looks like'))} | [{e.name}](effects.md#{e.name}) | {_cell(e.line('Separate by'))} |"
        for e in effects
        if not e.family
    ]
    return "\n".join(["| the residual shows | effect | separate it by |", "|---|---|---|", *rows])


def card(effect: Effect) -> str:
    """Card of one effect, as Markdown."""
    lines = [f"## {effect.name}", "", " ".join(effect.card.split("\nEquation:")[0].split()), ""]
    lines += [f"- {label}: {text}" for label in CARD if (text := effect.line(label))]
    lines.append(f"- Unit of {effect.symbol}: {effect.unit}; owner: {effect.owner}; {PORTS[effect.port]}.")
    lines.append(f"- Typical size: {effect.scale:g} ({effect.source}).")
    for label, refined in (("Refined by likelihood", True), ("Range fixed at fit time", False)):
        shapes = [f"{name} ({shape.unit})" for name, shape in effect.shapes.items() if shape.refined is refined]
        if shapes:
            lines.append(f"- {label}: {', '.join(shapes)}.")
    if effect.width > 1:
        lines.append(f"- Columns: {', '.join(effect.parts)}.")
    if effect.needs:
        lines.append(f"- Needs the side channel {' and '.join(effect.needs)}.")
    if effect.search.includes:
        lines.append(f"- Includes: {', '.join(effect.search.includes)}.")
    if effect.traits.positive:
        lines.append("- Only a positive coefficient is physical.")
    if effect.search.prior:
        mean, std = effect.search.prior
        lines.append(f"- Prior: {mean:g} ± {std:g} (1 sigma).")
    if effect.seen_by_sets:
        lines.append("- No motion of a level, untouched rig can show it.")
    elif not effect.traits.visible:
        lines.append("- A diagnosis does not search for it.")
    return "\n".join(lines) + "\n"


def spelled(name: str) -> str:
    """A name of the catalogue as people write it.

    Examples
    --------
    >>> spelled("odd_quadratic")
    'odd quadratic'
    """
    return name.replace("_", " ")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
