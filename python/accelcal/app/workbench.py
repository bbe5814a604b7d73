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
from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager, contextmanager, suppress
from dataclasses import replace
from functools import wraps
from pathlib import Path
from typing import Any, Concatenate, Literal, ParamSpec

from accelcal import io, verbs
from accelcal._support import errors
from accelcal._support.process import parts_of, within
from accelcal.app import mapping, session_file, tasks
from accelcal.app.state import (
    MOST_GUESTS,
    Cancelled,
    Change,
    Formula,
    Guest,
    Job,
    OpenedSession,
    Refused,
    Role,
    Run,
    SessionEffects,
    State,
    Step,
    Stretch,
    divided,
    time_span,
    with_files_held_out,
    with_role,
    with_something_held_out,
    with_use,
)
from accelcal.app.tasks import PREFIX, Export, Reader
from accelcal.app.workers import Compute, Report, Result, direct
from accelcal.data import Recording, require_same_sensor
from accelcal.diagnosis.runs import RunValues
from accelcal.diagnosis.verdict import AxesDiagnosis, Diagnosis
from accelcal.estimation import tracks
from accelcal.estimation.estimate import Fit, require_distinct
from accelcal.estimation.shape_parameters import moves
from accelcal.io.files import READABLE
from accelcal.model import Model
from accelcal.response import FrequencyResponse
from accelcal.results import model_file
from accelcal.validation.comparison import Evaluation
from accelcal.validation.differences import Comparison
from accelcal.validation.noise_floor import Ruler

EXPORTS: dict[Export, str] = {"C": "sensor.h", "Rust": "sensor.rs", "JSON": "sensor.json", "DCC": "draft.xml"}
"""Formats of an exported calibration, with their file names."""
MOST_KEPT = 4_000_000_000
"""Most that the files of one session take, bytes."""
MOST_UNDO = 100
"""Changes that can be undone."""
UNUSED = 600.0
"""Age from which files that no state names are removed, s."""
MOST_NAME = 100
"""Length of the name that an uploaded file is kept under, bytes; a file system takes 255."""


P = ParamSpec("P")


def action(
    title: str = "",
) -> Callable[[Callable[Concatenate[Workbench, State, Report, P], State]], Callable[Concatenate[Workbench, P], None]]:
    """Make a method that returns the next state an action of the user, which replaces the state.

    Parameters
    ----------
    title : of the action, for people; {0} is its first argument, {state} the state before it.
    """

    def enter(
        work: Callable[Concatenate[Workbench, State, Report, P], State],
    ) -> Callable[Concatenate[Workbench, P], None]:
        @wraps(work)
        def act(self: Workbench, /, *args: P.args, **kwargs: P.kwargs) -> None:
            called = title.format(*map(in_few_words, args), state=self.state)
            self._perform(called, lambda state, progress: work(self, state, progress, *args, **kwargs))

        return act

    return enter


