"""What differs between recordings: the error on each that is held out, the parameters of each that is fitted."""

from __future__ import annotations

import math

from nicegui import ui

from accelcal.app import figures, widgets
from accelcal.app.page import Page
from accelcal.app.state import State, Step
from accelcal.diagnosis.policy import HOMOGENEITY_ALPHA
from accelcal.diagnosis.runs import RunValues
from accelcal.effects import spelled
from accelcal.estimation.dwell_fit import DwellFit
from accelcal.results.comparisons import density
from accelcal.results.words import amount, length, number, probability, with_unit
from accelcal.validation.differences import quoted_error


def errors(page: Page) -> None:
    """Where several recordings are held out: the error of every model on each, and whose curves are drawn."""
    state = page.bench.state
    held = state.unseen_runs
    if len(held) < 2 or state.step is None:
        return
    titles = ["held out", *(spelled(step.label) for step in state.path), "noise alone", "bias less that of the fit"]
    rows = [error_row(state, number, run.name) for number, run in enumerate(held)]
    widgets.table(titles, [*rows, error_row(state, None, "together")], "Error on each held-out recording")
    names = {number: run.name for number, run in enumerate(held)}

    async def look(event: object) -> None:
        if chosen.value != state.looked_at:
            await page.act(page.bench.look_at_heldout, int(chosen.value))

    chosen = ui.select(names, value=state.looked_at, label="Recording of the curves below", on_change=look)
    chosen.props("dense outlined").classes("grow")


def error_row(state: State, number: int | None, name: str) -> list[widgets.Cell]:
    """Errors of the models on the path on one recording, and what noise alone would give."""
    compared = figures.path_of(state, number)
    horizon = figures.path_of(state).horizon
    seen = [step.heldout if number is None else step.heldouts[number] for step in state.path]
    floor = compared.noise_floor.at(horizon) or compared.floor
    bias = "" if number is None else amount(*seen[-1].setup_bias, "m/s²")
    errors = [quoted_error(one, horizon) for one in seen]
    return [name, *("too short" if math.isnan(e) else length(e) for e in errors), length(floor.value), bias]


def fitted(page: Page) -> None:
    """Where several files are fitted: whether they agree, and the parameters that each would have alone."""
    state = page.bench.state
    step = state.step
    if step is None or len(state.train) < 2:
        return
    found = page.bench.run_values
    with widgets.card("Do the recordings agree?"):
        if found is not None:
            ui.label(agreement(found)).classes("verdict-text")
            names = (*found.parameters, *(spread.name for spread in step.fit.spreads), *own_names(step))
            widgets.table(
                ["recording", *map(spelled, names), "noise"], rows_of(step, found), "Parameters of each recording"
            )
            ui.label(
                "Each value is that of one recording alone, with its standard uncertainty; p is the probability of "
                "such differences if all have one value."
            ).classes("note")
        elif len(step.fit.runs) > 1:
            ui.label(
                "Compared as soon as the model is diagnosed."
                if page.bench.diagnosis is None or page.bench.job is not None
                else "Not compared: they could not be fitted one by one."
            )
        widgets.lines([spread.sentence(step.fit[spread.name].value) + "." for spread in step.fit.spreads], "warning")
        if step.fit.dwells is not None:
            widgets.lines([dwells_sentence(step.fit.dwells)])


def agreement(found: RunValues) -> str:
    """Whether recordings agree, in a sentence."""
    pairs = zip(found.parameters, found.p_values, strict=True)
    unlike = [f"{spelled(name)} (p {probability(float(p))})" for name, p in pairs if p <= HOMOGENEITY_ALPHA]
    if unlike:
        return f"They disagree in {', '.join(unlike)}."
    return f"The {len(found.runs)} recordings agree in every parameter that they share."


def own_names(step: Step) -> list[str]:
    """Parameters that belong to each run by their nature: the timing."""
    return list(dict.fromkeys(e.name for e in step.fit.estimates if e.run is not None))


def rows_of(step: Step, found: RunValues) -> list[list[widgets.Cell]]:
    """A row for each recording, and the probabilities below."""
    rows: list[list[widgets.Cell]] = []
    for r, run in enumerate(found.runs):
        shared = [
            amount(float(value), float(std), unit)
            for value, std, unit in zip(found.value[r], found.std[r], found.units, strict=True)
        ]
        spreads = [with_unit(number(spread.runs[r]), spread.unit) for spread in step.fit.spreads]
        of_run = {e.name: amount(e.value, e.std, e.unit) for e in step.fit.estimates if e.run == r}
        own = [of_run.get(name, "") for name in own_names(step)]
        rows.append([run, *shared, *spreads, *own, density(step.fit.runs[r].noise.all.density)])
    p_values = [f"p {probability(float(p))}" for p in found.p_values]
    p_values += [f"p {probability(spread.p_value)}" for spread in step.fit.spreads]
    return [*rows, ["one value in all", *p_values, *[""] * (len(own_names(step)) + 1)]]


def dwells_sentence(found: DwellFit) -> str:
    """What the fit leaves of its dwells."""
    rms = math.sqrt(sum(value**2 for value in found.residual) / max(1, len(found.residual)))
    scatter = f"; p {probability(found.p_value)} under all that is declared" if found.freedom > 0 else ""
    return f"{found.name or 'Dwells'}: {len(found.angle)} dwells, rms residual {number(1e3 * rms, 3)} mm/s²{scatter}."
