"""Commands about accelcal itself: demo, paper, doctor."""

from __future__ import annotations

import time
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from accelcal.cli import printing
from accelcal.cli.common import (
    Json,
    UsageError,
    app,
    print_json,
    progress,
    say_line,
    suggest,
    with_exit_codes,
    writable_folder,
)
from accelcal.cli.data import truth_text, write_recording
from accelcal.cli.lazy import catalogue, io, model_file, plots, results_json, sensors, verbs, words
from accelcal.cli.overwriting import require_replaceable

if TYPE_CHECKING:
    from accelcal.demo import Hidden


@app.command()
@with_exit_codes
def demo(
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Folder to write into.", callback=writable_folder)
    ] = Path("demo"),
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 1,
    effect: Annotated[
        str | None, typer.Option("--effect", help="Hide this effect (or random, or none) and let improve find it.")
    ] = None,
) -> None:
    """Show the main steps: simulate two recordings, fit the first, compare with the second, plot.

    With --effect, hide an effect, store the answer in a file, and find the effect from the data.

    Example: [bold]accelcal demo --effect random --seed 3 -o demo[/bold]
    """
    paths = [output / "run1.csv", output / "run2.csv"]
    for path in (*paths, output / ("m.json" if effect is None else "best.json")):
        require_replaceable(path, f"--output {output}: ", paths)
    if effect is not None:
        demo_hidden(effect, output, seed)
        return
    import numpy as np

    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
    began = time.perf_counter()
    seeds = np.random.SeedSequence(seed).spawn(2)
    for path, number in zip(paths, seeds, strict=True):
        rng = np.random.default_rng(number)
        simulated = sensors.simulate("interleaved", seconds=60.0, rig=sensors.ADXL105_RIG, parameters=truth, rng=rng)
        write_recording(simulated.recording, path)
        count = len(simulated.recording.accel)
        say_line(f"simulated {path}: 60 s, {count} output samples; true values: {truth_text(truth)}")
    say_line(f"\n$ accelcal fit {paths[0]} -o {output / 'm.json'}")
    first = io.load(paths[0])
    with progress("fit") as report:
        fitted = verbs.fit(first, progress=report)
    model_file.save(fitted, output / "m.json")
    printing.show_fit(fitted, first)
    say_line(f"\n$ accelcal compare {output / 'm.json'} {paths[1]} --plots {output}")
    with progress("compare") as report:
        comparison = verbs.compare(fitted, io.load(paths[1]), progress=report)
    printing.show_comparison(comparison)
    for path in plots.write(comparison, output):
        say_line(f"wrote {path}")
    say_line(f"\nThis took {time.perf_counter() - began:.1f} s.")
    suggest("demo", "--effect", "random", "-o", output)


def demo_hidden(effect: str, output: Path, seed: int) -> None:
    """Hide an effect in two recordings and find it with `improve`."""
    from accelcal.demo import hide, seal

    hidden = hide(effect, seed)
    paths = [output / "run1.csv", output / "run2.csv"]
    for path, recording in zip(paths, (hidden.train, hidden.holdout), strict=True):
        write_recording(recording, path)
    seal(hidden, output / "answer.json")
    say_line(f"{paths[0]} and {paths[1]} may contain a hidden effect; the answer is in {output / 'answer.json'}.")
    say_line(f"\n$ accelcal improve {paths[0]} --holdout {paths[1]} -o {output / 'best.json'}")
    with progress("improve") as report:
        improvement = verbs.improve(hidden.train, holdout=hidden.holdout, progress=report)
    model_file.save(improvement.diagnosis.fit, output / "best.json")
    printing.show_improvement(improvement)
    say_line(f"\nFound: {', '.join(improvement.effects) or 'nothing'}. Hidden: {hidden_text(hidden)}.")
    suggest("report", output / "best.json", paths[0], "--holdout", paths[1], "-o", output / "report.html")


def hidden_text(hidden: Hidden) -> str:
    """The hidden effect with its coefficient and its shape parameters, each with its unit."""
    if hidden.effect is None:
        return "nothing"
    effect = catalogue.find(hidden.effect)
    size = f"{words.plain(effect.unit, hidden.size, 0.0)} = {words.with_unit(f'{hidden.size:.4g}', effect.unit)}"
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
