"""The command line: it reads options, calls the public functions and speaks; it holds no physics.

Grammar everywhere: model first, recording second. Data go to stdout, talk to stderr.
Exit codes: 0 fine, 2 usage, 3 bad data, 4 not identifiable, 130 interrupted.
"""

from __future__ import annotations

import functools
import inspect
import shlex
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, NoReturn

import typer

if TYPE_CHECKING:
    from accelcal.fit import Fit
    from accelcal.power import Plan
    from accelcal.recording import Recording
    from accelcal.rig import Rig as RigOf

USAGE, BAD_DATA, NOT_IDENTIFIABLE, INTERRUPTED = 2, 3, 4, 130

app = typer.Typer(
    name="accelcal",
    no_args_is_help=True,
    add_completion=True,
    pretty_exceptions_enable=False,
    rich_markup_mode="rich",
    context_settings={"help_option_names": ["-h", "--help"]},
    help="Estimate an accelerometer from position, see where the model fails, learn which physical effect is missing.",
)

Rig = Annotated[Path | None, typer.Option("--rig", help="Sidecar to use instead of NAME.toml beside the file.")]
Json = Annotated[bool, typer.Option("--json", help="JSON on stdout; everything else on stderr.")]
Band = Annotated[str | None, typer.Option("--band", help='Trust the encoder up to this frequency, e.g. "300 Hz".')]
From = Annotated[str | None, typer.Option("--from", help="Begin here on the position clock, s.")]
To = Annotated[str | None, typer.Option("--to", help="End here on the position clock, s.")]
Seed = Annotated[int | None, typer.Option("--seed", help="Seed of everything random; stored in what is written.")]
Output = Annotated[Path | None, typer.Option("-o", "--output", help="Write the result here.")]
Holdout = Annotated[Path | None, typer.Option("--holdout", help="Recording that is not fitted.")]
EffectsFile = Annotated[Path | None, typer.Option("--effects-file", help="Python file with effects of your own.")]
RunFile = Annotated[Path, typer.Argument(help="Recording: CSV, Parquet, MAT, npz or HDF5.", show_default=False)]
ModelFile = Annotated[Path, typer.Argument(help="Model file written by fit.", show_default=False)]


def main() -> None:
    """Run the command line."""
    app()


def reported(command: Callable[..., None]) -> Callable[..., None]:
    """Turn what the library raises into one sentence and an exit code."""

    @functools.wraps(command)
    def run(*args: Any, **kwargs: Any) -> None:
        try:
            command(*args, **kwargs)
        except KeyboardInterrupt:
            fail("interrupted; nothing was left half-written", INTERRUPTED)
        except (ValueError, OSError, ImportError) as error:
            fail(str(error), code_of(error))

    # typer reads options from evaluated annotations.
    signature = inspect.signature(command, eval_str=True)
    run.__signature__ = signature  # type: ignore[attr-defined]
    run.__annotations__ = {name: p.annotation for name, p in signature.parameters.items()} | {"return": None}
    return run


def code_of(error: Exception) -> int:
    """Exit code that suits an error."""
    from accelcal.gauss_newton import NotIdentifiable

    if isinstance(error, NotIdentifiable):
        return NOT_IDENTIFIABLE
    return USAGE if isinstance(error, Usage) else BAD_DATA


class Usage(ValueError):
    """An option whose text cannot be understood."""


def fail(text: str, code: int) -> NoReturn:
    """Say what is wrong and leave."""
    print(f"accelcal: {text}", file=sys.stderr)
    raise SystemExit(code)


def say(text: str) -> None:
    """Talk, on stderr."""
    print(text, file=sys.stderr)


def emit(content: dict[str, Any]) -> None:
    """Print JSON on stdout."""
    from accelcal import store

    print(store.dumps(content), end="")


def amount(text: str | None, kind: str, option: str) -> float | None:
    """Read an option with a unit; a bare number is taken in SI."""
    from accelcal.units import UnitError, quantity

    if text is None:
        return None
    try:
        return float(text)
    except ValueError:
        pass
    try:
        return quantity(text, kind)
    except UnitError as error:
        raise Usage(f"{option} {text!r}: {error}") from None


@contextmanager
def progress(title: str) -> Iterator[Callable[[float], None]]:
    """A bar with the time left on stderr; silent when stderr is not a terminal."""
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    console = Console(stderr=True)
    if not console.is_terminal:
        yield lambda share: None
        return
    columns = (TextColumn("{task.description}"), BarColumn(), TimeRemainingColumn())
    with Progress(*columns, console=console, transient=True) as bar:
        task = bar.add_task(title, total=1.0)
        yield lambda share: bar.update(task, completed=share)


@app.command()
@reported
def init(run: RunFile) -> None:
    """Write a commented sidecar for a recording from what can be read in it.

    Example: [bold]accelcal init run12.csv[/bold] writes run12.toml.
    """
    from accelcal import io

    say(f"wrote {io.init(run)}: fill in the marked lines, then run: accelcal check {run}")


@app.command()
@reported
def check(run: RunFile, rig: Rig = None, json: Json = False) -> None:
    """Say what was understood of a recording: rates, spans, gaps, ranges, findings.

    Example: [bold]accelcal check run12.csv[/bold]
    """
    from accelcal import io, overview

    recording = io.load(run, rig)
    if json:
        emit(overview.describe(recording))
    else:
        print(overview.summarise(recording))


