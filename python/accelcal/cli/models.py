"""Commands that make models: fit, add, drop, freeze."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal, cast, get_args, get_type_hints

import typer

from accelcal._support.process import within
from accelcal.cli import printing
from accelcal.cli.common import (
    NO_PRIOR,
    UNSEEN,
    Band,
    EffectsFile,
    From,
    Json,
    ModelFile,
    OfPosition,
    Output,
    Rig,
    To,
    UsageError,
    after_fit,
    app,
    deliver,
    parse_quantity,
    print_alignment,
    print_status,
    progress,
    suggest,
    with_exit_codes,
)
from accelcal.cli.lazy import data, io, model_file, summary, verbs
from accelcal.cli.overwriting import writing

if TYPE_CHECKING:
    from accelcal.estimation.engines import Method
    from accelcal.estimation.estimate import Fit
    from accelcal.filters.choice import FilterChoice
    from accelcal.model import Model, Prior


FittedRuns = Annotated[
    list[Path],
    typer.Argument(
        help="Recordings that it is fitted to again, tables of dwells among them: those of the model.", metavar="RUN..."
    ),
]
LOADED = 0.2
"""Share of the work of a command that is done when its recordings are read."""
MOST_HELD = 1e6
"""Largest value at which a parameter is held, SI."""
JOINED = "joined.parquet"
"""Name that is proposed for the recording of two loggers in one file."""
FILTER_OPTIONS = ("form", "interpolation", "integrator", "order", "carrier")
"""Options of the recursive filters."""


@app.command()
@with_exit_codes
def fit(
    context: typer.Context,
    runs: Annotated[
        list[Path],
        typer.Argument(
            help="Recordings of the same sensor, dwells or static positions of it among them, dwells also alone.",
            metavar="RUN...",
        ),
    ],
    position: OfPosition = None,
    rig: Rig = None,
    model: Annotated[str, typer.Option("--model", help="linear or cubic.")] = "linear",
    vary: Annotated[
        list[str] | None, typer.Option("--vary", help="A parameter that differs from run to run; can be repeated.")
    ] = None,
    prior: Annotated[
        Path | None, typer.Option("--prior", help="JSON of accelcal fleet: its sensors are the prior of this one.")
    ] = None,
    start: From = None,
    end: To = None,
    band: Band = None,
    method: Annotated[str, typer.Option("--method", help="auto, replay, weak, aci or cwpa.")] = "auto",
    form: Annotated[str, typer.Option("--form", help="aci: forward or inverse.")] = "forward",
    interpolation: Annotated[str, typer.Option("--interpolation", help="aci: hold, linear or cubic.")] = "cubic",
    integrator: Annotated[str, typer.Option("--integrator", help="aci: rk2, rk4 or exact.")] = "exact",
    order: Annotated[int, typer.Option("--order", help="aci, cwpa: 1 or 2.")] = 1,
    carrier: Annotated[str, typer.Option("--carrier", help="aci, cwpa: dense or factored.")] = "dense",
    output: Output = None,
    json: Json = False,
) -> None:
    """Estimate bias, scale factor and time offset (and K2, K3) with their uncertainty.

    Several recordings share the sensor's parameters; a reversed or rolled mount among them separates tilt or the
    cross-axis product.

    With --position, output and position are of two loggers: the clocks are aligned by the motion, and time_offset and
    clock_skew take the rest.

    Example: [bold]accelcal fit run12.csv --model cubic -o m.json[/bold]
    """
    from accelcal.model import Model

    chosen = {"linear": Model.linear, "cubic": Model.cubic}.get(model)
    if chosen is None:
        raise UsageError(f"--model {model!r}: expected linear or cubic")
    begin, stop = parse_quantity(start, "time", "--from"), parse_quantity(end, "time", "--to")
    width, engine = parse_quantity(band, "frequency", "--band"), method_of(context)
    with progress("fit") as report:
        recordings = load_runs(runs, rig) if position is None else of_two(runs, position, rig)
        if isinstance(engine, str):
            base = chosen().add("clock_skew") if print_alignment(*recordings) else chosen()
            base = base if prior is None else base.with_priors(priors_of(prior))
            wanted, part = varying(base, vary or []), within(report, LOADED, 1.0)
            result = verbs.fit(recordings, wanted, start=begin, end=stop, band=width, method=engine, progress=part)
        elif (
            len(recordings) != 1
            or band is not None
            or prior is not None
            or not isinstance(recordings[0], data.Recording)
        ):
            raise UsageError(
                f"--method {method} accepts one recording, no --band and no --prior; auto, replay and weak accept them"
            )
        else:
            result = verbs.fit(recordings[0], start=begin, end=stop, method=engine)
    finish_fit(result, recordings, output, json)
    if not json and position is None:
        after_fit(output, runs)
    elif not json:
        suggest("cut", *runs, "--position", position, "-o", JOINED)


def priors_of(path: Path) -> dict[str, Prior]:
    """Priors of the next sensor of a type, from the JSON of a fleet."""
    try:
        sensors = summary.Fleet.from_json(path.read_text(encoding="utf-8"))
    except (OSError, ValueError) as error:
        raise UsageError(
            f"--prior {path}: {error}; expected the JSON of a fleet: accelcal fleet FOLDER... --json > {path.name}"
        ) from None
    if not sensors.priors:
        raise UsageError(f"--prior {path}: {len(sensors.sensors)} sensor; expected a fleet of two sensors or more")
    return sensors.priors


def size_priors_of(path: Path | None) -> dict[str, Prior] | Literal["none"] | None:
    """Priors of effect sizes that an option gives: those of a fleet, none at all, or None where it is not given."""
    return "none" if path == NO_PRIOR else None if path is None else priors_of(path)


def varying(model: Model, names: Sequence[str]) -> Model:
    """A model with some parameters that differ from run to run."""
    for name in names:
        if name not in {term.name for term in model.free}:
            raise UsageError(f"--vary {name}: expected one of {', '.join(term.name for term in model.free)}")
    return model.vary(*names)


def method_of(context: typer.Context) -> Method | FilterChoice:
    """Engine that the options of `fit` name: a word, or the choices of a live filter."""
    from accelcal.estimation.engines import Method
    from accelcal.filters.choice import FilterChoice

    method, options = context.params["method"], {name: context.params[name] for name in FILTER_OPTIONS}
    if method in get_args(Method):
        for name in options:
            source = context.get_parameter_source(name)
            if source is not None and source.name == "COMMANDLINE":
                raise UsageError(
                    f"--{name} is an option of the recursive filters; add --method aci or --method cwpa, or omit it"
                )
        return cast("Method", method)
    if context.params["vary"]:
        raise UsageError(f"--vary needs --method auto, replay or weak; {method} accepts one recording")
    for name, value in {"method": method, **options}.items():
        field = get_type_hints(FilterChoice)["system" if name == "method" else name]
        if value not in get_args(field):
            expected = (*(get_args(Method) if name == "method" else ()), *get_args(field))
            raise UsageError(f"--{name} {value!r}: expected one of {', '.join(map(str, expected))}")
    return FilterChoice(system=method, model=context.params["model"], **options)


@app.command()
@with_exit_codes
def add(
    model: ModelFile,
    runs: FittedRuns,
    effects: Annotated[list[str], typer.Option("--effect", help="Effect to add; may be given several times.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Add effects to a model and refit it; shape parameters are estimated by likelihood.

    Example: [bold]accelcal add m.json run12.csv --effect cubic -o m2.json[/bold]
    """
    refit(
        lambda fitted, recordings, report: verbs.add(fitted, recordings, *effects, progress=report),
        *(model, runs, rig, output, json),
        then=("compare", model, output, UNSEEN),
    )


