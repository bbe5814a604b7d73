"""The steps of the workbench as a Python script and as shell commands: what "Copy as Python" puts on the clipboard."""

from __future__ import annotations

import shlex
from collections.abc import Callable

from accelcal.app.state import State, quoted


def python(state: State) -> str:
    """A script that repeats the steps to the current model."""
    lines = ["import accelcal as ac", ""]
    lines += [f'ac.load_effects("{own.effect.name}.py")' for own in state.own]
    if state.file is None or state.recording is None:
        return "\n".join([*lines, "# load a recording first"]) + "\n"
    sidecar = f", {quoted(f'{state.file.stem}.toml')}" if state.sidecar is not None else ""
    lines += [f"data = ac.load({quoted(state.file.name)}{sidecar})"]
    if state.breaks:
        lines.append(f"data = data.part({state.used[0]!r}, {state.used[1]!r})  # one model cannot hold across a break")
    if state.excluded:
        lines.append(f"data = data.without({', '.join(f'({a!r}, {b!r})' for a, b in state.excluded)})")
    if state.held_out is not None:
        a, b = state.held_out
        lines += [f"train, unseen = data.without(({a!r}, {b!r})), data.part({a!r}, {b!r})"]
    else:
        other = state.other.name if state.other is not None else ""
        lines += [f"train, unseen = data, ac.load({quoted(other)})"]
    if not state.path:
        lines.insert(1, "from accelcal.data.summary import summarise")
        return "\n".join([*lines, "print(summarise(data))"]) + "\n"
    names = [f"m{i}" for i in range(len(state.path))]
    lines.append("")
    for i, step in enumerate(state.path):
        made = step.change.python.replace("PARENT", names[i - 1] if i else "")
        lines.append(f"{names[i]} = {made}")
    lines += [
        "",
        f"models = [{', '.join(names)}]",
        "for m, seen in zip(models, ac.history(models, unseen)):",
        "    print(m.model.added, seen.coast_rms, seen.simulated_rms)",
        f"print(ac.diagnose({names[-1]}, train).sentence)",
        f'ac.save_model({names[-1]}, "model.json")',
    ]
    return "\n".join(lines) + "\n"


def command_line(state: State) -> str:
    """Shell commands that repeat the steps to the current model."""
    if state.file is None or state.recording is None:
        return "# load a recording first\n"
    run = shlex.quote(state.file.name)
    rig = f" --rig {shlex.quote(state.file.stem + '.toml')}" if state.sidecar is not None else ""
    lines = [f"accelcal check {run}{rig}"]
    only = f" --only {state.used[0]!r}:{state.used[1]!r}" if state.breaks else ""
    without = "".join(f" --without {a!r}:{b!r}" for a, b in state.excluded)
    if state.held_out is not None:
        a, b = state.held_out
        held = f" --only {a!r}:{b!r}"
        lines.append(f"accelcal cut {run}{rig}{only}{without} --without {a!r}:{b!r} -o train.csv")
        lines.append(f"accelcal cut {run}{rig}{without}{held} -o unseen.csv")
        unseen = "unseen.csv"
    else:
        lines.append(f"accelcal cut {run}{rig}{only}{without} -o train.csv")
        unseen = shlex.quote(state.other.name if state.other is not None else "")
    names = [f"m{i}.json" for i in range(len(state.path))]
    for i, step in enumerate(state.path):
        lines.append(
            step.change.command(state.own_files).replace("PARENT", names[i - 1] if i else "").replace("THIS", names[i])
        )
    if names:
        option = state.own_files
        lines.append(f"accelcal diagnose {names[-1]} train.csv{option}")
        lines.append(f"accelcal history {' '.join(names)} --on {unseen}{option}")
        lines.append(f"accelcal report {names[-1]} train.csv --holdout {unseen}{option} -o report.html")
    return "\n".join(lines) + "\n"


COPIES: dict[str, Callable[[State], str]] = {"Python": python, "command line": command_line}
