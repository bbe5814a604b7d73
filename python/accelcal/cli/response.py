"""The command for sensitivity by frequency."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, cast, get_args

import typer

from accelcal.cli.certificates import Dcc, Lab, Schema, checked, laboratory_of, require_usable, tell
from accelcal.cli.common import (
    Json,
    Rig,
    RunFile,
    UsageError,
    app,
    print_json,
    print_status,
    progress,
    with_exit_codes,
    writable_file,
)


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
    from accelcal import io
    from accelcal.io import atomic_write, together
    from accelcal.response.certificate import draft_response
    from accelcal.response.measure import Method, frequency_response
    from accelcal.response.table import lines, to_csv
    from accelcal.results.json import content

    require_usable(dcc, lab, schema)
    if method not in get_args(Method):
        raise UsageError(f"--method {method!r}: expected {', '.join(get_args(Method))}")
    asked = None if frequencies is None else parse_frequencies(frequencies)
    laboratory = laboratory_of(lab)
    with progress("response") as share:
        recording = io.load(run, rig=rig)
        share(0.2)
        found = frequency_response(recording, frequencies=asked, method=cast("Method", method))
    certificate = draft_response(found, recording.rig.sensor, laboratory)
    if dcc is not None:
        checked(certificate, schema)
    with together():
        if csv is not None:
            atomic_write(csv, to_csv(found))
        if dcc is not None:
            atomic_write(dcc, certificate.text)
        if figure is not None:
            from accelcal.plots import sensitivity
            from accelcal.plots.matplotlib import save

            save(sensitivity(found), figure)
    if json:
        print_json(content(found))
    else:
        print("\n".join(lines(found)))
    for path in (csv, dcc, figure):
        if path is not None:
            print_status(f"wrote {path}")
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
