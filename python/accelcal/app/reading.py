"""Files to runs of a workbench: columns, recording or dwells, and what the check finds; others do the reading."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from accelcal import io
from accelcal._support.progress import within
from accelcal.app import tasks
from accelcal.app.known import units_of
from accelcal.app.run import Run
from accelcal.app.workers import Report
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording, RecordingError
from accelcal.data.rig import Rig
from accelcal.effects.side_channels import side_channels
from accelcal.io.sidecar import has_sidecar

MOST_BYTES = 1_000_000_000
"""Largest file that is read."""
MOST_SAMPLES = 20_000_000
"""Largest number of accelerometer samples."""


@dataclass(frozen=True, slots=True)
class Reader:
    """Reads files for one workbench."""

    done: Callable[..., Any]
    """Has a task done."""
    folder: Path
    """For sidecars that were written on the page."""
    plain: Callable[[str], str]
    """A sentence with file names as the user knows them."""
    arrived: Callable[[Recording], None] = lambda recording: None
    """Called with a recording that was read, before it is checked."""

    def several(self, paths: Sequence[Path], present: Sequence[Run], progress: Report) -> tuple[Run, ...]:
        """Read files of one sensor; one without a sidecar has the rig of the first recording that has one.

        Parameters
        ----------
        paths : what is read.
        present : what the workbench has already.

        Raises
        ------
        RecordingError
            If one cannot be read as a table.
        """
        order = sorted(range(len(paths)), key=lambda number: not has_sidecar(paths[number]))
        found: dict[int, Run] = {}
        for count, number in enumerate(order):
            runs = [run for run in (*present, *found.values()) if run.recording is not None and not run.lender]
            lender = next((run for run in runs if run.sidecar is not None or has_sidecar(run.file)), None)
            share = within(progress, count / len(paths), (count + 1) / len(paths))
            found[number] = self.run(paths[number], None, lender, share)
        return tuple(found[number] for number in range(len(paths)))

    def run(self, path: Path, sidecar: str | None, lender: Run | None, progress: Report) -> Run:
        """Read a file; where its columns are not understood, `Run.problem` says why.

        Parameters
        ----------
        path : the file.
        sidecar : text in place of the sidecar beside it.
        lender : whose rig it has where it has no sidecar.

        Raises
        ------
        RecordingError
            If it cannot be read as a table.
        """
        columns: tuple[str, ...] = ()
        template = ""
        borrowed = lender if lender is not None and sidecar is None and not has_sidecar(path) else None
        try:
            size = path.stat().st_size if path.is_file() else 0
            if size > MOST_BYTES:
                raise RecordingError(
                    f"{path.name}: {size / 1e6:.0f} MB; the limit of the workbench is {MOST_BYTES / 1e6:.0f} MB. "
                    "Convert it to Parquet, cut it, or use the command line"
                )
            columns, template = self.done(tasks.columns, path, progress=within(progress, 0.0, 0.1))
            rig: Path | Rig | None = self.declared(path, sidecar)
            if borrowed is not None and borrowed.recording is not None:
                rig = borrowed.recording.rig
            known = self.read(path, rig, within(progress, 0.1, 0.4))
        except RecordingError as error:
            if not columns:
                raise
            problem = self.plain(str(error))
            return Run(path, sidecar, columns=columns, template=template, problem=problem)
        progress(0.4)
        if isinstance(known, Dwells):
            return Run(path, sidecar, columns=columns, template=template, dwells=known)
        self.arrived(known)
        checked: tasks.Checked = self.done(tasks.check, known, progress=within(progress, 0.4, 0.98))
        return Run(
            file=path,
            sidecar=sidecar,
            lender=borrowed.name if borrowed is not None else "",
            columns=columns,
            template=template,
            recording=known,
            summary=checked.summary,
            used=(checked.marks.start, checked.marks.end),
            breaks=checked.marks.breaks,
            marks=checked.marks,
        )

    def declared(self, path: Path, sidecar: str | None) -> Path | None:
        """The file of a sidecar that the user has written here; None: the one beside the recording."""
        if sidecar is None:
            return None
        declared = self.folder / "sidecar" / io.sidecar_of(path).name
        declared.parent.mkdir(parents=True, exist_ok=True)
        io.atomic_write(declared, sidecar)
        return declared

    def read(self, path: Path, rig: Path | Rig | None, progress: Report) -> Recording | Dwells:
        """Read a file as what it is.

        Raises
        ------
        RecordingError
            If it is not understood, or has more samples than the workbench takes.
        """
        known: Recording | Dwells = self.done(tasks.load, path, rig, progress=progress)
        if isinstance(known, Dwells):
            return known
        if len(known.accel) > MOST_SAMPLES:
            raise RecordingError(
                f"{path.name}: {len(known.accel)} samples; the limit of the workbench is {MOST_SAMPLES}. "
                "Cut the file, or use the command line"
            )
        side_channels(units_of(known))  # their effects have names in every process
        return known
