"""The steps of the workbench as a Python script and as shell commands: what "Copy as Python" puts on the clipboard."""

from __future__ import annotations

import shlex
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

from accelcal.app.state import Run, State, Stretch, quoted


def python(state: State) -> str:
    """A script that repeats the steps to the current model."""
    loads = [f'ac.load_effects("{entry.effect.name}.py")' for entry in state.own]
    if state.recording is None:
        return "\n".join(["import accelcal as ac", "", *loads, "# load a recording first"]) + "\n"
    named = Named.of(state)
    summarised = [] if state.path else ["from accelcal.data.quality import summarise"]
    responding = responses(state, named)
    asked = ["from accelcal.response import frequency_response"] if responding else []
    lines = ["import accelcal as ac", *summarised, *asked, "", *loads]
    for run, name in named.pairs:
        lines += loading(run, name, named)
    lines += [*division(state, named), *responding]
    if not state.path:
        return "\n".join([*lines, *(f"print(summarise({n}))" for r, n in named.pairs if r.recording)]) + "\n"
    names = [f"m{i}" for i in range(len(state.path))]
    lines.append("")
    for i, step in enumerate(state.path):
        code = step.change.python.replace("PARENT", names[i - 1] if i else "")
        lines.append(f"{names[i]} = {code}")
    lines += ["", f"models = [{', '.join(names)}]", *comparing()]
    if sum(run.role == "fit" and run.recording is not None for run in in_use(state)) > 1:
        lines.insert(1 + len(summarised) + len(asked), "from accelcal.verbs import run_values")
        lines += [f"print(run_values({names[-1]}, train))  # whether the recordings agree"]
    lines += [
        f"print(ac.diagnose({names[-1]}, train).sentence)",
        f'{names[-1]}.save("model.json")',
    ]
    return "\n".join(lines) + "\n"


@dataclass(frozen=True, slots=True)
class Named:
    """Files in use with the names that they have in a script, in the order in which they are loaded."""

    pairs: tuple[tuple[Run, str], ...]

    @classmethod
    def of(cls, state: State) -> Named:
        """Those of a state that are fitted or held out; one alone is called data. Who lends a rig comes first."""
        used = in_use(state)
        lenders = {run.lender for run in used} - {""}
        lending = [run for run in state.runs if run.name in lenders and run not in used]
        runs = sorted([*lending, *used], key=lambda run: bool(run.lender))
        names = ["data"] if len(runs) == 1 else [f"run{number}" for number in range(1, len(runs) + 1)]
        return cls(tuple(zip(runs, names, strict=True)))

    def name(self, run: Run) -> str:
        """Name of a file."""
        return next(name for other, name in self.pairs if other is run)

    def lender(self, run: Run) -> tuple[Run, str]:
        """The recording whose sidecar or rig a file has, and its name."""
        return next(pair for pair in self.pairs if pair[0].name == run.lender and not pair[0].lender)


def in_use(state: State) -> list[Run]:
    """Files that are fitted or held out, in their order."""
    return [run for run in state.runs if run.source is not None and run.role != "leave out"]


def loading(run: Run, name: str, named: Named) -> list[str]:
    """Lines that load a file and leave out what is not used of it."""
    file = quoted(run.name)
    if run.dwells is not None:
        sidecar = f", {quoted(f'{run.file.stem}.toml')}" if run.sidecar is not None else ""
        return [f"{name} = ac.load_dwells({file}{sidecar})"]
    rig = f", {quoted(f'{run.file.stem}.toml')}" if run.sidecar is not None else ""
    if run.lender:
        lender, called = named.lender(run)
        rig = f", {quoted(f'{lender.file.stem}.toml')}" if lender.columns == run.columns else f", {called}.rig"
    lines = [f"{name} = ac.{'load_axes' if run.axes else 'load'}({file}{rig})"]
    if run.breaks:
        used = of_each(run, name, "part({!r}, {!r})".format(*run.used))
        lines.append(f"{name} = {used}  # one model cannot hold across a break")
    if run.excluded:
        left_out = f"without({', '.join(f'({a!r}, {b!r})' for a, b in run.excluded)})"
        lines.append(f"{name} = {of_each(run, name, left_out)}")
    return lines


def of_each(run: Run, name: str, part: str) -> str:
    """A part of a file as an expression: of every output where there are three."""
    return f"[axis.{part} for axis in {name}]" if run.axes else f"{name}.{part}"


def responded(state: State) -> list[Run]:
    """Files whose frequency response was asked for."""
    return [r for r in in_use(state) if r.recording is not None and r.data.digest in state.responded]


def responses(state: State, named: Named) -> list[str]:
    """Lines that print the frequency response of recordings."""
    return [
        line
        for run in responded(state)
        for line in (
            f"for point in frequency_response({named.name(run)}).points:",
            "    print(point.frequency, point.magnitude, point.expanded, point.phase, point.expanded_phase)",
        )
    ]


