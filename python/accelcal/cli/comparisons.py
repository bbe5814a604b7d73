"""Command that judges models on recordings: compare."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal._support.progress import within
from accelcal.cli.common import (
    Band,
    EffectsFile,
    From,
    Json,
    Output,
    Rig,
    To,
    UsageError,
    app,
    load_own_effects,
    parse_quantity,
    print_json,
    print_status,
    progress,
    with_exit_codes,
    writable_folder,
)
from accelcal.cli.hints import after_comparison
from accelcal.cli.models import LOADED, load_like

if TYPE_CHECKING:
    from accelcal.validation.differences import Comparison


@app.command()
@with_exit_codes
def compare(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="One or several model files (NAME.json), then one or several recordings.",
            metavar="MODEL... RUN...",
            show_default=False,
        ),
    ],
    rig: Rig = None,
    band: Band = None,
    start: From = None,
    end: To = None,
    plots: Annotated[
        Path | None, typer.Option("--plots", help="Write figures into this folder.", callback=writable_folder)
    ] = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Compare models with recordings: unaided drift, one-step prediction errors, residuals by region.

    Each of several models is compared with the first on the same recordings: whether it is better, by how much, and
    the interval of that.

    Example: [bold]accelcal compare m.json run13.csv[/bold], or
    [bold]accelcal compare m.json m2.json run13.csv run14.csv[/bold]
    """
    from accelcal.cli.printing import show_comparison
    from accelcal.io import atomic_write, together
    from accelcal.results import json as results_json
    from accelcal.results import model_file
    from accelcal.workflow import compare as compare_with

    load_own_effects(effects_file)
    models, runs = models_and_runs(files)
    fits = [model_file.load(path) for path in models]
    with progress("compare") as report:
        comparison = compare_with(
            fits,
            [load_like(fits[0], path, rig) for path in runs],
            names=[str(path) for path in models],
            band=parse_quantity(band, "frequency", "--band"),
            start=parse_quantity(start, "time", "--from"),
            end=parse_quantity(end, "time", "--to"),
            progress=within(report, LOADED, 1.0),
        )
    content = results_json.content(comparison)

    written: list[Path] = []
    with together():
        if output is not None:
            atomic_write(output, model_file.dumps(content))
            written.append(output)
        if plots is not None:
            from accelcal.plots import write

            written += write(comparison, plots)
    for path in written:
        print_status(f"wrote {path}")
    if json:
        print_json(content)
    else:
        show_comparison(comparison)
        best = best_of(comparison)
        after_comparison(fits[best], models[best], runs[0])


def models_and_runs(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The model files, which come first, and the recordings.

    Raises
    ------
    UsageError
        If there is no recording, or a model is given twice.
    """
    count = next((i for i, path in enumerate(files) if i and path.suffix != ".json"), len(files))
    models, runs = list(files[:count]), list(files[count:])
    if not runs:
        raise UsageError(f"found {len(files)} files and no recording among them; expected MODEL.json RUN.csv")
    late = next((path for path in runs if path.suffix == ".json"), None)
    if late is not None:
        raise UsageError(f"{late} comes after the recording {runs[0]}; give all model files first, then the recordings")
    twice = next((path for path in models if models.count(path) > 1), None)
    if twice is not None:
        raise UsageError(f"{twice} is given twice; a model does not differ from itself: name another model file")
    return models, runs


def best_of(found: Comparison) -> int:
    """The model that differs most for the better from the first; the first where none is surely better."""
    better = [
        (one.pooled.percent, number)
        for number, one in enumerate(found.differences, start=1)
        if one.pooled is not None and one.verdict == "better"
    ]
    return min(better, default=(0.0, 0))[1]
