"""One user's workbench: actions on its state through the public functions; it knows nothing of a page.

Every action takes the state as it stands and puts a new one in its place, whole or not at all. One action runs at a
time; a cancelled one leaves no trace.
"""

from __future__ import annotations

import itertools
import re
import threading
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np

from accelcal import io
from accelcal.app import mapping
from accelcal.app.state import Cancelled, Job, State, Step, Stretch
from accelcal.calibration.export import Laboratory, calibrate, draft, header, module, to_dict
from accelcal.data.recording import Recording, RecordingError
from accelcal.diagnosis.verdict import Diagnosis
from accelcal.effects import Effect, from_expression
from accelcal.estimation.estimate import Fit, require_distinct
from accelcal.model import Model
from accelcal.plots.interactive import marks
from accelcal.report import gather, html
from accelcal.serialization import model_file
from accelcal.simulation.sensor import CXL02_RIG, simulate
from accelcal.validation.comparison import HELD_OUT, Comparison
from accelcal.validation.evaluation import accel_residual, compare
from accelcal.validation.prediction import Prediction
from accelcal.workflow import add, diagnose, drop, fit

EXAMPLE = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-3}
"""What the simulated example is made of."""
Report = Callable[[float], None]
MOST_BYTES = 1_000_000_000
"""Largest file that is taken."""
MOST_SAMPLES = 20_000_000
"""Most samples of the accelerometer that are worked on."""
Export = Literal["C", "Rust", "JSON", "DCC"]
EXPORTS: dict[Export, str] = {"C": "sensor.h", "Rust": "sensor.rs", "JSON": "sensor.json", "DCC": "draft.xml"}
"""What a calibration is written as, and the name of the file."""
SUFFIXES = (".csv", ".txt", ".tsv", ".parquet", ".mat", ".npz", ".h5", ".hdf5")


class Refused(ValueError):
    """Something that cannot be done now. The text says why and what to do first."""


