"""What each file is used for: fitted, held out or left out; something is fitted and something held out, always."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

from accelcal._support.errors import AccelcalError
from accelcal.app.run import Role, Run
from accelcal.estimation.run_differences import run_to_hold_out

ROLES: tuple[Role, ...] = ("fit", "hold out", "leave out")


class Refused(AccelcalError):
    """An action that is not possible now. The text says why and what to do first."""


def divided(runs: Sequence[Run]) -> tuple[Run, ...]:
    """Files that were dropped together with the roles that `accelcal improve` gives them.

    The last of three recordings or more is held out whose axis and mount another one has; else the end of the first.
    """
    motions = [(number, run.recording) for number, run in enumerate(runs) if run.recording is not None]
    given = [replace(run, role="fit", held_out=None) for run in runs]
    last = run_to_hold_out([recording for _, recording in motions])
    if last is not None:
        number = motions[last][0]
        given[number] = replace(given[number], role="hold out")
    return with_something_held_out(given)


def with_role(runs: Sequence[Run], number: int, role: Role) -> tuple[Run, ...]:
    """The files with another role for one of them.

    A recording that is held out takes the place of parts that were; when the last one is used otherwise, the end of the
    first fitted one is held out again.

    Raises
    ------
    Refused
        If dwells were to be held out, or no recording would be left to fit.
    """
    run = runs[number]
    if role == "hold out" and run.dwells is not None:
        raise Refused(f"{run.name}: dwells show no motion to compare a model with; fit them, or leave them out")
    made = [replace(one, held_out=None) if role == "hold out" else one for one in runs]
    made[number] = replace(run, role=role, held_out=run.held_out if role == "fit" else None)
    return with_something_held_out(made)


def with_something_held_out(runs: Sequence[Run]) -> tuple[Run, ...]:
    """The files; where nothing is held out, the end of the first recording that is fitted is.

    Raises
    ------
    Refused
        If no recording is fitted.
    """
    fitted = [number for number, run in enumerate(runs) if run.role == "fit" and run.recording is not None]
    if not fitted and any(run.recording is not None for run in runs):
        raise Refused("no recording would be left to fit; give another one the role fit first")
    if not fitted or any(run.holds_out for run in runs):
        return tuple(runs)
    first = fitted[0]
    return tuple(replace(run, held_out=run.end) if number == first else run for number, run in enumerate(runs))