def in_few_words(given: object) -> str:
    """An argument of an action, files by their names."""
    files = given if isinstance(given, Sequence) and not isinstance(given, str) else (given,)
    return f"{len(files)} files" if len(files) > 1 else str(files[0].name if isinstance(files[0], Path) else files[0])


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
        self.diagnoses: dict[tuple[int, int], Diagnosis | AxesDiagnosis] = {}
        """By key of the model and number of user effects among the candidates."""
        self._run_values: dict[int, RunValues] = {}
        """By key of the model."""
        self._responses: dict[str, FrequencyResponse] = {}
        """By digest of the data."""
        self._keys = itertools.count(1)
        self._lock = threading.RLock()
        self._whole: tuple[tuple[int, int, str], Evaluation] | None = None
        self._pair: tuple[State, tuple[str, str], Comparison] | None = None
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
        used = {run.file.parent for state in states for run in state.runs}
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
        if not stem or ending not in (*READABLE, ".toml", ".json", session_file.SUFFIX):
            shown = bare[-40:] or name[-40:]
            raise Refused(
                f"{shown!r}: drop a recording ({', '.join(READABLE)}), its sidecar (.toml) or a session "
                f"({session_file.SUFFIX})"
            )
        stem_kept = stem.encode(errors="ignore")[: MOST_NAME - len(ending)].decode(errors="ignore").rstrip()
        return upload_folder / f"{stem_kept or 'recording'}{bare[len(stem) :]}"

    @action("reading {0}")
    def load(self, state: State, progress: Report, path: Path, sidecar: str | None = None) -> State:
        """Begin anew with a recording; where its columns are not understood, `Run.problem` says why until they are.

        Parameters
        ----------
        path : the file.
        sidecar : text in place of the sidecar beside the file.
        """
        return State(runs=divided([self._reader().run(path, sidecar, (), progress)]))

    @action("reading {0}")
    def load_several(self, state: State, progress: Report, paths: Sequence[Path]) -> State:
        """Begin anew with recordings and dwells of one sensor."""
        return with_one_to_map(State(runs=divided(self._reader().several(paths, (), progress))))

    @action("reading {0}")
    def include(self, state: State, progress: Report, paths: Sequence[Path], role: Role = "hold out") -> State:
        """Read further recordings and dwells, of the sensor of those that are there; dwells are fitted.

        Models stay where the recordings are held out, and the parts that no model was fitted to stay held out, too.
        """
        loaded(state)
        new = self._reader().several(paths, state.runs, within(progress, 0.0, 0.5))
        runs = (*state.runs, *(with_use(run, role) for run in new))
        changed = with_one_to_map(replace(state, runs=with_files_held_out(runs, keep=bool(state.steps))))
        return replace(self._divided(state, changed.runs, within(progress, 0.5, 0.98)), shown=changed.shown)

    @action("reading {state.title}")
    def declare(self, state: State, progress: Report, sidecar: str) -> State:
        """Read the file on the time line again, with a text in place of its sidecar.

        Files with the same columns that share its sidecar, or are not understood either, are read so, too.
        """
        return self._declared(state, sidecar, progress)

    @action("declaring the low-pass")
    def declare_low_pass(self, state: State, progress: Report, cutoff: float) -> State:
        """Declare an RC low-pass of the output for every recording, and fit the models up to the current one again."""
        entry, changed = mapping.LowPassEntry("RC", f"{cutoff:g} Hz"), state
        owners = [number for number, run in enumerate(state.runs) if run.recording is not None and not run.lender]
        for number, part in zip(owners, parts_of(progress, len(owners), 0.0, 0.4), strict=True):
            run = state.runs[number]
            text = mapping.text_of(run.file, run.sidecar, run.template)
            columns = mapping.choices(run.columns, text, run.template)
            sidecar = mapping.sidecar_from(text, columns, changes=entry.changed(text))
            changed = self._declared(replace(changed, shown=number), sidecar, part)
        changed = replace(changed, shown=state.shown)
        for step, part in zip(state.path, parts_of(progress, len(state.path), 0.4, 0.98), strict=True):
            changed = self._grown(changed, step.change, part)
        return changed

    def _declared(self, state: State, sidecar: str, progress: Report) -> State:
        """The state with the file on the time line, and those that share its sidecar, read with another one."""
        asked = state.run
        if asked is None:
            raise Refused("load a recording first")
        same = [run for run in state.runs if run.columns == asked.columns]
        owner = next((run for run in same if run.name == asked.lender), asked)
        sharing = [run for run in state.runs if run.lender == owner.name]
        alike = [owner, *sharing, *(run for run in same if run.problem and run is not owner)]
        read: dict[int, Run] = {}
        for run, part in zip(alike, parts_of(progress, len(alike), 0.0, 0.9), strict=True):
            new = self._reader().run(run.file, None if run in sharing else sidecar, list(read.values()), part)
            if new.problem and not asked.problem and len(state.runs) > 1:
                raise Refused(new.problem)
            read[id(run)] = self._divided_as(run, new)
        runs = tuple(read.get(id(run), run) for run in state.runs)
        if all(run.problem for run in state.runs):
            return without_models(with_one_to_map(replace(state, runs=divided(runs))))
        runs = with_files_held_out(runs, keep=bool(state.steps) or not asked.problem)
        changed = with_one_to_map(replace(state, runs=runs))
        if asked.problem:  # what was understood before is as it was
            return replace(self._divided(state, runs, within(progress, 0.9, 0.98)), shown=changed.shown)
        return without_models(changed)

    def _divided_as(self, before: Run, run: Run) -> Run:
        """A file that was read again with its role, and with its parts where the time line is the same."""
        used = with_use(run, before.role)
        if used.recording is None:
            return used
        if before.recording is None or time_span(before.recording) != time_span(used.recording):
            return replace(used, held_out=used.end if before.held_out is not None else None)
        if before.excluded:
            marks, summary = self._done(tasks.check, recordings_of(used), before.excluded)
            used = replace(used, excluded=before.excluded, marks=marks, summary=summary)
        return replace(used, held_out=before.held_out)

    def _divided(self, state: State, runs: tuple[Run, ...], progress: Report) -> State:
        """The state with other runs; its models stay where what they were fitted to does, and are compared again."""
        bare = without_models(replace(state, runs=runs, looked_at=0))
        require_both_parts(bare)
        if not state.steps or [part.digest for part in bare.train] != [part.digest for part in state.train]:
            return bare
        fits = [step.fit for step in state.steps]
        judged = self._done(tasks.judged, fits, bare.unseen, Ruler.of(fits), fits[0], progress=progress)
        steps = tuple(
            replace(step, heldouts=evaluations) for step, evaluations in zip(state.steps, judged, strict=True)
        )
        return replace(bare, steps=steps, current=state.current)

    def _reader(self) -> Reader:
        return Reader(self._done, self.folder, self.plain, self._arrived)

    def _arrived(self, recording: Recording) -> None:
        with self._lock:
            self.arriving = recording
            self.version += 1

    # Roles

    @action("choosing what is held out")
    def assign(self, state: State, progress: Report, number: int, role: Role) -> State:
        """Choose what a file is used for."""
        return self._divided(state, with_role(state.runs, known_number(state, number), role), progress)

    @action()
    def remove(self, state: State, progress: Report, number: int) -> State:
        """Remove a file."""
        removed = state.runs[known_number(state, number)]
        rest = tuple(run for run in state.runs if run is not removed)
        if not any(run.recording is not None for run in rest):
            raise Refused("this is the only recording; load another one to begin anew")
        if lent := next((run for run in rest if run.lender == removed.name and run.columns != removed.columns), None):
            raise Refused(f"{lent.name} has the rig of {removed.name}; declare its own before that file is removed")
        text = mapping.text_of(removed.file, removed.sidecar, removed.template)
        rest = tuple(replace(run, lender="", sidecar=text) if run.lender == removed.name else run for run in rest)
        return self._divided(replace(state, shown=0), with_something_held_out(rest), progress)

    @action()
    def show(self, state: State, progress: Report, number: int) -> State:
        """Bring a file to the time line, where stretches of it are held out or excluded."""
        return replace(state, shown=known_number(state, number))

    @action()
    def look_at_heldout(self, state: State, progress: Report, number: int) -> State:
        """Draw the curves of another held-out recording."""
        return replace(state, looked_at=number % len(state.unseen_runs))

    @action("opening {0}")
    def open(self, state: State, progress: Report, path: Path) -> State:
        """Go on with the work of a session file; a recording that is missing is asked for: `State.opened`."""
        return self._resumed(OpenedSession(*session_file.read(path)), progress)

    @action("reading {0}")
    def give(self, state: State, progress: Report, paths: Sequence[Path]) -> State:
        """Give recordings that an opened session asks for."""
        if state.opened is None:
            raise Refused("open a session first")
        return self._resumed(state.opened.with_files(paths), progress)

    def _resumed(self, opened: OpenedSession, progress: Report) -> State:
        """The state that a session file holds, its recordings read again and its models compared again."""
        missing = opened.missing
        if missing is not None:
            return State(opened=replace(opened, awaited=missing))
        with SessionEffects().catalogue():  # the work that it takes the place of leaves no effects behind
            return self._read_again(opened, progress)

    def _read_again(self, opened: OpenedSession, progress: Report) -> State:
        """The same, with every recording at hand."""
        content = opened.content
        self._done(tasks.tried, content.own, progress=within(progress, 0.0, 0.1), state=State())
        effects = tuple(formula.enter() for formula in content.own)
        runs = self._runs_of(opened, within(progress, 0.1, 0.7))
        guests = tuple(
            Guest(name, self._model(text, f"guest{number}"))
            for number, (name, text) in enumerate(zip(content.guests, opened.guests, strict=True), start=1)
        )
        state = State(runs=runs, shown=content.shown, own=effects, guests=guests)
        require_one_sensor(state)
        require_both_parts(state)
        return self._with_models(state, opened, within(progress, 0.7, 0.98))

    def _runs_of(self, opened: OpenedSession, progress: Report) -> tuple[Run, ...]:
        """The files of a session, those with a sidecar first: others have the rig of the first of them."""
        stored = opened.content.runs
        runs: dict[int, Run] = {}
        order = sorted(range(len(stored)), key=lambda number: stored[number].sidecar is None)
        for number, part in zip(order, parts_of(progress, len(stored)), strict=True):
            stored_run = stored[number]
            path = opened.path(stored_run.source)
            beside = stored_run.sidecar == (mapping.text_of(path, None, "") or None)
            lenders = [runs[n] for n in sorted(runs)]
            run = self._reader().run(path, None if beside else stored_run.sidecar, lenders, part)
            if run.problem:
                raise Refused(run.problem)
            runs[number] = replace(
                run, role=stored_run.role, held_out=stored_run.held_out, excluded=tuple(stored_run.excluded)
            )
        return tuple(runs[number] for number in range(len(stored)))

    def _with_models(self, state: State, opened: OpenedSession, progress: Report) -> State:
        """The state with the tree of models of a session file, under keys of this workbench."""
        stored = opened.content.steps
        if not stored:
            return state
        fits = [self._model(opened.models[step.key], step.key) for step in stored]
        compared = self._done(tasks.judged, fits, state.unseen, Ruler.of(fits), fits[0], progress=progress, state=state)
        keys: dict[int | None, int | None] = {None: None}
        steps: list[Step] = []
        for step, fitted_model, heldouts in zip(stored, fits, compared, strict=True):
            key = keys[step.key] = next(self._keys)
            change = Change(step.kind, step.name, step.value)
            require_made(change, fitted_model, next((s.fit for s in steps if s.key == keys[step.parent]), None))
            moving = self._moving(fitted_model, state)
            steps.append(Step(key, keys[step.parent], change, fitted_model, heldouts, moving))
        return replace(state, steps=tuple(steps), current=keys[opened.content.current])

    def _model(self, text: str, key: int | str) -> Fit:
        """A model of a session file."""
        path = self.folder / "models" / f"{key}.json"
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        return model_file.load(path)

    def session(self) -> bytes:
        """The work as a session file."""
        return session_file.dumps(self.state)

    @action("choosing the held-out part")
    def hold_out(self, state: State, progress: Report, start: float, end: float) -> State:
        """Choose the part of the recording that is held out."""
        if shown(state).role != "fit":
            raise Refused(f"{shown(state).name} is not fitted; give it the role fit to hold out a part of it")
        return self._divided(state, with_run(state, held_out=inside_used(state, start, end)).runs, progress)

    @action()
    def fit_whole(self, state: State, progress: Report) -> State:
        """Fit all of the recording on the time line, where something else is held out."""
        whole = with_run(state, held_out=None)
        if not whole.unseen_runs:
            raise Refused("nothing would be held out; give another recording the role hold out first")
        return self._divided(state, whole.runs, progress)

    @action("excluding a stretch")
    def exclude(self, state: State, progress: Report, start: float, end: float) -> State:
        """Exclude a stretch from both fit and validation."""
        return self._excluding(state, (*shown(state).excluded, inside_used(state, start, end)), progress)

    @action("including a stretch again")
    def use_again(self, state: State, progress: Report, number: int) -> State:
        """Include a stretch again that was excluded."""
        before = shown(state).excluded
        if not 0 <= number < len(before):
            raise Refused(f"there is no excluded stretch {number}")
        return self._excluding(state, before[:number] + before[number + 1 :], progress)

    def _excluding(self, state: State, excluded: tuple[Stretch, ...], progress: Report) -> State:
        """The state with other stretches of the recording on the time line excluded, and the rest of it checked."""
        changed = with_run(state, excluded=excluded)
        require_both_parts(changed)
        outputs = recordings_of(shown(state))
        marks, summary = self._done(tasks.check, outputs, excluded, progress=within(progress, 0.0, 0.6))
        checked = with_run(changed, marks=marks, summary=summary)
        return self._divided(state, checked.runs, within(progress, 0.6, 0.98))

    # Models

    @action("fitting the base model")
    def fit(self, state: State, progress: Report, model: Literal["linear", "cubic"] = "linear") -> State:
        """Fit a base model to what is not held out."""
        return self._grown(without_models(loaded(state)), Change("base", model), progress)

    @action("adding {0}")
    def add(self, state: State, progress: Report, name: str) -> State:
        """Add an effect to the current model, and fit again."""
        return self._grown(state, Change("add", name), progress)

    @action("removing {0}")
    def drop(self, state: State, progress: Report, name: str) -> State:
        """Remove an effect from the current model, and fit again."""
        return self._grown(state, Change("drop", name), progress)

    @action("fixing {0}")
    def freeze(self, state: State, progress: Report, name: str, value: float) -> State:
        """Hold a parameter at a value (SI), and fit the others again."""
        before = fitted(state).fit
        if name not in {e.name for e in (*before.estimates, *before.shapes)}:
            raise Refused(f"{name!r} is not a parameter of this model")
        return self._grown(state, Change("hold", name, value), progress)

    @action("freeing {0}")
    def release(self, state: State, progress: Report, name: str) -> State:
        """Let a held parameter be estimated again."""
        return self._grown(state, Change("release", name), progress)

    def _made(self, state: State, change: Change, progress: Report) -> Fit:
        """The fit that a change makes of the current model."""
        name, train = change.name, state.train
        if change.kind == "base":
            base = {"linear": Model.linear, "cubic": Model.cubic}[name]()
            return self._done(verbs.fit, train, base, progress=progress)
        before = fitted(state).fit
        if change.kind == "add":
            return self._done(tasks.added, before, train, name, names_of(state), progress=progress)
        if change.kind == "drop":
            return self._done(verbs.drop, before, train, name, progress=progress)
        held = change.kind == "hold"
        model = before.model.freeze(**{name: change.value}) if held else before.model.release(name)
        return self._done(verbs.refit, before, train, model, progress=progress)

    def _grown(self, state: State, change: Change, progress: Report) -> State:
        """The state with one more model, made the current one; all are compared with one filter."""
        grown = self._made(state, change, within(progress, 0.0, 0.8))
        before, ruler = [step.fit for step in state.steps], Ruler.of([*(step.fit for step in state.steps), grown])
        again = state.steps if before and Ruler.of(before) != ruler else ()
        fits = [*(step.fit for step in again), grown]
        *others, last = self._done(
            tasks.judged,
            fits,
            state.unseen,
            ruler,
            before[0] if before else grown,
            progress=within(progress, 0.8, 0.95),
        )
        compared = tuple(replace(step, heldouts=heldouts) for step, heldouts in zip(again, others, strict=True))
        step = Step(next(self._keys), state.current, change, grown, last, self._moving(grown, state))
        return replace(state, steps=(*(compared or state.steps), step), current=step.key)

    def _moving(self, fit: Fit, state: State) -> tuple[tracks.Path, ...]:
        """Coefficients that processes and mechanisms of a model move, over the first fitted recording of a state."""
        if not any(map(moves, fit.model.terms)) or fit.axes:
            return ()
        return self._done(tasks.moving, fit, state.first_fitted.train, state=state)

    def _done(
        self,
        task: Callable[..., Result],
        *args: Any,
        progress: Report = lambda share: None,
        state: State | None = None,
    ) -> Result:
        """The result of long work on the data of a state, by default the present one."""
        return self._compute(
            task, *args, progress=progress, memory=SessionEffects.to(self.state if state is None else state)
        )

    @action("entering {0}")
    def own_effect(
        self,
        state: State,
        progress: Report,
        name: str,
        expression: str,
        unit: str,
        port: Literal["output", "position"],
    ) -> State:
        """Add a user effect, given as a formula, to the candidates."""
        channels = tuple(loaded(state).data.side)
        if name in names_of(state):
            raise Refused(f"{name} is a candidate already")
        formula = Formula.model_construct(name=name, expression=expression, unit=unit, port=port, channels=channels)
        self._done(tasks.tried, [formula], progress=progress)
        return replace(state, own=(*state.own, formula.enter()))

    def diagnose(self) -> None:
        """Diagnose the current model; the result goes into `diagnoses`."""
        with self._lock:
            state = self.state
        asked = question(state)
        if asked is None or asked in self.diagnoses:
            return
        with self._working("searching for missing effects") as job:
            step = fitted(state)
            effects, report = names_of(state), within(job.report, 0.0, 0.9)
            diagnosis = self._done(tasks.diagnosed, step.fit, state.train, effects, progress=report)
            with self._lock:
                job.report(0.9)  # last chance to be cancelled
                self.diagnoses[asked] = diagnosis
            if sum(run.recording is not None for run in state.fitted_files) > 1:
                values = None
                with suppress(ValueError):  # a recording alone does not determine them
                    report = within(job.report, 0.9, 0.98)
                    values = self._done(tasks.values_of_runs, step.fit, state.train, progress=report)
                with self._lock:
                    job.report(1.0)
                    if values is not None:
                        self._run_values[step.key] = values

    @property
    def diagnosis(self) -> Diagnosis | AxesDiagnosis | None:
        """Diagnosis of the current model; None until there is one."""
        asked = question(self.state)
        return None if asked is None else self.diagnoses.get(asked)

    @property
    def run_values(self) -> RunValues | None:
        """Parameters of each fitted recording under the current model; None until it is diagnosed, or of one alone."""
        return None if self.state.current is None else self._run_values.get(self.state.current)

    @action("computing the frequency response")
    def respond(self, state: State, progress: Report) -> State:
        """Compute the frequency response of the recording on the time line; see `response`."""
        run = shown(state)
        if run.role == "leave out":
            raise Refused(f"{run.name} is left out; give it another role on the Data tab")
        data = run.data
        if data.digest in state.responded:
            return state
        if data.digest not in self._responses:
            self._responses[data.digest] = self._done(tasks.responded, data, progress=progress)
        return replace(state, responded=(*state.responded, data.digest))

    @property
    def response(self) -> FrequencyResponse | None:
        """Frequency response of the recording on the time line; None until it was asked for."""
        run = self.state.run
        if run is None or run.recording is None or run.data.digest not in self.state.responded:
            return None
        return self._responses.get(run.data.digest)

    @action()
    def look_at(self, state: State, progress: Report, key: int) -> State:
        """Make another model of the tree the current one; adding to it begins a branch."""
        if key not in {s.key for s in state.steps}:
            raise Refused("this model is no longer in the tree")
        return replace(state, current=key)

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

    def whole(self) -> Evaluation | None:
        """The current model against all data in use, the held-out part included; cached for one model and its data."""
        state = self.state
        if state.step is None:
            return None
        held, asked = self._whole, (state.step.key, state.shown, f"{state.data.digest}{state.axis}")
        if held is None or held[0] != asked:
            held = self._whole = (asked, self._done(tasks.compared, [state.step.fit], [state.data], ["model"])[0])
        return held[1]

    def before(self) -> Evaluation | None:
        """The previous model against held-out data, with the filter and in the band of the current comparison."""
        previous = self.state.previous
        return None if previous is None else previous.heldouts[self.state.looked_at]

    # Side by side

    @action("reading {0}")
    def invite(self, state: State, progress: Report, path: Path) -> State:
        """Put the models of a model file, or of another session, beside those of this one."""
        loaded(state)
        is_session = path.suffix.lower() == session_file.SUFFIX
        guests = self._guests(path, progress) if is_session else (Guest(path.name, model_file.load(path)),)
        taken = set(state.models)
        if len(state.guests) + len(guests) > MOST_GUESTS:
            raise Refused(f"{path.name}: more than {MOST_GUESTS} models beside those of this session; open it alone")
        if any(guest.name in taken for guest in guests):
            raise Refused(f"{path.name}: its models are there already")
        return replace(state, guests=(*state.guests, *guests))

    def _guests(self, path: Path, progress: Report) -> tuple[Guest, ...]:
        """Models of a session file; with the errors on its own held-out data where its recordings are at hand."""
        opened = OpenedSession(*session_file.read(path))
        if opened.content.own:
            raise Refused(f"{path.name}: its models may have formulas that this session does not know; open it alone")
        if opened.missing is None:
            other = self._resumed(opened, progress)
            return tuple(Guest(f"{path.stem}: {other.named(s)}", s.fit, s.heldout) for s in other.steps)
        with SessionEffects().catalogue():
            fits = [(step, self._model(opened.models[step.key], step.key)) for step in opened.content.steps]
        return tuple(Guest(f"{path.stem}: {' '.join(('base', *fit.model.added))}", fit) for _, fit in fits)

    def compare_pair(self, names: tuple[str, str]) -> None:
        """Compare two models with what is held out here, under one ruler; see `pair`."""
        state = self.state
        with self._working("comparing two models") as job:
            fits = [state.models[name] for name in names]
            report = within(job.report, 0.0, 0.98)
            called = names if names[0] != names[1] else ("first", "second")
            comparison = self._done(tasks.compared, fits, state.unseen, called, progress=report)
            with self._lock:
                job.report(1.0)
                self._pair = (state, names, comparison)

    def pair(self, names: tuple[str, str]) -> Comparison | None:
        """The comparison of two models in the present state; None until it was asked for."""
        held = self._pair
        return held[2] if held is not None and held[0] is self.state and held[1] == names else None

    def refuse(self, sentence: str) -> None:
        """Tell the user why an action was refused."""
        with self._lock:
            self.sentence = self.plain(sentence)
            self.version += 1

    # Export

    @action("simulating a recording")
    def example(self, state: State, progress: Report, name: str) -> State:
        """Simulate an example recording with a hidden effect, and load it.

        Parameters
        ----------
        name : of an example in `accelcal.app.tasks.EXAMPLES`.
        """
        path = self.upload_folder() / f"{PREFIX}{name}.csv"
        self._done(tasks.simulated, path, name, progress=within(progress, 0.0, 0.3))
        return State(runs=divided([self._reader().run(path, None, (), within(progress, 0.3, 1.0))]))

    def model_text(self) -> str:
        """The current model, as `accelcal fit -o` writes it."""
        with self.catalogue():
            return model_file.dumps(model_file.to_dict(fitted(self.state).fit))

    def report(self) -> Path | None:
        """Write the report of the current model; None where that failed or was cancelled."""
        with self._working("writing the report") as job:
            state = self.state
            fitted_model, effects, report = fitted(state).fit, names_of(state), within(job.report, 0.0, 0.99)
            first = [output.train for output in state.first_fitted.outputs]
            unseen = [output.unseen for output in state.unseen_runs if output.file == state.unseen_runs[0].file]
            diagnosis = self.diagnosis if len(state.fitted_files) == 1 else None  # that of several is not of the first
            page = self._done(tasks.reported, fitted_model, first, unseen, effects, diagnosis, progress=report)
            job.report(1.0)
            target = self.upload_folder() / "report.html"
            io.atomic_write(target, page)
            return target
        return None

    def export(self, kind: Export) -> Path | None:
        """Write the sensor's own calibration; None where the model cannot be exported: `sentence` says why."""
        with self._working("writing the calibration") as job:
            target = self.upload_folder() / EXPORTS[kind]
            io.atomic_write(
                target, self._done(tasks.exported, fitted(self.state).fit, kind, target.name, progress=job.report)
            )
            return target
        return None

    # Work

    def catalogue(self) -> AbstractContextManager[None]:
        """The catalogue of effects of this session as it is now; nobody else in the process sees it."""
        return SessionEffects.to(self.state).catalogue()

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
    def _working(self, title: str) -> Iterator[Job]:
        """One action at a time; what the library refuses becomes the sentence that the command line prints.

        Its beginning takes the last sentence away and changes nothing else that a page must show anew.
        """
        with self._lock:
            if self.job is not None:
                self.sentence = f"Please wait: {self.job.title}, or cancel it."
                self.version += 1
                raise Busy(self.sentence)
            self.version += bool(self.sentence)
            self.sentence = ""
            job = self.job = Job(title)
        try:
            with self.catalogue():
                yield job
        except Cancelled:
            pass
        except Exception as error:
            text = errors.sentence(error)
            with self._lock:
                if not job.cancelled:
                    self.sentence = self.plain(text)
        finally:
            with self._lock:
                if self.job is job:  # a cancelled one has been shown as such, and another may be under way
                    self.job = None
                    self.arriving = None
                    self.version += 1

    def plain(self, text: str) -> str:
        """A sentence of the library with file names as the user knows them, without the folder of the workbench."""
        return re.sub(re.escape(str(self.folder)) + r"/(?:sidecar/[^/]*/|models/|drop\d+/)?", "", text)


