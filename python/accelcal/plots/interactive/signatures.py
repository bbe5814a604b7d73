"""How alike the signatures of effects are on a record: the map behind "cannot be told apart"."""

from __future__ import annotations

from collections.abc import Sequence
from typing import TYPE_CHECKING

from accelcal.effects import spelled
from accelcal.experiment import Power
from accelcal.experiment.signature_correlation import SignatureCorrelation, signature_correlation
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.style import OKABE_ITO, ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure

MOST = 20
"""Effects that are drawn."""


def chosen(power: Power, first: Sequence[str] = (), most: int = MOST) -> SignatureCorrelation:
    """Effects named in `first`, then those tied to another one, then the best seen; like beside like.

    Parameters
    ----------
    power : of the record.
    first : effects that must be on the map, if they have one column.
    most : effects on the map.
    """
    whole = signature_correlation(power)
    tied = [name for group in power.ties for name in group.members]
    rest = sorted(whole.names, key=lambda name: power[name].largest)
    wanted = [n for n in dict.fromkeys([*first, *tied, *rest]) if n in whole.names][:most]
    return whole.of(_chain(whole.of(wanted)))


def signatures(power: Power, first: Sequence[str] = (), *, theme: ThemeName = "light") -> Figure:
    """Draw the correlation of the signatures of effects on a record.

    Parameters
    ----------
    power : from `accelcal.power`.
    first : effects that must be on the map.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    seen = chosen(power, first)
    figure = drawing.new_figure()
    if len(seen.names) < 2:
        return drawing.message(figure, palette, "Signatures", "Fewer than two effects can be seen on this record.")
    names = [drawing.escaped(spelled(n)) for n in seen.names]
    texts = [[f"{100 * v:.0f}" if abs(v) >= 0.5 else "" for v in row] for row in seen.correlation]
    figure.add_heatmap(
        z=seen.correlation,
        x=names,
        y=names,
        text=texts,
        texttemplate="%{text}",
        textfont={"size": 10},
        zmin=-1,
        zmax=1,
        xgap=1,
        ygap=1,
        hovertemplate="%{x} and %{y}: %{z:.3f}<extra></extra>",
        colorscale=[[0.0, OKABE_ITO["blue"]], [0.5, palette.page], [1.0, OKABE_ITO["vermillion"]]],
        colorbar={"title": {"text": "ρ", "side": "top"}, "thickness": 12, "outlinewidth": 0},
    )
    drawing.format_figure(
        figure,
        palette,
        "How alike effects look on this record: correlation of their signatures, the base taken out",
        note="numbers in percent where |ρ| is 50 or more; beyond 95 % two effects cannot be told apart",
        height=drawing.BOTTOM + 24 * len(names),
        legend=False,
        left=drawing.label_margin(names),
    )
    under = 40 + int(0.8 * drawing.label_margin(names))
    figure.update_layout(margin_b=under, height=figure.layout.height + under - drawing.BOTTOM)
    figure.update_xaxes(tickangle=-50, showgrid=False, ticks="", title_text="effect (ρ has unit 1)")
    figure.update_yaxes(autorange="reversed", showgrid=False, ticks="")
    return figure


def _chain(seen: SignatureCorrelation) -> list[str]:
    """An order in which each effect follows the one that it is most like."""
    order = list(range(min(1, len(seen.names))))
    while len(order) < len(seen.names):
        left = [i for i in range(len(seen.names)) if i not in order]
        order.append(max(left, key=lambda i: abs(float(seen.correlation[order[-1], i]))))
    return [seen.names[i] for i in order]
