"""Candidates by what each explains, with brackets around those that cannot be told apart."""

from __future__ import annotations

from typing import TYPE_CHECKING

from accelcal.diagnosis.search.scan import Candidate
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.plots import style
from accelcal.plots.interactive import drawing
from accelcal.plots.numbers import candidate_groups
from accelcal.plots.style import Theme, ThemeName

if TYPE_CHECKING:
    from plotly.graph_objects import Figure


def ranking(diagnosis: Diagnosis, *, theme: ThemeName = "light") -> Figure:
    """Draw equivalent standard deviations of each candidate; significant ones filled, ties in brackets.

    Parameters
    ----------
    diagnosis : from `accelcal.diagnose`.
    theme : "light" or "dark".

    Raises
    ------
    MissingExtra
        If plotly is not installed.
    """
    palette = style.theme_of(theme)
    figure = drawing.new_figure()
    groups = candidate_groups(diagnosis)
    if not groups:
        return drawing.message(figure, palette, "Candidates", "No candidate could be tested on this record.")
    flat = [c for group in groups for c in group]
    names = [drawing.escaped(spelled(c.effect)) for c in flat]
    for filled in (True, False):
        _bars(figure, flat, [c.p_value < diagnosis.alpha for c in flat], filled=filled, palette=palette)
    top = max(c.snr for c in flat)
    _brackets(figure, groups, 1.2 * top, palette)
    drawing.format_figure(
        figure,
        palette,
        f"What the model lacks: {diagnosis.scan.examined} candidates examined",
        note=f"family-wise false-alarm rate {diagnosis.alpha:g}",
        height=drawing.BOTTOM + 20 + 30 * len(flat),
        left=drawing.label_margin(names),
    )
    figure.update_xaxes(
        title_text=drawing.axis_title("what it explains", "equivalent standard deviations"), range=[0, 1.42 * top]
    )
    figure.update_yaxes(
        tickvals=list(range(len(flat))),
        ticktext=names,
        range=[len(flat) - 0.4, -0.6],
        showgrid=False,
        ticks="",
    )
    return figure


def _bars(figure: Figure, flat: list[Candidate], significant: list[bool], *, filled: bool, palette: Theme) -> None:
    """Bars of the candidates that are significant, or of those that are not."""
    rows = [i for i, found in enumerate(significant) if found == filled]
    chosen = palette.model if filled else palette.floor
    if rows:
        figure.add_bar(
            y=rows,
            x=[flat[i].snr for i in rows],
            orientation="h",
            name="significant" if filled else "no evidence",
            width=0.62,
            marker={
                "color": chosen.colour if filled else drawing.translucent(chosen.colour, 0.15),
                "line": {"color": chosen.colour, "width": 1.5},
                "pattern": {"shape": "" if filled else "/", "size": 5},
            },
            text=[f"{flat[i].snr:.1f} σ" for i in rows],
            textposition="outside",
            cliponaxis=False,
            customdata=[[_amount(flat[i]), f"{flat[i].p_value:.2g}"] for i in rows],
            hovertemplate="%{x:.1f} σ, family-wise p %{customdata[1]}<br>%{customdata[0]}<extra></extra>",
        )


def _brackets(figure: Figure, groups: list[list[Candidate]], x: float, palette: Theme) -> None:
    """A bracket at `x` around each class of several candidates."""
    begin = 0
    for group in groups:
        end = begin + len(group) - 1
        if len(group) > 1:
            figure.add_scatter(
                x=[x * 0.985, x, x, x * 0.985],
                y=[begin - 0.3, begin - 0.3, end + 0.3, end + 0.3],
                mode="lines",
                line={"color": palette.other.colour, "width": 2},
                hoverinfo="skip",
                showlegend=False,
            )
            figure.add_annotation(
                x=x,
                y=0.5 * (begin + end),
                text="cannot be<br>told apart",
                showarrow=False,
                xanchor="left",
                xshift=6,
                align="left",
            )
        begin = end + 1


def _amount(c: Candidate) -> str:
    if len(c.estimate) == 1:
        return drawing.escaped(f"{c.estimate[0]:.4g} ± {c.std[0]:.2g} {c.unit}, at most {c.largest:.3g}")
    return drawing.escaped(f"{len(c.estimate)} coefficients, at most {c.largest:.3g}")
