"""Widgets shared by all screens: headings, buttons, tables, notes, and the frame, look and theme of every page."""

from __future__ import annotations

import copy
import html
import itertools
import math
import re
import textwrap
import time
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from importlib import resources
from typing import Any, TypeAlias

import numpy as np
from nicegui import ui

from accelcal.app.state import Run, State, Step, Stretch
from accelcal.app.workbench import Workbench
from accelcal.data import instant
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import spelled
from accelcal.estimation.remarks import Remark
from accelcal.plots import diagnosis, plotly, residuals, timeline
from accelcal.plots.figure import Bars, Figure, Level, Line, ThemeName, ruled, share_text
from accelcal.results.comparisons import quoted
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison

MARKERS = ("o", "s", "D", "^", "P", "X")
"""Of the held-out recordings."""


@dataclass(frozen=True, slots=True)
class Picture:
    """A figure, the sentence above it and the small print."""

    headline: str
    note: str
    figure: dict[str, Any]


def picture(figure: Figure | Picture, theme: ThemeName, **config: Any) -> Picture:
    """Separate the headline from a figure, unless that is done."""
    if isinstance(figure, Picture):
        return figure
    content = plotly.as_dict(figure, theme, headline=False)
    removed = ["toImage", *config.pop("modeBarButtonsToRemove", ())]  # a button beside the headline saves it with that
    content["config"] = {"displaylogo": False, "responsive": True, "modeBarButtonsToRemove": removed, **config}
    return Picture(figure.headline, figure.small_print, content)


def marked(run: Run) -> list[tuple[float, float, str]]:
    """Stretches that are held out or excluded."""
    return [(a, b, "excluded") for a, b in run.excluded] + (
        [(*run.held_out, "held out")] if run.held_out is not None else []
    )


def data(run: Run, theme: ThemeName) -> Picture:
    """The recording with its marks, ready for brushing."""
    assert run.recording is not None
    lost = run.marks.left_out[: timeline.MOST] if run.marks is not None else ()
    names = [(*span, "" if k else timeline.LEFT_OUT) for k, span in enumerate(lost)]
    figure = timeline.linked(run.recording.without(*lost, *run.excluded), marked=[*marked(run), *names])
    first, *rest = figure.panels
    breaks = [Level(at, role="other", upright=True, text=f"break at {instant(at)} s") for at in run.breaks]
    figure = replace(figure, panels=(replace(first, marks=(*first.marks, *breaks)), *rest), key="")
    drawn = picture(figure, theme, modeBarButtonsToRemove=["lasso2d", "autoScale2d"], scrollZoom=False)
    drawn.figure["layout"] |= {"dragmode": "select", "selectdirection": "h"}
    # Plotly selects markers only: two invisible ones make the axes react to brushing.
    low, high = (float(run.recording.position.t[i]) for i in (0, -1))
    unseen = {"type": "scatter", "mode": "markers", "showlegend": False, "hoverinfo": "skip"}
    drawn.figure["data"].append({**unseen, "x": [low, high], "y": [None, None], "xaxis": "x", "yaxis": "y"})
    return drawn


def linked(
    state: State, evaluation: Evaluation | None, window: Stretch | None = None, chosen: Stretch | None = None
) -> Figure:
    """Position, output, residual and side channels with one time axis, and a stretch that was chosen."""
    marks = marked(state.run) if state.run is not None else []
    marks += [(*chosen, timeline.CHOSEN)] if chosen is not None else []
    return timeline.linked(state.data, evaluation, window=window, marked=marks)


def path_of(state: State, number: int | None = None) -> Comparison:
    """Models on the path to the current one: on one held-out recording, by default on all of them."""
    evaluations = tuple(zip(*(step.heldouts for step in state.path), strict=True))
    evaluations = evaluations if number is None else evaluations[number : number + 1]
    return Comparison(
        tuple(step.fit for step in state.path),
        tuple(step.change.label for step in state.path),
        tuple(group[0].recording for group in evaluations),
        evaluations,
        state.holds_out_parts,
    )


def labelled(step: Step) -> str:
    """What distinguishes a model from its parent, with effect names as words."""
    return " ".join(map(spelled, step.change.label.split()))