def division(state: State, named: Named) -> list[str]:
    """Lines that say what is fitted and what is held out; of one recording they are two parts."""
    if len(named.pairs) == 1:
        ((run, name),) = named.pairs
        a, b = run.held_out or (0.0, 0.0)
        train, unseen = of_each(run, name, f"without(({a!r}, {b!r}))"), of_each(run, name, f"part({a!r}, {b!r})")
        return [f"train, unseen = {train}, {unseen}"]
    fitted, held = list[str](), list[str]()
    for run in in_use(state):
        name, spread = named.name(run), "*" * bool(run.axes)
        if run.role == "fit":
            fitted.append(spread + (name if run.held_out is None else of_each(run, name, f"without({run.held_out!r})")))
        if run.holds_out:
            part = "part({!r}, {!r})".format(*run.held_out or (0.0, 0.0))
            held.append(spread + (name if run.held_out is None else of_each(run, name, part)))
    return ["", f"train = [{', '.join(fitted)}]", f"unseen = [{', '.join(held)}]"]


def comparing() -> list[str]:
    """Lines that print the held-out errors."""
    return [
        "comparison = ac.compare(models, unseen)",
        "print(comparison)",
        "for evaluations in comparison.evaluations:",
        "    for fit, evaluation in zip(models, evaluations):",
        "        print(fit.model.added, evaluation.coast_rms, evaluation.simulated_rms)",
    ]


def command_line(state: State) -> str:
    """Shell commands that repeat the steps to the current model."""
    if state.recording is None:
        return "# load a recording first\n"
    used = in_use(state)
    lines = [f"accelcal check {shlex.quote(run.name)}{rig_of(run)}" for run in used if run.recording is not None]
    for run in responded(state):
        lines += response_command(run)
    train, moving, unseen = [], [], []
    for run in used:
        cuts, fitted, held = cut(run, alone=len(used) == 1)
        lines += cuts
        train += fitted
        moving += fitted if run.recording is not None else []
        unseen += held
    data = " ".join(train)
    names = [f"m{i}.json" for i in range(len(state.path))]
    for i, step in enumerate(state.path):
        lines.append(
            step.change.command(state.own_files, data)
            .replace("PARENT", names[i - 1] if i else "")
            .replace("THIS", names[i])
        )
    if names:
        option = state.own_files
        lines += [
            f"accelcal diagnose {names[-1]} {data}{option}",
            f"accelcal compare {' '.join((*names, *unseen))}{option}",
            f"accelcal report {names[-1]} {moving[0]} --holdout {unseen[0]}{option} -o report.html",
        ]
    return "\n".join(lines) + "\n"


def response_command(run: Run) -> list[str]:
    """Commands that write the frequency response of a recording."""
    file, rig = run.name, rig_of(run)
    table, draft = (shlex.quote(f"{run.file.stem}_response{ending}") for ending in (".csv", ".xml"))
    parts = f"{option('--only', [run.used] if run.breaks else [])}{option('--without', run.excluded)}"
    lines = []
    if parts:
        used = f"{run.file.stem}_used.csv"
        lines, file, rig = [f"accelcal cut {shlex.quote(file)}{rig}{parts} -o {shlex.quote(used)}"], used, ""
    return [*lines, f"accelcal response {shlex.quote(file)}{rig} --csv {table} --dcc {draft}"]


def rig_of(run: Run) -> str:
    """The option that names the sidecar of a file where it is not beside it."""
    if run.lender:
        return f" --rig {shlex.quote(Path(run.lender).with_suffix('.toml').name)}"
    return f" --rig {shlex.quote(f'{run.file.stem}.toml')}" if run.sidecar is not None else ""


def cut(run: Run, *, alone: bool) -> tuple[list[str], list[str], list[str]]:
    """Commands that write the parts of a file, the files to fit, and those to compare with."""
    file, rig = shlex.quote(run.name), rig_of(run)
    only = option("--only", [run.used] if run.breaks else [])
    without = option("--without", run.excluded)
    if run.dwells is not None:
        return [], [file], []
    if run.axes:
        return [f"# accelcal cut takes one output: {file} is fitted whole; Python can hold a part out"], [file], [file]
    prefix = "" if alone else f"{run.file.stem}_"
    train, unseen = shlex.quote(f"{prefix}train.csv"), shlex.quote(f"{prefix}unseen.csv")
    if run.held_out is not None:
        rest = f"{only}{without}{option('--without', [run.held_out])}"
        part = f"{without}{option('--only', [run.held_out])}"
        cuts = [f"accelcal cut {file}{rig}{rest} -o {train}", f"accelcal cut {file}{rig}{part} -o {unseen}"]
        return cuts, [train], [unseen]
    whole = train if run.role == "fit" else unseen
    cuts = [f"accelcal cut {file}{rig}{only}{without} -o {whole}"] if rig or only or without else []
    name = whole if cuts else file
    return cuts, [name] if run.role == "fit" else [], [name] if run.role == "hold out" else []


def option(name: str, stretches: Sequence[Stretch]) -> str:
    """An option for each of some stretches."""
    return "".join(f" {name} {a!r}:{b!r}" for a, b in stretches)


COPIES: dict[str, Callable[[State], str]] = {"Python": python, "command line": command_line}
