"""Commands that hand results on: report, export, workbench."""

from __future__ import annotations

import shlex
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal.cli.common import (
    EffectsFile,
    Holdout,
    Json,
    ModelFile,
    Output,
    Rig,
    RunFile,
    Usage,
    app,
    emit,
    new_file,
    own_effects,
    progress,
    reported,
    say,
)
from accelcal.cli.models import load_like
from accelcal.cli.printing import show_export

if TYPE_CHECKING:
    pass


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
    from accelcal.serialization import model_file

    target = output if output is not None else run.with_suffix(".html")
    if target.suffix not in (".html", ".pdf"):
        raise Usage(f"--output {target}: expected a name that ends in .html or .pdf")
    own_effects(effects_file)
    fitted = model_file.load(model)
    with progress("report") as share:
        content = page.gather(
            fitted,
            load_like(fitted, run, rig),
            holdout=None if holdout is None else load_like(fitted, holdout, rig),
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
    c: Annotated[Path | None, typer.Option("--c", help="Write a C99 header.", callback=new_file)] = None,
    rust: Annotated[Path | None, typer.Option("--rust", help="Write a Rust module.", callback=new_file)] = None,
    dcc: Annotated[
        Path | None, typer.Option("--dcc", help="Write a draft certificate (DCC 3.2.1).", callback=new_file)
    ] = None,
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
    from accelcal.calibration import export as exports
    from accelcal.io import atomic_write
    from accelcal.serialization import model_file

    if not (c or rust or dcc or json):
        raise Usage("say what to write: --c sensor.h, --rust sensor.rs, --dcc draft.xml or --json")
    if dcc is None and (lab or schema):
        raise Usage("--lab and --schema belong to a certificate; add --dcc draft.xml")
    for option, path, endings in (("--c", c, (".h", ".c")), ("--rust", rust, (".rs",)), ("--dcc", dcc, (".xml",))):
        if path is not None and path.suffix not in endings:
            raise Usage(f"{option} {path}: expected a name that ends in {' or '.join(endings)}")
    own_effects(effects_file)
    made = exports.calibrate(model_file.load(model), without=without or (), source=model.name)
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