def falling(state: State, theme: ThemeName) -> Picture:
    """One bar for each model on the path, and beside the error on all held-out data that on each of the recordings."""
    compared = path_of(state)
    figure = diagnosis.error_reduction(compared)
    (panel,) = figure.panels
    measure, (factor, _) = compared.headline, ruled(compared)
    sizes = [quoted(measure, e).partition(" (")[0].replace(" ", "\N{NO-BREAK SPACE}") for e in compared]
    letters = max(12, AXIS_LETTERS // len(sizes))  # in a line: where names overlap, plotly turns and cuts them
    names = [
        f"{textwrap.fill(f'{labelled(step)}: {size}', letters)}\n{textwrap.fill(share_text(compared, i), letters)}"
        for i, (step, size) in enumerate(zip(state.path, sizes, strict=True))
    ]
    marks = [replace(m, text=()) if isinstance(m, Bars) else m for m in panel.marks]  # text would sit on the noise line
    several, top = len(state.unseen_runs), panel.y.range[1] if panel.y.range else 0.0
    if several > 1:
        for run, evaluations, marker in zip(state.unseen_runs, compared.evaluations, itertools.cycle(MARKERS)):
            errors = np.array([measure.error(evaluation) for evaluation in evaluations])
            marks.append(Line(np.arange(float(len(errors))), errors * factor, run.name, "ink", marker=marker))
            top = max(top, 1.1 * float(np.max(errors)) * factor)
    panel = replace(
        panel,
        marks=tuple(marks),
        x=replace(panel.x, title="", ticks=(range(len(names)), names)),
        y=replace(panel.y, range=(0.0, top)),
        height=panel.height - 60.0,
    )
    note = f"unseen data: {several} series; bars are their error together" if several > 1 else figure.note
    return picture(replace(figure, panels=(panel,), note=note), theme, displayModeBar=False)


def overlay(state: State, window: Stretch | None = None, chosen: Stretch | None = None) -> Figure:
    """Measured and simulated on held-out data, for every model on the path, and a stretch that was chosen."""
    evaluations = [(labelled(step), step.heldouts[state.looked_at]) for step in state.path]
    return timeline.overlay(evaluations, window=window, chosen=chosen)


def where(diagnosis: Diagnosis, theme: ThemeName) -> list[Figure | Picture]:
    """Residuals of the model on the fitted data, by variable, frequency and lag."""
    places = diagnosis.where
    return [
        picture(residuals.tiles(places), theme, displayModeBar=False),
        residuals.regions(places),
        residuals.spectrum(diagnosis.fit, places, diagnosis.channels),
        residuals.whiteness_plot(places),
        residuals.quantile_plot(places),
    ]


AXIS_LETTERS = 90
"""Letters along the abscissa of a figure in a wide window."""
WIDTH = 272
"""Width of the axes on a phone, px."""
PANEL = 150
"""Height of a panel, px."""
TALLEST = 230
"""Most that the axes of a figure with one panel take, px."""
GAP = 88
"""Height between two panels, for the labels of the upper axis and the title of the lower panel, px."""
LEFT = 62
"""Most that the labels of an ordinate take, px."""
LETTER, KEY, ROW = 6.5, 44, 19
"""Width of a letter and of a key of the legend, and height of a row of it, px."""
BESIDE = 0.02
"""Distance between a title and the middle of its panel that is still its own, as a share of the figure."""
ABSCISSA, ORDINATE = 36, 24
"""Letters in a line of a title along the abscissa, and along the ordinate."""
LINE = 16
"""Height of a line of a title, px."""
HALF = 500
"""Width of the axes of a figure that has half of a wide window, px."""

Axes: TypeAlias = "tuple[dict[str, Any], dict[str, Any]]"
"""Abscissa and ordinate of a panel."""


def narrowed(picture: Picture) -> Picture:
    """The same figure with its panels in one column, and with short lines at its sides."""
    figure = copy.copy(picture.figure)
    layout = figure["layout"] = copy.deepcopy(figure["layout"])
    panels = axes_of(layout)
    margin, left = layout["margin"], LEFT
    if len({x["domain"][0] for x, _ in panels}) > 1:
        stack(layout, panels)
    elif any(isinstance(y, str) for trace in figure["data"] for y in _listed(trace)):
        figure["data"] = [
            {**trace, "y": [y.replace(", ", ",<br>", 1) if isinstance(y, str) else y for y in _listed(trace)]}
            for trace in figure["data"]
        ]
        names = [y for trace in figure["data"] for y in trace["y"] if isinstance(y, str)]
        left = round(LETTER * max(len(line) for name in names for line in name.split("<br>")))
    elif len(panels) == 1:
        layout["height"] = min(layout["height"], margin["t"] + margin["b"] + TALLEST)
    if any([wrap_titles(axes) for axes in panels]):
        left += LINE
    if layout.get("showlegend", False):
        figure["data"] = [wrap_name(trace) for trace in figure["data"]]
        layout["shapes"] = [wrap_name(shape) for shape in layout.get("shapes", [])]
    margin["l"], margin["r"] = min(margin["l"], left), min(margin["r"], 12)
    make_room(figure, WIDTH)
    return replace(picture, figure=figure)


def roomy(picture: Picture) -> Picture:
    """The same figure with room for the legend where the window is wide and the figure half as wide."""
    figure = {**picture.figure, "layout": copy.deepcopy(picture.figure["layout"])}
    make_room(figure, HALF)
    return replace(picture, figure=figure)


def make_room(figure: dict[str, Any], width: float) -> None:
    """Make room above the axes for every row of the legend; `width` of the axes in px."""
    layout = figure["layout"]
    more = ROW * (legend_rows(figure, width) - 1)
    layout["margin"]["t"], layout["height"] = layout["margin"]["t"] + more, layout["height"] + more


def wrap_name(trace: dict[str, Any]) -> dict[str, Any]:
    """A trace whose name in the legend, where a line does not hold it, has several; plotly would cut it."""
    name = str(trace.get("name") or "")
    letters = int((WIDTH - KEY) / LETTER)
    return {**trace, "name": _wrapped(name, letters)} if len(name) > letters else trace


def wrap_titles(axes: Axes) -> bool:
    """Wrap the titles of a panel's axes and the names along its abscissa; whether its ordinate has two lines now."""
    x, y = axes
    for axis, letters in ((x, ABSCISSA), (y, ORDINATE)):
        title = axis.get("title") or {}
        if title.get("text"):
            title.update(text=_wrapped(title["text"], letters), font={**title.get("font", {}), "size": 12})
    names = x.get("ticktext")
    if isinstance(names, list) and names:
        x["tickangle"] = 0
        x["ticktext"] = [
            "<br>".join(_wrapped(part, max(8, 44 // len(names))) for part in n.split("<br>")) for n in names
        ]
    return "<br>" in str((y.get("title") or {}).get("text", ""))


def axes_of(layout: dict[str, Any]) -> list[Axes]:
    """Axes of each panel, from the upper left to the lower right."""
    axes = []
    for key, y in layout.items():
        if key.startswith("yaxis") and "overlaying" not in y:
            x = layout.get(f"xaxis{str(y.get('anchor', 'x')).removeprefix('x')}")
            if isinstance(x, dict) and "domain" in x and "domain" in y:
                axes.append((x, y))
    return sorted(axes, key=lambda pair: (-pair[1]["domain"][1], pair[0]["domain"][0]))


def stack(layout: dict[str, Any], panels: list[Axes]) -> None:
    """Give every panel the whole width and a height of its own; its title goes with it."""
    inside = len(panels) * PANEL + (len(panels) - 1) * GAP
    margin, notes = layout["margin"], layout.get("annotations", [])
    before = layout["height"] - margin["t"] - margin["b"]
    layout["height"] = inside + margin["t"] + margin["b"]
    layout["annotations"] = copy.deepcopy(notes)
    for i, (x, y) in enumerate(panels):
        middle, top = sum(x["domain"]) / 2.0, y["domain"][1]
        new_top = 1.0 - i * (PANEL + GAP) / inside
        for old, new in zip(notes, layout["annotations"], strict=True):
            if abs(old.get("x", -1.0) - middle) < BESIDE and abs(old.get("y", -1.0) - top) < BESIDE:
                new.update(x=0.5, y=new_top, text=_wrapped(old["text"], ABSCISSA))
        x["domain"], y["domain"] = [0.0, 1.0], [max(0.0, new_top - PANEL / inside), new_top]
        x["showticklabels"] = y["showticklabels"] = True
    legend = layout.get("legend", {})
    if legend.get("y", 0.0) > 1.0:
        legend["y"] = 1.0 + (legend["y"] - 1.0) * before / inside


def legend_rows(figure: dict[str, Any], width: float) -> int:
    """Lines that a horizontal legend takes: one where all fits, else its widest entry sets the columns."""
    if not figure["layout"].get("showlegend", False):
        return 1
    named = [trace for trace in figure["data"] if trace.get("showlegend", True) and trace.get("name")]
    named += [shape for shape in figure["layout"].get("shapes", []) if shape.get("showlegend")]
    groups = {trace.get("legendgroup") or trace["name"]: str(trace["name"]) for trace in named}
    names = [name.split("<br>") for name in groups.values()]
    widths = [KEY + LETTER * max(map(len, lines)) for lines in names]
    more = sum(len(lines) - 1 for lines in names)
    if sum(widths) <= width:
        return 1 + more
    return math.ceil(len(widths) / max(1, math.floor(width / max(widths)))) + more


def _listed(trace: dict[str, Any]) -> list[Any]:
    y = trace.get("y")
    return y if isinstance(y, list) else []


def _wrapped(text: str, letters: int) -> str:
    whole = re.sub(r"(?<=\d) (?=σ)", "\N{NO-BREAK SPACE}", text)  # a number stays with its unit
    return "<br>".join(textwrap.wrap(whole, letters)) if "<" not in text else text


class Uploader(ui.upload):
    """An area for files that knows whether some are on their way; its removal would lose them."""

    SLOWEST = 10.0
    """Time in which the browser has said that it sends what was dropped, s."""
    is_sending = False
    _left_at = math.inf

    def sends(self, under_way: bool) -> None:
        """Note that files begin to be sent, or that all are here."""
        self.is_sending = under_way

    @property
    def may_send(self) -> bool:
        """Whether files are on their way from it, or may be of which the browser has not said so yet."""
        self._left_at = min(self._left_at, time.monotonic())
        return self.is_sending or time.monotonic() - self._left_at < self.SLOWEST


def clear(place: ui.element) -> None:
    """Remove what stands in a place; areas that files may be on their way from are hidden until these have come."""
    for child in list(place):
        areas = [x for x in child.descendants(include_self=True) if isinstance(x, Uploader)]
        if not any([area.may_send for area in areas]):  # a list: each of them notes when it was left
            child.delete()
        elif child not in areas:  # one that is hidden itself takes no files
            child.set_visibility(False)
            clear(child)


def attribute(text: str) -> str:
    """Text escaped for an attribute of `props`."""
    return html.escape(" ".join(text.split())).replace("\\", "/")


def heading(text: str, level: int = 2) -> ui.label:
    """A heading that screen readers find."""
    return ui.label(text).classes(f"h{level}").props(f"role=heading aria-level={level}")


def button(
    text: str, icon: str, action: Callable[..., Any], *, flat: bool = False, primary: bool = False, label: str = ""
) -> ui.button:
    """A button with a name; only the suggested next step is filled."""
    widget = ui.button(text, icon=icon, on_click=action, color="primary" if primary else None)
    widget.classes("" if primary else "secondary").props(
        "no-caps " + ("unelevated" if primary else "flat" if flat else "outline")
    )
    if label:
        widget.props(f'aria-label="{attribute(label)}"')
    return widget


@contextmanager
def card(title: str = "", classes: str = "") -> Iterator[None]:
    """A sheet with a heading."""
    with ui.element("section").classes(f"sheet {classes}"):
        if title:
            heading(title)
        yield


def lines(texts: Sequence[str], kind: str = "note") -> None:
    """Sentences, one a line."""
    for text in texts:
        ui.label(text).classes(kind)


def later(box: ui.expansion, build: Callable[[], None]) -> None:
    """Build what a box holds when it is first opened, because that takes a while."""

    def opened(event: Any) -> None:
        if event.value and not box.default_slot.children:
            with box:
                build()

    box.on_value_change(opened)


def png(plot: ui.plotly, headline: ui.label) -> None:
    """A button that saves a figure with its headline as a picture."""
    save = button("PNG", "photo_camera", lambda: None, flat=True, label=f"Save as PNG: {headline.text}")
    save.props("dense").on("click", js_handler=f"() => savePicture({plot.id}, {headline.id})")


def remark_text(remark: Remark) -> str:
    """A remark without the command that a button stands for."""
    text = remark.sentence.replace(str(remark.values.get("cut", "")), "")
    return f"Suspect data: {text}."


Cell = str | Callable[[], Any]
"""Text, or a function that builds the content of a cell."""


def table(titles: Sequence[str], rows: Sequence[Sequence[Cell]], label: str) -> None:
    """A table; a cell is text, or a function that builds it."""
    name = f'aria-label="{attribute(label)}"'
    with ui.element("div").classes("scroll").props(f"tabindex=0 role=group {name}"), ui.element("table").props(name):
        with ui.element("thead"), ui.element("tr"):
            for title in titles:
                with ui.element("th").props("scope=col"):
                    ui.label(title)
        with ui.element("tbody"):
            for row in rows:
                with ui.element("tr"):
                    for cell in row:
                        with ui.element("td"):
                            if callable(cell):
                                cell()
                            else:
                                ui.label(cell)


def code(text: str, language: str, label: str) -> None:
    """Source text that can be scrolled by keyboard and copied."""
    widget = ui.code(text, language=language).classes("full")
    widget.markdown.props(f'tabindex=0 role=group aria-label="{attribute(label)}"')
    widget.copy_button.props(f'aria-label="Copy: {attribute(label)}"')


def empty(text: str) -> None:
    """A hint in place of content that does not exist yet."""
    with ui.element("section").classes("sheet empty"):
        ui.label(text)


def copies(page: Any) -> None:
    """Buttons that copy the steps so far as a Python script or as shell commands."""
    from accelcal.app.script import COPIES

    with ui.row().classes("copies"):
        for name, make in COPIES.items():

            def copy(name: str = name, make: Callable[[Any], str] = make) -> None:
                ui.clipboard.write(make(page.bench.state))
                ui.notify(f"Copied as {name}", position="bottom-right")

            button(f"Copy as {name}", "content_copy", copy, flat=True)


NARROW = 700
"""Widest window on which figures are drawn one panel a line, px; page.css stacks its columns below it."""


def dress() -> None:
    """Give a page the look and the manners of the workbench."""
    ui.colors(primary="#0072B2", positive="#009E73", negative="#B3261E", warning="#8A5A00")
    files = resources.files("accelcal.app")
    ui.add_css(files.joinpath("page.css").read_text(encoding="utf-8"))
    ui.add_head_html(f"<script>{files.joinpath('page.js').read_text(encoding='utf-8')}</script>")


class Frame:
    """What the pages of the workbench have in common: header, message, body and theme."""

    themes: ThemeSwitch
    bench: Workbench
    is_narrow = False
    """Whether the window is as narrow as that of a phone."""

    def lay_out(self) -> None:
        """Lay out the frame."""
        dress()
        with ui.header().classes("bar"):
            skip = ui.link("Skip to content").classes("skip")
            ui.label("accelcal").classes("brand")
            self.file = ui.label().classes("file")
            ui.space()
            with ui.row().classes("tools"):
                self.tools()
                self.themes = ThemeSwitch(self.rebuild)
        self.above()
        with ui.row().classes("sentence").props("role=alert") as self.alert:
            ui.icon("error_outline").props("aria-hidden=true")
            self.message = ui.label().classes("message")
        self.alert.set_visibility(False)
        self.below()
        self.body = ui.element("div").classes("body").props("tabindex=-1")
        skip.props(f"href=#{self.body.html_id}")
        # plotly.js takes a second or two to load; a hidden figure loads it before the first recording is dropped.
        ui.plotly({"data": [], "layout": {"width": 10, "height": 10}}).classes("unseen").props("aria-hidden=true")

    def tools(self) -> None:
        """Buttons in the header."""

    def above(self) -> None:
        """What stands above the message."""

    def below(self) -> None:
        """What stands below the message."""

    def rebuild(self) -> None:
        """Draw the page anew."""

    def tell(self, sentence: str) -> None:
        """Show a message, or none."""
        self.alert.set_visibility(bool(sentence))
        self.message.set_text(sentence)

    async def ask_browser(self) -> None:
        """Take the theme that the browser asks for, and note whether its window is narrow."""
        asked = f"[matchMedia('(prefers-color-scheme: dark)').matches, innerWidth <= {NARROW}]"
        dark = False
        with suppress(TimeoutError):  # a browser that is busy gets its page all the same
            dark, self.is_narrow = map(bool, await ui.run_javascript(asked, timeout=30.0))
        self.themes.set("dark" if dark else "light")

    def sized(self, picture: Picture, narrow: bool = False) -> Picture:
        """A figure for the width of this window, or for a narrow place in it."""
        return narrowed(picture) if self.is_narrow or narrow else roomy(picture)


class ThemeSwitch:
    """A button that goes from one theme to the other; `rebuild` draws the page anew."""

    def __init__(self, rebuild: Callable[[], None]) -> None:
        self.theme: ThemeName = "light"
        self._rebuild = rebuild
        self._dark = ui.dark_mode()
        self._button = button("Dark theme", "dark_mode", self._toggle, flat=True)

    def set(self, theme: ThemeName) -> None:
        """Take a theme; nothing is drawn anew."""
        self.theme = theme
        self._dark.set_value(theme == "dark")
        self._button.set_text("Light theme" if theme == "dark" else "Dark theme")
        self._button.props(f"icon={'light_mode' if theme == 'dark' else 'dark_mode'}")

    def _toggle(self) -> None:
        self.set("light" if self.theme == "dark" else "dark")
        self._rebuild()
