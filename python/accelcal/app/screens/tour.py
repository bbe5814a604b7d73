"""A tour of one minute: what each screen is for, step by step, by mouse or keyboard."""

from __future__ import annotations

from nicegui import ui

from accelcal.app import widgets

STEPS = (
    (
        "Drop a recording",
        "The sensor's output and the position of an encoder, in one file. Where the columns have other names, the page "
        "asks which is which. A part at the end is held out: no fit uses it, and the error is computed on it.",
    ),
    (
        "Fit",
        "One click estimates bias, scale factor and time offset, and compares the model with the held-out part.",
    ),
    (
        "Read the verdict",
        "The page tests every effect of the catalogue. It says which one is missing and how sure that is, which others "
        "look the same on this recording, and what to record to separate them; or that nothing is missing, and how "
        "large an effect could have hidden.",
    ),
    (
        "Add, and see the error fall",
        "Add fits again. The falling error is that of held-out data, so that a wrong effect does not help. Undo takes "
        "it back; every model stays in the tree and may be the start of another branch.",
    ),
    (
        "Look and export",
        "Residuals shows where a model fails, Model has every parameter with its uncertainty, Export has the report, "
        "the model, code for firmware, and your steps as a script.",
    ),
)
"""Title and text of each step."""


def open_tour() -> None:
    """Open the tour above the page."""
    at = 0
    with ui.dialog() as dialog, ui.card().classes("tour"):
        count = ui.label().classes("note").props("role=status")
        title = widgets.heading("", 2)
        text = ui.label()
        with ui.row().classes("line"):
            back = widgets.button("Back", "arrow_back", lambda: go(-1))
            forward = widgets.button("Next", "arrow_forward", lambda: go(1), primary=True).props("data-autofocus")
            widgets.button("Close", "close", dialog.close, flat=True)
    dialog.props('aria-label="One-minute tour"')
    dialog.on("hide", dialog.delete)

    def go(by: int) -> None:
        nonlocal at
        if at + by == len(STEPS):
            dialog.close()
            return
        at += by
        count.set_text(f"{at + 1} of {len(STEPS)}")
        title.set_text(STEPS[at][0])
        text.set_text(STEPS[at][1])
        back.set_enabled(at > 0)
        forward.set_text("Done" if at + 1 == len(STEPS) else "Next")

    go(0)
    dialog.open()
