"""Figures for a phone: panels one under the other with their own titles, legends with room, traces untouched."""

from __future__ import annotations

import json

import pytest
from plotly.subplots import make_subplots

from accelcal.app.widgets import PANEL, ROW, Picture, axes_of, legend_rows, narrowed, roomy


def grid(columns: int, names: tuple[str, ...] = ("a", "b")) -> Picture:
    """Two rows of panels, each with its title and a trace for each name."""
    count = 2 * columns
    figure = make_subplots(rows=2, cols=columns, subplot_titles=[f"panel {i}" for i in range(count)])
    for i in range(count):
        for name in names:
            place = {"row": i // columns + 1, "col": i % columns + 1}
            figure.add_scatter(x=[0, 1], y=[i, i + 1], name=name, legendgroup=name, showlegend=i == 0, **place)
    figure.update_layout(height=460, margin={"l": 92, "r": 24, "t": 60, "b": 58}, showlegend=True)
    figure.update_layout(legend={"orientation": "h", "y": 1.1})
    content = json.loads(figure.to_json())
    content["layout"].pop("template")
    return Picture("headline", "", content)


def test_panels_stand_one_under_the_other_in_their_order_with_their_titles() -> None:
    before = grid(3)
    after = narrowed(before).figure["layout"]
    panels = axes_of(after)
    assert len(panels) == 6
    assert {tuple(x["domain"]) for x, _ in panels} == {(0.0, 1.0)}
    inside = after["height"] - after["margin"]["t"] - after["margin"]["b"]
    edges = [edge for _, y in panels for edge in reversed(y["domain"])]
    assert edges == sorted(edges, reverse=True)
    for (_, y), note, i in zip(panels, after["annotations"], range(6), strict=True):
        assert inside * (y["domain"][1] - y["domain"][0]) == pytest.approx(PANEL)
        assert note["text"] == f"panel {i}"
        assert (note["x"], note["y"]) == (0.5, y["domain"][1])


def test_the_figure_of_a_wide_window_is_left_as_it_was() -> None:
    before = grid(2)
    remaining = json.dumps(before.figure)
    narrowed(before)
    roomy(before)
    assert json.dumps(before.figure) == remaining


def test_every_row_of_the_legend_has_room() -> None:
    few, many = grid(1), grid(1, ("bias of this run re-estimated", "all parameters from the fit", "noise floor"))
    assert (legend_rows(few.figure, 272), legend_rows(many.figure, 272), legend_rows(many.figure, 900)) == (1, 3, 1)
    wide = roomy(many).figure["layout"]
    assert wide["height"] - many.figure["layout"]["height"] == ROW * (legend_rows(many.figure, 500) - 1)


def test_names_along_the_axes_are_broken_and_numbers_are_not() -> None:
    picture = grid(1)
    layout, data = picture.figure["layout"], picture.figure["data"]
    layout["xaxis"]["ticktext"] = ["base: 9.13 mm", "+ cubic: 1.98 mm<br>98 % of the excess explained"]
    layout["yaxis"]["title"] = {"text": "accelerometer residual ((m/s²)/√Hz)"}
    data[0]["y"] = ["acceleration, −2 to 2 m/s²", "time, 0 to 40 s"]
    after = narrowed(picture).figure
    assert after["data"][0]["y"] == ["acceleration,<br>−2 to 2 m/s²", "time,<br>0 to 40 s"]
    assert after["data"][1]["y"] == data[1]["y"]
    assert after["layout"]["yaxis"]["title"]["text"] == "accelerometer residual<br>((m/s²)/√Hz)"
    assert max(len(line) for name in after["layout"]["xaxis"]["ticktext"] for line in name.split("<br>")) <= 22


def test_a_name_that_no_line_of_the_legend_holds_has_two() -> None:
    long = "noise alone, with 95 % prediction interval"
    figure = narrowed(grid(1, ("in the model", long))).figure
    names = [trace["name"] for trace in figure["data"]]
    assert names[:2] == ["in the model", "noise alone, with 95 % prediction<br>interval"]
    assert legend_rows(figure, 272) == 3
    short = narrowed(grid(1, ("in the model", "noise"))).figure
    assert [trace["name"] for trace in short["data"]][:2] == ["in the model", "noise"]
    assert figure["layout"]["height"] - short["layout"]["height"] == 2 * ROW
