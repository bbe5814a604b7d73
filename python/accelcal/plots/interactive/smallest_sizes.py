"""Detection limits of a record: the largest contribution that each effect can make without being detected."""

from __future__ import annotations

from typing import TYPE_CHECKING

from accelcal.effects import find, spelled
from accelcal.experiment import Detectability, Power
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST = 50
"""Effects that are drawn at each port."""
ROW, GAP = 20, 90
"""Height of a row, and of the space between panels, pixels."""


def detectable_at(power: Power, port: str) -> list[Detectability]:
    """Effects that are detectable at the sensor ("output") or at the encoder ("position"), smallest first."""
    return sorted(
        (s for s in power.detectabilities if s.seen and (find(s.effect).port == "position") == (port == "position")),
        key=lambda s: s.largest,
    )


def detectable_sizes(power: Power, *, theme: ThemeName = "light") -> Figure:
    """Draw the size of each effect that is found with 95 % probability, as its largest contribution.

    Parameters
    ----------
    power : from `accelcal.power`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    panels = [
        (detectable_at(power, port)[:MOST], unit, title)
        for port, unit, title in (("output", "m/s²", "at the sensor"), ("position", "m", "at the encoder"))
    ]
    panels = [p for p in panels if p[0]]
    if not panels:
        return drawing.message(
            drawing.new_figure(), palette, "Detection limits", "No effect is detectable on this record."
        )
    heights = [len(p[0]) for p in panels]
    total = sum(heights)
    room = ROW * (total + len(panels)) + GAP * (len(panels) - 1)
    figure = drawing.new_figure(
        len(panels),
        1,
        row_heights=[(h + 1.0) / (total + len(panels)) for h in heights],
        subplot_titles=[title for _, _, title in panels],
        vertical_spacing=GAP / room if len(panels) > 1 else 0.0,
    )
    for row, (several, unit, _) in enumerate(panels, 1):
        names = [drawing.escaped(spelled(s.effect)) for s in several]
        figure.add_scatter(
            x=[s.largest for s in several],
            y=names,
            mode="markers",
            showlegend=False,
            row=row,
            col=1,
            marker={"color": palette.model.colour, "symbol": "diamond", "size": 8},
            customdata=[f"{min(s.smallest):.3g} {s.unit}" for s in several],
            hovertemplate="%{y}: %{customdata}, at most %{x:.3g} " + unit + "<extra></extra>",
        )
        scale = drawing.logarithmic(0.7 * several[0].largest, 1.4 * several[-1].largest)
        title = drawing.axis_title("largest contribution at the smallest detectable size", unit)
        figure.update_xaxes(**scale, title_text=title, row=row, col=1)
        figure.update_yaxes(range=[len(several) - 0.5, -0.5], row=row, col=1)
    undetectable = [spelled(s.effect) for s in power.detectabilities if not s.seen]
    drawing.format_figure(
        figure,
        palette,
        f"Detection limits of this record: 95 % probability, {power.examined} alternatives",
        note=f"not detectable: {', '.join(undetectable)}" if undetectable else "",
        height=drawing.BOTTOM + room,
        legend=False,
        titled=True,
        left=drawing.label_margin([s.effect for several, _, _ in panels for s in several]),
    )
    return figure
