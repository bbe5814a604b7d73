"""How figures look: palette, themes, and what each role of a mark is drawn with.

Colours are those of Okabe and Ito (2008), which readers with any colour vision can distinguish; line style or marker is
the second cue.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Literal

ThemeName = Literal["light", "dark"]
Role = Literal["measured", "model", "other", "floor", "residual", "band", "before", "fault", "ink", "grid"]
"""What a mark shows: the measurement, the (current) model, a second curve of it, the noise floor, a residual without
other curves, what noise alone explains, the same quantity of the model before, a fault."""
OKABE_ITO: Mapping[str, str] = MappingProxyType(
    {
        "black": "#000000",
        "orange": "#E69F00",
        "sky blue": "#56B4E9",
        "bluish green": "#009E73",
        "yellow": "#F0E442",
        "blue": "#0072B2",
        "vermillion": "#D55E00",
        "reddish purple": "#CC79A7",
    }
)


@dataclass(frozen=True, slots=True)
class LineStyle:
    """How one kind of curve is drawn, in two cues: colour, and line style or marker."""

    colour: str
    line: str
    marker: str


@dataclass(frozen=True, slots=True)
class Theme:
    """Colours of a page and of what is drawn on it."""

    name: ThemeName
    page: str
    ink: str
    grid: str
    measured: LineStyle
    model: LineStyle
    other: LineStyle
    """A second curve of the model."""
    floor: LineStyle
    """Noise floor."""
    residual: LineStyle
    """A residual drawn without other curves."""
    band: str
    """Fill of the regions expected from noise."""

    @property
    def line_styles(self) -> tuple[LineStyle, ...]:
        """All line styles, for figures with curves of equal rank."""
        return self.measured, self.model, self.other, self.floor

    def style(self, role: Role) -> LineStyle:
        """How a mark of this role is drawn."""
        if role in ("measured", "model", "other", "floor", "residual"):
            line: LineStyle = getattr(self, role)
            return line
        if role == "fault":
            return LineStyle(self.other.colour, "-", "X")
        return LineStyle({"band": self.band, "grid": self.grid}.get(role, self.ink), "-", "o")


LIGHT = Theme(
    name="light",
    page="#FFFFFF",
    ink="#1A1A1A",
    grid="#DDDDDD",
    measured=LineStyle(OKABE_ITO["black"], "-", "o"),
    model=LineStyle(OKABE_ITO["blue"], "--", "s"),
    other=LineStyle(OKABE_ITO["vermillion"], "-.", "^"),
    floor=LineStyle(OKABE_ITO["bluish green"], ":", "D"),
    residual=LineStyle(OKABE_ITO["blue"], "-", "s"),
    band=OKABE_ITO["orange"],
)

DARK = Theme(
    name="dark",
    page="#15171C",
    ink="#E8E8E8",
    grid="#3A3E47",
    measured=LineStyle("#FFFFFF", "-", "o"),  # the palette's black, for a dark page
    model=LineStyle(OKABE_ITO["sky blue"], "--", "s"),
    other=LineStyle(OKABE_ITO["yellow"], "-.", "^"),
    floor=LineStyle(OKABE_ITO["bluish green"], ":", "D"),
    residual=LineStyle(OKABE_ITO["sky blue"], "-", "s"),
    band=OKABE_ITO["orange"],
)

THEMES: Mapping[ThemeName, Theme] = MappingProxyType({"light": LIGHT, "dark": DARK})


def theme_of(name: ThemeName) -> Theme:
    """Return the theme called `name`.

    Raises
    ------
    ValueError
        If there is none.
    """
    if name not in THEMES:
        raise ValueError(f"there is no theme {name!r}; choose one of {', '.join(THEMES)}")
    return THEMES[name]


def role_of_model(number: int, count: int) -> Role:
    """Role of one of several models, in order: the last is the current one, the one before it differs in both cues."""
    return "model" if number == count - 1 else ("other", "floor")[(count - 2 - number) % 2]