@app.command()
@reported
def fit(
    runs: Annotated[list[Path], typer.Argument(help="One or several recordings of the same sensor.", metavar="RUN...")],
    rig: Rig = None,
    model: Annotated[str, typer.Option("--model", help="linear or cubic.")] = "linear",
    start: From = None,
    end: To = None,
    band: Band = None,
    method: Annotated[str, typer.Option("--method", help="replay, aci or cwpa.")] = "replay",
    form: Annotated[str, typer.Option("--form", help="aci: forward or inverse.")] = "forward",
    interpolation: Annotated[str, typer.Option("--interpolation", help="aci: hold, linear or cubic.")] = "cubic",
    integrator: Annotated[str, typer.Option("--integrator", help="aci: rk2, rk4 or exact.")] = "exact",
    order: Annotated[int, typer.Option("--order", help="aci, cwpa: 1 or 2.")] = 1,
    carrier: Annotated[str, typer.Option("--carrier", help="aci, cwpa: dense or factored.")] = "dense",
    output: Output = None,
    json: Json = False,
    seed: Seed = None,
) -> None:
    """Estimate bias, scale factor and time offset (and K2, K3) with their uncertainty.

    Several recordings share the sensor's parameters; with a reversed or rolled mount among them, tilt or the
    cross-axis product is separated.

    Example: [bold]accelcal fit run12.csv --model cubic -o m.json[/bold]
    """
    from accelcal import io, store
    from accelcal.fit import fit as fit_replay
    from accelcal.model import Model

    chosen = {"linear": Model.linear, "cubic": Model.cubic}.get(model)
    if chosen is None:
        raise Usage(f"--model {model!r}: expected linear or cubic")
    begin, stop = amount(start, "time", "--from"), amount(end, "time", "--to")
    width = amount(band, "frequency", "--band")
    recordings = [io.load(path, rig) for path in runs]
    if method == "replay":
        with progress("fit") as report:
            found = fit_replay(chosen(), recordings, start=begin, end=stop, band=width, report=report)
    else:
        choice = filter_choice(method, model, form, interpolation, integrator, order, carrier)
        if len(recordings) != 1 or band is not None:
            raise Usage(f"--method {method} takes one recording and no --band; the replay takes several")
        from accelcal.recursive import fit_recursive

        found, _ = fit_recursive(choice, recordings[0], start=begin, end=stop)
    if output is not None:
        store.save(found, output, seed=seed)
    if json:
        emit(store.to_dict(found, seed=seed))
    else:
        show_fit(found, recordings[0])
    if output is not None:
        say(f"wrote {output}")


def filter_choice(
    method: str, model: str, form: str, interpolation: str, integrator: str, order: int, carrier: str
) -> Any:
    """Check the five choices of a live filter."""
    from accelcal.filters import FilterChoice

    allowed: tuple[tuple[str, Any, tuple[Any, ...]], ...] = (
        ("--method", method, ("aci", "cwpa")),
        ("--form", form, ("forward", "inverse")),
        ("--interpolation", interpolation, ("hold", "linear", "cubic")),
        ("--integrator", integrator, ("rk2", "rk4", "exact")),
        ("--order", order, (1, 2)),
        ("--carrier", carrier, ("dense", "factored")),
    )
    for option, value, known in allowed:
        if value not in known:
            expected = ", ".join(str(k) for k in (*(("replay",) if option == "--method" else ()), *known))
            raise Usage(f"{option} {value!r}: expected one of {expected}")
    return FilterChoice(
        system=method,  # type: ignore[arg-type]
        model=model,  # type: ignore[arg-type]
        form=form,  # type: ignore[arg-type]
        interpolation=interpolation,  # type: ignore[arg-type]
        integrator=integrator,  # type: ignore[arg-type]
        order=order,  # type: ignore[arg-type]
        carrier=carrier,  # type: ignore[arg-type]
    )