@app.command()
@with_exit_codes
def drop(
    model: ModelFile,
    runs: FittedRuns,
    effects: Annotated[list[str], typer.Option("--effect", help="Effect to drop; may be given several times.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Drop effects from a model and refit it.

    Example: [bold]accelcal drop m2.json run12.csv --effect cubic -o m3.json[/bold]
    """
    refit(
        lambda fitted, recordings, report: verbs.drop(fitted, recordings, *effects, progress=report),
        *(model, runs, rig, output, json),
        then=("compare", output, model, UNSEEN),
    )


@app.command()
@with_exit_codes
def freeze(
    model: ModelFile,
    runs: FittedRuns,
    at: Annotated[list[str] | None, typer.Option("--at", help="Hold NAME=VALUE (SI).")] = None,
    release: Annotated[list[str] | None, typer.Option("--release", help="Estimate NAME again.")] = None,
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Hold parameters at given values, or release them, and refit the model.

    Example: [bold]accelcal freeze m.json run12.csv --at bias=0.05 -o m2.json[/bold]
    """
    if not at and not release:
        raise UsageError("name the parameters to hold or to estimate again: --at bias=0.05 or --release bias")
    held: dict[str, float] = {}
    for text in at or ():
        name, _, value = text.partition("=")
        try:
            held[name] = float(value)
            if not abs(held[name]) <= MOST_HELD:
                raise ValueError
        except ValueError:
            raise UsageError(
                f"--at {text!r}: expected NAME=VALUE with a number in SI of at most {MOST_HELD:g}, such as bias=0.05"
            ) from None

    def again(
        fitted: Fit, recordings: list[data.Recording | data.Dwells | data.Positions], report: Callable[[float], None]
    ) -> Fit:
        model = fitted.model.release(*(release or ())).freeze(**held)
        return verbs.refit(fitted, recordings, model, report)

    refit(again, model, runs, rig, output, json, then=("diagnose", output, *runs))


def refit(
    work: Callable[[Fit, list[data.Recording | data.Dwells | data.Positions], Callable[[float], None]], Fit],
    model: Path,
    runs: Sequence[Path],
    rig: Path | None,
    output: Path | None,
    json: bool,
    then: Sequence[str | Path | None],
) -> None:
    """Make a model of another one on its recordings by `work`, deliver it, and say what comes `then`."""
    fitted = model_file.load(model)
    with progress(writing.get().command) as report:
        recordings = load_all(fitted, runs, rig)
        result = work(fitted, recordings, within(report, LOADED, 1.0))
    finish_fit(result, recordings, output, json)
    if not json:  # dwells alone show no motion to compare models on
        suggest(*(then if result.runs else ("diagnose", output, *runs)))


def finish_fit(
    result: Fit, recordings: Sequence[data.Recording | data.Dwells | data.Positions], output: Path | None, json: bool
) -> None:
    """Write and print a fit."""
    read = [recording for recording in recordings if isinstance(recording, data.Recording)]
    deliver(result, lambda fit: printing.show_fit(fit, *read), output, json, result)


def of_two(
    runs: Sequence[Path], position: Path, rig: Path | None
) -> list[data.Recording | data.Dwells | data.Positions]:
    """Read the output of one file, or three, and the position of another, aligned."""
    if len(runs) != 1:
        raise UsageError(f"--position {position}: expected one file with the output, found {len(runs)}; give one")
    return io.load_declared(runs[0], rig, position=position)


def load_runs(
    paths: Sequence[Path], rig: Path | None, single: Callable[[Path], data.Recording] | None = None
) -> list[data.Recording | data.Dwells | data.Positions]:
    """Read recordings, all outputs where there are three, or dwells where file or sidecar says so; `single`
    reads a recording of one output."""
    return [run for path in paths for run in io.load_declared(path, rig, single)]


def load_all(
    fitted: Fit, paths: Sequence[Path], rig: Path | None
) -> list[data.Recording | data.Dwells | data.Positions]:
    """Read recordings of the model's sensor, all outputs where there are three, or dwells of it."""
    return load_runs(paths, rig, lambda path: load_like(fitted, path, rig))


def load_like(fitted: Fit, run: Path, rig: Path | None) -> data.Recording:
    """Read a recording of the model's sensor; without a sidecar of its own, under the rig of the model."""
    declared = rig is not None or io.sidecar_of(run).exists()
    recording = io.load(run, rig if declared else fitted.rig)
    data.require_same_sensor(recording, fitted.rig, "the model")
    if not declared:
        print_status(f"{run}: no sidecar; the rig stored in the model is used")
    return recording
