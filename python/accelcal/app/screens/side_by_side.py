"""Two models side by side: two nodes of the tree, or one beside a model of another session or of a model file."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import side_by_side, widgets
from accelcal.app.page import Page
from accelcal.app.screens import uploads
from accelcal.app.side_by_side import Difference
from accelcal.app.state import State
from accelcal.effects import spelled
from accelcal.estimation.noise_effects import NoiseEffect
from accelcal.model import Estimate
from accelcal.results.words import amount, length, number, plain
from accelcal.validation.comparison import Evaluation
from accelcal.validation.stretches import headline_horizon, quoted_error


def card(page: Page) -> None:
    """Choose two models, and see their parameters and errors."""
    state = page.bench.state
    with widgets.card("Two models side by side"):
        names = list(state.models)
        if len(names) > 1:
            pair = chosen(page, names)
            with ui.row().classes("line"):
                select(page, names, 0)
                select(page, names, 1)
            compared(state, pair)
            errors(page, pair)
        else:
            ui.label("A second model of the tree, or one of another sensor, can stand beside this one.").classes("note")
        uploads.drop(page, "Drop a model (.json) or another session (.accelcal)", guest=True)


def chosen(page: Page, names: list[str]) -> tuple[str, str]:
    """The two models that were chosen; the first and the last where they are no longer there."""
    if page.pair is None or not set(page.pair) <= set(names):
        page.pair = (names[0], names[-1])
    return page.pair


def select(page: Page, names: list[str], side: int) -> None:
    """The choice of one of the two."""
    assert page.pair is not None

    def choose() -> None:
        first, second = page.pair or ("", "")
        page.pair = (str(made.value), second) if side == 0 else (first, str(made.value))
        page.rebuild()

    label = ("First model", "Second model")[side]
    made = ui.select(names, value=page.pair[side], label=label, on_change=choose)
    made.props("dense outlined").classes("grow")


def compared(state: State, pair: tuple[str, str]) -> None:
    """Parameters of both, and how they differ."""
    first, second = (state.models[name] for name in pair)
    rows = [row(one) for one in side_by_side.differences(first, second)]
    widgets.table(["parameter", "first", "second", "difference", "in joint σ"], rows, "Parameters of two models")
    note = "Joint σ is the root of the sum of both variances, that of independent fits."
    if {digest for _, digest in first.sources} & {digest for _, digest in second.sources}:
        note += " These two share recordings and their noise, so that it is too large for most of their differences."
    ui.label(note).classes("note")


def row(one: Difference) -> list[widgets.Cell]:
    """One parameter."""
    difference = "" if one.value is None else plain(one.unit, one.value, one.std)
    sigma = "" if one.sigma is None else f"{number(one.sigma, 3)} σ"
    return [spelled(one.name), text(one.first), text(one.second), difference, sigma]


def text(e: Estimate | NoiseEffect | None) -> str:
    """A value with its uncertainty, or that the model has none."""
    return "not in it" if e is None else amount(e.value, e.std, e.unit)


def errors(page: Page, pair: tuple[str, str]) -> None:
    """Errors of both on what is held out here, and of guests on what their own session holds out."""
    bench, state = page.bench, page.bench.state
    for guest in state.guests:
        if guest.name in pair and guest.own is not None:
            ui.label(f"{guest.name}: {own_error(guest.own)} on what its own session holds out ({guest.own.recording}).")
    if not side_by_side.same_sensor([state.models[name] for name in pair], state):
        ui.label("One of them is of another sensor: its errors on the recordings of this session mean nothing.")
        return
    seen = bench.pair(pair)
    if seen is None:
        widgets.button("Compare on held-out data", "compare_arrows", lambda: page.act(bench.compare_pair, pair))
        return
    for which, label in (("", "Errors of two models on held-out data"), ("changes", "Changes of the errors")):
        table = seen.table(which)
        head, rows = table.cells
        widgets.lines([*table.alarms, *([] if which else [table.sentence]), *table.notes])
        widgets.table(head, rows, label)


def own_error(seen: Evaluation) -> str:
    """The error of a model on its own held-out data, in words."""
    horizon = headline_horizon(seen)
    called = "free-running error" if horizon is None else f"drift after {horizon:g} s"
    return f"{called} {length(quoted_error(seen, horizon))}"
