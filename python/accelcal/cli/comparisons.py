"""Commands that judge models on recordings: compare, history."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

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
from accelcal.cli.hints import after_comparison, fitted_files, held_out, suggest
from accelcal.cli.models import LOADED, load_like

if TYPE_CHECKING:
    from accelcal.validation.differences import PairedComparison


@app.command()
@with_exit_codes
def compare(
    files: Annotated[
        list[Path],
        typer.Argument(
            help="A model file and a recording; or several model files (NAME.json), then one or several recordings.",
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
    """Compare a fitted model with a recording: unaided drift, one-step prediction errors, residuals by region.

    Of several models, each is compared with the first on the same recordings: whether it is better, by how much, and
    the interval of that.

    Example: [bold]accelcal compare m.json run13.csv[/bold], or
    [bold]accelcal compare m.json m2.json run13.csv run14.csv[/bold]
    """
    load_own_effects(effects_file)
    models, runs = models_and_runs(files)
    part = {
        "band": parse_quantity(band, "frequency", "--band"),
        "start": parse_quantity(start, "time", "--from"),
        "end": parse_quantity(end, "time", "--to"),
    }
    if len(models) > 1:
        compare_several(models, runs, rig, part, plots, output, json)
    else:
        compare_one(models[0], runs[0], rig, part, plots, output, json)


def models_and_runs(files: Sequence[Path]) -> tuple[list[Path], list[Path]]:
    """The model files, which come first, and the recordings.

    Raises
    ------
    UsageError
        If there is no recording, or several for one model.
    """
    count = next((i for i, path in enumerate(files) if i and path.suffix != ".json"), len(files))
    models, runs = list(files[:count]), list(files[count:])
    if not runs:
        raise UsageError(f"found {len(files)} files and no recording among them; expected MODEL.json RUN.csv")
    late = next((path for path in runs if path.suffix == ".json"), None)
    if late is not None:
        raise UsageError(f"{late} comes after the recording {runs[0]}; give all model files first, then the recordings")
    if len(models) == 1 and len(runs) > 1:
        raise UsageError(
            f"one model and {len(runs)} recordings; give one recording, or at least two model files (NAME.json), whose "
            "difference is then taken over all recordings"
        )
    return models, runs


def compare_one(
    model: Path, run: Path, rig: Path | None, part: dict[str, Any], plots: Path | None, output: Path | None, json: bool
) -> None:
    """One model on one recording."""
    from accelcal.cli.printing import show_comparison
    from accelcal.results import json as results_json
    from accelcal.results import model_file
    from accelcal.workflow import compare as compare_with

    fitted = model_file.load(model)
    with progress("compare") as report:
        seen = compare_with(fitted, load_like(fitted, run, rig), report=within(report, LOADED, 1.0), **part)
    content = results_json.content(seen)

    def draw(folder: Path) -> list[Path]:
        from accelcal.plots import write

        return write(fitted, seen, folder)

    write_results(content, draw, plots, output)
    if json:
        print_json(content)
    else:
        show_comparison(seen)
        after_comparison(fitted, model, run)


def compare_several(
    models: Sequence[Path],
    runs: Sequence[Path],
    rig: Path | None,
    part: dict[str, Any],
    plots: Path | None,
    output: Path | None,
    json: bool,
) -> None:
    """Each model against the first, on the same recordings."""
    from accelcal.cli.printing import show
    from accelcal.results import json as results_json
    from accelcal.results import model_file
    from accelcal.workflow import compare_paired

    twice = next((path for path in models if models.count(path) > 1), None)
    if twice is not None:
        raise UsageError(f"{twice} is given twice; a model does not differ from itself: name another model file")
    fits = [model_file.load(path) for path in models]
    with progress("compare") as report:
        recordings = [load_like(fits[0], path, rig) for path in runs]
        share = within(report, LOADED, 1.0)
        found = compare_paired(fits, recordings, names=[str(path) for path in models], report=share, **part)
    content = results_json.content(found)

    def draw(folder: Path) -> list[Path]:
        from accelcal.plots.timeline import write_overlays

        return write_overlays(found, folder)

    write_results(content, draw, plots, output)
    if json:
        print_json(content)
    else:
        show(found)
        best = best_of(found)
        after_comparison(fits[best], models[best], runs[0])


def best_of(found: PairedComparison) -> int:
    """The model that differs most for the better from the first; the first where none is surely better."""
    better = [
        (one.pooled.percent, number)
        for number, one in enumerate(found.differences, start=1)
        if one.pooled is not None and one.verdict == "better"
    ]
    return min(better, default=(0.0, 0))[1]


def write_results(
    content: dict[str, Any], draw: Callable[[Path], list[Path]], plots: Path | None, output: Path | None
) -> None:
    """Write numbers and figures, all of them or none."""
    from accelcal.io import atomic_write, together
    from accelcal.results import model_file

    written: list[Path] = []
    with together():
        if output is not None:
            atomic_write(output, model_file.dumps(content))
            written.append(output)
        if plots is not None:
            written += draw(plots)
    for path in written:
        print_status(f"wrote {path}")


@app.command()
@with_exit_codes
def history(
    models: Annotated[
        list[Path], typer.Argument(help="Model files, in the order in which effects were added.", metavar="MODEL...")
    ],
    on: Annotated[Path, typer.Option("--on", help="Recording that no model was fitted to.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    json: Json = False,
) -> None:
    """Compare several models with one held-out recording.

    Example: [bold]accelcal history m.json m2.json --on run13.csv[/bold]
    """
    from accelcal.cli.printing import show
    from accelcal.results import json as results_json
    from accelcal.results import model_file
    from accelcal.workflow import history as history_of

    load_own_effects(effects_file)
    fits = [model_file.load(path) for path in models]
    with progress("history") as report:
        seen = history_of(fits, load_like(fits[0], on, rig), report=within(report, LOADED, 1.0))
    if json:
        print_json(results_json.content(seen))
    else:
        show(seen)
        fitted = fitted_files(fits[-1], models[-1], on)
        suggest("report", models[-1], fitted[0], *held_out(on), "-o", f"{models[-1].stem}.html")
