"""Commands that deliver results: report, export, workbench."""

from __future__ import annotations

import shlex
import sys
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal, cast, get_args

import typer

from accelcal._support.errors import visible
from accelcal._support.process import within
from accelcal.cli import printing
from accelcal.cli.common import (
    EffectsFile,
    Holdout,
    Json,
    ModelFile,
    Output,
    Rig,
    RunFile,
    UsageError,
    app,
    deliver,
    print_status,
    print_written,
    progress,
    require_ending,
    require_folder,
    suggest,
    with_exit_codes,
    writable_file,
)
from accelcal.cli.lazy import drawing, exports, io, model_file, pages, plots, response_files, verbs
from accelcal.cli.models import load_all

if TYPE_CHECKING:
    from accelcal.calibration.export.certificate import Draft
    from accelcal.estimation.estimate import Fit


Style = Literal["kalibr", "imu_tk", "ros"]
Language = Literal["c", "rust"]
Precision = Literal["f32", "f64"]
Dcc = Annotated[
    Path | None, typer.Option("--dcc", help="Write a draft certificate (DCC 3.2.1).", callback=writable_file)
]
Lab = Annotated[Path | None, typer.Option("--lab", help="TOML with the administrative data of --dcc.")]
Schema = Annotated[Path | None, typer.Option("--schema", help="Validate --dcc against this dcc.xsd.")]
Gate = Annotated[
    float | None,
    typer.Option("--gate", help="Squared innovation over its variance beyond which --filter omits a reading."),
]


def require_usable(dcc: Path | None, lab: Path | None, schema: Path | None) -> None:
    """Refuse options of a certificate without one, and a file of another kind.

    Raises
    ------
    UsageError
        With what was expected.
    """
    if dcc is None and (lab or schema):
        raise UsageError("--lab and --schema apply to a certificate; add --dcc draft.xml")
    require_ending("--dcc", dcc, ".xml")


def laboratory_of(lab: Path | None) -> exports.Laboratory:
    """The administrative data as far as they are declared."""
    return exports.Laboratory() if lab is None else exports.read_laboratory(lab)


def checked(certificate: Draft, schema: Path | None) -> Draft:
    """The certificate, validated where there is a schema."""
    if schema is not None:
        exports.require_valid(certificate.text, schema)
    return certificate


def tell(path: Path, certificate: Draft, schema: Path | None) -> None:
    """Print what a written certificate lacks, and whether it was validated."""
    print_status(f"{path} is a draft; missing: {', '.join(certificate.missing) or 'nothing'}")
    valid = "not validated; give --schema dcc.xsd" if schema is None else f"valid against {schema}"
    print_status(f"{path} is {valid}")


@app.command()
@with_exit_codes
def report(
    model: ModelFile,
    run: Annotated[
        Path, typer.Argument(help="Recording; with --compare another model of the sensor.", show_default=False)
    ],
    holdout: Holdout = None,
    rig: Rig = None,
    compare: Annotated[
        bool, typer.Option("--compare", help="Compare two models of one sensor: report --compare A.json B.json.")
    ] = False,
    light: Annotated[
        bool, typer.Option("--light", help="Static figures, no script: small enough to mail, slower to draw.")
    ] = False,
    pdf: Annotated[bool, typer.Option("--pdf", help="Write a PDF too; only a PDF if --output ends in .pdf.")] = False,
    effects_file: EffectsFile = None,
    output: Output = None,
) -> None:
    """Write a report on a model and a recording: diagnosis, error reduction, residuals, parameters, uncertainty budget.

    One HTML page that opens offline; RUN.html by default. Three outputs of one sensor stand side by side. With
    --compare on two calibrations of one sensor: whether they agree, and what changed between them.

    Example: [bold]accelcal report m.json run12.csv --holdout run13.csv -o run12.html[/bold]
    """
    if compare and (holdout or rig or light):
        raise UsageError("--compare takes two models and no recording; leave out --holdout, --rig and --light")
    written = pages_to_write(output if output is not None else run.with_suffix(".html"), pdf)
    fitted = model_file.load(model)
    content: Any
    with progress("report") as share, io.together():
        if compare:
            names = (model.name, run.name) if model.name != run.name else (str(model), str(run))
            content = pages.agreement(fitted, model_file.load(run), names=names)
            page, paper = cast("Any", pages.agreement_html), cast("Any", pages.agreement_pdf)
        else:
            runs = verbs.runs_of(load_all(fitted, [run], rig))
            unseen = None if holdout is None else verbs.runs_of(load_all(fitted, [holdout], rig))
            content = pages.gather(
                fitted,
                runs,
                holdout=unseen,
                command=visible(shlex.join(["accelcal", *sys.argv[1:]]), one_line=True),
                progress=within(share, 0.0, 0.8),
            )
            page, paper = pages.light if light else pages.html, pages.pdf
        for path in written:
            if path.suffix == ".pdf":
                paper(content, path)
            else:
                io.atomic_write(path, page(content))
    if compare:
        printing.show_agreement(content)
    print_written(*written)
    if not compare:
        suggest("export", model, "--c", "sensor.h")


