"""The long work of a workbench, one function each, whose input and output can be sent to another process; examples."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from shlex import quote
from types import MappingProxyType
from typing import Any, Literal, TypeAlias

import numpy as np

from accelcal import io
from accelcal._support.errors import AccelcalError
from accelcal._support.process import parts_of, within
from accelcal.app import mapping
from accelcal.app.state import Formula, Run, Stretch, units_of
from accelcal.app.workers import Report
from accelcal.calibration.export import Laboratory, calibrate, draft, header, module
from accelcal.data import Dwells, Positions, Recording, RecordingError, Rig, quality
from accelcal.demo import TRUTH, with_effect
from accelcal.diagnosis.faults import examine
from accelcal.diagnosis.runs import RunValues
from accelcal.diagnosis.verdict import AxesDiagnosis, Diagnosis
from accelcal.effects import Effect, find, side_channels, spelled
from accelcal.estimation import tracks
from accelcal.estimation.estimate import Fit, solve_runs
from accelcal.estimation.plausible import suspicion
from accelcal.estimation.run import prepare, recording_of
from accelcal.io.sidecar import has_sidecar
from accelcal.plots.timeline import Marks, marks
from accelcal.report import gather, html
from accelcal.response import FrequencyResponse, frequency_response
from accelcal.results import model_file
from accelcal.results.json import content as content_of
from accelcal.results.words import with_unit
from accelcal.simulation.sensor import CXL02_RIG, simulate
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.noise_floor import Ruler
from accelcal.verbs import (
    add,
    compare,
    compare_models,
    diagnose,
    model_in_motion,
    run_values,
    used_runs,
)


@dataclass(frozen=True, slots=True)
class Example:
    """A recording that is simulated when it is asked for; the same one every time."""

    title: str
    about: str
    """What was recorded, without the answer."""
    motion: str
    """Profile of `accelcal.simulation.motion`."""
    effect: str
    """What is hidden: a name of the catalogue."""
    size: float
    """Its coefficient, SI."""
    seed: int
    seconds: float = 40.0

    @property
    def answer(self) -> str:
        """The hidden effect with its true coefficient, a sentence."""
        size = with_unit(f"{self.size:g}", find(self.effect).unit)
        return f"Hidden: {spelled(self.effect)}, with the coefficient {size}."

    def record(self) -> Recording:
        """Simulate the recording."""
        simulated = simulate(
            self.motion, seconds=self.seconds, rig=CXL02_RIG, parameters=TRUTH, rng=np.random.default_rng(self.seed)
        )
        return with_effect(simulated, find(self.effect), self.size, {}, prepare(simulated.recording).origins)


EXAMPLES: Mapping[str, Example] = MappingProxyType(
    {
        "stage": Example(
            "A positioning stage",
            "It moves, stops and moves back. Without position the model drifts by centimetres within seconds.",
            "moves",
            "coulomb",
            2e-2,
            1,
        ),
        "shaker": Example(
            "A shaker",
            "Bursts of vibration with rests between them. What the sensor says depends on how hard it is shaken.",
            "bursts",
            "quadratic",
            2e-3,
            2,
        ),
        "mixed": Example(
            "Moves and bursts",
            "Slow moves and fast bursts in turn. Two effects look alike here; the product says which, and how to "
            "separate them.",
            "interleaved",
            "cubic",
            1e-3,
            1,
        ),
    }
)
"""By the name of the file that each becomes: example_NAME.csv."""
PREFIX = "example_"


def example_of(path: Path | None) -> Example | None:
    """The example that a recording of this name is; None where it is none."""
    if path is None or not path.stem.startswith(PREFIX):
        return None
    return EXAMPLES.get(path.stem.removeprefix(PREFIX))


Data: TypeAlias = Sequence[Recording | Dwells]
"""What models are fitted to: recordings and dwells of one sensor."""
Export = Literal["C", "Rust", "JSON", "DCC"]


def columns(path: Path, *, progress: Report) -> tuple[tuple[str, ...], str]:
    """Names of the columns of a file, and the template of a sidecar for it."""
    return mapping.columns_of(path), io.template(path)


def load(path: Path, rig: Path | Rig | None, *, progress: Report) -> tuple[Recording, ...] | Dwells:
    """Read every output of a recording, or dwells where the file or its sidecar says that it is some."""
    beside, single = (None, partial(io.load, rig=rig)) if isinstance(rig, Rig) else (rig, None)
    outputs: list[Recording] = []
    for output in io.load_declared(path, beside, single):
        if isinstance(output, Dwells):
            return output
        if isinstance(output, Positions):
            raise RecordingError(
                f"{path.name}: positions of three outputs at rest, which the workbench does not show; calibrate "
                "them by `accelcal dwells`, or together with a motion by `accelcal fit`"
            )
        # named as in the commands that are copied
        outputs.append(replace(output, origin=replace(output.origin, arguments=quote(path.name))))
    return tuple(outputs)


def check(
    outputs: Sequence[Recording], excluded: Sequence[Stretch], *, progress: Report
) -> tuple[Marks, Mapping[str, Any]]:
    """Look for breaks, faults and rest in what is not excluded; the summary is that of `accelcal check --json`. Of
    several outputs the shortest usable part, and what is noticed in any of them."""
    rest = [quality.with_extremes_of_rest(output.without(*excluded)) if excluded else output for output in outputs]
    results = [marks(output) for output in rest]
    progress(0.9)
    both = zip(reversed(outputs), reversed(results), strict=True)  # of the same remark on several that on the first
    noticed = {note.sentence.removeprefix(of.name): note for of, result in both for note in reversed(result.remarks)}
    shortest = min(results, key=lambda result: result.end - result.start)
    suspect = suspicion(recording_of(examine(rest[0]).stepped[0]))
    summary = {**quality.describe(rest[0]), "suspect": [suspect] if suspect else []}
    return replace(shortest, remarks=tuple(noticed.values())[::-1]), summary


def added(before: Fit, train: Data, name: str, own_names: Sequence[str], *, progress: Report) -> Fit:
    """Fit again with an effect more; `own_names` names effects of the user."""
    return add(before, list(train), name, extra=effects(own_names), progress=progress)


def compared(fits: Sequence[Fit], data: Sequence[Recording], names: Sequence[str], *, progress: Report) -> Comparison:
    """Compare models with data under one ruler."""
    return compare(fits, list(data), names=names, progress=progress)


def judged(
    fits: Sequence[Fit], data: Sequence[Recording], ruler: Ruler, base: Fit, *, progress: Report
) -> tuple[tuple[Evaluation, ...], ...]:
    """Compare models with recordings, all with the filter of `ruler`, above the noise floor of the model they grew
    from: for each model its comparisons."""
    comparisons = [
        compare_models(fits, data_set, ruler, part, base=base)
        for data_set, part in zip(data, parts_of(progress, len(data)), strict=True)
    ]
    return tuple(zip(*comparisons, strict=True))


def responded(recording: Recording, *, progress: Report) -> FrequencyResponse:
    """Sensitivity by frequency."""
    return frequency_response(recording)


def diagnosed(fitted: Fit, train: Data, own_names: Sequence[str], *, progress: Report) -> Diagnosis | AxesDiagnosis:
    """Search for missing effects."""
    return diagnose(fitted, list(train), extra=effects(own_names), progress=progress)


def values_of_runs(fitted: Fit, train: Data, *, progress: Report) -> RunValues:
    """Parameters of each recording alone."""
    return run_values(fitted, list(train))


def moving(fitted: Fit, train: Recording, *, progress: Report) -> tuple[tracks.Path, ...]:
    """Coefficients that processes and mechanisms of a model move, over one recording that it was fitted to; none where
    that recording alone does not determine the model."""
    runs, _ = used_runs([examine(train)], fitted)
    with suppress(ValueError):
        model = model_in_motion(fitted)
        return tracks.paths_of(solve_runs(model, runs, origins=fitted.origins, engine=fitted.engine, progress=progress))
    return ()


def reported(
    fitted: Fit,
    train: Sequence[Recording],
    holdout: Sequence[Recording],
    own_names: Sequence[str],
    diagnosis: Diagnosis | AxesDiagnosis | None,
    *,
    progress: Report,
) -> str:
    """The report of a model on one recording, and on one that is held out, as a page of HTML; `diagnosis` is the
    diagnosis, where there is one."""
    content = gather(
        fitted,
        train,
        holdout=holdout,
        extra=effects(own_names),
        command="accelcal app",
        diagnosis=diagnosis,
        progress=within(progress, 0.0, 0.9),
    )
    return html(content)


def exported(fitted: Fit, kind: Export, name: str, *, progress: Report) -> str:
    """The sensor's own calibration in one of the formats, as the content of a file called `name`."""
    if fitted.axes:
        raise AccelcalError(
            f"{kind}: a model of three outputs is several files; save it (Model), then `accelcal export model.json --c "
            "sensor.h --rust sensor.rs --parameters sensor.yaml`"
        )
    calibration = calibrate(fitted)
    texts: dict[Export, Callable[[], str]] = {
        "C": lambda: header(calibration, name),
        "Rust": lambda: module(calibration),
        "JSON": lambda: model_file.dumps(content_of(calibration)),
        "DCC": lambda: draft(calibration, Laboratory()).text,
    }
    return texts[kind]()


