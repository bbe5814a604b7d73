"""Commands about accelcal itself: demo, paper, doctor."""

from __future__ import annotations

import time
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from accelcal.cli.common import (
    Json,
    UsageError,
    app,
    print_json,
    progress,
    say,
    say_line,
    suggest,
    with_exit_codes,
    writable_folder,
)
from accelcal.cli.data import write_recording
from accelcal.cli.lazy import catalogue, drawing, io, model_file, results_json, words
from accelcal.cli.overwriting import require_replaceable

if TYPE_CHECKING:
    from accelcal.demo import Hidden
    from accelcal.estimation.estimate import Fit


@app.command()
@with_exit_codes
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.", callback=writable_folder)
    ] = Path("demo"),
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 1,
    effect: Annotated[str, typer.Option("--effect", help="The effect to hide: a name, random or none.")] = "random",
) -> None:
    """Show the loop: hide an effect in two recordings, compare, see, learn, add, and watch the error fall.

    The answer is sealed in a file and opened at the end.

    Example: [bold]accelcal demo --effect random --seed 3 -o demo[/bold]
    """
    paths = [output / "run1.csv", output / "run2.csv"]
    models = [output / "m.json", output / "best.json"]
    for path in (*paths, *models):
        require_replaceable(path, f"--output {output}: ", paths)
    from accelcal.demo import hide, loop, seal

    began = time.perf_counter()
    hidden = hide(effect, seed)
    for path, recording in zip(paths, (hidden.train, hidden.holdout), strict=True):
        write_recording(recording, path)
    seal(hidden, output / "answer.json")
    hidden = replace(hidden, train=io.load(paths[0]), holdout=io.load(paths[1]))
    say_line(f"{paths[0]} and {paths[1]}: one rig, 60 s each; an effect may be hidden, answer in {output}/answer.json.")
    with progress("loop"):
        steps = loop(hidden=hidden)
    evaluation = steps.comparison.evaluations[0][0]

    def verb(name: str, command: str, text: str) -> None:
        say_line(f"\n{name}  $ accelcal {command}")
        say(text)

    model_file.save(steps.fit, models[0])
    verb("fit", f"fit {paths[0]} -o {models[0]}", values(steps.fit))
    verb("compare", f"compare {models[0]} {paths[1]}", evaluation.table().sentence)
    verb("see", f"compare {models[0]} {paths[1]} --plots {output}", words.largest_residual(evaluation.worst))
    verb("learn", f"diagnose {models[0]} {paths[0]}", steps.diagnosis.table().sentence)
    if steps.named:
        model_file.save(steps.better, models[1])
        verb("add", f"add {models[0]} {paths[0]} --effect {steps.named} -o {models[1]}", values(steps.better))
        verb("watch", f"compare {' '.join(map(str, models))} {paths[1]}", steps.comparison.table().sentence)
    classes = {name for group in steps.diagnosis.classes for name in group.members}
    confounded = steps.named and hidden.effect in classes - {steps.named}
    tied = ", which this record does not tell from it" if confounded else ""
    say_line(f"\nHidden: {hidden_text(hidden)}. Named: {steps.named or 'nothing'}{tied}.")
    drawing.save(steps.plot(), output / "demo.png")
    say_line(f"wrote {output / 'demo.png'}; this took {time.perf_counter() - began:.1f} s.")
    suggest(
        "report", models[1] if steps.named else models[0], paths[0], "--holdout", paths[1], "-o", output / "report.html"
    )


def values(fit: Fit) -> str:
    """The parameters of a fit in one line."""
    return ", ".join(f"{e.symbol} {words.amount(e.value, e.std, e.unit)}" for e in fit.estimates)


def hidden_text(hidden: Hidden) -> str:
    """The hidden effect with its coefficient and its shape parameters, each with its unit."""
    if hidden.effect is None:
        return "nothing"
    effect = catalogue.find(hidden.effect)
    exact = f"{hidden.size:.4g}".replace("-", "−")
    several = words.plain(effect.unit, hidden.size, 0.0), words.with_unit(exact, effect.unit)
    size = " = ".join(dict.fromkeys(several))
    shapes = [
        f"{name} {words.with_unit(f'{value:.4g}', effect.shapes[name].unit)}"
        for name, value in hidden.shape.items()
        if name in effect.shapes
    ]
    return ", ".join([f"{hidden.effect}, {size}", *shapes])


@app.command()
@with_exit_codes
def schema(
    name: Annotated[str | None, typer.Argument(help="Schema to print; without it all are listed.")] = None,
) -> None:
    """Print the JSON schema of what a command writes, or list all schemas.

    Example: [bold]accelcal schema diagnosis[/bold]
    """
    if name is None:
        for schema_name in results_json.SCHEMAS:
            say_line(schema_name)
        return
    try:
        print_json(results_json.schema(name))
    except ValueError as error:
        raise UsageError(str(error)) from None


@app.command()
@with_exit_codes
def doctor(json: Json = False) -> None:
    """Print versions, installed extras and the number of processors.

    Example: [bold]accelcal doctor[/bold]
    """
    import importlib.metadata as metadata
    import importlib.util
    import os
    import platform
    import shutil

    import accelcal
    from accelcal.io.decoding.known_formats import FORMATS

    extras = {
        "plot": "matplotlib",
        "report": "plotly",
        "pdf": "typst",
        "app": "nicegui",
        "live": "serial",
        "dask": "distributed",
        "dcc": "xmlschema",
        "pandas": "pandas",
        "xarray": "xarray",
        "docs": "sphinx",
        **{file_format.extra: file_format.library for file_format in FORMATS if file_format.extra},
        "peers": "filterpy",
    }
    named = {"serial": "pyserial", "nptdms": "npTDMS"}
    content: dict[str, Any] = {
        "accelcal": accelcal.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "packages": {name: metadata.version(name) for name in ("numpy", "scipy", "pyarrow", "pint", "typer", "rich")},
        "extras": {
            extra: metadata.version(named.get(package, package)) if importlib.util.find_spec(package) else None
            for extra, package in extras.items()
        },
        "chromium": shutil.which("chromium"),
    }
    if json:
        print_json(content)
        return
    say_line(f"accelcal {content['accelcal']}, Python {content['python']}, {content['platform']}")
    say_line(f"processors: {content['processors']}")
    for name, version in content["packages"].items():
        say_line(f"  {name} {version}")
    for extra, version in content["extras"].items():
        text = version or f'missing; pip install "accelcal[{extra}]"'
        say_line(f"  [{extra}] {extras[extra]} {text}")