class Busy(Exception):
    """Another action is under way."""


def recordings_of(run: Run) -> list[Recording]:
    """Every output of a file."""
    return [output.recording for output in run.outputs if output.recording is not None]


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


def shown(state: State) -> Run:
    """The recording on the time line, or refuse where there is none."""
    run = loaded(state).run
    if run is None or run.recording is None:
        raise Refused(f"{run.name if run else 'this'}: has no time line; show a recording first")
    return run


def known_number(state: State, number: int) -> int:
    """The number of a file, or refuse where it is no longer there."""
    if not 0 <= number < len(state.runs):
        raise Refused("this file is no longer in the session")
    return number


def with_run(state: State, **changes: Any) -> State:
    """The state with changes to the file on the time line."""
    return replace(
        state, runs=tuple(replace(run, **changes) if at == state.shown else run for at, run in enumerate(state.runs))
    )


def with_one_to_map(state: State) -> State:
    """The state of files that were read with one on the time line: first those whose columns are to be mapped."""
    require_one_sensor(state)
    unclear = [number for number, run in enumerate(state.runs) if run.problem]
    moving = [number for number, run in enumerate(state.runs) if run.recording is not None]
    if not moving and not unclear:
        raise Refused(
            f"{state.title}: dwells alone show no motion. Drop a recording together with them, or fit them with "
            "accelcal fit"
        )
    return replace(state, shown=unclear[0] if unclear else state.shown if state.shown in moving else moving[0])


