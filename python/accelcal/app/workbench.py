"""One user's workbench: actions on its state through the public functions, independent of any page.

Every action replaces the state by a new one, whole or not at all. One action runs at a time; a cancelled one leaves the
state as it was.
"""

from __future__ import annotations

import itertools
import re
import shutil
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal

from accelcal import io
from accelcal._support import internal_error
from accelcal._support.progress import within
from accelcal.app import mapping, session_file, tasks
from accelcal.app.examples import PREFIX
from accelcal.app.known import Known, units_of
from accelcal.app.opened_session import OpenedSession
from accelcal.app.own_formula import OwnFormula
from accelcal.app.state import Cancelled, Change, Job, State, Step, Stretch
from accelcal.app.tasks import Export
from accelcal.app.workers import Compute, Report, direct
from accelcal.data.recording import Recording, RecordingError
from accelcal.data.rig import Rig
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects.side_channels import side_channels
from accelcal.estimation.estimate import Fit, require_distinct
from accelcal.model import Model
from accelcal.serialization import model_file
from accelcal.signals.signals import Origins
from accelcal.validation.comparison import HELD_OUT, Comparison
from accelcal.validation.ruler import Ruler

MOST_BYTES = 1_000_000_000
"""Largest file that is read."""
MOST_SAMPLES = 20_000_000
"""Largest number of accelerometer samples."""
EXPORTS: dict[Export, str] = {"C": "sensor.h", "Rust": "sensor.rs", "JSON": "sensor.json", "DCC": "draft.xml"}
"""Formats of an exported calibration, with their file names."""
SUFFIXES = (".csv", ".txt", ".tsv", ".parquet", ".mat", ".npz", ".h5", ".hdf5")
MOST_KEPT = 4_000_000_000
"""Most that the files of one session take, bytes."""
MOST_UNDO = 100
"""Changes that can be undone."""
UNUSED = 600.0
"""Age from which files that no state names are removed, s."""
MOST_NAME = 100
"""Length of the name that an uploaded file is kept under, bytes; a file system takes 255."""


class Refused(ValueError):
    """An action that is not possible now. The text says why and what to do first."""


