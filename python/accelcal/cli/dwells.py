"""Commands on static dwells: find them in a long record, calibrate a triad from positions of unknown attitude."""

from __future__ import annotations

import math
import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from accelcal.cli.common import (
    Json,
    Output,
    Rig,
    RunFile,
    UsageError,
    app,
    parse_quantity,
    print_json,
    print_status,
    progress,
    with_exit_codes,
    writable_file,
)
from accelcal.cli.overwriting import mark_of

if TYPE_CHECKING:
    from accelcal.estimation.triad import Positions, TriadFit
    from accelcal.io.dwells import Rest, Rests

SHORTEST = "2 s"


@app.command()
@with_exit_codes
def dwells(
    run: RunFile,
    rig: Rig = None,
    least: Annotated[str, typer.Option("--least", help="Shortest rest that is used.")] = SHORTEST,
    attitudes: Annotated[
        str | None,
        typer.Option("--attitudes", help="Elevation of each rest in degrees: 0,90,180 or FIRST:STEP such as 0:15."),
    ] = None,
    figure: Annotated[
        Path | None, typer.Option("--figure", help="Figure of the rests: .png, .svg or .pdf.", callback=writable_file)
    ] = None,
    yes: Annotated[bool, typer.Option("--yes", help="Use the rests without asking.")] = False,
    output: Output = None,
    json: Json = False,
) -> None:
    """Find the rests of a long tumble record and write them as a table of dwells; or calibrate a triad from them.

    With accel_x, accel_y, accel_z in the sidecar and attitude = "unknown", nine parameters are estimated from the norm
    of gravity alone.

    Example: [bold]accelcal dwells tumble.csv --attitudes 0:15 -o dwells.csv[/bold]
    """
    from accelcal.cli.common import show_table
    from accelcal.estimation.triad import fit_triad
    from accelcal.io.dwells import load_rests, table_of, write_table

    shortest = parse_quantity(least, "time", "--least") or 0.0
    with progress("dwells"):
        found = load_rests(run, rig, shortest)
    degrees = angles(attitudes, len(found.rests))
    if figure is not None:
        from accelcal.plots.matplotlib import draw, save
        from accelcal.plots.model import rests

        save(draw(rests(found)), figure)
        print_status(f"wrote {figure}")
    triad = found.triad
    if not json:
        head = ("", "from (s)", "to (s)", *(f"mean {axis} ({found.unit})" for axis in found.names), "std", "attitude")
        show_table(head, [line(k, rest, degrees) for k, rest in enumerate(found.rests)])
    if (output is not None or triad) and not yes and not confirmed(len(found.rests)):
        print_status("nothing was used or written")
        return
    if triad:
        from accelcal.results.json import content

        fitted = fit_triad(positions(found))
        values = content(fitted)
        if output is not None:
            from accelcal.io import atomic_write
            from accelcal.results.json import dumps

            atomic_write(output, dumps(values))
            print_status(f"wrote {output}")
        print_json(values) if json else show_triad(fitted)
        return
    if output is not None:
        sidecar = write_table(found, degrees, output, mark_of(output))
        missing = "" if degrees else "; fill in attitude_deg"
        print_status(f"wrote {output} and {sidecar}{missing}, then run: accelcal fit {output} --model cubic")
    if json:
        print_json({"rests": table_of(found, degrees)})


def positions(found: Rests) -> Positions:
    """Rests of a triad as positions."""
    import numpy as np

    from accelcal.estimation.triad import Positions

    return Positions(
        mean=np.array([rest.mean for rest in found.rests]),
        std=np.array([rest.std for rest in found.rests]),
        samples=np.array([float(rest.samples) for rest in found.rests]),
        gravity=found.gravity,
        name=found.name,
        unit=found.unit,
    )


def confirmed(count: int) -> bool:
    """Whether the user wants the rests to be used; without a terminal, --yes is needed.

    Raises
    ------
    UsageError
        If nobody can be asked.
    """
    if not sys.stdin.isatty():
        raise UsageError(f"{count} rests were found; look at them, then add --yes to use them")
    return bool(typer.confirm(f"use these {count} rests?", default=False, err=True))


def angles(text: str | None, count: int) -> list[float]:
    """Elevations in degrees, one for each rest; empty where none are given."""
    if text is None:
        return []
    try:
        if ":" in text:
            first, step = (float(part) for part in text.split(":"))
            found = [first + k * step for k in range(count)]
        else:
            found = [float(part) for part in text.split(",")]
        if not all(math.isfinite(angle) for angle in found):
            raise ValueError
    except ValueError:
        raise UsageError(
            f"--attitudes {text!r}: expected degrees such as 0,90,180, or FIRST:STEP such as 0:15"
        ) from None
    if len(found) != count:
        raise UsageError(f"--attitudes: {len(found)} angles for {count} rests; give one for each, or change --least")
    return found


def line(k: int, rest: Rest, degrees: list[float]) -> tuple[str, ...]:
    """One rest as a line of the table."""
    means = (f"{y:.7g}" for y in rest.mean)
    shown = f"{degrees[k]:g} deg" if degrees else ""
    return (str(k + 1), f"{rest.start:.6g}", f"{rest.end:.6g}", *means, f"{max(rest.std):.3g}", shown)


def show_triad(fit: TriadFit) -> None:
    """Print nine parameters and what they leave."""
    from accelcal.cli.common import say_line, show_table
    from accelcal.results.words import concise, plain

    units = {"K": f"(m/s²)/{fit.unit}", "T": "rad", "b": fit.unit}
    std = dict(fit.std)
    rows = [
        (name, plain(units[name[0]], y, std[name]), concise(y, std[name]), units[name[0]])
        for name, y in fit.values.items()
    ]
    say_line(f"{fit.name}: a = T K (y - b), {len(fit.residual)} positions, |a| = {fit.gravity:g} m/s²")
    show_table(("parameter", "value", "SI value (u)", "SI unit"), rows)
    say_line(f"residual of the norm: {fit.rms:.3g} m/s² rms")
    say_line(fit.sentence)
    for text in fit.remarks:
        say_line(f"note: {text}")