def require_one_sensor(state: State) -> None:
    """Refuse a file that is there twice, and one of another sensor."""
    recordings = [run.recording for run in state.runs if run.recording is not None]
    require_distinct(recordings)
    for number, run in enumerate(state.runs):
        if run.dwells is not None:
            if recordings:
                require_same_sensor(run.dwells, recordings[0].rig, recordings[0].name)
            if run.digest in {before.digest for before in state.runs[:number]}:
                raise Refused(f"{run.name} is given twice: its dwells would count twice. Give it once")


def without_models(state: State) -> State:
    """The state without its models, which were fitted to other data."""
    return replace(state, steps=(), current=None)


def inside_used(state: State, start: float, end: float) -> Stretch:
    """A stretch cut to the used range, of all channels where nothing breaks."""
    run = shown(state)
    assert run.recording is not None
    low, high = run.used if run.breaks else time_span(run.recording)
    begin, finish = max(low, min(start, end)), min(high, max(start, end))
    if not begin < finish:
        raise Refused(f"{start:g} s to {end:g} s is outside the used range of the recording, {low:g} s to {high:g} s")
    return begin, finish


def require_both_parts(state: State) -> None:
    """Refuse a division that leaves no data to fit, or none to validate on."""
    moving = [part for part in state.train if isinstance(part, Recording)]
    for parts, purpose in ((moving, "to fit"), (state.unseen, "to hold out")):
        if not parts or not all(len(part.position) and len(part.accel) for part in parts):
            raise Refused(f"no data would be left {purpose}; choose a shorter stretch")


def names_of(state: State) -> tuple[str, ...]:
    """Names of user-defined effects."""
    return tuple(entry.effect.name for entry in state.own)


def require_made(change: Change, fitted: Fit, parent: Fit | None) -> None:
    """Refuse a model of a session file that did not come from its parent as the file says."""
    held = {e.name for e in (*fitted.estimates, *fitted.shapes)}
    fits = {
        "base": parent is None,
        "add": change.name in fitted.model.effects,
        "drop": parent is not None and change.name in parent.model.effects,
        "hold": change.name in held,
        "release": change.name in held,
    }
    if not fits[change.kind]:
        raise Refused(f"the session says {change.label[:100]!r} of a model that is not so; take a copy that is whole")


def question(state: State) -> tuple[int, int] | None:
    """Key of a diagnosis: the model, and the number of user effects among the candidates."""
    return None if state.current is None else (state.current, len(state.own))
