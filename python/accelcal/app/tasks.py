"""The long work of a workbench, one function each: what goes in and what comes out can be sent to another process."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Literal, TypeAlias

from accelcal import io
from accelcal._support.progress import within
from accelcal.app import mapping
from accelcal.app.examples import EXAMPLES
from accelcal.app.session_content import Formula
from accelcal.app.workers import Report
from accelcal.calibration.export import Laboratory, calibrate, draft, header, module
from accelcal.data import summary
from accelcal.data.dwells import Dwells
from accelcal.data.recording import Recording
from accelcal.data.rig import Rig
from accelcal.diagnosis.run_agreement import RunValues
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect, find
from accelcal.estimation.estimate import Fit
from accelcal.model import Model
from accelcal.plots.timeline import Marks, marks
from accelcal.report import gather, html
from accelcal.response import FrequencyResponse, frequency_response
from accelcal.results import model_file
from accelcal.results.json import content as content_of
from accelcal.signals.signals import Origins
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.ruler import Ruler
from accelcal.workflow import add, compare, compare_models, diagnose, drop, fit, run_values

Data: TypeAlias = Sequence[Recording | Dwells]
"""What models are fitted to: recordings and dwells of one sensor."""
Export = Literal["C", "Rust", "JSON", "DCC"]


@dataclass(frozen=True, slots=True)
class Checked:
    """What was found in a recording."""

    marks: Marks
    summary: Mapping[str, Any]
    """As `accelcal check --json` prints it."""


def columns(path: Path, *, progress: Report) -> tuple[tuple[str, ...], str]:
    """Names of the columns of a file, and the template of a sidecar for it."""
    return mapping.columns_of(path), io.template(path)


def load(path: Path, rig: Path | Rig | None, *, progress: Report) -> Recording | Dwells:
    """Read a recording, or dwells where the file or its sidecar says that it is some."""
    beside = rig if isinstance(rig, Path) else None
    return io.load_dwells(path, beside) if io.declares_dwells(path, beside) else io.load(path, rig)


def check(recording: Recording, *, progress: Report) -> Checked:
    """Look for breaks, faults and rest."""
    found = marks(recording)
    progress(0.9)
    return Checked(found, summary.describe(recording))


def fitted(model: Model, train: Data, origins: Origins | None, *, progress: Report) -> Fit:
    """Fit a model."""
    return fit(list(train), model, origins=origins, progress=progress)


def added(before: Fit, train: Data, name: str, own: Sequence[str], *, progress: Report) -> Fit:
    """Fit again with an effect more; `own` names effects of the user."""
    return add(before, list(train), name, extra=effects(own), progress=progress)


def dropped(before: Fit, train: Data, name: str, *, progress: Report) -> Fit:
    """Fit again with an effect less."""
    return drop(before, list(train), name, progress=progress)


def compared(fits: Sequence[Fit], data: Sequence[Recording], names: Sequence[str], *, progress: Report) -> Comparison:
    """Compare models with data under one ruler."""
    return compare(fits, list(data), names=names, progress=progress)


def judged(
    fits: Sequence[Fit], data: Sequence[Recording], ruler: Ruler, base: Fit, *, progress: Report
) -> tuple[tuple[Evaluation, ...], ...]:
    """Compare models with recordings, all with the filter of `ruler`, above the noise floor of the model they grew
    from: for each model its comparisons."""
    found, part = [], 1.0 / len(data)
    for number, one in enumerate(data):
        found.append(compare_models(fits, one, ruler, within(progress, number * part, (number + 1) * part), base=base))
    return tuple(zip(*found, strict=True))


def responded(recording: Recording, *, progress: Report) -> FrequencyResponse:
    """Sensitivity by frequency."""
    return frequency_response(recording)


def diagnosed(found: Fit, train: Data, own: Sequence[str], *, progress: Report) -> Diagnosis:
    """Search for missing effects."""
    return diagnose(found, list(train), extra=effects(own), progress=progress)


def values_of_runs(found: Fit, train: Data, *, progress: Report) -> RunValues:
    """Parameters of each recording alone."""
    return run_values(found, list(train))


def reported(
    found: Fit, train: Recording, holdout: Recording, own: Sequence[str], known: Diagnosis | None, *, progress: Report
) -> str:
    """The report of a model on one recording, and on one that is held out, as a page of HTML; `known` is the
    diagnosis, where there is one."""
    content = gather(
        found,
        train,
        holdout=holdout,
        extra=effects(own),
        command="accelcal app",
        diagnosis=known,
        progress=within(progress, 0.0, 0.9),
    )
    return html(content)


def exported(found: Fit, kind: Export, name: str, *, progress: Report) -> str:
    """The sensor's own calibration in one of the formats, as the content of a file called `name`."""
    made = calibrate(found)
    texts: dict[Export, Callable[[], str]] = {
        "C": lambda: header(made, name),
        "Rust": lambda: module(made),
        "JSON": lambda: model_file.dumps(content_of(made)),
        "DCC": lambda: draft(made, Laboratory()).text,
    }
    return texts[kind]()


def tried(formulas: Sequence[Formula], *, progress: Report) -> None:
    """Evaluate formulas of the user for the first time."""
    for number, formula in enumerate(formulas, start=1):
        formula.try_out()
        progress(number / len(formulas))


def simulated(path: Path, name: str, *, progress: Report) -> None:
    """Write an example recording, and its sidecar."""
    made = EXAMPLES[name].record()
    io.write_sidecar(made.rig, io.write_csv(made, path), io.sidecar_of(path))


def effects(names: Sequence[str]) -> tuple[Effect, ...]:
    """Effects of the catalogue by their names."""
    return tuple(find(name) for name in names)
