"""Effects entered when they are asked for: processes of a coefficient and further waves; found by name.

`quadratic_gauss_markov` is a process of any coefficient; `tone_2` is a second line, `encoder_cyclic_2` a second wave.
Pickles hold the name of an effect, no code. The catalogue as a page is here, too: docs/effects.md, which `make pages`
writes.
"""

from __future__ import annotations

import copyreg
import re
from collections.abc import Callable, Container, Iterable, Sequence
from dataclasses import replace
from itertools import count
from pickle import PicklingError

from accelcal._support.errors import AccelcalError
from accelcal.effects import mechanisms, registry
from accelcal.effects.drift import CORRELATION, MADE, process
from accelcal.effects.mechanisms import DRIVERS, PATTERN
from accelcal.effects.registry import CARD, CATALOGUE, Effect, enter

KINDS = re.compile(r"(?P<stem>\w+)_(?P<kind>gauss_markov|random_walk)")

FURTHER = re.compile(r"(?P<stem>\w+)_(?P<number>[2-9]|[1-9]\d+)")


def find(name: str) -> Effect:
    """Return the effect called `name`; a mechanism, a random process or a further wave of a known effect is made where
    it is not known yet.

    Raises
    ------
    ValueError
        If there is none; the text offers the nearest names.

    Examples
    --------
    >>> find("quadratic_gauss_markov").unit
    '(m/s²)⁻¹'
    """
    mechanism = mechanisms.named(name)
    if mechanism is not None:
        return mechanism
    asked = KINDS.fullmatch(name)
    if name not in CATALOGUE and asked is not None and asked["stem"] in CATALOGUE:
        stem = CATALOGUE[asked["stem"]]
        if stem.port == "output" and stem.width == 1 and stem.traits.visible and stem.traits.noise is None:
            enter({name: process(stem.name, CORRELATION if asked["kind"] == "gauss_markov" else None)})
    asked = FURTHER.fullmatch(name)
    if name not in CATALOGUE and asked is not None and asked["stem"] in CATALOGUE:
        stem = CATALOGUE[asked["stem"]]
        if any(shape.width for shape in stem.shapes.values()):
            symbol, beside = f"{stem.symbol}{asked['number']}", replace(stem.search, beside=stem.name)
            CATALOGUE[name] = replace(stem, name=name, symbol=symbol, search=beside)
    asked = registry.ON_AXIS.fullmatch(name)
    if name not in CATALOGUE and asked is not None:
        try:
            stem = find(asked["effect"])
        except AccelcalError:
            return registry.find(name)
        if not stem.axis and stem.owner in ("sensor", "mounting") and stem.name not in ("bias", "scale_factor"):
            return registry.on_axis(stem, asked["axis"])
    return registry.find(name)


def on_demand(effect: Effect) -> bool:
    """Whether an effect is one that `find` has made."""
    random = effect.port == "process" and effect.prior.source == MADE.format(effect.traits.changes)
    return random or effect.mechanism is not None or stem_of(effect) != effect.name


def has_time_constant(effect: Effect) -> bool:
    """Whether `tau` of an effect is the correlation time of a random process, and not of what the process changes."""
    return effect.port == "process" and "tau" in effect.shapes and "tau" not in find(effect.traits.changes).shapes


def stem_of(effect: Effect) -> str:
    """Name of the effect of which an effect is a further wave; its name where it is none.

    Examples
    --------
    >>> stem_of(find("tone_2")), stem_of(find("cubic"))
    ('tone', 'cubic')
    """
    asked = FURTHER.fullmatch(effect.name)
    stem = CATALOGUE.get(asked["stem"]) if asked else None
    return stem.name if stem is not None and stem.function is effect.function else effect.name


def next_name(stem: str, used: Container[str]) -> str:
    """Name under which one more wave of an effect enters beside those that are `used`.

    Examples
    --------
    >>> next_name("tone", ()), next_name("tone", ("tone", "tone_2"))
    ('tone', 'tone_3')
    """
    return next(name for n in count(1) if (name := stem if n == 1 else f"{stem}_{n}") not in used)