def tried(formulas: Sequence[Formula], *, progress: Report) -> None:
    """Evaluate formulas of the user for the first time."""
    for number, formula in enumerate(formulas, start=1):
        formula.try_out()
        progress(number / len(formulas))


def simulated(path: Path, name: str, *, progress: Report) -> None:
    """Write an example recording, and its sidecar."""
    record = EXAMPLES[name].record()
    io.write_sidecar(record.rig, io.write_csv(record, path), io.sidecar_of(path))


def effects(names: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of the catalogue by their names."""
    return tuple(find(name) for name in names)


FORM = "the form"
"""Name of a file with what was declared on the page, as sentences have it: nobody made a sidecar."""
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
        """Read files of one sensor; one without a sidecar has that of a recording with the same columns, or the rig of
        the first one that has a sidecar.

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
        by_number: dict[int, Run] = {}
        for number, part in zip(order, parts_of(progress, len(paths)), strict=True):
            by_number[number] = self.run(paths[number], None, [*present, *by_number.values()], part)
        return tuple(by_number[number] for number in range(len(paths)))

    def run(self, path: Path, sidecar: str | None, lenders: Sequence[Run], progress: Report) -> Run:
        """Read a file; where its columns are not understood, `Run.problem` says why.

        Parameters
        ----------
        path : the file.
        sidecar : text in place of the sidecar beside it.
        lenders : one of which declares what it is where it has no sidecar.

        Raises
        ------
        RecordingError
            If it cannot be read as a table.
        """
        names: tuple[str, ...] = ()
        template = ""
        lender: Run | None = None
        try:
            size = path.stat().st_size if path.is_file() else 0
            if size > MOST_BYTES:
                raise RecordingError(
                    f"{path.name}: {size / 1e6:.0f} MB; the limit of the workbench is {MOST_BYTES / 1e6:.0f} MB. "
                    "Convert it to Parquet, cut it, or use the command line"
                )
            names, template = self.done(columns, path, progress=within(progress, 0.0, 0.1))
            rig: Path | Rig | None = self.declared(path, sidecar)
            if sidecar is None and not has_sidecar(path):
                lender = lender_among(lenders, names)
            if lender is not None:
                rig, template = self.lent(lender, names, template)
            content = self.read(path, rig, within(progress, 0.1, 0.4))
        except RecordingError as error:
            if not names:
                raise
            return Run(path, sidecar, columns=names, template=template, problem=self.plain(str(error)))
        progress(0.4)
        if isinstance(content, Dwells):
            return Run(path, sidecar, columns=names, template=template, dwells=content)
        self.arrived(content[0])
        result, summary = self.done(check, content, (), progress=within(progress, 0.4, 0.98))
        return Run(
            file=path,
            sidecar=sidecar,
            lender=lender.name if lender is not None else "",
            columns=names,
            template=template,
            recording=content[0],
            axes=content if len(content) > 1 else (),
            summary=summary,
            used=(result.start, result.end),
            breaks=result.breaks,
            marks=result,
        )

    def lent(self, lender: Run, names: Sequence[str], template: str) -> tuple[Path | Rig, str]:
        """What a file with columns of these names has of another one, and the text of a sidecar for it: the sidecar
        where the columns are the same, else the rig alone."""
        assert lender.recording is not None
        if lender.columns != tuple(names):
            return lender.recording.rig, template
        beside = io.sidecar_of(lender.file)
        return self.declared(lender.file, lender.sidecar) or beside, mapping.text_of(lender.file, lender.sidecar, "")

    def declared(self, path: Path, sidecar: str | None) -> Path | None:
        """The file of a sidecar that the user has written here; None: the one beside the recording."""
        if sidecar is None:
            return None
        declared = self.folder / "sidecar" / path.stem / FORM
        declared.parent.mkdir(parents=True, exist_ok=True)
        io.atomic_write(declared, sidecar)
        return declared

    def read(self, path: Path, rig: Path | Rig | None, progress: Report) -> tuple[Recording, ...] | Dwells:
        """Read a file as what it is.

        Raises
        ------
        RecordingError
            If it is not understood, or has more samples than the workbench takes.
        """
        content: tuple[Recording, ...] | Dwells = self.done(load, path, rig, progress=progress)
        if isinstance(content, Dwells):
            return content
        recording = content[0]
        if len(recording.accel) > MOST_SAMPLES:
            raise RecordingError(
                f"{path.name}: {len(recording.accel)} samples; the limit of the workbench is {MOST_SAMPLES}. "
                "Cut the file, or use the command line"
            )
        side_channels(units_of(recording))  # their effects have names in every process
        return content


def lender_among(runs: Sequence[Run], names: Sequence[str]) -> Run | None:
    """The first recording with a sidecar of its own; one whose columns have these names comes before others."""
    declared = [run for run in runs if run.recording is not None and (run.sidecar is not None or has_sidecar(run.file))]
    return next((run for run in declared if run.columns == tuple(names)), declared[0] if declared else None)