def pages_to_write(target: Path, pdf: bool) -> list[Path]:
    """The page, the PDF, or both.

    Raises
    ------
    UsageError
        If the name ends in neither .html nor .pdf.
    """
    require_ending("--output", target, ".html", ".pdf")
    return [target, target.with_suffix(".pdf")] if pdf and target.suffix == ".html" else [target]


@app.command()
@with_exit_codes
def export(
    model: ModelFile,
    c: Annotated[Path | None, typer.Option("--c", help="Write a C99 header.", callback=writable_file)] = None,
    rust: Annotated[Path | None, typer.Option("--rust", help="Write a Rust module.", callback=writable_file)] = None,
    dcc: Dcc = None,
    lab: Lab = None,
    schema: Schema = None,
    without: Annotated[
        list[str] | None, typer.Option("--without", help="Omit an effect that cannot be exported.")
    ] = None,
    parameters: Annotated[
        Path | None,
        typer.Option("--parameters", help="Write matrix and offsets of three outputs.", callback=writable_file),
    ] = None,
    style: Annotated[Style, typer.Option("--style", help="Of --parameters: kalibr, imu_tk or ros.")] = "kalibr",
    live: Annotated[
        Language | None, typer.Option("--filter", help="Write the live filter of the whole model, as c or rust.")
    ] = None,
    rate: Annotated[float | None, typer.Option("--rate", help="Outputs a second that --filter takes, Hz.")] = None,
    precision: Annotated[Precision, typer.Option("--precision", help="Numbers of --filter: f32 or f64.")] = "f32",
    watch: Annotated[
        str | None,
        typer.Option("--watch", help="Effects that --filter watches for, a comma between names.", show_default=False),
    ] = None,
    gate: Gate = None,
    output: Annotated[Path, typer.Option("-o", "--output", help="Beginning of the names of the files of --filter.")] = (
        Path("filter")
    ),
    effects_file: EffectsFile = None,
    json: Json = False,
) -> None:
    """Export the sensor's own calibration as code for firmware, as JSON, or as a draft certificate.

    The code converts a reading in V, counts or m/s² to acceleration, with a proven error bound. With --filter the code
    is the live filter of the model instead: position, velocity and parameters from output and encoder.

    Example: [bold]accelcal export m.json --c sensor.h --rust sensor.rs --dcc draft.xml[/bold]
    Example: [bold]accelcal export m.json --filter c --rate 1667 --watch cubic,quadratic -o tracker[/bold]
    """
    if live is not None or rate is not None:
        if live is None or rate is None or c or rust or dcc or json or without or parameters:
            raise UsageError("--filter c (or rust) and --rate 1667 go together, and with no other form of export")
        suspects = tuple(name.strip() for name in watch.split(",")) if watch is not None else ()
        followed = exports.live_filter(of_one_output(model), rate, watch=suspects, gate=gate)
        texts = exports.filter_files(followed, output.name, live, precision, model.name)
        paths = {output.parent / name: text for name, text in texts.items()}
        write_together(paths)
        print_written(*paths)
        return
    if watch is not None or gate is not None:
        raise UsageError("--watch and --gate: go with --filter c (or rust) and --rate 1667")
    if not (c or rust or dcc or json or parameters):
        raise UsageError(
            "nothing to write: give --c sensor.h, --rust sensor.rs, --dcc draft.xml, --filter, --json, or --parameters "
            "of three outputs"
        )
    require_usable(dcc, lab, schema)
    for option, path, endings in (("--c", c, (".h", ".c")), ("--rust", rust, (".rs",))):
        if path is not None and path.suffix not in endings:
            raise UsageError(f"{option} {path}: expected a name that ends in {' or '.join(endings)}")
    fitted, files = model_file.load(model), dict[Path, str]()
    if fitted.axes or parameters is not None:
        if dcc is not None:
            raise UsageError("--dcc: a certificate is of one output; give a model of one axis, load(..., axis=...)")
        export_axes(model, fitted, c, rust, {} if parameters is None else {parameters: style}, without or (), json=json)
        return
    calibration = exports.calibrate(fitted, without=without or (), source=model.name)
    if c is not None:
        files[c] = exports.header(calibration, c.name)
    if rust is not None:
        files[rust] = exports.module(calibration)
    if dcc is not None:
        certificate = checked(exports.draft(calibration, laboratory_of(lab)), schema)
        files[dcc] = certificate.text
    write_together(files)
    deliver(calibration, printing.show_export, None, json)
    print_written(*files)
    if dcc is not None:
        tell(dcc, certificate, schema)