@app.command()
@reported
def compare(
    model: ModelFile,
    run: RunFile,
    rig: Rig = None,
    band: Band = None,
    start: From = None,
    end: To = None,
    plots: Annotated[Path | None, typer.Option("--plots", help="Write pictures into this folder.")] = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Compare a fitted model with a recording: unaided drift, one-step residuals, where it fails.

    Example: [bold]accelcal compare m.json run13.csv[/bold]
    """
    from accelcal import store
    from accelcal.compare import compare as compare_with
    from accelcal.io import atomic_write

    own_effects(effects_file)
    fitted = store.load(model)
    recording = load_like(fitted, run, rig)
    seen = compare_with(
        fitted,
        recording,
        band=amount(band, "frequency", "--band"),
        start=amount(start, "time", "--from"),
        end=amount(end, "time", "--to"),
    )
    content = store.comparison_to_dict(seen)
    if output is not None:
        atomic_write(output, store.dumps(content))
        say(f"wrote {output}")
    if plots is not None:
        from accelcal.plots.compare import write

        for path in write(fitted, seen, plots):
            say(f"wrote {path}")
    if json:
        emit(content)
    else:
        show_comparison(content)


@app.command()
@reported
def diagnose(
    model: ModelFile,
    run: RunFile,
    rig: Rig = None,
    holdout: Holdout = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Say which physical effect a model lacks on a recording: ranked candidates, ties, a verdict.

    Example: [bold]accelcal diagnose m.json run12.csv --holdout run13.csv[/bold]
    """
    from accelcal import findings, store
    from accelcal.compare import compare as compare_with
    from accelcal.io import atomic_write
    from accelcal.loop import diagnose as diagnose_with

    extra = own_effects(effects_file)
    fitted = store.load(model)
    recording = load_like(fitted, run, rig)
    found = diagnose_with(fitted, recording, extra=extra)
    content = findings.diagnosis_to_dict(found)
    if recording.digest not in {one.digest for one in fitted.runs}:
        say(f"{run} is not the recording of {model}: all coefficients were profiled anew on it")
    if holdout is not None:
        seen = compare_with(found.fit, load_like(fitted, holdout, rig))
        content["heldout"] = store.comparison_to_dict(seen)
    if output is not None:
        atomic_write(output, store.dumps(content))
        say(f"wrote {output}")
    if json:
        emit(content)
        return
    show_diagnosis(content)
    if holdout is not None:
        show_steps([(str(model), content["heldout"])])


@app.command()
@reported
def add(
    model: ModelFile,
    run: RunFile,
    effects: Annotated[list[str], typer.Option("--effect", help="Effect to add; may be given several times.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Add effects to a model and fit it again; shape parameters are found by likelihood.

    Example: [bold]accelcal add m.json run12.csv --effect cubic -o m2.json[/bold]
    """
    from accelcal import store
    from accelcal.loop import add as add_to

    extra = own_effects(effects_file)
    fitted = store.load(model)
    recording = load_like(fitted, run, rig)
    finish_fit(add_to(fitted, recording, *effects, extra=extra), recording, output, json)


@app.command()
@reported
def drop(
    model: ModelFile,
    run: RunFile,
    effects: Annotated[list[str], typer.Option("--effect", help="Effect to drop; may be given several times.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Drop effects from a model and fit it again.

    Example: [bold]accelcal drop m2.json run12.csv --effect cubic -o m3.json[/bold]
    """
    from accelcal import store
    from accelcal.loop import drop as drop_from

    own_effects(effects_file)
    fitted = store.load(model)
    recording = load_like(fitted, run, rig)
    finish_fit(drop_from(fitted, recording, *effects), recording, output, json)


@app.command()
@reported
def history(
    models: Annotated[list[Path], typer.Argument(help="Model files, in the order of the story.", metavar="MODEL...")],
    on: Annotated[Path, typer.Option("--on", help="Recording that none of them was fitted to.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    json: Json = False,
) -> None:
    """Compare several models with one recording: the falling error.

    Example: [bold]accelcal history m.json m2.json --on run13.csv[/bold]
    """
    from accelcal import findings, store
    from accelcal.loop import history as history_of

    own_effects(effects_file)
    fits = [store.load(path) for path in models]
    content = findings.history_to_dict([str(m) for m in models], history_of(fits, load_like(fits[0], on, rig)).steps)
    if json:
        emit(content)
    else:
        show_steps([(step["model"], step["heldout"]) for step in content["steps"]])


@app.command()
@reported
def improve(
    runs: Annotated[list[Path], typer.Argument(help="One or several recordings to learn from.", metavar="RUN...")],
    holdout: Holdout = None,
    rig: Rig = None,
    most: Annotated[int, typer.Option("--max-effects", help="Most effects to add.", min=0)] = 3,
    effects_file: EffectsFile = None,
    start: From = None,
    end: To = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Fit the base model, diagnose, add the effect that is missing, refit, until nothing is missing.

    Example: [bold]accelcal improve run12.csv --holdout run13.csv -o best.json[/bold]
    """
    from accelcal import findings, io, store
    from accelcal.loop import improve as improve_with

    extra = own_effects(effects_file)
    recordings = [io.load(path, rig) for path in runs]
    with progress("improve") as report:
        found = improve_with(
            recordings,
            holdout=None if holdout is None else io.load(holdout, rig),
            most=most,
            extra=extra,
            start=amount(start, "time", "--from"),
            end=amount(end, "time", "--to"),
            report=report,
        )
    if output is not None:
        store.save(found.diagnosis.fit, output)
        say(f"wrote {output}")
    content = findings.improvement_to_dict(found)
    if json:
        emit(content)
        return
    show_diagnosis(content)
    if found.same_run:
        print("held out: the end of the same run; it cannot show set-up or slow-drift errors")
    show_steps([(" + ".join(["base", *step["effects"]]), step["heldout"]) for step in content["steps"]])


@app.command()
@reported
def report(
    model: ModelFile,
    run: RunFile,
    holdout: Holdout = None,
    rig: Rig = None,
    light: Annotated[bool, typer.Option("--light", help="Pictures and no script: small enough to mail.")] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="PDF as well; PDF alone where --output ends in .pdf.")] = False,
    effects_file: EffectsFile = None,
    output: Output = None,
) -> None:
    """Write one page on a model and a recording: verdict, falling error, parameters, budget, where it fails.

    The page opens offline. RUN.html unless --output says otherwise.

    Example: [bold]accelcal report m.json run12.csv --holdout run13.csv -o run12.html[/bold]
    """
    from accelcal import report as page
    from accelcal import store

    target = output if output is not None else run.with_suffix(".html")
    if target.suffix not in (".html", ".pdf"):
        raise Usage(f"--output {target}: expected a name that ends in .html or .pdf")
    extra = own_effects(effects_file)
    fitted = store.load(model)
    with progress("report") as share:
        content = page.gather(
            fitted,
            load_like(fitted, run, rig),
            holdout=None if holdout is None else load_like(fitted, holdout, rig),
            extra=extra,
            command=shlex.join(["accelcal", *sys.argv[1:]]),
            report=share,
        )
    if target.suffix == ".html":
        page.write(page.light(content) if light else page.html(content), target)
        say(f"wrote {target}")
    if pdf or target.suffix == ".pdf":
        page.pdf(content, target.with_suffix(".pdf"))
        say(f"wrote {target.with_suffix('.pdf')}")


@app.command()
@reported
def export(
    model: ModelFile,
    c: Annotated[Path | None, typer.Option("--c", help="Write a C99 header.")] = None,
    rust: Annotated[Path | None, typer.Option("--rust", help="Write a Rust module.")] = None,
    dcc: Annotated[Path | None, typer.Option("--dcc", help="Write a draft certificate (DCC 3.2.1).")] = None,
    lab: Annotated[Path | None, typer.Option("--lab", help="TOML with the administrative data of --dcc.")] = None,
    schema: Annotated[Path | None, typer.Option("--schema", help="Hold --dcc against this dcc.xsd.")] = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Leave out an effect that cannot be exported.")
    ] = None,
    effects_file: EffectsFile = None,
    json: Json = False,
) -> None:
    """Write the sensor's own calibration as code for firmware, as JSON, as a draft certificate.

    From a reading in V, counts or m/s² to acceleration, with a proven bound on its error.

    Example: [bold]accelcal export m.json --c sensor.h --rust sensor.rs --dcc draft.xml[/bold]
    """
    from accelcal import export as exports
    from accelcal import store
    from accelcal.io import atomic_write

    if not (c or rust or dcc or json):
        raise Usage("say what to write: --c sensor.h, --rust sensor.rs, --dcc draft.xml or --json")
    if dcc is None and (lab or schema):
        raise Usage("--lab and --schema belong to a certificate; add --dcc draft.xml")
    own_effects(effects_file)
    made = exports.calibrate(store.load(model), without=without or (), source=model.name)
    files: dict[Path, str] = {}
    if c is not None:
        files[c] = exports.header(made, c.name)
    if rust is not None:
        files[rust] = exports.module(made)
    if dcc is not None:
        certificate = exports.draft(made, exports.Laboratory() if lab is None else exports.read_laboratory(lab))
        if schema is not None:
            exports.require_valid(certificate.text, schema)
        files[dcc] = certificate.text
    for path, text in files.items():
        atomic_write(path, text)
    if json:
        emit(exports.to_dict(made))
    else:
        show_export(exports.to_dict(made))
    for path in files:
        say(f"wrote {path}")
    if dcc is not None:
        say(f"{dcc} is a draft; missing: {', '.join(certificate.missing) or 'nothing'}")
        say("it was not checked; give --schema dcc.xsd" if schema is None else f"it follows {schema}")


def show_export(content: dict[str, Any]) -> None:
    """Print what was exported: where it holds, how good it is, what is not in it."""
    from accelcal.export.words import upwards

    low, high = content["validity"]["acceleration_m_per_s2"]
    print(content["model"])
    print(f"valid for {low:.6g} to {high:.6g} m/s²", end="")
    warm = content["validity"]["temperature_degC"]
    print("" if warm is None else f", {warm[0]:.4g} to {warm[1]:.4g} degC")
    for kind in ("double", "float"):
        code = content[kind]
        terms = sum(len(row) for s in code["segments"] for row in s["coefficients"])
        print(f"{kind}: within {upwards(code['bound_m_per_s2'])} m/s² of the exact inverse, {terms} coefficients")
    least, most = content["std_m_per_s2"]
    print(f"standard uncertainty from the fit: {least:.2g} to {most:.2g} m/s²")
    for one in content["left_out"]:
        print(f"not exported: {one['effect']} {one['why']}")
    for text in content["remarks"]:
        print(f"note: {text}")


@app.command("app")
@reported
def workbench(
    run: Annotated[Path | None, typer.Argument(help="Recording to begin with.", show_default=False)] = None,
    port: Annotated[
        int | None, typer.Option("--port", help="Port on 127.0.0.1; the first free one by default.")
    ] = None,
    show: Annotated[bool, typer.Option("--browser/--no-browser", help="Open a browser.")] = True,
) -> None:
    """Open the workbench: the same loop in a browser, on this machine only.

    Example: [bold]accelcal app run12.csv[/bold]
    """
    from accelcal.app import serve

    if run is not None and not run.is_file():
        raise Usage(f"{run}: there is no such file; check the path")
    serve(None if run is None else run.absolute(), port=port, show=show)


@app.command()
@reported
def cut(
    run: RunFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    only: Annotated[list[str] | None, typer.Option("--only", help="Keep FROM:TO in s.")] = None,
    without: Annotated[list[str] | None, typer.Option("--without", help="Leave out FROM:TO in s.")] = None,
    rig: Rig = None,
) -> None:
    """Write a part of a recording, or all but some stretches of it, with its sidecar.

    Example: [bold]accelcal cut run12.csv --without 42:60 -o train.csv[/bold]
    """
    from accelcal import io

    recording = io.load(run, rig)
    for text in only or ():
        recording = recording.part(*stretch(text, "--only"))
    recording = recording.without(*(stretch(text, "--without") for text in without or ()))
    say(f"wrote {output} and {write_recording(recording, output)}")


def stretch(text: str, option: str) -> tuple[float, float]:
    """Read FROM:TO."""
    try:
        start, end = (float(part) for part in text.split(":"))
    except ValueError:
        raise Usage(f"{option} {text!r}: expected two times in s with a colon between, such as 42:60") from None
    return start, end


@app.command()
@reported
def freeze(
    model: ModelFile,
    run: RunFile,
    at: Annotated[list[str] | None, typer.Option("--at", help="Hold NAME=VALUE (SI).")] = None,
    release: Annotated[list[str] | None, typer.Option("--release", help="Let NAME be estimated again.")] = None,
    rig: Rig = None,
    effects_file: EffectsFile = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Hold parameters at given values, or release them, and fit the model again.

    Example: [bold]accelcal freeze m.json run12.csv --at bias=0.05 -o m2.json[/bold]
    """
    from accelcal import store
    from accelcal.fit import fit as fit_replay

    own_effects(effects_file)
    fitted = store.load(model)
    recording = load_like(fitted, run, rig)
    held: dict[str, float] = {}
    for text in at or ():
        name, _, value = text.partition("=")
        try:
            held[name] = float(value)
        except ValueError:
            raise Usage(f"--at {text!r}: expected NAME=VALUE in SI, such as bias=0.05") from None
    chosen = fitted.model.release(*(release or ())).freeze(**held)
    finish_fit(fit_replay(chosen, recording, origins=fitted.origins), recording, output, json)


@app.command()
@reported
def effects(
    name: Annotated[str | None, typer.Argument(help="Show the card of this effect.")] = None,
    effects_file: EffectsFile = None,
) -> None:
    """List the catalogue, or show the card of one effect.

    Example: [bold]accelcal effects cubic[/bold]
    """
    from rich.console import Console
    from rich.table import Table

    from accelcal.effects import CATALOGUE, card, find

    own_effects(effects_file)
    if name is not None:
        print(card(find(name)))
        return
    table = Table("effect", "unit", "port", "owner", "what it is", box=None)
    for each in CATALOGUE.values():
        table.add_row(each.name, each.unit, each.port, each.owner, each.card.split("\n", maxsplit=1)[0])
    Console().print(table)


@app.command()
@reported
def power(
    run: Annotated[Path, typer.Argument(help="Recording, or a planned motion: time and position alone.")],
    rig: Rig = None,
    effects_file: EffectsFile = None,
    start: From = None,
    end: To = None,
    json: Json = False,
) -> None:
    """Say what a recording, or a planned motion, can see: smallest detectable size of every effect, and the ties.

    A planned motion is judged by the noise density and resolution of its sidecar, its readings at its own set-points.

    Example: [bold]accelcal power run12.csv[/bold]
    """
    from accelcal import io
    from accelcal.power import power as power_of
    from accelcal.power import power_of_set_points

    extra = own_effects(effects_file)
    recording = io.load(run, rig, need_accel=False)
    if len(recording.accel):
        begin, stop = amount(start, "time", "--from"), amount(end, "time", "--to")
        seen = power_of(recording, extra=extra, start=begin, end=stop)
    elif start is not None or end is not None:
        raise Usage("--from and --to are for recordings; a planned motion is judged as a whole")
    else:
        seen = power_of_set_points(recording, extra=extra)
    if json:
        emit(seen.to_dict())
    else:
        show_power(seen.to_dict())


@app.command()
@reported
def plan(
    effects: Annotated[str, typer.Option("--effects", help="Effects to separate, with commas between.")],
    stroke: Annotated[str, typer.Option("--stroke", help='Travel from end to end, e.g. "0.2 m".')],
    vmax: Annotated[str, typer.Option("--vmax", help='Largest speed, e.g. "0.1 m/s".')],
    amax: Annotated[str, typer.Option("--amax", help='Largest acceleration, e.g. "20 m/s^2".')],
    seconds: Annotated[float, typer.Option("--seconds", help="Length, s.")] = 60.0,
    sensor: Annotated[str, typer.Option("--sensor", help="ADXL105 or CXL02.")] = "ADXL105",
    rig: Annotated[Path | None, typer.Option("--rig", help="Sidecar of your own rig, in place of --sensor.")] = None,
    output: Output = None,
    json: Json = False,
) -> None:
    """Plan a motion that separates effects within the limits of a stage, and say what it would see.

    Example: [bold]accelcal plan --effects quadratic,cubic --stroke "0.2 m" --vmax "0.1 m/s" --amax "20 m/s^2"[/bold]
    """
    from accelcal import io
    from accelcal.power import plan as plan_for
    from accelcal.simulate import ADXL105_RIG, CXL02_RIG

    rigs = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
    if rig is None and sensor not in rigs:
        raise Usage(f"--sensor {sensor!r}: expected {' or '.join(rigs)}")
    used = rigs[sensor] if rig is None else io.read_sidecar(rig).rig
    found = plan_for(
        [name.strip() for name in effects.split(",") if name.strip()],
        stroke=limit(stroke, "length", "--stroke"),
        v_max=limit(vmax, "speed", "--vmax"),
        a_max=limit(amax, "acceleration", "--amax"),
        seconds=seconds,
        rig=used,
    )
    if output is not None:
        for path in write_set_points(found, used, output):
            say(f"wrote {path}")
    if json:
        emit(found.to_dict())
    else:
        show_plan(found.to_dict())


def limit(text: str, kind: str, option: str) -> float:
    """A limit of the stage in SI; a bare number is refused, because 20 cm and 20 m are both stages."""
    if text.strip().replace(".", "", 1).replace("e", "", 1).lstrip("+-").isdigit():
        example = {"length": "0.2 m", "speed": "0.1 m/s", "acceleration": "20 m/s^2"}[kind]
        raise Usage(f'{option} {text!r} has no unit; expected a {kind} with one, as in {option} "{example}"')
    return amount(text, kind, option) or 0.0


def write_set_points(found: Plan, rig: RigOf, path: Path) -> tuple[Path, Path]:
    """Write time and position of a planned motion, and a sidecar that says how it was judged."""
    from accelcal import io
    from accelcal.io.sidecar import Clock, Source

    t, p = found.set_points()
    rows = "\n".join(f"{when:.6f},{where:.12f}" for when, where in zip(t, p, strict=True))
    path.parent.mkdir(parents=True, exist_ok=True)
    io.atomic_write(path, f"t_s,position_m\n{rows}\n")
    sidecar = io.sidecar_of(path)
    # The output that is still to be recorded is declared too, or its low-pass would be lost.
    columns: dict[str, Clock | Source] = {
        "time": Clock("t_s", unit="s"),
        "position": Source("position_m", "m"),
        "accel": Source("accel_mps2", "m/s^2"),
    }
    io.write_sidecar(rig, columns, sidecar)
    return path, sidecar


def show_power(content: dict[str, Any]) -> None:
    """Print the smallest detectable size of every effect, then what could not be told apart."""
    from rich.console import Console
    from rich.table import Column, Table

    console = Console()
    share = f"{100 * content['probability']:.0f} %"
    console.print(
        f"{content['name'] or 'recording'}: what would be found with {share} probability among "
        f"{content['candidates_examined']} candidates, false alarms {100 * content['alpha']:.2g} % per record",
        style="bold",
        highlight=False,
    )
    whole, folded = functools.partial(Column, no_wrap=True), functools.partial(Column, overflow="fold")
    columns = (whole("effect"), whole("smallest size"), whole("unit"), folded("largest contribution"))
    table = Table(*columns, folded("cannot be told from"), box=None)
    for each in content["effects"]:
        sizes = each["smallest_detectable"]
        every = sizes if isinstance(sizes, list) else [sizes]
        known = [v for v in every if v is not None]
        # Two parts are told one by one; of the many pieces of a shape the one that is seen best speaks for all.
        sized = every if len(every) <= 2 else [min(known, default=None)]
        largest = each["largest_contribution"]
        table.add_row(
            each["effect"],
            " / ".join("-" if v is None else f"{v:.3g}" for v in sized) if known else "not visible",
            each["unit"],
            f"{largest:.2g} {each['largest_contribution_unit']}" if largest is not None else "",
            ", ".join(each["class"][1:]),
        )
    console.print(table)
    if any(not each["class"][1:] and each["smallest_detectable"] is None for each in content["effects"]):
        console.print("not visible: the base model takes it up, or it would have to be as large as the motion itself")
    for tie in content["ties"]:
        console.print(f"cannot be told apart: {', '.join(tie['members'])}. {tie['experiment']}", highlight=False)


def show_plan(content: dict[str, Any]) -> None:
    """Print what a planned motion would see, and whether it separates what it should."""
    from rich.console import Console

    console = Console()
    names = ", ".join(each["effect"] for each in content["effects"])
    limits = content["limits"]
    verdict = "can be told apart" if content["separated"] else "cannot all be told apart within these limits"
    console.print(
        f"{names} {verdict}; {content['motions_tried']} motions of {content['seconds']:g} s tried within "
        f"{limits['stroke_m']:g} m, {limits['speed_m_per_s']:g} m/s, {limits['acceleration_m_per_s2']:g} m/s²",
        style="bold",
        highlight=False,
    )
    show_power({**content, "name": "this motion", "probability": 0.95, "ties": []})
    for pair in content["correlations"]:
        console.print(f"{' and '.join(pair['effects'])}: correlation {pair['correlation']:.3f}", highlight=False)


def own_effects(path: Path | None) -> Any:
    """Load a user's file of effects, if one is given."""
    from accelcal.effects import load_effects

    return load_effects(path) if path is not None else ()


def finish_fit(found: Fit, recording: Recording, output: Path | None, json: bool) -> None:
    """Write and print a fit."""
    from accelcal import store

    if output is not None:
        store.save(found, output)
        say(f"wrote {output}")
    if json:
        emit(store.to_dict(found))
    else:
        show_fit(found, recording)


def show_diagnosis(content: dict[str, Any]) -> None:
    """Print a sentence first, then the candidates and what cannot be told apart."""
    from rich.console import Console
    from rich.table import Table

    console = Console()
    for text in content["suspect_data"]:
        console.print(f"suspect data: {text}", style="bold red", highlight=False)
    console.print(content["sentence"], style="bold", highlight=False)
    if content.get("candidates"):
        table = Table("candidate", "estimate", "unit", "sigma", "p", "largest, m/s²", "cannot be told from", box=None)
        for c in content["candidates"][:8]:
            single = isinstance(c["estimate"], float)
            rivals = [m for m in c["class"] if m != c["effect"]]
            table.add_row(
                c["effect"],
                f"{c['estimate']:.4g} ± {c['std']:.2g}" if single else f"{len(c['estimate'])} coefficients",
                c["unit"],
                f"{c['snr']:.1f}",
                f"{c['p_value']:.2g}" if c["p_value"] > 0.0 else "<1e-300",
                contribution(c["largest_contribution"]).split(" m/s²")[0],
                ", ".join(rivals[:3]) + (f" and {len(rivals) - 3} more" if len(rivals) > 3 else ""),
            )
        console.print(table)
        console.print(
            f"p is family-wise over {content['candidates_examined']} candidates; largest is the largest contribution "
            "over the used range",
            highlight=False,
        )
    for text in effect_lines(content):
        console.print(text, highlight=False)
    for one in content["dropped"]:
        console.print(f"note: {one['sentence']}", highlight=False)
    if "where" in content:
        console.print(f"where it fails: {content['where']['worst']}", highlight=False)
    for tie in content["classes"]:
        if len(tie["members"]) > 1:
            console.print(f"cannot be told apart: {', '.join(tie['members'])}. {tie['experiment']}.", highlight=False)
    for tie in content["inseparable"]:
        console.print(f"never apart on this rig: {', '.join(tie['members'])}. {tie['experiment']}.", highlight=False)


def contribution(size: dict[str, float | None]) -> str:
    """A largest contribution in m/s², mg and percent of full scale, or in um at the encoder."""
    if size["m_per_s2"] is None:
        return f"{1e6 * (size['m'] or 0.0):.3g} um"
    share = size["percent_of_full_scale"]
    full = "" if share is None else f", {share:.3g} %FS"
    return f"{size['m_per_s2']:.3g} m/s², {size['mg']:.3g} mg{full}"


def effect_lines(content: dict[str, Any]) -> list[str]:
    """One line for each effect that was named: how large it is over the used range, and whether that matters."""
    from accelcal.rig import STANDARD_GRAVITY

    judged, lines = content["tolerance"], []
    for name in content["effects"]:
        size = content["largest_contributions"].get(name)
        text = f"{name}: " + ("no size of its own" if size is None else f"at most {contribution(size)}")
        if judged is not None:
            limit = f"{1e3 * judged['m_per_s2'] / STANDARD_GRAVITY:.3g} mg"
            kind = next(kind for kind in ("matters", "below", "not_comparable") if name in judged[kind])
            text += {
                "matters": f"; matters (tolerance {limit})",
                "below": f"; below tolerance ({limit})",
                "not_comparable": "; not comparable with the tolerance, which is of the output",
            }[kind]
        lines.append(text)
    return lines


def show_steps(steps: list[tuple[str, dict[str, Any]]]) -> None:
    """Print the falling error on held-out data; the least floor, since a model takes what it lacks for noise."""
    from rich.console import Console
    from rich.table import Table

    table = Table("model", "1 s, mm", "5 s, mm", "10 s, mm", "one step, um", box=None)
    for name, seen in steps:
        drift = [seen["coast_rms_m"][h] for h in ("1", "5", "10")]
        cells = ["-" if v is None else f"{1e3 * v:.4g}" for v in drift]
        table.add_row(name, *cells, f"{1e6 * seen['one_step_rms_m']:.4g}")
    floors = [[one["coast_floor_m"][h] for _, one in steps if one["coast_floor_m"][h]] for h in ("1", "5", "10")]
    table.add_row("noise alone", *(f"{1e3 * min(known):.4g}" if known else "-" for known in floors), "")
    console = Console()
    console.print("unaided drift on held-out data (rezeroed)")
    console.print(table)
    for text in outside_lines(steps[-1][1]):
        console.print(f"held out: {text}", highlight=False)


def load_like(fitted: Fit, run: Path, rig: Path | None) -> Recording:
    """Read a recording; without a sidecar of its own, under the rig of the model."""
    from accelcal import io

    if rig is None and not io.sidecar_of(run).exists():
        say(f"{run}: no sidecar; the rig stored in the model is assumed")
        return io.load(run, fitted.rig)
    return io.load(run, rig)


@app.command()
@reported
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    motion: Annotated[str, typer.Option("--motion", help="tones, interleaved, moves, bursts, fast, chirp, rests.")] = (
        "interleaved"
    ),
    seconds: Annotated[float, typer.Option("--seconds", help="Length, s.")] = 60.0,
    sensor: Annotated[str, typer.Option("--sensor", help="ADXL105 or CXL02.")] = "ADXL105",
    a_rms: Annotated[float | None, typer.Option("--a-rms", help="Rms acceleration, m/s².")] = None,
    bias: Annotated[float, typer.Option("--bias", help="K0, m/s².")] = 0.05,
    scale_factor: Annotated[float, typer.Option("--scale-factor", help="k.")] = 0.01,
    time_offset: Annotated[float, typer.Option("--time-offset", help="s, positive = output late.")] = 0.0,
    quadratic: Annotated[float, typer.Option("--quadratic", help="K2, (m/s²)⁻¹.")] = 0.0,
    cubic: Annotated[float, typer.Option("--cubic", help="K3, (m/s²)⁻².")] = 0.0,
    missing: Annotated[float, typer.Option("--missing", help="Share of samples lost.")] = 0.0,
    seed: Annotated[int, typer.Option("--seed", help="Seed of everything random.")] = 1,
    json: Json = False,
) -> None:
    """Simulate a recording of the paper's rig, with its sidecar.

    Example: [bold]accelcal simulate -o run.csv --motion interleaved --cubic 1e-3 --seed 4[/bold]
    """
    import numpy as np

    from accelcal.simulate import ADXL105_RIG, CXL02_RIG
    from accelcal.simulate import simulate as simulate_rig

    rigs = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
    if sensor not in rigs:
        raise Usage(f"--sensor {sensor!r}: expected {' or '.join(rigs)}")
    truth = {
        "bias": bias,
        "scale_factor": scale_factor,
        "time_offset": time_offset,
        "quadratic": quadratic,
        "cubic": cubic,
    }
    made = simulate_rig(
        motion,
        seconds=seconds,
        rig=rigs[sensor],
        parameters=truth,
        rng=np.random.default_rng(seed),
        a_rms=a_rms,
        missing=missing,
    )
    sidecar = write_recording(made.recording, output)
    if json:
        emit({"file": str(output), "sidecar": str(sidecar), "truth": truth, "seed": seed})
    else:
        say(f"wrote {output} and {sidecar}; the truth is {truth}")


def write_recording(recording: Recording, path: Path) -> Path:
    """Write a recording and the sidecar beside it; return the sidecar's path."""
    from accelcal import io

    write = {".csv": io.write_csv, ".parquet": io.write_parquet}.get(path.suffix)
    if write is None:
        raise Usage(f"--output {path}: expected a name that ends in .csv or .parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    columns = write(recording, path)
    sidecar = io.sidecar_of(path)
    io.write_sidecar(recording.rig, columns, sidecar)
    return sidecar


@app.command()
@reported
def demo(
    output: Annotated[Path, typer.Option("-o", "--output", help="Folder to write into.")] = Path("demo"),
    seed: Annotated[int, typer.Option("--seed", help="Seed of everything random.")] = 1,
    effect: Annotated[
        str | None, typer.Option("--effect", help="Hide this effect (or random, or none) and walk the loop.")
    ] = None,
) -> None:
    """Walk the main job: simulate two recordings, fit the first, compare the second, draw.

    With --effect, hide an effect, seal the answer, and walk the loop that finds it.

    Example: [bold]accelcal demo --effect random --seed 3 -o demo[/bold]
    """
    if effect is not None:
        demo_hidden(effect, output, seed)
        return
    import numpy as np

    from accelcal import io, store
    from accelcal.compare import compare as compare_with
    from accelcal.fit import fit as fit_replay
    from accelcal.model import Model
    from accelcal.plots.compare import write
    from accelcal.simulate import ADXL105_RIG
    from accelcal.simulate import simulate as simulate_rig

    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
    began = time.perf_counter()
    paths = [output / "run1.csv", output / "run2.csv"]
    seeds = np.random.SeedSequence(seed).spawn(2)
    for path, each in zip(paths, seeds, strict=True):
        rng = np.random.default_rng(each)
        made = simulate_rig("interleaved", seconds=60.0, rig=ADXL105_RIG, parameters=truth, rng=rng)
        write_recording(made.recording, path)
        print(f"simulated {path}: 60 s, {len(made.recording.accel)} output samples, truth {truth}")
    print(f"\n$ accelcal fit {paths[0]} -o {output / 'm.json'}")
    first = io.load(paths[0])
    found = fit_replay(Model.linear(), first)
    store.save(found, output / "m.json", seed=seed)
    show_fit(found, first)
    print(f"\n$ accelcal compare {output / 'm.json'} {paths[1]} --plots {output}")
    seen = compare_with(found, io.load(paths[1]))
    show_comparison(store.comparison_to_dict(seen))
    for path in write(found, seen, output):
        print(f"wrote {path}")
    print(f"\nThe main job took {time.perf_counter() - began:.1f} s.")


def demo_hidden(effect: str, output: Path, seed: int) -> None:
    """Hide an effect in two recordings and walk the loop."""
    from accelcal import findings, store
    from accelcal.demo import hide, seal
    from accelcal.loop import improve as improve_with

    hidden = hide(effect, seed)
    paths = [output / "run1.csv", output / "run2.csv"]
    for path, recording in zip(paths, (hidden.train, hidden.holdout), strict=True):
        write_recording(recording, path)
    seal(hidden, output / "answer.json")
    print(f"Something may be hidden in {paths[0]} and {paths[1]}; the answer is sealed in {output / 'answer.json'}.")
    print(f"\n$ accelcal improve {paths[0]} --holdout {paths[1]} -o {output / 'best.json'}")
    with progress("improve") as report:
        found = improve_with(hidden.train, holdout=hidden.holdout, report=report)
    store.save(found.diagnosis.fit, output / "best.json", seed=seed)
    content = findings.improvement_to_dict(found)
    show_diagnosis(content)
    show_steps([(" + ".join(["base", *step["effects"]]), step["heldout"]) for step in content["steps"]])
    truth = "nothing" if hidden.effect is None else f"{hidden.effect}, {hidden.size:.4g}"
    print(f"\nFound: {', '.join(found.effects) or 'nothing'}. Hidden was: {truth}.")


@app.command()
@reported
def paper(
    full: Annotated[bool, typer.Option("--full", help="All runs of the paper; minutes instead of seconds.")] = False,
    output: Annotated[Path | None, typer.Option("-o", "--output", help="Folder for the figures.")] = None,
    seed: Annotated[int, typer.Option("--seed", help="Seed of everything random.")] = 2007,
    json: Json = False,
) -> None:
    """Reproduce the paper and print measured beside expected.

    Example: [bold]accelcal paper -o figures[/bold]
    """
    from accelcal.paper import reproduce

    with progress("paper") as report:
        found = reproduce(quick=not full, seed=seed, out=output, progress=lambda name, share: report(share))
    if json:
        emit(found.to_dict())
    else:
        print(found.to_text())
    for path in found.figures:
        say(f"wrote {path}")


@app.command()
@reported
def doctor(json: Json = False) -> None:
    """Say which versions, extras and processors are at hand.

    Example: [bold]accelcal doctor[/bold]
    """
    import importlib.metadata as metadata
    import importlib.util
    import os
    import platform
    import shutil

    import accelcal

    extras = {
        "plot": "matplotlib",
        "report": "plotly",
        "pdf": "typst",
        "app": "nicegui",
        "dask": "distributed",
        "dcc": "xmlschema",
        "docs": "sphinx",
        "hdf5": "h5py",
        "peers": "filterpy",
    }
    needed = ("numpy", "scipy", "pyarrow", "pint", "uncertainties", "typer", "rich")
    content = {
        "accelcal": accelcal.__version__,
        "python": platform.python_version(),
        "platform": platform.platform(),
        "processors": os.cpu_count(),
        "packages": {name: metadata.version(name) for name in needed},
        "extras": {
            extra: metadata.version(package) if importlib.util.find_spec(package) else None
            for extra, package in extras.items()
        },
        "chromium": shutil.which("chromium"),
    }
    if json:
        emit(content)
        return
    print(f"accelcal {content['accelcal']}, Python {content['python']}, {content['platform']}")
    print(f"processors: {content['processors']}")
    for name in needed:
        print(f"  {name} {metadata.version(name)}")
    for extra, package in extras.items():
        have = importlib.util.find_spec(package) is not None
        text = metadata.version(package) if have else f'missing; pip install "accelcal[{extra}]"'
        print(f"  [{extra}] {package} {text}")


def show_fit(found: Fit, recording: Recording) -> None:
    """Print a fit as a table with what must be read beside it."""
    from rich.console import Console
    from rich.table import Table
    from uncertainties import ufloat

    from accelcal.fit import tied_sum
    from accelcal.store import electrical
    from accelcal.units import display

    console = Console()
    table = Table("parameter", "value (std)", "unit", "95 % interval", "usual unit", "what it really is here", box=None)
    for e in (*found.estimates, *found.shapes):
        name = e.name if e.run is None else f"{e.name} [{found.runs[e.run].name}]"
        value = f"{ufloat(e.value, e.std):.2uS}" if e.std > 0.0 else f"{e.value:.6g} (held)"
        interval = f"{e.value - 1.96 * e.std:.6g} .. {e.value + 1.96 * e.std:.6g}" if e.std > 0.0 else ""
        shown = f"{e.symbol} = {value}"
        table.add_row(name, shown, e.unit, interval, display(e.unit, e.value, e.std) or "", tied_sum(found, e.name))
    console.print(f"{', '.join(run.name or 'recording' for run in found.runs)}: {found.method}", style="bold")
    console.print(table)
    volts = electrical(found, recording.rig)
    if volts is not None:
        for key, one in volts.items():
            console.print(f"{key.replace('_', ' ')}: {ufloat(one['value'], one['std']):.2uS} {one['unit']}")
    for run in found.runs:
        for line in noise_lines(run.noise):
            console.print(line, highlight=False)
    for text in (*recording.rig.assumptions, *found.remarks):
        console.print(f"note: {text}", highlight=False)


def noise_lines(report: Any) -> list[str]:
    """Noise of one run in words: all of it, rest, motion, and the data sheet."""
    from accelcal.units import MICRO_G

    lines = []
    for label, one in (("noise", report.all), ("  at rest", report.rest), ("  in motion", report.motion)):
        if one is not None:
            lines.append(
                f"{label}: {one.density / MICRO_G:.4g} ± {one.density_std / MICRO_G:.2g} ug/sqrt(Hz), "
                f"encoder {1e6 * one.reading:.4g} um, {one.count} readings"
            )
    if report.declared is not None:
        lines.append(
            f"  declared: {report.declared / MICRO_G:.4g} ug/sqrt(Hz); fitted is {report.ratio:.3g} times that"
        )
    edge = f"band {report.band:.4g} Hz" if report.band is not None else f"crossover {report.crossover:.4g} Hz"
    lines.append(f"  {edge}: below it the encoder, above it the accelerometer knows acceleration better")
    return lines


def show_comparison(content: dict[str, Any]) -> None:
    """Print a comparison: unaided drift first."""
    from rich.console import Console
    from rich.table import Table

    def millimetres(value: float | None) -> str:
        return "-" if value is None else f"{1e3 * value:.4g}"

    console = Console()
    console.print(f"{content['recording'] or 'recording'}", style="bold")
    table = Table("unaided drift after", "rezeroed, mm", "frozen, mm", "noise floor, mm", "start points", box=None)
    for horizon, value in content["coast_rms_m"].items():
        table.add_row(
            f"{horizon} s",
            millimetres(value),
            millimetres(content["coast_frozen_rms_m"][horizon]),
            millimetres(content["coast_floor_m"][horizon]),
            str(content["coast_starts"][horizon]),
        )
    console.print(table)
    setup = content["setup_bias_m_per_s2"]
    if setup["std"] is not None:
        console.print(f"set-up or turn-on bias: {setup['value']:+.4g} ± {setup['std']:.2g} m/s²", highlight=False)
    nis = "" if content["nis"] is None else f", normalised innovation squared {content['nis']:.4f} (1 when consistent)"
    console.print(f"one step ahead: {1e6 * content['one_step_rms_m']:.4g} um rms{nis}", highlight=False)
    steps = ", ".join(f"{k}: {1e6 * v:.4g} um" for k, v in content["k_step_rms_m"].items() if v is not None)
    console.print(f"readings ahead: {steps}", highlight=False)
    console.print(
        f"accelerometer side, up to {content['band_hz']:.4g} Hz: {content['accel_rms_m_per_s2']:.4g} m/s² rms",
        highlight=False,
    )
    console.print(f"worst: {content['worst']}", highlight=False)
    for text in (*outside_lines(content), *content["remarks"]):
        console.print(f"note: {text}", highlight=False)


def outside_lines(content: dict[str, Any]) -> list[str]:
    """One line for each variable that leaves the range which the fit has seen: how often, and the errors apart."""
    lines = []
    for one in content["outside"]:
        if one["readings_outside"] == 0 or one["range"] is None:
            continue
        low, high = one["range"]
        text = (
            f"{one['readings_outside']} of {one['readings']} readings lie outside the trained range of "
            f"{one['variable']} [{low:.4g}, {high:.4g}] {one['unit']}".rstrip()
            + ": "
        )
        one_step = [millionths(one["one_step_rms_m"][side]) for side in ("inside", "outside")]
        text += f"one step {one_step[0]} inside, {one_step[1]} outside"
        for horizon, drift in one["coast_rms_m"].items():
            windows = one["coast_starts"][horizon]
            if windows["outside"]:
                sides = [
                    f"{1e3 * drift[side]:.4g} mm {side} ({windows[side]})" if windows[side] else f"none {side}"
                    for side in ("inside", "outside")
                ]
                text += f"; drift after {horizon} s {', '.join(sides)}"
        lines.append(text)
    return lines


def millionths(value: float | None) -> str:
    """A length in um, or that there is none."""
    return "-" if value is None else f"{1e6 * value:.4g} um"


if __name__ == "__main__":
    main()