class Workbench:
    """The loop with undo and branches: load, divide, fit, diagnose, add, drop, hold.

    Parameters
    ----------
    folder : for uploaded files and sidecars of this user.
    compute : how long work is done; by default here, in the calling thread.
    """

    def __init__(self, folder: Path, compute: Compute = direct) -> None:
        self.folder = folder
        self._compute = compute
        self.state = State()
        self.job: Job | None = None
        self.sentence = ""
        """The last error, for the user; empty after a success."""
        self.arriving: Recording | None = None
        """A recording that was read and is still being checked for breaks and faults."""
        self.version = 0
        """Incremented with every change that a page must show."""
        self.diagnoses: dict[tuple[int, int], Diagnosis] = {}
        """By key of the model and number of user effects among the candidates."""
        self._keys = itertools.count(1)
        self._lock = threading.RLock()
        self._whole: tuple[int, Comparison] | None = None
        self.changed: Callable[[State], object] = lambda state: None
        """Called with each new state."""
        self._undo: list[State] = []
        self._redo: list[State] = []

    # Data

    def upload_folder(self) -> Path:
        """Return a new folder for files that were dropped together, so that no older sidecar is in it."""
        self._sweep()
        new = self.folder / f"drop{next(self._keys)}"
        new.mkdir(parents=True)
        return new

    def require_room(self) -> None:
        """Refuse further files of a session whose files take too much of the disk.

        Raises
        ------
        Refused
            With what they take and the limit.
        """
        taken = sum(file.stat().st_size for file in self.folder.rglob("*") if file.is_file())
        if taken > MOST_KEPT:
            raise Refused(
                f"the recordings of this session take {taken / 1e9:.1f} GB, and {MOST_KEPT / 1e9:.0f} GB is the limit; "
                "save the session, and open it in a new tab"
            )

    def _sweep(self) -> None:
        """Remove files that no undo brings back."""
        with self._lock:
            states = [self.state, *self._undo, *self._redo]
        used = {file.parent for state in states for file in (state.file, state.other_file) if file is not None}
        used |= {file.parent for state in states if state.opened for file in state.opened.given.values()}
        for old in self.folder.glob("drop*"):
            if old not in used and time.time() - old.stat().st_mtime > UNUSED:
                shutil.rmtree(old, ignore_errors=True)

    @staticmethod
    def upload_path(name: str, upload_folder: Path) -> Path:
        """Return the path for an uploaded file called `name`: inside `upload_folder`, whatever the name contains.

        Raises
        ------
        Refused
            If the file has an ending that is not read here.
        """
        bare = re.sub(r"[^\w.+ -]", "_", name.replace("\\", "/").rpartition("/")[2]).lstrip(". ")
        stem, dot, ending = bare.rpartition(".")
        ending = dot + ending.lower()
        if not stem or ending not in (*SUFFIXES, ".toml", session_file.SUFFIX):
            shown = bare[-40:] or name[-40:]
            raise Refused(
                f"{shown!r}: drop a recording ({', '.join(SUFFIXES)}), its sidecar (.toml) or a session "
                f"({session_file.SUFFIX})"
            )
        kept = stem.encode(errors="ignore")[: MOST_NAME - len(ending)].decode(errors="ignore").rstrip()
        return upload_folder / f"{kept or 'recording'}{bare[len(stem) :]}"

    def load(self, path: str | Path, sidecar: str | None = None) -> None:
        """Read a recording; where its columns are not understood, `State.problem` says why until they are mapped.

        Parameters
        ----------
        path : the file.
        sidecar : text in place of the sidecar beside the file.
        """
        path = Path(path)
        self._perform(f"reading {path.name}", lambda state, report: self._load(path, sidecar, report))

    def _load(self, path: Path, sidecar: str | None, report: Report) -> State:
        columns: tuple[str, ...] = ()
        template = ""
        try:
            require_size(path)
            columns, template = self._done(tasks.columns, path, report=within(report, 0.0, 0.1))
            recording = self._read(path, self._declared(path, sidecar), within(report, 0.1, 0.4))
        except RecordingError as error:
            if not columns:
                raise
            problem = self.plain(str(error))
            return State(file=path, sidecar=sidecar, columns=columns, template=template, problem=problem)
        report(0.4)
        with self._lock:
            self.arriving = recording
            self.version += 1
        found: tasks.Checked = self._done(tasks.check, recording, report=within(report, 0.4, 0.98))
        seen = found.marks
        begin, end = seen.start, seen.end
        return State(
            file=path,
            sidecar=sidecar,
            columns=columns,
            template=template,
            recording=recording,
            summary=found.summary,
            used=(begin, end),
            breaks=seen.breaks,
            marks=seen,
            held_out=(round(end - HELD_OUT * (end - begin), 3), end if seen.breaks else time_span(recording)[1]),
        )

    def _declared(self, path: Path, sidecar: str | None) -> Path | None:
        """The file of a sidecar that the user has written here; None: the one beside the recording."""
        if sidecar is None:
            return None
        declared = self.folder / "sidecar" / io.sidecar_of(path).name
        declared.parent.mkdir(parents=True, exist_ok=True)
        io.atomic_write(declared, sidecar)
        return declared

    def _read(self, path: Path, rig: Path | Rig | None, report: Report) -> Recording:
        recording: Recording = self._done(tasks.load, path, rig, report=report)
        if len(recording.accel) > MOST_SAMPLES:
            raise RecordingError(
                f"{path.name}: {len(recording.accel)} samples; the limit of the workbench is {MOST_SAMPLES}. "
                "Cut the file, or use the command line"
            )
        side_channels(units_of(recording))  # their effects have names in every process
        return recording

    def load_other(self, path: str | Path) -> None:
        """Hold out another recording instead of a part of this one."""
        path = Path(path)

        def work(state: State, report: Report) -> State:
            require_size(path)
            if state.recording is None:
                raise Refused("load the recording to fit first")
            other = self._read(path, None if io.sidecar_of(path).exists() else state.recording.rig, report)
            require_distinct([state.recording, other])
            return without_models(replace(state, other=other, other_file=path, held_out=None))

        self._perform(f"reading {path.name}", work)

    def open(self, path: str | Path) -> None:
        """Go on with the work of a session file; a recording that is missing is asked for: `State.opened`."""
        path = Path(path)

        def work(state: State, report: Report) -> State:
            return self._resumed(OpenedSession(*session_file.read(path)), report)

        self._perform(f"opening {path.name}", work)

    def give(self, path: str | Path) -> None:
        """Give the recording that an opened session asks for."""
        path = Path(path)

        def work(state: State, report: Report) -> State:
            if state.opened is None:
                raise Refused("open a session first")
            return self._resumed(state.opened.with_file(path), report)

        self._perform(f"reading {path.name}", work)

    def _resumed(self, opened: OpenedSession, report: Report) -> State:
        """The state that a session file holds, its recordings read again and its models compared again."""
        missing = opened.missing
        if missing is not None:
            return State(opened=replace(opened, awaited=missing))
        with Known().catalogue():  # the work that it takes the place of leaves no effects behind
            return self._read_again(opened, report)

    def _read_again(self, opened: OpenedSession, report: Report) -> State:
        """The same, with every recording at hand."""
        content = opened.content
        formulas = [OwnFormula.of_stored(formula) for formula in content.own]
        self._done(tasks.tried, formulas, report=within(report, 0.0, 0.1), state=State())
        own = tuple(formula.enter() for formula in formulas)
        path = opened.path(content.recording)
        beside = content.sidecar == (mapping.text_of(path, None, "") or None)
        state = self._load(path, None if beside else content.sidecar, within(report, 0.1, 0.5))
        if state.recording is None:
            raise Refused(state.problem)
        held_out, excluded, whole_rig = content.held_out, tuple(content.excluded), state.recording.rig
        state = replace(state, held_out=held_out, excluded=excluded, own=own)
        if content.other is not None:
            path = opened.path(content.other)
            rig = self._declared(path, content.other_sidecar) or whole_rig
            other = self._read(path, rig, within(report, 0.5, 0.7))
            state = replace(state, other=other, other_file=path)
        require_both_parts(state)
        return self._with_models(state, opened, within(report, 0.7, 0.98))

    def _with_models(self, state: State, opened: OpenedSession, report: Report) -> State:
        """The state with the tree of models of a session file, under keys of this workbench."""
        stored = opened.content.steps
        if not stored:
            return state
        fits = [self._model(opened.models[step.key], step.key) for step in stored]
        ruler = Ruler.of(fits)
        compared = self._done(tasks.judged, fits, state.unseen, ruler, fits[0], report=report, state=state)
        keys: dict[int | None, int | None] = {None: None}
        steps: list[Step] = []
        for step, found, heldout in zip(stored, fits, compared, strict=True):
            key = keys[step.key] = next(self._keys)
            change = Change(step.kind, step.name, step.value)
            parent = next((s.fit for s in steps if s.key == keys[step.parent]), None)
            require_made(change, found, parent)
            steps.append(Step(key, keys[step.parent], change, found, heldout))
        return replace(state, steps=tuple(steps), current=keys[opened.content.current])

    def _model(self, text: str, key: int) -> Fit:
        """A model of a session file."""
        path = self.folder / "models" / f"{key}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return model_file.load(path)

    def session(self) -> bytes:
        """The work as a session file."""
        return session_file.dumps(self.state)

    def hold_out(self, start: float, end: float) -> None:
        """Choose the part of the recording that is held out."""

        def work(state: State, report: Report) -> State:
            begin, finish = inside_used(state, start, end)
            new = replace(state, held_out=(begin, finish), other=None, other_file=None)
            require_both_parts(new)
            return without_models(new)

        self._perform("choosing the held-out part", work)

    def exclude(self, start: float, end: float) -> None:
        """Exclude a stretch from both fit and validation."""

        def work(state: State, report: Report) -> State:
            new = replace(state, excluded=(*state.excluded, inside_used(state, start, end)))
            require_both_parts(new)
            return without_models(new)

        self._perform("excluding a stretch", work)

    def use_again(self, number: int) -> None:
        """Include a stretch again that was excluded."""

        def work(state: State, report: Report) -> State:
            if not 0 <= number < len(state.excluded):
                raise Refused(f"there is no excluded stretch {number}")
            return without_models(replace(state, excluded=state.excluded[:number] + state.excluded[number + 1 :]))

        self._perform("including a stretch again", work)

    # Models

    def fit(self, model: Literal["linear", "cubic"] = "linear") -> None:
        """Fit a base model to what is not held out."""

        def work(state: State, report: Report) -> State:
            chosen = {"linear": Model.linear, "cubic": Model.cubic}[model]()
            bare = without_models(loaded(state))
            return self._grown(bare, Change("base", model), self._fitted(chosen, None, state, report), report)

        self._perform("fitting the base model", work)

    def add(self, name: str) -> None:
        """Add an effect to the current model, and fit again."""

        def work(state: State, report: Report) -> State:
            before, own = fitted(state).fit, names_of(state)
            found = self._done(tasks.added, before, state.train, name, own, report=first_part(report))
            return self._grown(state, Change("add", name), found, report)

        self._perform(f"adding {name}", work)

    def drop(self, name: str) -> None:
        """Remove an effect from the current model, and fit again."""

        def work(state: State, report: Report) -> State:
            found = self._done(tasks.dropped, fitted(state).fit, state.train, name, report=first_part(report))
            return self._grown(state, Change("drop", name), found, report)

        self._perform(f"removing {name}", work)

    def freeze(self, name: str, value: float) -> None:
        """Hold a parameter at a value (SI), and fit the others again."""

        def work(state: State, report: Report) -> State:
            before = fitted(state).fit
            require_parameter(before, name)
            found = self._fitted(before.model.freeze(**{name: value}), before.origins, state, report)
            return self._grown(state, Change("hold", name, value), found, report)

        self._perform(f"fixing {name}", work)

    def release(self, name: str) -> None:
        """Let a held parameter be estimated again."""

        def work(state: State, report: Report) -> State:
            before = fitted(state).fit
            found = self._fitted(before.model.release(name), before.origins, state, report)
            return self._grown(state, Change("release", name), found, report)

        self._perform(f"freeing {name}", work)

    def _fitted(self, model: Model, origins: Origins | None, state: State, report: Report) -> Fit:
        found: Fit = self._done(tasks.fitted, model, state.train, origins, report=first_part(report))
        return found

    def _grown(self, state: State, change: Change, found: Fit, report: Report) -> State:
        """The state with one more model, made the current one; all models are compared with one filter."""
        before, ruler = [step.fit for step in state.steps], Ruler.of([*(step.fit for step in state.steps), found])
        again = state.steps if before and Ruler.of(before) != ruler else ()
        fits = [*(step.fit for step in again), found]
        base = before[0] if before else found
        judged = self._done(tasks.judged, fits, state.unseen, ruler, base, report=within(report, 0.8, 1.0))
        *others, last = judged
        compared = tuple(replace(step, heldout=heldout) for step, heldout in zip(again, others, strict=True))
        step = Step(next(self._keys), state.current, change, found, last)
        return replace(state, steps=(*(compared or state.steps), step), current=step.key)

    def _done(
        self,
        task: Callable[..., Any],
        *args: Any,
        report: Report = lambda share: None,
        state: State | None = None,
    ) -> Any:
        """The result of long work on the data of a state, by default the present one."""
        return self._compute(task, *args, report=report, known=Known.to(self.state if state is None else state))

    def own_effect(self, name: str, expression: str, unit: str, port: Literal["output", "position"]) -> None:
        """Add a user effect, given as a formula, to the candidates."""

        def work(state: State, report: Report) -> State:
            channels = tuple(loaded(state).data.side)
            if name in names_of(state):
                raise Refused(f"{name} is a candidate already")
            formula = OwnFormula(name, expression, unit or "1", port, channels)
            self._done(tasks.tried, [formula], report=report)
            return replace(state, own=(*state.own, formula.enter()))

        self._perform(f"entering {name}", work)

    def diagnose(self) -> None:
        """Diagnose the current model; the result goes into `diagnoses`."""
        with self._lock:
            state = self.state
        asked = question(state)
        if asked is None or asked in self.diagnoses:
            return
        with self._working("searching for missing effects", silent=True) as job:
            step = fitted(state)
            own, report = names_of(state), within(job.report, 0.0, 0.98)
            found = self._done(tasks.diagnosed, step.fit, state.train, own, report=report)
            with self._lock:
                job.report(1.0)
                self.diagnoses[asked] = found

    @property
    def diagnosis(self) -> Diagnosis | None:
        """Diagnosis of the current model; None until there is one."""
        asked = question(self.state)
        return None if asked is None else self.diagnoses.get(asked)

    def look_at(self, key: int) -> None:
        """Make another model of the tree the current one; adding to it begins a branch."""

        def work(state: State, report: Report) -> State:
            if key not in {s.key for s in state.steps}:
                raise Refused("this model is no longer in the tree")
            return replace(state, current=key)

        self._perform("", work)

    def undo(self) -> None:
        """Undo the last change."""
        self._swap(self._undo, self._redo)

    def redo(self) -> None:
        """Redo the last change that was undone."""
        self._swap(self._redo, self._undo)

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to undo."""
        return bool(self._undo) and self.job is None

    @property
    def can_redo(self) -> bool:
        """Whether there is a change to redo."""
        return bool(self._redo) and self.job is None

    def _swap(self, source: list[State], target: list[State]) -> None:
        with self._lock:
            if source and self.job is None:
                target.append(self.state)
                self.state = source.pop()
                self.changed(self.state)
                self.sentence = ""
                self.version += 1

    def whole(self) -> Comparison | None:
        """The current model against all data in use, the held-out part included; cached for one model."""
        state = self.state
        if state.step is None:
            return None
        kept = self._whole
        if kept is None or kept[0] != state.step.key:
            kept = self._whole = (state.step.key, self._done(tasks.compared, state.step.fit, state.data))
        return kept[1]

    def before(self) -> Comparison | None:
        """The previous model against held-out data, with the filter and in the band of the current comparison."""
        return None if self.state.previous is None else self.state.previous.heldout

    def refuse(self, sentence: str) -> None:
        """Tell the user why an action was refused."""
        with self._lock:
            self.sentence = self.plain(sentence)
            self.version += 1

    # Export

    def example(self, name: str) -> None:
        """Simulate an example recording with a hidden effect, and load it.

        Parameters
        ----------
        name : of an example in `accelcal.app.examples.EXAMPLES`.
        """
        path = self.upload_folder() / f"{PREFIX}{name}.csv"

        def work(state: State, report: Report) -> State:
            self._done(tasks.simulated, path, name, report=within(report, 0.0, 0.3))
            return self._load(path, None, within(report, 0.3, 1.0))

        self._perform("simulating a recording", work)

    def model_text(self) -> str:
        """The current model, as `accelcal fit -o` writes it."""
        with self.catalogue():
            return model_file.dumps(model_file.to_dict(fitted(self.state).fit))

    def report(self) -> Path | None:
        """Write the report of the current model; None where that failed or was cancelled."""
        with self._working("writing the report") as job:
            state = self.state
            found, own, report = fitted(state).fit, names_of(state), within(job.report, 0.0, 0.99)
            page = self._done(tasks.reported, found, state.train, state.unseen, own, self.diagnosis, report=report)
            job.report(1.0)
            target = self.upload_folder() / "report.html"
            io.atomic_write(target, page)
            return target
        return None

    def export(self, kind: Export) -> Path | None:
        """Write the sensor's own calibration; None where the model cannot be exported: `sentence` says why."""
        with self._working("writing the calibration") as job:
            target = self.upload_folder() / EXPORTS[kind]
            text = self._done(tasks.exported, fitted(self.state).fit, kind, target.name, report=job.report)
            io.atomic_write(target, text)
            return target
        return None

    # Work

    def catalogue(self) -> AbstractContextManager[None]:
        """The catalogue of effects of this session as it is now; nobody else in the process sees it."""
        return Known.to(self.state).catalogue()

    def cancel(self) -> None:
        """Cancel the running action and discard its result."""
        with self._lock:
            if self.job is not None:
                self.job.cancelled = True
                self.job = None
                self.arriving = None
                self.sentence = "Cancelled; nothing was changed."
                self.version += 1

    def _perform(self, title: str, work: Callable[[State, Report], State]) -> None:
        """Replace the state by what `work` returns."""
        with self._working(title) as job:
            before = self.state
            after = work(before, job.report)
            with self._lock:
                job.report(1.0)  # last chance to be cancelled
                if after is not before:
                    self._undo = [*self._undo[1 - MOST_UNDO :], before]
                    self._redo.clear()
                    self.state = after
                    self.changed(after)

    @contextmanager
    def _working(self, title: str, *, silent: bool = False) -> Iterator[Job]:
        """One action at a time; what the library refuses becomes the sentence that the command line prints.

        A silent one changes nothing on the page until it ends.
        """
        with self._lock:
            if self.job is not None:
                self.sentence = f"Please wait: {self.job.title}, or cancel it."
                self.version += 1
                return_early = True
            else:
                return_early = False
                silent = silent and not self.sentence
                self.sentence = ""
                job = self.job = Job(title)
                self.version += not silent
        if return_early:
            raise Busy(self.sentence)
        try:
            with self.catalogue():
                yield job
        except Cancelled:
            pass
        except Exception as error:
            text = internal_error.sentence(error)
            with self._lock:
                if not job.cancelled:
                    self.sentence = self.plain(text)
        finally:
            with self._lock:
                if self.job is job:
                    self.job = None
                self.arriving = None
                self.version += 1

    def plain(self, text: str) -> str:
        """A sentence of the library with file names as the user knows them, without the folder of the workbench."""
        return re.sub(re.escape(str(self.folder)) + r"/(?:sidecar/|models/|drop\d+/)?", "", text)