class Workbench:
    """The loop with a memory: load, divide, fit, diagnose, add, drop, hold, undo, branch.

    Parameters
    ----------
    folder : where uploaded files and sidecars of this user live.
    """

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.state = State()
        self.job: Job | None = None
        self.sentence = ""
        """What went wrong last, for the user; empty when nothing did."""
        self.arriving: Recording | None = None
        """A recording that has been read and is still being searched for breaks and faults."""
        self.version = 0
        """Rises with every change that a page must show."""
        self.diagnoses: dict[tuple[int, int], Diagnosis] = {}
        """By key of the model and number of own effects that were offered."""
        self._keys = itertools.count(1)
        self._lock = threading.RLock()
        self._whole: tuple[int, Comparison] | None = None
        self._undo: list[State] = []
        self._redo: list[State] = []

    # Data

    def drawer(self) -> Path:
        """Return a fresh folder for files that were dropped together, so that no older sidecar lies beside them."""
        new = self.folder / f"drop{next(self._keys)}"
        new.mkdir(parents=True)
        return new

    @staticmethod
    def accept(name: str, drawer: Path) -> Path:
        """Return where an uploaded file called `name` is to be written: in the drawer, whatever the name says.

        Raises
        ------
        Refused
            If it is no kind of file that is read here.
        """
        bare = re.sub(r"[^\w.+ -]", "_", name.replace("\\", "/").rpartition("/")[2]).lstrip(". ")[-120:]
        if Path(bare).suffix.lower() not in (*SUFFIXES, ".toml"):
            raise Refused(f"{bare or name!r}: drop a recording ({', '.join(SUFFIXES)}) or its sidecar (.toml)")
        return drawer / bare

    def load(self, path: str | Path, sidecar: str | None = None) -> None:
        """Read a recording; where its columns are not understood, the state says so and waits for a mapping.

        Parameters
        ----------
        path : the file.
        sidecar : text in place of the sidecar beside the file.
        """
        path = Path(path)
        self._do(f"reading {path.name}", lambda state, report: self._load(path, sidecar, report))

    def _load(self, path: Path, sidecar: str | None, report: Report) -> State:
        columns: tuple[str, ...] = ()
        try:
            require_size(path)
            columns = mapping.columns_of(path)
            report(0.1)
            recording = self._read(path, sidecar)
        except RecordingError as error:
            if not columns:
                raise
            return State(file=path, sidecar=sidecar, columns=columns, trouble=self.plain(str(error)))
        report(0.4)
        with self._lock:
            self.arriving = recording
            self.version += 1
        seen = marks(recording)
        begin, end = seen.start, seen.end
        return State(
            file=path,
            sidecar=sidecar,
            columns=columns,
            recording=recording,
            used=(begin, end),
            breaks=seen.breaks,
            marks=seen,
            held_out=(round(end - HELD_OUT * (end - begin), 3), end if seen.breaks else stamps(recording)[1]),
        )

    def _read(self, path: Path, sidecar: str | None) -> Recording:
        if sidecar is None:
            recording = io.load(path)
        else:
            declared = self.folder / "sidecar" / io.sidecar_of(path).name
            declared.parent.mkdir(parents=True, exist_ok=True)
            io.atomic_write(declared, sidecar)
            recording = io.load(path, declared)
        if len(recording.accel) > MOST_SAMPLES:
            raise RecordingError(
                f"{path.name}: {len(recording.accel)} samples; the workbench takes {MOST_SAMPLES}. "
                "Cut the file, or use the command line"
            )
        return recording

    def load_other(self, path: str | Path) -> None:
        """Hold out another recording instead of a part of this one."""
        path = Path(path)

        def work(state: State, report: Report) -> State:
            require_size(path)
            if state.recording is None:
                raise Refused("load the recording to learn from first")
            beside = io.sidecar_of(path).exists()
            other = io.load(path) if beside else io.load(path, state.recording.rig)
            require_distinct([state.recording, other])
            return again(replace(state, other=other, held_out=None))

        self._do(f"reading {path.name}", work)

    def hold_out(self, start: float, end: float) -> None:
        """Choose the part of the recording that no fit sees."""

        def work(state: State, report: Report) -> State:
            begin, finish = clipped(state, start, end)
            new = replace(state, held_out=(begin, finish), other=None)
            require_parts(new)
            return again(new)

        self._do("choosing the held-out part", work)

    def leave_out(self, start: float, end: float) -> None:
        """Mark a stretch that is not used at all."""

        def work(state: State, report: Report) -> State:
            new = replace(state, left_out=(*state.left_out, clipped(state, start, end)))
            require_parts(new)
            return again(new)

        self._do("leaving a stretch out", work)

    def take_back(self, number: int) -> None:
        """Use a stretch again that was left out."""

        def work(state: State, report: Report) -> State:
            if not 0 <= number < len(state.left_out):
                raise Refused(f"there is no stretch {number} that is left out")
            return again(replace(state, left_out=state.left_out[:number] + state.left_out[number + 1 :]))

        self._do("using a stretch again", work)

    # Models

    def fit(self, model: Literal["linear", "cubic"] = "linear") -> None:
        """Fit a base model to what is not held out."""

        def work(state: State, report: Report) -> State:
            chosen = {"linear": Model.linear, "cubic": Model.cubic}[model]()
            found = fit(chosen, loaded(state).train, report=share_of(report, 0.0, 0.8))
            python = f"loop.fit(ac.Model.{model}(), train)"
            command = f"accelcal fit train.csv --model {model} -o THIS"
            return self._grown(replace(state, steps=(), current=None), "base", python, command, found)

        self._do("fitting the base model", work)

    def add(self, name: str) -> None:
        """Add an effect to the model that is looked at, and fit again."""

        def work(state: State, report: Report) -> State:
            before = fitted(state)
            extra = effects_of(state)
            found = add(before.fit, state.train, name, extra=extra, report=share_of(report, 0.0, 0.8))
            more = ", extra=own" if extra else ""
            python = f'loop.add(PARENT, train, "{name}"{more})'
            command = f"accelcal add PARENT train.csv --effect {name}{state.own_files} -o THIS"
            return self._grown(state, f"+ {name}", python, command, found)

        self._do(f"adding {name}", work)

    def drop(self, name: str) -> None:
        """Remove an effect from the model that is looked at, and fit again."""

        def work(state: State, report: Report) -> State:
            found = drop(fitted(state).fit, state.train, name, report=share_of(report, 0.0, 0.8))
            python = f'loop.drop(PARENT, train, "{name}")'
            command = f"accelcal drop PARENT train.csv --effect {name}{state.own_files} -o THIS"
            return self._grown(state, f"− {name}", python, command, found)

        self._do(f"removing {name}", work)

    def freeze(self, name: str, value: float) -> None:
        """Hold a parameter at a value (SI), and fit the others again."""

        def work(state: State, report: Report) -> State:
            before = fitted(state).fit
            require_parameter(before, name)
            found = self._again(before, before.model.freeze(**{name: value}), state, report)
            python = f'loop.fit(PARENT.model.freeze(**{{"{name}": {value!r}}}), train, origins=PARENT.origins)'
            command = f"accelcal freeze PARENT train.csv --at {name}={value!r}{state.own_files} -o THIS"
            return self._grown(state, f"{name} held", python, command, found)

        self._do(f"holding {name}", work)

    def release(self, name: str) -> None:
        """Let a held parameter be estimated again."""

        def work(state: State, report: Report) -> State:
            before = fitted(state).fit
            found = self._again(before, before.model.release(name), state, report)
            python = f'loop.fit(PARENT.model.release("{name}"), train, origins=PARENT.origins)'
            command = f"accelcal freeze PARENT train.csv --release {name}{state.own_files} -o THIS"
            return self._grown(state, f"{name} free", python, command, found)

        self._do(f"releasing {name}", work)

    @staticmethod
    def _again(before: Fit, model: Model, state: State, report: Report) -> Fit:
        return fit(model, state.train, origins=before.origins, report=share_of(report, 0.0, 0.8))

    def _grown(self, state: State, label: str, python: str, command: str, found: Fit) -> State:
        """The state with one model more, which is then looked at."""
        step = Step(next(self._keys), state.current, label, python, command, found, judged(found, state))
        return replace(state, steps=(*state.steps, step), current=step.key)

    def own_effect(self, name: str, expression: str, unit: str, port: Literal["output", "position"]) -> None:
        """Offer an effect of the user's own, given as a formula, beside the catalogue."""

        def work(state: State, report: Report) -> State:
            channels = tuple(loaded(state).data.side)
            made = from_expression(name, expression, unit=unit or "1", port=port, channels=channels)
            if made.effect in effects_of(state):
                raise Refused(f"{name} is offered already")
            return replace(state, own=(*state.own, made))

        self._do(f"entering {name}", work)

    def diagnose(self) -> None:
        """Ask what the model that is looked at lacks; the answer stands in `diagnoses`."""
        with self._lock:
            state = self.state
        asked = question(state)
        if asked is None or asked in self.diagnoses:
            return
        with self._working("looking for what is missing", quiet=True) as job:
            step = fitted(state)
            found = diagnose(step.fit, state.train, extra=effects_of(state), report=share_of(job.report, 0.0, 0.98))
            with self._lock:
                job.report(1.0)
                self.diagnoses[asked] = found

    @property
    def diagnosis(self) -> Diagnosis | None:
        """What the model that is looked at lacks; None until it has been asked."""
        asked = question(self.state)
        return None if asked is None else self.diagnoses.get(asked)

    def look_at(self, key: int) -> None:
        """Go to another model of the tree; what is added there begins a branch."""

        def work(state: State, report: Report) -> State:
            if key not in {s.key for s in state.steps}:
                raise Refused("this model is not in the tree any more")
            return replace(state, current=key)

        self._do("", work)

    def undo(self) -> None:
        """Take the last change back."""
        self._swap(self._undo, self._redo)

    def redo(self) -> None:
        """Make a change again that was taken back."""
        self._swap(self._redo, self._undo)

    @property
    def can_undo(self) -> bool:
        """Whether there is a change to take back."""
        return bool(self._undo) and self.job is None

    @property
    def can_redo(self) -> bool:
        """Whether there is a change to make again."""
        return bool(self._redo) and self.job is None

    def _swap(self, source: list[State], target: list[State]) -> None:
        with self._lock:
            if source and self.job is None:
                target.append(self.state)
                self.state = source.pop()
                self.sentence = ""
                self.version += 1

    def whole(self) -> Comparison | None:
        """The model that is looked at against all that is used, the held-out part included; kept for one model."""
        state = self.state
        if state.step is None:
            return None
        kept = self._whole
        if kept is None or kept[0] != state.step.key:
            kept = self._whole = (state.step.key, compare(state.step.fit, state.data))
        return kept[1]

    def before(self) -> Comparison | None:
        """The previous model against held-out data, in the band in which the present one is judged."""
        state = self.state
        if state.step is None or state.previous is None:
            return None
        was, band = state.previous, state.step.heldout.band
        t, residual, _ = accel_residual(Prediction.of(was.fit, state.unseen), band)
        return replace(was.heldout, accel_residual=(t, residual), band=band)

    def refuse(self, sentence: str) -> None:
        """Say why something is not done."""
        with self._lock:
            self.sentence = self.plain(sentence)
            self.version += 1

    # To take away

    def example(self) -> None:
        """Write a simulated recording with a hidden effect, and load it."""
        made = simulate(
            "interleaved", seconds=60.0, rig=CXL02_RIG, parameters=EXAMPLE, rng=np.random.default_rng()
        ).recording
        path = self.drawer() / "example.csv"
        io.write_sidecar(made.rig, io.write_csv(made, path), io.sidecar_of(path))
        self.load(path)

    def model_text(self) -> str:
        """The model that is looked at, as `accelcal fit -o` writes it."""
        return model_file.dumps(model_file.to_dict(fitted(self.state).fit))

    def report(self) -> Path | None:
        """Write the report of the model that is looked at; None where that failed or was cancelled."""
        with self._working("writing the report") as job:
            state = self.state
            content = gather(
                fitted(state).fit,
                state.train,
                holdout=state.unseen,
                extra=effects_of(state),
                command="accelcal app",
                report=share_of(job.report, 0.0, 0.9),
            )
            page = html(content)
            job.report(1.0)
            target = self.drawer() / "report.html"
            io.atomic_write(target, page)
            return target
        return None

    def export(self, kind: Export) -> Path | None:
        """Write the sensor's own calibration; None where the model cannot be exported, which is said."""
        with self._working("writing the calibration"):
            made = calibrate(fitted(self.state).fit)
            target = self.drawer() / EXPORTS[kind]
            texts: dict[Export, Callable[[], str]] = {
                "C": lambda: header(made, target.name),
                "Rust": lambda: module(made),
                "JSON": lambda: model_file.dumps(to_dict(made)),
                "DCC": lambda: draft(made, Laboratory()).text,
            }
            io.atomic_write(target, texts[kind]())
            return target
        return None

    # Work

    def cancel(self) -> None:
        """Give up what is under way; its result is thrown away."""
        with self._lock:
            if self.job is not None:
                self.job.cancelled = True
                self.job = None
                self.arriving = None
                self.sentence = "Cancelled; nothing was changed."
                self.version += 1

    def _do(self, title: str, work: Callable[[State, Report], State]) -> None:
        """Put what `work` makes of the state in its place."""
        with self._working(title) as job:
            before = self.state
            after = work(before, job.report)
            with self._lock:
                job.report(1.0)  # last chance to be cancelled
                if after is not before:
                    self._undo.append(before)
                    self._redo.clear()
                    self.state = after

    @contextmanager
    def _working(self, title: str, *, quiet: bool = False) -> Iterator[Job]:
        """One action at a time; what the library refuses becomes the sentence that the command line prints.

        A quiet one changes nothing that is shown until it ends.
        """
        with self._lock:
            if self.job is not None:
                self.sentence = f"Please wait: {self.job.title}, or cancel it."
                self.version += 1
                return_early = True
            else:
                return_early = False
                quiet = quiet and not self.sentence
                self.sentence = ""
                job = self.job = Job(title)
                self.version += not quiet
        if return_early:
            raise Busy(self.sentence)
        try:
            yield job
        except Cancelled:
            pass
        except (ValueError, OSError, ImportError) as error:
            with self._lock:
                if not job.cancelled:
                    self.sentence = self.plain(str(error))
        finally:
            with self._lock:
                if self.job is job:
                    self.job = None
                self.arriving = None
                self.version += 1

    def plain(self, text: str) -> str:
        """A sentence of the library with file names as the user knows them."""
        return re.sub(re.escape(str(self.folder)) + r"/(?:sidecar/|drop\d+/)?", "", text)