def export_axes(
    model: Path,
    fitted: Fit,
    c: Path | None,
    rust: Path | None,
    parameters: Mapping[Path, Style],
    without: Sequence[str],
    *,
    json: bool,
) -> None:
    """Write what is asked for of three outputs: a C header and those of its axes, a Rust module, parameters."""
    matrix = exports.SensorMatrix.of(fitted, model.name)
    headers = {} if c is None else exports.c_files(fitted, c.name, without, model.name)
    files = {c.parent / name: text for name, text in headers.items()} if c is not None else {}
    files |= {} if rust is None else {rust: exports.rust_module(fitted, without, model.name)}
    files |= {path: exports.PARAMETERS[style](matrix) for path, style in parameters.items()}
    write_together(files)
    deliver(matrix, printing.show, None, json)
    print_written(*files)


def write_together(files: Mapping[Path, str]) -> None:
    """Write files, all or none."""
    with io.together():
        for path, text in files.items():
            io.atomic_write(path, text)


def of_one_output(model: Path) -> Fit:
    """The fit of a model file from which a live filter can be made.

    Raises
    ------
    UsageError
        If it is of three outputs.
    """
    fitted = model_file.load(model)
    if fitted.axes:
        raise UsageError(
            f"--filter: {model} is of {len(fitted.axes)} outputs; expected one. Fit one, or give --c or --rust"
        )
    return fitted


@app.command("app")
@with_exit_codes
def workbench(
    run: Annotated[Path | None, typer.Argument(help="Recording or session to load first.", show_default=False)] = None,
    port: Annotated[
        int | None, typer.Option("--port", help="Port on 127.0.0.1; by default the first free one.")
    ] = None,
    show: Annotated[bool, typer.Option("--browser/--no-browser", help="Open a browser.")] = True,
) -> None:
    """Open the workbench: fit, diagnose and improve in a browser, on this machine only.

    Example: [bold]accelcal app run12.csv[/bold]
    """
    require_folder("app")
    from accelcal.app import serve

    if run is not None and not run.is_file():
        raise UsageError(f"{run}: there is no such file; check the path")
    serve(None if run is None else run.absolute(), port=port, show=show)


@app.command()
@with_exit_codes
def response(
    run: RunFile,
    frequencies: Annotated[
        str | None, typer.Option("--frequencies", help="Hz, such as 10,20,40; by default all that are found.")
    ] = None,
    method: Annotated[str, typer.Option("--method", help="auto, sine or broadband.")] = "auto",
    csv: Annotated[Path | None, typer.Option("--csv", help="Write the table as CSV.", callback=writable_file)] = None,
    dcc: Dcc = None,
    lab: Lab = None,
    schema: Schema = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Figure to write: .png, .svg or .pdf.", callback=writable_file)
    ] = None,
    rig: Rig = None,
    json: Json = False,
) -> None:
    """Measure magnitude and phase of the sensitivity by frequency, from sine steps, a sweep or a random motion.

    Then parameters (gain, poles, resonance, delay), where they fail, amplitude linearity, and a linear fit in the time
    domain to compare with. The reference is the position, or the velocity or acceleration that was recorded in
    its place; a lag has a negative phase.

    Example: [bold]accelcal response shaker.csv --frequencies 10,20,40,80 --csv table.csv[/bold]
    """
    from accelcal.response.measure import Method, frequency_response

    require_usable(dcc, lab, schema)
    if method not in get_args(Method):
        raise UsageError(f"--method {method!r}: expected {', '.join(get_args(Method))}")
    asked = None if frequencies is None else parse_frequencies(frequencies)
    laboratory = laboratory_of(lab)
    with progress("response") as share:
        recording = io.load(run, rig=rig)
        share(0.2)
        result = frequency_response(recording, frequencies=asked, method=cast("Method", method))
    certificate = response_files.draft_response(result, recording.rig.sensor, laboratory)
    if dcc is not None:
        checked(certificate, schema)
    with io.together():
        if csv is not None:
            io.atomic_write(csv, response_files.to_csv(result))
        if dcc is not None:
            io.atomic_write(dcc, certificate.text)
        if figure is not None:
            drawing.save(plots.sensitivity(result), figure)
    deliver(result, lambda response: print("\n".join(response_files.lines(response, recording.rig.sensor))), None, json)
    print_written(csv, dcc, figure)
    if dcc is not None:
        tell(dcc, certificate, schema)


def parse_frequencies(text: str) -> list[float]:
    """Parse numbers in Hz separated by commas."""
    try:
        return [float(part) for part in text.split(",")]
    except ValueError:
        raise UsageError(
            f"--frequencies {text!r}: expected numbers in Hz separated by commas, such as 10,20,40"
        ) from None