class Busy(Exception):
    """Another action is under way."""


def require_size(path: Path) -> None:
    """Refuse a file that is too large for the workbench.

    Raises
    ------
    RecordingError
        With the size and the limit.
    """
    size = path.stat().st_size if path.is_file() else 0
    if size > MOST_BYTES:
        raise RecordingError(
            f"{path.name}: {size / 1e6:.0f} MB; the limit of the workbench is {MOST_BYTES / 1e6:.0f} MB. "
            "Convert it to Parquet, cut it, or use the command line"
        )


def loaded(state: State) -> State:
    """Return the state, or refuse where no recording is loaded."""
    if state.recording is None:
        raise Refused("load a recording first")
    return state


def fitted(state: State) -> Step:
    """The current model, or refuse where there is none."""
    if state.step is None:
        raise Refused("fit a model first")
    return state.step


def without_models(state: State) -> State:
    """The state without its models, which were fitted to other data."""
    return replace(state, steps=(), current=None)


def time_span(recording: Recording) -> Stretch:
    """First and last time stamp of any channel, s."""
    channels = [c for c in (recording.accel, recording.position, *recording.side.values()) if len(c)]
    return min(float(c.t[0]) for c in channels), max(float(c.t[-1]) for c in channels)


def inside_used(state: State, start: float, end: float) -> Stretch:
    """A stretch cut to the used range; one that reaches an end includes the last samples of every channel there."""
    low, high = loaded(state).used
    begin, finish = max(low, min(start, end)), min(high, max(start, end))
    if not begin < finish:
        raise Refused(f"{start:g} s to {end:g} s is outside the used range of the recording, {low:g} s to {high:g} s")
    assert state.recording is not None
    if not state.breaks:
        first, last = time_span(state.recording)
        begin, finish = (first if begin == low else begin), (last if finish == high else finish)
    return begin, finish


