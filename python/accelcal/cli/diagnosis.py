"""Commands that find missing effects, and compute what a motion can detect."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal._support.errors import AccelcalError
from accelcal._support.process import within
from accelcal._support.stopping import Stopped
from accelcal.cli import lazy, printing
from accelcal.cli.common import (
    Band,
    EffectsFile,
    From,
    Holdout,
    Json,
    ModelFile,
    Output,
    Rig,
    SizesFrom,
    To,
    UsageError,
    after_comparison,
    after_diagnosis,
    app,
    deliver,
    parse_quantity,
    print_json,
    print_status,
    print_written,
    progress,
    say_card,
    show_table,
    suggest,
    with_exit_codes,
    writable_file,
    writable_folder,
)
from accelcal.cli.data import rig_of_sensor
from accelcal.cli.lazy import catalogue, data, experiment, io, model_file, results_json, verbs
from accelcal.cli.models import LOADED, load_all, load_like, load_runs, size_priors_of
from accelcal.cli.overwriting import mark_of

if TYPE_CHECKING:
    from accelcal.estimation.estimate import Fit
    from accelcal.simulation.motion import Motion
    from accelcal.validation.differences import Comparison


@app.command()
@with_exit_codes
def diagnose(
    model: ModelFile,
    runs: Annotated[
        list[Path],
        typer.Argument(help="One or several recordings, tables of dwells among them or alone.", metavar="RUN..."),
    ],
    rig: Rig = None,
    holdout: Holdout = None,
    effects_file: EffectsFile = None,
    prior: SizesFrom = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Find the physical effect that a model lacks on recordings: a verdict, ranked candidates, confounded effects.

    Example: [bold]accelcal diagnose m.json run12.csv --holdout run13.csv[/bold]
    """
    from accelcal.data.recording import with_dwells
    from accelcal.diagnosis.verdict import AxesDiagnosis

    fitted, sizes = model_file.load(model), size_priors_of(prior)
    with progress("diagnose") as report:
        recordings = with_dwells(load_all(fitted, runs, rig))
        if not isinstance(recordings, data.Dwells):
            share = within(report, LOADED, 0.8 if holdout else 1.0)
            diagnosis = verbs.diagnose(fitted, recordings, prior=sizes, progress=share)
            comparison = None
            if holdout is not None:
                unseen = verbs.runs_of(load_all(fitted, [holdout], rig))
                comparison = verbs.compare(fitted if isinstance(diagnosis, AxesDiagnosis) else diagnosis.fit, unseen)
    if isinstance(recordings, data.Dwells):
        if holdout is not None or prior is not None:
            raise UsageError("--holdout and --prior need a recording of a motion; these are dwells alone")
        judged = verbs.diagnose(fitted, recordings)
        deliver(judged, printing.show, output, json)
        if judged.members and not json:
            suggest("add", model, *runs, "--effect", judged.members[0], "-o", f"{model.stem}_{judged.members[0]}.json")
        return
    if comparison is not None:
        if isinstance(diagnosis, AxesDiagnosis):
            pairs = zip(diagnosis.by_axis, comparison.evaluations, strict=False)
            diagnosis = replace(diagnosis, by_axis=tuple(replace(alone, heldout=row[0]) for alone, row in pairs))
        else:
            diagnosis = replace(diagnosis, heldout=comparison[0])
    made_from = {key for run in fitted.runs for key in (run.digest, run.session)}
    others = [r.name for r in recordings if not {r.digest, r.session} & made_from]
    if others:
        print_status(
            f"{', '.join(others)} is not what {model} was fitted to: all coefficients were estimated again on it"
        )
    deliver(diagnosis, printing.show, output, json)
    if json:
        return
    if comparison is not None:
        printing.show(comparison)
    after_diagnosis(fitted, diagnosis, model, runs)