class Names:
    """Every effect of the catalogue as an attribute, whose value is its name; those of users appear when they enter.

    Examples
    --------
    >>> Names().cubic, "odd_quadratic" in dir(Names())
    ('cubic', True)
    """

    __slots__ = ()

    def __getattr__(self, name: str) -> str:
        if name.startswith("_"):
            raise AttributeError(name)
        try:
            return find(name).name
        except ValueError as error:
            raise AttributeError(str(error)) from None

    def __dir__(self) -> list[str]:
        return sorted(CATALOGUE)

    def __repr__(self) -> str:
        return f"Names({len(CATALOGUE)} effects; effects.names.<tab> lists them)"


names = Names()
"""The catalogue's names."""


def found_by_name(name: str, channels: Sequence[tuple[str, str]]) -> Effect:
    """The effect of a name, in a process to which recorded channels (name, unit) may be new."""
    mechanisms.side_channels(channels)
    return find(name)


def by_name(effect: Effect) -> tuple[Callable[..., Effect], tuple[str, tuple[tuple[str, str], ...]]]:
    """What a pickle of an effect holds: its name, under which the reader's catalogue has it, and what it follows.

    Raises
    ------
    PicklingError
        If the catalogue has no such effect, or another one of that name.
    """
    if CATALOGUE.get(effect.name) is not effect:
        raise PicklingError(
            f"the effect {effect.name} is not the one in the catalogue; enter it with @accelcal.effect or "
            "accelcal.load_effects, here and where it is read"
        )
    followed = mechanisms.channel_of(effect)
    return found_by_name, (effect.name, ((followed, mechanisms.driver_of(followed).unit),) if followed else ())


copyreg.pickle(Effect, by_name)  # copies of an effect are the effect itself

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
        *(
            f"| [{e.name}](#{e.name}) | {_cell(e.symbol)} | {e.unit} | {PORTS[e.port]} | {e.owner} | "
            + f"{', '.join(name for name, shape in e.shapes.items() if shape.refined) or '–'} |"
            for e in effects
        ),
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
    prior = effect.prior
    size = f"{prior.mean:g} ± {prior.scale:g}" if prior.mean else f"{prior.scale:g}"
    worse = "".join(f", as likely {m:g} times as large" for m in prior.tails[1:])
    lines.append(f"- Prior of its size: {size} ({prior.source}){worse}.")
    for label, refined in (("Refined by likelihood", True), ("Range fixed at fit time", False)):
        shapes = [f"{name} ({shape.unit})" for name, shape in effect.shapes.items() if shape.refined is refined]
        if shapes:
            lines.append(f"- {label}: {', '.join(shapes)}.")
    further = (
        (effect.width > 1, f"Columns: {', '.join(effect.parts)}"),
        (effect.needs, f"Needs the side channel {' and '.join(effect.needs)}"),
        (effect.search.includes, f"Includes: {', '.join(effect.search.includes)}"),
        (effect.traits.positive, "Only a positive coefficient is physical"),
        (effect.seen_by_sets, "No motion of a level, untouched rig can show it"),
        (not effect.traits.visible and not effect.seen_by_sets, "A diagnosis does not search for it"),
    )
    lines += [f"- {text}." for holds, text in further if holds]
    return "\n".join(lines) + "\n"


def spelled(name: str) -> str:
    """A name of the catalogue as people write it.

    Examples
    --------
    >>> spelled("odd_quadratic"), spelled("scale_factor_follows_abs_a.tau"), spelled("zero_g_output")
    ('odd quadratic', 'scale factor follows |a|.tau', 'zero-g output')
    """
    stem, point, parameter = name.partition(".")
    of = PATTERN.fullmatch(stem)
    if of is not None:  # of any recorded channel, whether it is in the catalogue or not
        driver = DRIVERS.get(of["driver"])
        name = f"{of['carrier']} follows {of['driver'] if driver is None else driver.text}{point}{parameter}"
    return name.replace("zero_g_", "zero-g ").replace("_", " ")


def _cell(text: str) -> str:
    return text.replace("|", "\\|")