def require_both_parts(state: State) -> None:
    """Refuse a division that leaves no data to fit, or none to validate on."""
    train, unseen = state.train, state.unseen
    for part, purpose in ((train, "to fit"), (unseen, "to hold out")):
        if not len(part.position) or not len(part.accel):
            raise Refused(f"no data would be left {purpose}; choose a shorter stretch")


def require_parameter(found: Fit, name: str) -> None:
    """Refuse a name that the fit does not have."""
    if name not in {e.name for e in (*found.estimates, *found.shapes)}:
        raise Refused(f"{name!r} is not a parameter of this model")


def names_of(state: State) -> tuple[str, ...]:
    """Names of user-defined effects."""
    return tuple(own.effect.name for own in state.own)


def require_made(change: Change, found: Fit, parent: Fit | None) -> None:
    """Refuse a model of a session file that did not come from its parent as the file says."""
    held = {e.name for e in (*found.estimates, *found.shapes)}
    fits = {
        "base": parent is None,
        "add": change.name in found.model.effects,
        "drop": parent is not None and change.name in parent.model.effects,
        "hold": change.name in held,
        "release": change.name in held,
    }
    if not fits[change.kind]:
        raise Refused(f"the session says {change.label[:100]!r} of a model that is not so; take a copy that is whole")


def question(state: State) -> tuple[int, int] | None:
    """Key of a diagnosis: the model, and the number of user effects among the candidates."""
    return None if state.current is None else (state.current, len(state.own))


def first_part(report: Report) -> Report:
    """Progress of a fit that is then compared with held-out data."""
    return within(report, 0.0, 0.8)