class Busy(Exception):
    """Another action is under way."""


def require_size(path: Path) -> None:
    """Refuse what is too large to be read here.

    Raises
    ------
    RecordingError
        With the size and the limit.
    """
    size = path.stat().st_size if path.is_file() else 0
    if size > MOST_BYTES:
        raise RecordingError(
            f"{path.name}: {size / 1e6:.0f} MB; the workbench takes {MOST_BYTES / 1e6:.0f} MB. "
            "Write it as Parquet, cut it, or use the command line"
        )


def loaded(state: State) -> State:
    """The state, if there is a recording in it."""
    if state.recording is None:
        raise Refused("load a recording first")
    return state


def fitted(state: State) -> Step:
    """The model that is looked at."""
    if state.step is None:
        raise Refused("fit a model first")
    return state.step


def again(state: State) -> State:
    """The state without models, which were fitted to other data."""
    return replace(state, steps=(), current=None)


def stamps(recording: Recording) -> Stretch:
    """First and last instant of any channel, s."""
    channels = [c for c in (recording.accel, recording.position, *recording.side.values()) if len(c)]
    return min(float(c.t[0]) for c in channels), max(float(c.t[-1]) for c in channels)


def clipped(state: State, start: float, end: float) -> Stretch:
    """A stretch inside what is used; one that reaches an end takes everything there, also a last stray sample."""
    low, high = loaded(state).used
    begin, finish = max(low, min(start, end)), min(high, max(start, end))
    if not begin < finish:
        raise Refused(f"{start:g} s to {end:g} s is outside the recording, which is used from {low:g} s to {high:g} s")
    assert state.recording is not None
    if not state.breaks:
        first, last = stamps(state.recording)
        begin, finish = (first if begin == low else begin), (last if finish == high else finish)
    return begin, finish


def require_parts(state: State) -> None:
    """Refuse a division that leaves nothing to learn from or nothing to judge by."""
    train, unseen = state.train, state.unseen
    for part, what in ((train, "fitted"), (unseen, "held out")):
        if not len(part.position) or not len(part.accel):
            raise Refused(f"nothing is left to be {what}; choose a shorter stretch")


def require_parameter(found: Fit, name: str) -> None:
    """Refuse a name that the fit does not have."""
    if name not in {e.name for e in (*found.estimates, *found.shapes)}:
        raise Refused(f"{name!r} is not a parameter of this model")


def effects_of(state: State) -> tuple[Effect, ...]:
    """The user's own effects."""
    return tuple(own.effect for own in state.own)


def question(state: State) -> tuple[int, int] | None:
    """What a diagnosis answers: which model, and how many own effects stand beside the catalogue."""
    return None if state.current is None else (state.current, len(state.own))


def judged(found: Fit, state: State) -> Comparison:
    """The model against data that no fit has seen."""
    return compare(found, state.unseen)


def share_of(report: Report, low: float, high: float) -> Report:
    """Report one part of the work as a share of the whole."""
    return lambda share: report(low + share * (high - low))