@app.command()
@with_exit_codes
def improve(
    runs: Annotated[list[Path], typer.Argument(help="One or several recordings to fit.", metavar="RUN...")],
    holdout: Holdout = None,
    rig: Rig = None,
    most: Annotated[int, typer.Option("--max-effects", help="Largest number of effects to add.", min=0)] = 3,
    further: Annotated[
        bool, typer.Option("--next", help="Rank further runs where causes are confounded, as accelcal next does.")
    ] = False,
    effects_file: EffectsFile = None,
    prior: SizesFrom = None,
    start: From = None,
    end: To = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Fit the base model, then diagnose, add the missing effect and refit, until no effect is missing.

    Without --holdout the last of three recordings or more is held out whose axis and mount another one has, else the
    end of the first.

    Example: [bold]accelcal improve run12.csv --holdout run13.csv -o best.json[/bold]
    """
    from accelcal.estimation.estimate import require_distinct

    if further and json:
        raise UsageError("--next prints a table; for its JSON run accelcal next MODEL RUN --json")
    sizes, recordings = size_priors_of(prior), load_runs(runs, rig)
    unseen = None if holdout is None else io.load(holdout, rig)
    if unseen is not None:
        require_distinct([*(recording for recording in recordings if isinstance(recording, data.Recording)), unseen])
    steps: list[Fit] = []
    with kept_on_the_way(steps, output), progress("improve") as report:
        improvement = verbs.improve(
            recordings,
            holdout=unseen,
            most=most,
            prior=sizes,
            start=parse_quantity(start, "time", "--from"),
            end=parse_quantity(end, "time", "--to"),
            progress=report,
            on_step=steps.append,
        )
    deliver(improvement, printing.show_improvement, output, json, improvement.best)
    if further:
        try:
            printing.show_next(experiment.next_experiments(improvement, verbs.runs_of(recordings)))
        except AccelcalError as error:
            print_status(f"--next: {error}")
    if not json:
        suggest("report", output, runs[0], "-o", f"{runs[0].stem}.html")


@contextmanager
def kept_on_the_way(steps: Sequence[Fit], output: Path | None) -> Iterator[None]:
    """Where a signal ends the search, write the newest of its models to the file that was asked for."""
    try:
        yield
    except (Stopped, KeyboardInterrupt):
        if steps and output is not None:
            model_file.save(steps[-1], output)
            added = ", ".join(steps[-1].model.added) or "no effect yet"
            print_status(f"wrote {output}, the model so far ({added}); the search was not finished")
        raise


@app.command()
@with_exit_codes
def formula(
    model: ModelFile,
    run: Annotated[Path, typer.Argument(help="Recording.", metavar="RUN")],
    curve: Annotated[str, typer.Option("--curve", help="Nonparametric curve, e.g. shape_of_velocity.")],
    name: Annotated[str, typer.Option("--name", help="Name of the effect in the file of --output.")] = "own_formula",
    holdout: Holdout = None,
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Find short formulas for what depends on one variable, and say which of them the recording does not separate.

    A coefficient that follows the memory of a driver may be the answer; `accelcal add` takes it by name.
    With -o the first formula is written as an effect, for --effects-file and `accelcal add`.

    Example: [bold]accelcal formula m.json run12.csv --curve shape_of_velocity -o drag.py[/bold]
    """
    try:
        shape = catalogue.find(curve)
    except ValueError as error:
        raise UsageError(f"--curve: {error}") from None
    fitted = model_file.load(model)
    try:
        with progress("formula") as report:
            recording = load_like(fitted, run, rig)
            unseen = None if holdout is None else load_like(fitted, holdout, rig)
            result = verbs.formulas(fitted, recording, curve, holdout=unseen, progress=within(report, LOADED, 1.0))
    except data.RecordingError:
        raise
    except ValueError as error:
        raise UsageError(f"--curve {curve}: {error}") from None
    deliver(result, printing.show_formulas, None, json)
    first = result.formulas[0] if result.formulas else None
    if output and (first is None or first.mechanism):
        print_status(f"{output} is not written: {'the effect has a name' if first else 'there is no formula'}")
    if first and first.mechanism and not first.contradicted:
        suggest("add", model, run, "--effect", first.mechanism)
    if output is None or first is None or first.mechanism:
        return
    try:
        owner = shape.owner if shape.owner != "timing" else "sensor"
        effect = first.effect(name, owner=owner, port=shape.port, channels=shape.needs)
    except catalogue.ExpressionError as error:
        raise UsageError(f"--name {name}: {error}") from None
    io.atomic_write(output, effect.file)
    print_written(output)
    suggest("add", model, run, "--effects-file", output, "--effect", name)


@app.command()
@with_exit_codes
def effects(
    name: Annotated[str | None, typer.Argument(help="Describe this effect.")] = None,
    effects_file: EffectsFile = None,
) -> None:
    """List all effects, or describe one of them.

    Example: [bold]accelcal effects cubic[/bold]
    """
    if name is not None:
        say_card(catalogue.card(catalogue.find(name)))
        suggest("add", "MODEL.json", "RUN.csv", "--effect", name)
        return
    rows = [(e.name, e.unit, e.port, e.owner, e.card.split("\n", maxsplit=1)[0]) for e in catalogue.CATALOGUE.values()]
    show_table(("effect", "unit", "port", "owner", "description"), rows, wrapped=True)


@app.command()
@with_exit_codes
def power(
    run: Annotated[Path, typer.Argument(help="Recording, or a planned motion: time and position only.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    start: From = None,
    end: To = None,
    json: Json = False,
) -> None:
    """Compute what a recording or a planned motion can detect: the smallest detectable size of every effect.

    Confounded effects are listed. For a planned motion, noise density and resolution come from its sidecar, and the
    readings are at its set-points.

    Example: [bold]accelcal power run12.csv[/bold]
    """
    from accelcal.model import Model

    with progress("power") as report:
        recording = io.load(run, rig, need_accel=False)
        if len(recording.accel):
            begin, stop = parse_quantity(start, "time", "--from"), parse_quantity(end, "time", "--to")
            result = experiment.power(
                Model.linear(), recording, start=begin, end=stop, progress=within(report, LOADED, 1.0)
            )
        elif start is not None or end is not None:
            raise UsageError("--from and --to are for recordings; a planned motion is always used as a whole")
        else:
            result = experiment.power_of_set_points(recording)
    deliver(result, printing.show_power, None, json)
    if not json:
        suggest("fit", run if len(recording.accel) else None, "-o", f"{run.stem}.json")


@app.command()
@with_exit_codes
def plan(
    effects: Annotated[str, typer.Option("--effects", help="Effects to separate, separated by commas.")],
    stroke: Annotated[str, typer.Option("--stroke", help='Travel from end to end, e.g. "0.2 m".')],
    vmax: Annotated[str, typer.Option("--vmax", help='Largest speed, e.g. "0.1 m/s".')],
    amax: Annotated[str, typer.Option("--amax", help='Largest acceleration, e.g. "20 m/s^2".')],
    seconds: Annotated[float, typer.Option("--seconds", help="Length, s.")] = 60.0,
    sensor: Annotated[str | None, typer.Option("--sensor", help="ADXL105, the default, or CXL02.")] = None,
    rig: Annotated[Path | None, typer.Option("--rig", help="Sidecar of your own rig, instead of --sensor.")] = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Plan a motion that separates effects within the limits of a stage, and compute what it would detect.

    Example: [bold]accelcal plan --effects quadratic,cubic --stroke "0.2 m" --vmax "0.1 m/s" --amax "20 m/s^2"[/bold]
    """
    if rig is not None and sensor is not None:
        raise UsageError("--sensor and --rig both say which sensor it is; leave one out")
    used = rig_of_sensor("ADXL105" if sensor is None else sensor) if rig is None else io.read_sidecar(rig).rig
    with progress("plan") as report:
        result = experiment.plan(
            [name.strip() for name in effects.split(",") if name.strip()],
            stroke=printing.limit(stroke, "length", "--stroke"),
            v_max=printing.limit(vmax, "speed", "--vmax"),
            a_max=printing.limit(amax, "acceleration", "--amax"),
            seconds=seconds,
            rig=used,
            progress=report,
        )
    if output is not None:
        print_written(*write_set_points(result.motion, used, output))
    deliver(result, printing.show_plan, None, json)


STAGE = "; by default what the first recording used."


@app.command("next")
@with_exit_codes
def next_run(
    model: ModelFile,
    runs: Annotated[
        list[Path],
        typer.Argument(help="Recordings that leave a class of causes, those that were to separate it last."),
    ],
    rig: Rig = None,
    stroke: Annotated[str | None, typer.Option("--stroke", help=f'Travel of the stage, e.g. "0.2 m"{STAGE}')] = None,
    vmax: Annotated[str | None, typer.Option("--vmax", help=f'Largest speed, e.g. "0.1 m/s"{STAGE}')] = None,
    amax: Annotated[str | None, typer.Option("--amax", help=f'Largest acceleration, "20 m/s^2"{STAGE}')] = None,
    tiltable: Annotated[bool, typer.Option("--tiltable", help="The axis can be set level and upright.")] = False,
    setup: Annotated[str, typer.Option("--setup", help="Time of a change of mount or set-up.")] = "5 min",
    motion: Annotated[
        Path | None,
        typer.Option("--motion", help="Write set-points of the best planned motion.", callback=writable_file),
    ] = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Rank further runs by how well they would separate causes that recordings confound, for each minute.

    With a further recording behind the first ones, all are diagnosed together: weights before and after it.

    Example: [bold]accelcal next m.json run12.csv --stroke "0.2 m" --vmax "0.1 m/s" --amax "20 m/s^2"[/bold]
    """
    texts = (stroke, "length", "--stroke"), (vmax, "speed", "--vmax"), (amax, "acceleration", "--amax")
    limits = [None if text is None else printing.limit(text, kind, option) for text, kind, option in texts]
    seconds = parse_quantity(setup, "time", "--setup") or 0.0
    fitted = model_file.load(model)
    with progress("next") as report:
        recordings = verbs.runs_of(load_all(fitted, runs, rig))
        if len({recording.axis for recording in recordings}) > 1:
            raise UsageError("next separates the causes of one output; load one axis of the three")
        before = None
        if len(recordings) > 1:
            before = verbs.diagnose(fitted, recordings[:-1], progress=within(report, LOADED, 0.4))
        diagnosis = verbs.diagnose(fitted, recordings, progress=within(report, 0.4, 0.7))
        result = experiment.next_experiments(
            diagnosis,
            recordings,
            before=before,
            **dict(zip(("stroke", "v_max", "a_max"), limits, strict=True)),
            tiltable=tiltable,
            setup=seconds,
            progress=within(report, 0.7, 1.0),
        )
    if motion is not None:
        planned = next((run.motion for run in result.ranked if run.motion is not None), None)
        if planned is None:
            raise UsageError(f"--motion {motion}: no planned motion is among the runs; leave it out to see them")
        print_written(*write_set_points(planned, recordings[0].rig, motion))
    deliver(result, printing.show_next, output, json)


def write_set_points(motion: Motion, rig: data.Rig, path: Path) -> tuple[Path, Path]:
    """Write time and position of a planned motion, and a sidecar with the rig that it was planned for."""
    from accelcal.io.sidecar import Clock, Source

    t, p = experiment.set_points_of(motion)
    rows = "\n".join(f"{when:.6f},{where:.12f}" for when, where in zip(t, p, strict=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    sidecar = io.sidecar_of(path)
    # The output, still to be recorded, is declared too: otherwise its low-pass would be lost.
    columns: dict[str, Clock | Source] = {
        "time": Clock("t_s", unit="s"),
        "position": Source("position_m", "m"),
        "accel": Source("accel_m_per_s2", "m/s^2"),
    }
    with io.together():
        io.atomic_write(path, f"t_s,position_m\n{rows}\n")
        io.write_sidecar(rig, columns, sidecar, mark=mark_of(path))
    return path, sidecar


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
    budget: Annotated[
        bool, typer.Option("--budget", help="Split the drift: noise, start, parameters, what is missing, the rest.")
    ] = False,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Compare models with recordings: systematic error, unaided drift, one-step errors, residuals by region.

    Each of several models is compared with the first on the same recordings: whether it is better, by how much, and
    the interval of that.

    Example: [bold]accelcal compare m.json run13.csv[/bold], or
    [bold]accelcal compare m.json m2.json run13.csv run14.csv[/bold]
    """
    models, runs = models_and_runs(files)
    fits = [model_file.load(path) for path in models]
    with progress("compare") as report:
        comparison = verbs.compare(
            fits,
            verbs.runs_of(load_all(fits[0], runs, rig)),
            names=[str(path) for path in models],
            band=parse_quantity(band, "frequency", "--band"),
            start=parse_quantity(start, "time", "--from"),
            end=parse_quantity(end, "time", "--to"),
            budget=budget,
            progress=within(report, LOADED, 1.0),
        )
    content = results_json.content(comparison)

    written: list[Path] = []
    with io.together():
        if output is not None:
            io.atomic_write(output, model_file.dumps(content))
            written.append(output)
        if plots is not None:
            written += lazy.plots.write(comparison, plots)
    print_written(*written)
    if json:
        print_json(content)
    else:
        printing.show_comparison(comparison)
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


def best_of(comparison: Comparison) -> int:
    """The model that differs most for the better from the first; the first where none is surely better."""
    better = [
        (difference.pooled.percent, number)
        for number, difference in enumerate(comparison.differences, start=1)
        if difference.pooled is not None and difference.verdict == "better"
    ]
    return min(better, default=(0.0, 0))[1]
