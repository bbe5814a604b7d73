"""From files to dwells: a table with one line for each, or a recording at rest whose attitude is declared."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from accelcal._support.arguments import checked
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording, RecordingError
from accelcal.data.rig import STANDARD_GRAVITY
from accelcal.io.assign import fix
from accelcal.io.dwell_table import assumed, from_table, is_table
from accelcal.io.files import is_there
from accelcal.io.formats import open_table
from accelcal.io.loading import load
from accelcal.io.sidecar import Sidecar, has_sidecar, no_sidecar, read_sidecar, sidecar_of


def declares_dwells(path: Path, rig: Path | None = None) -> bool:
    """Whether a file is a table of dwells, or its sidecar declares the attitude of a dwell."""
    if not is_there(path):
        return False
    if is_table(open_table(path)):
        return True
    declared = rig is not None or has_sidecar(path)
    setup = read_sidecar(rig or sidecar_of(path)).dwell if declared else None
    return setup is not None and setup.angle is not None


@checked
def load_dwells(path: str | Path, rig: str | Path | None = None) -> Dwells:
    """Read dwells and check them.

    Parameters
    ----------
    path : table with the header ``attitude_deg,mean,std,duration_s,temperature_degC,samples,group``, or a recording at
        rest whose sidecar declares ``[dwell] attitude`` or ``angle``.
    rig : sidecar; None = ``NAME.toml`` beside the file. It declares the unit of the mean as that of the accelerometer.

    Raises
    ------
    RecordingError
        Naming file, column and row, what was expected and the next step.

    Examples
    --------
    >>> import pathlib, tempfile
    >>> table = pathlib.Path(tempfile.mkdtemp(), "tumble.csv")
    >>> rows = "90,9.86,0.001,60,,6000,0\\n0,0.05,0.001,60,,6000,0\\n-90,-9.76,0.001,60,,6000,0\\n"
    >>> _ = table.write_text("attitude_deg,mean,std,duration_s,temperature_degC,samples,group\\n" + rows)
    >>> _ = table.with_suffix(".toml").write_text("[channels]\\naccel = { column = 'mean', unit = 'm/s^2' }\\n")
    >>> len(load_dwells(table))
    3
    """
    path = Path(path)
    beside = Path(rig) if rig is not None else sidecar_of(path)
    declared = read_sidecar(beside) if rig is not None or has_sidecar(path) else no_sidecar()
    table = open_table(path)
    if is_table(table):
        return from_table(table, declared, beside)
    return from_recording(load(path, beside if declared.path else None, need_position=False), declared, beside)


def from_recording(recording: Recording, declared: Sidecar, sidecar: Path) -> Dwells:
    """A recording at rest as one dwell."""
    setup = declared.dwell
    if setup is None or setup.angle is None:
        what = "is unknown" if setup is not None and setup.unknown else "is not declared"
        raise RecordingError(
            f"{recording.name}: the attitude of this dwell {what}; "
            + fix(sidecar, '[dwell]\nattitude = "up"   # or "down", "level", or angle = "30 deg"')
        )
    accel = recording.accel
    if len(accel) < 2:
        raise RecordingError(f"{recording.name}: {len(accel)} samples of the output; a dwell needs at least 2")
    warm = recording.side.get("temperature")
    step = float(accel.t[-1] - accel.t[0]) / (len(accel) - 1)
    return Dwells(
        angle=np.array([setup.angle]),
        mean=np.array([float(np.mean(accel.y))]),
        std=np.array([float(np.std(accel.y, ddof=1))]),
        duration=np.array([step * len(accel)]),
        samples=np.array([float(len(accel))]),
        group=("",),
        rig=declared.rig,
        temperature=None if warm is None else np.array([float(np.mean(warm.y))]),
        angle_std=setup.angle_std or 0.0,
        gravity=setup.gravity or STANDARD_GRAVITY,
        name=recording.name,
        digest=recording.digest,
        assumptions=assumed(setup),
    )
