"""Commands on recordings: describe, check, cut, simulate."""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, cast

import typer

from accelcal.cli.common import (
    Json,
    OfPosition,
    Rig,
    RunFile,
    UsageError,
    app,
    print_alignment,
    print_json,
    print_status,
    progress,
    say_line,
    suggest,
    time_range,
    with_exit_codes,
)
from accelcal.cli.overwriting import mark_of

if TYPE_CHECKING:
    from accelcal.data import Recording, Reference


@app.command()
@with_exit_codes
def init(run: RunFile) -> None:
    """Write a commented sidecar template for a recording, filled in as far as the file allows.

    Example: [bold]accelcal init run12.csv[/bold] writes run12.toml.
    """
    from accelcal import io

    io.init(run)
    print_status(f"wrote {io.sidecar_of(run)}: fill in the marked lines, then run: accelcal check {run}")


@app.command()
@with_exit_codes
def check(run: RunFile, rig: Rig = None, json: Json = False) -> None:
    """Check a recording: rates, spans, gaps, ranges, warnings, what is left out, and where the relation breaks.

    Example: [bold]accelcal check run12.csv[/bold]
    """
    from accelcal import io
    from accelcal.data import quality
    from accelcal.data.recording import RecordingError
    from accelcal.diagnosis.change_points import usable
    from accelcal.diagnosis.left_out import left_out_sentences, without_wrong_readings
    from accelcal.results.comparisons import broken

    with progress("check") as report:
        recording = io.load(run, rig)
        quality.require_varying(recording)
        report(0.6)
        whole = without_wrong_readings(recording)
        try:
            breaks = list(usable(whole).breaks)
        except RecordingError:  # too short to look for one: the summary says how long it is
            breaks = []
        report(0.9)
        gone = list(left_out_sentences(whole))
        content = {**quality.describe(recording), "breaks_s": breaks, "left_out": gone} if json else {}
        text = "" if json else quality.summarise(recording)
    if json:
        print_json(content)
        return
    say_line(text)
    for text in (*gone, *broken(breaks)):
        say_line(f"suspect data: {text}")
    suggest("fit", run, "-o", f"{run.stem}.json")


@app.command()
@with_exit_codes
def cut(
    run: RunFile,
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    only: Annotated[list[str] | None, typer.Option("--only", help="Keep FROM:TO in s.")] = None,
    without: Annotated[list[str] | None, typer.Option("--without", help="Exclude FROM:TO in s.")] = None,
    position: OfPosition = None,
    rig: Rig = None,
) -> None:
    """Write a part of a recording, or all of it without some stretches, with its sidecar; two loggers as one file.

    Example: [bold]accelcal cut run12.csv --without 42:60 -o train.csv[/bold]
    """
    from accelcal import io

    with progress("cut") as report:
        recording = io.load(run, rig, position=position)
        print_alignment(recording)
        report(0.5)
        for text in only or ():
            recording = recording.part(*time_range(text, "--only"))
        recording = recording.without(*(time_range(text, "--without") for text in without or ()))
        sidecar = write_recording(recording, output)
    if recording.dwells is not None:
        print_status(f"{recording.dwells.name} is not written: name it in the new sidecar, [dwell] table = ...")
    print_status(f"wrote {output} and {sidecar}")
    suggest("check", output)


@app.command()
@with_exit_codes
def simulate(
    output: Annotated[Path, typer.Option("-o", "--output", help="Recording to write: .csv or .parquet.")],
    motion: Annotated[
        str,
        typer.Option("--motion", help="tones, interleaved, moves, bursts, fast, chirp, rests, sine_steps, sweep."),
    ] = "interleaved",
    seconds: Annotated[float, typer.Option("--seconds", help="Length, s.")] = 60.0,
    sensor: Annotated[str, typer.Option("--sensor", help="ADXL105 or CXL02.")] = "ADXL105",
    a_rms: Annotated[float | None, typer.Option("--a-rms", help="Rms acceleration, m/s².")] = None,
    bias: Annotated[float, typer.Option("--bias", help="K0, m/s².")] = 0.05,
    scale_factor: Annotated[float, typer.Option("--scale-factor", help="k.")] = 0.01,
    time_offset: Annotated[float, typer.Option("--time-offset", help="s, positive = output lags.")] = 0.0,
    quadratic: Annotated[float, typer.Option("--quadratic", help="K2, (m/s²)⁻¹.")] = 0.0,
    cubic: Annotated[float, typer.Option("--cubic", help="K3, (m/s²)⁻².")] = 0.0,
    reference: Annotated[
        str, typer.Option("--reference", help="position, velocity or reference_acceleration.")
    ] = "position",
    missing: Annotated[float, typer.Option("--missing", help="Share of samples lost.")] = 0.0,
    seed: Annotated[int, typer.Option("--seed", help="Random seed.", min=0)] = 1,
    json: Json = False,
) -> None:
    """Simulate a recording of the paper's rig, with its sidecar.

    Example: [bold]accelcal simulate -o run.csv --motion interleaved --cubic 1e-3 --seed 4[/bold]
    """
    import numpy as np

    from accelcal.data.recording import UNITS
    from accelcal.simulation.sensor import ADXL105_RIG, CXL02_RIG
    from accelcal.simulation.sensor import simulate as simulate_rig

    rigs = {"ADXL105": ADXL105_RIG, "CXL02": CXL02_RIG}
    if sensor not in rigs:
        raise UsageError(f"--sensor {sensor!r}: expected {' or '.join(rigs)}")
    if reference not in UNITS:
        raise UsageError(f"--reference {reference!r}: expected {', '.join(UNITS)}")
    truth = {
        "bias": bias,
        "scale_factor": scale_factor,
        "time_offset": time_offset,
        "quadratic": quadratic,
        "cubic": cubic,
    }
    with progress("simulate") as report:
        made = simulate_rig(
            motion,
            seconds=seconds,
            rig=rigs[sensor],
            parameters=truth,
            rng=np.random.default_rng(seed),
            a_rms=a_rms,
            missing=missing,
            reference=cast("Reference", reference),
        )
        report(0.3)
        sidecar = write_recording(made.recording, output)
    if json:
        print_json({"file": str(output), "sidecar": str(sidecar), "truth": truth, "seed": seed})
    else:
        print_status(f"wrote {output} and {sidecar}; true values: {truth_text(truth)}")
        suggest("check", output)


def truth_text(truth: Mapping[str, float]) -> str:
    """True parameters that are not zero, each with its unit."""
    from accelcal.effects import find

    values = [f"{name} {value:g} {find(name).unit}".removesuffix(" 1") for name, value in truth.items() if value]
    return ", ".join(values) or "a perfect sensor"


def write_recording(recording: Recording, path: Path) -> Path:
    """Write a recording and the sidecar beside it; return the sidecar's path."""
    from accelcal import io

    write = {".csv": io.write_csv, ".parquet": io.write_parquet}.get(path.suffix)
    if write is None:
        raise UsageError(f"--output {path}: expected a name that ends in .csv or .parquet")
    path.parent.mkdir(parents=True, exist_ok=True)
    sidecar = io.sidecar_of(path)
    with io.together():
        columns = write(recording, path)
        io.write_sidecar(recording.rig, columns, sidecar, labels=recording.labels, mark=mark_of(path))
    return sidecar
