"""Session files: what goes in comes out, a recording is asked for, and what is hostile ends in one sentence."""

from __future__ import annotations

import ast
import io
import json
import re
import shlex
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from accelcal.app import session_file
from accelcal.app.session_file import CONTENT, MOST, MOST_FILE, MOST_MEMBER, Keeper, SessionError, peek, read
from accelcal.app.state import MOST_GUESTS, MOST_MODELS, Change
from accelcal.app.workbench import Workbench
from accelcal.results import model_file

from .case import case_rng, cases
from .workbench import write


@pytest.fixture(scope="module")
def place(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("sessions")
    write(folder / "run.csv", 1)
    write(folder / "other.csv", 2)
    return folder


@pytest.fixture(scope="module")
def grown(place: Path) -> Workbench:
    """A workbench with an own effect, a stretch that is excluded, and a tree of models with a branch."""
    bench = Workbench(place / "home")
    (place / "home").mkdir()
    bench.load(place / "run.csv")
    bench.exclude(3.0, 4.0)
    bench.own_effect("law_of_the_session", "a**3", "(m/s²)⁻²", "output")
    bench.fit()
    base = bench.state.current
    bench.add("law_of_the_session")
    bench.look_at(base)
    bench.freeze("bias", 0.04)
    assert bench.sentence == ""
    return bench


@pytest.fixture(scope="module")
def raw(grown: Workbench) -> bytes:
    return grown.session()


def opened(folder: Path, content: bytes) -> Workbench:
    """A fresh workbench that has opened a session file."""
    path = folder / "work.accelcal"
    path.write_bytes(content)
    (folder / "fresh").mkdir()
    bench = Workbench(folder / "fresh")
    bench.open(path)
    return bench


def parts(raw: bytes) -> dict[str, bytes]:
    """Parts of a session file."""
    with zipfile.ZipFile(io.BytesIO(raw)) as archive:
        return {name: archive.read(name) for name in archive.namelist()}


def packed(members: dict[str, bytes]) -> bytes:
    """A session file of these parts."""
    packed_file = io.BytesIO()
    with zipfile.ZipFile(packed_file, "w", zipfile.ZIP_DEFLATED) as archive:
        for name, content in members.items():
            archive.writestr(name, content)
    return packed_file.getvalue()


def changed(raw: bytes, change: Callable[[dict[str, Any]], Any]) -> bytes:
    """A session file with a change in its content."""
    members = parts(raw)
    content = json.loads(members[CONTENT])
    change(content)
    return packed({**members, CONTENT: json.dumps(content).encode()})


def test_a_session_comes_back_as_it_was(grown: Workbench, raw: bytes, tmp_path: Path) -> None:
    bench = opened(tmp_path, raw)
    assert bench.sentence == ""
    assert [s.change for s in bench.state.steps] == [s.change for s in grown.state.steps]
    assert [s.change for s in bench.state.path] == [s.change for s in grown.state.path]
    for mine, theirs in zip(bench.state.steps, grown.state.steps, strict=True):
        with bench.catalogue():
            assert model_file.to_dict(mine.fit) == model_file.to_dict(theirs.fit)
        fresh, remaining = (json.loads(step.heldout.to_json()) for step in (mine, theirs))
        for name in ("bins", "worst_regions"):  # of models compared together, regions are of the motion of the first
            pairs = zip(fresh.pop(name), remaining.pop(name), strict=True)
            assert all(x["variable"] == y["variable"] for x, y in pairs)
        assert fresh == remaining
    assert [(run.excluded, run.held_out) for run in bench.state.runs] == [
        (run.excluded, run.held_out) for run in grown.state.runs
    ]
    assert [entry.effect.name for entry in bench.state.own] == ["law_of_the_session"]
    bench.drop("nothing")  # the work goes on
    assert "not an added effect" in bench.sentence
    bench.release("bias")
    assert bench.sentence == ""
    assert [s.change.label for s in bench.state.path] == ["base", "bias fixed", "bias free"]
    bench.undo()
    bench.undo()
    assert bench.state.file is None


def test_no_recorded_data_are_in_it(grown: Workbench, raw: bytes) -> None:
    members = parts(raw)
    assert set(members) == {CONTENT, *(f"models/{s.key}.json" for s in grown.state.steps)}
    assert len(raw) < 50_000  # a recording of 33 000 samples
    content = json.loads(members[CONTENT])
    assert content["runs"][0].keys() == {"source", "sidecar", "role", "held_out", "excluded"}


def test_a_recording_that_is_missing_or_changed_is_asked_for(raw: bytes, place: Path, tmp_path: Path) -> None:
    moved = changed(raw, lambda c: c["runs"][0]["source"].update(file=str(tmp_path / "elsewhere" / "run.csv")))
    bench = opened(tmp_path, moved)
    assert bench.sentence == ""
    assert bench.state.opened is not None
    assert bench.state.recording is None
    bench.give([place / "other.csv"])
    assert "not the recording that this session was made with (run.csv, SHA-256" in bench.sentence
    assert bench.state.opened is not None
    copy = tmp_path / "copy.csv"
    copy.write_bytes((place / "run.csv").read_bytes())
    bench.give([copy])
    assert bench.sentence == ""
    assert len(bench.state.steps) == 3
    copy.write_bytes(copy.read_bytes() + b"\n")
    (tmp_path / "again").mkdir()
    again = opened(tmp_path / "again", changed(raw, lambda c: c["runs"][0]["source"].update(file=str(copy))))
    assert again.state.opened is not None


def test_a_held_out_recording_comes_back(place: Path, tmp_path: Path) -> None:
    (tmp_path / "home").mkdir()
    bench = Workbench(tmp_path / "home")
    bench.load(place / "run.csv")
    bench.include([place / "other.csv"], "hold out")
    bench.fit()
    fresh = opened(tmp_path, bench.session())
    assert fresh.sentence == ""
    assert fresh.state.step is not None
    assert bench.state.step is not None
    assert fresh.state.step.heldout.recording == "other.csv"
    assert fresh.state.step.heldout.coast_rms == bench.state.step.heldout.coast_rms


def of_run(raw: bytes, **change: Any) -> bytes:
    """A session file with a change in what it holds of its recording."""
    return changed(raw, lambda content: content["runs"][0].update(change))


def of_source(raw: bytes, **change: Any) -> bytes:
    """A session file with a change in where its recording was, or in its digest."""
    return changed(raw, lambda content: content["runs"][0]["source"].update(change))


def bomb(size: int) -> bytes:
    """A part that unpacks to a size."""
    return b" " * size


MOST_PARTS = MOST_MODELS + MOST_GUESTS + 1
"""Parts of the archive: the models, and what says what they are."""
REFUSED: list[tuple[str, Callable[[bytes], bytes], str]] = [
    ("no zip", lambda raw: b"no zip at all", "cannot be read as a session file"),
    ("empty", lambda raw: b"", "cannot be read as a session file"),
    ("cut", lambda raw: raw[: len(raw) // 2], "cannot be read as a session file"),
    ("no content", lambda raw: packed({"x": b""}), "session.json is missing"),
    ("no model", lambda raw: packed({CONTENT: parts(raw)[CONTENT]}), "models/.* is missing"),
    ("more parts", lambda raw: packed({**parts(raw), "run.csv": b"1,2"}), "1 parts that belong to no model"),
    ("a path", lambda raw: packed({**parts(raw), "../../x.json": b"1"}), "belong to no model"),
    ("large part", lambda raw: packed({**parts(raw), CONTENT: bomb(MOST_MEMBER + 1)}), "unpacks to more than"),
    (
        "many large parts",
        lambda raw: packed({f"models/{i}.json": bomb(MOST_MEMBER) for i in range(MOST_FILE // MOST_MEMBER + 1)}),
        "unpacks to more than",
    ),
    ("many parts", lambda raw: packed({f"{i}": b"" for i in range(MOST_PARTS + 1)}), "more than a session can have"),
    ("deep", lambda raw: packed({**parts(raw), CONTENT: b"[" * 100_000}), "expected the schema|cannot be read"),
    ("digits", lambda raw: packed({**parts(raw), CONTENT: b"9" * 6000}), "expected the schema|cannot be read"),
    ("not UTF-8", lambda raw: packed({**parts(raw), CONTENT: b"\xff\xfe"}), "cannot be read|expected the schema"),
    ("another version", lambda raw: changed(raw, lambda c: c.update(schema="accelcal/session/9")), "schema"),
    ("a key more", lambda raw: changed(raw, lambda c: c.update(more=1)), "more: Extra inputs"),
    ("a key less", lambda raw: changed(raw, lambda c: c.pop("runs")), "runs: Field required"),
    (
        "digest",
        lambda raw: of_source(raw, sha256="0" * 63),
        "runs.0.source.sha256",
    ),
    (
        "escape",
        lambda raw: of_source(raw, file="\x1b]0;x\x07"),
        "runs.0.source.file",
    ),
    ("not finite", lambda raw: of_run(raw, held_out=[0.0, float("nan")]), "held_out"),
    ("infinite", lambda raw: of_run(raw, excluded=[[0.0, 1e999]]), "excluded"),
    ("a loop", lambda raw: changed(raw, lambda c: c["steps"][0].update(parent=c["steps"][1]["key"])), "before its par"),
    ("twice", lambda raw: changed(raw, lambda c: c["steps"].append(c["steps"][0])), "occurs twice"),
    ("nobody", lambda raw: changed(raw, lambda c: c.update(current=999)), "not in the tree"),
    ("nothing held out", lambda raw: of_run(raw, held_out=None), "held out"),
    ("a role", lambda raw: of_run(raw, role="test"), "runs.0.role"),
    ("nothing shown", lambda raw: changed(raw, lambda c: c.update(shown=1)), "on the time line"),
    ("twice the file", lambda raw: changed(raw, lambda c: c["runs"].append(c["runs"][0])), "once more"),
    ("base", lambda raw: changed(raw, lambda c: c["steps"][0].update(name="__import__")), "no base model"),
    ("code", lambda raw: changed(raw, lambda c: c["steps"][1].update(name='x"); import os; ("')), "steps.1.name"),
    ("shell", lambda raw: changed(raw, lambda c: c["steps"][1].update(name="x; rm -rf ~")), "a model that is not so"),
    ("formula", lambda raw: changed(raw, lambda c: c["own"][0].update(expression="__import__('os')")), "allowed are"),
    ("nonsense", lambda raw: of_run(raw, held_out=[1e9, 2e9]), "no|outside|part"),
    (
        "backwards",
        lambda raw: changed(raw, lambda c: c["runs"][0].update(held_out=[9.0, 2.0])),
        "give start before end",
    ),
]


@pytest.mark.parametrize(("change", "sentence"), [r[1:] for r in REFUSED], ids=[r[0] for r in REFUSED])
def test_a_hostile_session_is_refused_in_one_sentence(
    raw: bytes, change: Callable[[bytes], bytes], sentence: str, tmp_path: Path
) -> None:
    bench = opened(tmp_path, change(raw))
    assert bench.state.recording is None
    assert bench.state.opened is None
    assert re.search(sentence, bench.sentence), bench.sentence
    assert bench.sentence.isprintable()
    assert "Traceback" not in bench.sentence
    outside = [p for p in tmp_path.rglob("x.json")]
    assert outside == []


def test_what_is_copied_runs_nothing_that_a_file_has_named() -> None:
    change = Change("add", 'x"); import os; ("$(id); rm -rf ~')
    assert ast.literal_eval(change.python.removeprefix("ac.add(PARENT, train, ").removesuffix(")")) == change.name
    assert shlex.split(change.command("", "run.csv"))[5] == change.name
    held = Change("hold", "y'`id`", 1.0)
    assert shlex.split(held.command("", "run.csv"))[5] == f"{held.name}=1.0"


def test_a_member_may_not_lie_about_its_size(raw: bytes, tmp_path: Path) -> None:
    archive = bytearray(packed({CONTENT: bomb(MOST_MEMBER * 3)}))
    at = archive.rfind(b"PK\x01\x02")
    archive[at + 24 : at + 28] = (10).to_bytes(4, "little")  # the size that the directory declares
    path = tmp_path / "lie.accelcal"
    path.write_bytes(bytes(archive))
    for reader in (read, peek):
        with pytest.raises(SessionError):
            reader(path)


def test_mutated_sessions_end_in_a_sentence_or_are_whole(raw: bytes, tmp_path: Path) -> None:
    refused = 0
    numbers = cases(300, 20_000)
    original = parts(raw)
    for number in numbers:
        rng = case_rng("session file", number)
        path = tmp_path / "mutated.accelcal"
        if number % 2:
            content = bytearray(original[CONTENT])
            for at in rng.integers(0, len(content), int(rng.integers(1, 6))):
                content[at] = int(rng.integers(256))
            path.write_bytes(packed({**original, CONTENT: bytes(content)}))
        else:
            flipped = bytearray(raw)
            for at in rng.integers(0, len(flipped), int(rng.integers(1, 12))):
                flipped[at] = int(rng.integers(256))
            path.write_bytes(bytes(flipped))
        sentence = ""
        try:
            read(path)
        except SessionError as error:
            sentence = str(error)
        assert sentence == "" or sentence.isprintable(), (number, sentence)
        refused += sentence != ""
    accepted = len(numbers) - refused
    print(f"{len(numbers)} mutated session files: {refused} refused in a sentence, {accepted} read, 0 tracebacks")
    assert refused > len(numbers) // 3


def test_kept_work_is_bounded_listed_and_removed(grown: Workbench, tmp_path: Path) -> None:
    keeper = Keeper(tmp_path / "state")
    names = [f"{i:016d}" for i in range(MOST + 3)]
    for name in names:
        keeper.keep(name, grown.state).result()
    assert len(keeper.listed()) == MOST
    assert (tmp_path / "state").stat().st_mode & 0o077 == 0
    assert keeper.path(names[-1]) is not None
    assert keeper.listed()[0].title == "run.csv, 3 models"
    for name in ("../../etc/passwd", "", "A" * 17, "AAAAAAAAAAAAAAA/", "..", "\0" * 16):
        assert keeper.path(name) is None
    (tmp_path / "state" / f"{'B' * 16}.accelcal").write_bytes(b"damaged")
    (tmp_path / "state" / f"{'C' * 16}.accelcal").symlink_to("/etc/passwd")
    assert "B" * 16 not in {remaining.name for remaining in keeper.listed()}
    assert keeper.path("C" * 16) is None
    keeper.remove(names[-1])
    assert keeper.path(names[-1]) is None
    keeper.close()


def test_a_folder_that_cannot_be_written_is_said(grown: Workbench, tmp_path: Path) -> None:
    (tmp_path / "file").write_text("no folder")
    keeper = Keeper(tmp_path / "file" / "state")
    keeper.keep("A" * 16, grown.state).result()
    assert "This work is not kept" in keeper.problem
    assert keeper.listed() == []
    keeper.close()


def test_an_empty_workbench_has_no_session(tmp_path: Path) -> None:
    with pytest.raises(SessionError, match="load a recording first"):
        session_file.dumps(Workbench(tmp_path).state)
