"""Writing a file whatever stands in its place, however many write at once, and with no space left."""

from __future__ import annotations

import json
import os
import resource
import shutil
import stat
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from pyarrow import parquet

import accelcal as ac
from accelcal import io
from accelcal._support import locks
from accelcal._support.locks import scratch_folder
from accelcal.cli import app, write_recording
from accelcal.estimation.estimate import estimate
from accelcal.io.write import GrowingParquet
from accelcal.results import model_file
from accelcal.simulation import ADXL105_RIG
from tests.commands import accelcal
from tests.hostile.case import LONG, case_rng

WRITERS = 6
WRITES = 10_000 if LONG else 600
"""Of one path, over all threads."""
PROCESSES, EACH = (6, 500) if LONG else (2, 20)
CHILD = """
import sys
from accelcal.io import atomic_write
path, mark, count = sys.argv[1], sys.argv[2], int(sys.argv[3])
for k in range(count):
    atomic_write(path, mark * (1 + k % 7) * 1000)
"""


@pytest.fixture
def umask() -> Iterator[None]:
    """A usual umask."""
    before = os.umask(0o027)
    yield
    os.umask(before)


@pytest.fixture(scope="module")
def files(tmp_path_factory):
    folder = tmp_path_factory.mktemp("made")
    recording = ac.simulate(
        "tones", seconds=10.0, rig=ADXL105_RIG, parameters={"bias": 0.05}, rng=np.random.default_rng(1)
    ).recording
    write_recording(recording, folder / "run.csv")
    model_file.save(estimate(ac.Model.linear(), recording), folder / "m.json")
    return folder


def mode(path: Path) -> int:
    return stat.S_IMODE(path.stat().st_mode)


def names(folder: Path) -> list[str]:
    return sorted(path.name for path in folder.iterdir())


def is_version(content: bytes) -> bool:
    """Whether a file is one whole version of those that the writers write."""
    return len(set(content)) == 1 and len(content) % 1000 == 0


def test_threads_that_write_one_path_are_never_refused(tmp_path):
    target = tmp_path / "one.bin"
    refusals: list[BaseException] = []
    torn: list[int] = []
    done = threading.Event()

    def write(mark: int) -> None:
        rng = case_rng("threads", mark)
        for _ in range(WRITES // WRITERS):
            try:
                io.atomic_write(target, bytes([65 + mark]) * 1000 * int(rng.integers(1, 8)))
            except BaseException as error:
                refusals.append(error)

    def read() -> None:
        while not done.is_set():
            if target.exists() and not is_version(content := target.read_bytes()):
                torn.append(len(content))

    reader = threading.Thread(target=read)
    writers = [threading.Thread(target=write, args=(mark,)) for mark in range(WRITERS)]
    for thread in (reader, *writers):
        thread.start()
    for thread in writers:
        thread.join()
    done.set()
    reader.join()
    print(f"{WRITERS} threads, {WRITES} writes of one path: {len(refusals)} refusals, {len(torn)} torn (none allowed)")
    assert not refusals, refusals[0]
    assert not torn
    assert names(tmp_path) == ["one.bin"]


def test_processes_that_write_one_path_are_never_refused(tmp_path):
    target = tmp_path / "one.bin"
    children = [
        subprocess.Popen([sys.executable, "-c", CHILD, str(target), chr(65 + k), str(EACH)], stderr=subprocess.PIPE)
        for k in range(PROCESSES)
    ]
    while any(child.poll() is None for child in children):
        if target.exists():
            assert is_version(target.read_bytes())
    for child in children:
        assert child.communicate()[1] == b""
        assert child.returncode == 0
    print(f"{PROCESSES} processes, {PROCESSES * EACH} writes of one path: 0 refusals, 0 torn")
    assert names(tmp_path) == ["one.bin"]


@pytest.mark.usefixtures("umask")
def test_permissions_are_those_of_a_file_that_is_opened(tmp_path):
    (tmp_path / "opened").write_text("x")
    io.atomic_write(tmp_path / "new", "x")
    assert mode(tmp_path / "new") == mode(tmp_path / "opened") == 0o640
    (tmp_path / "new").chmod(0o604)
    io.atomic_write(tmp_path / "new", "y")
    assert mode(tmp_path / "new") == 0o604


def test_a_link_stays_and_its_target_is_replaced(tmp_path):
    (tmp_path / "far").mkdir()
    (tmp_path / "far" / "real").write_text("old")
    (tmp_path / "near").symlink_to("far/real")
    (tmp_path / "dangling").symlink_to("far/made")
    for link in ("near", "dangling"):
        io.atomic_write(tmp_path / link, "new")
        assert (tmp_path / link).is_symlink()
    assert (tmp_path / "far" / "real").read_text() == (tmp_path / "far" / "made").read_text() == "new"
    assert names(tmp_path / "far") == ["made", "real"]
    (tmp_path / "loop").symlink_to("loop")
    (tmp_path / "nowhere").symlink_to("absent/made")
    for link in ("loop", "nowhere"):
        with pytest.raises(OSError, match=f"{link}: cannot be written"):
            io.atomic_write(tmp_path / link, "new")


def test_a_hard_link_keeps_the_old_content(tmp_path):
    (tmp_path / "one").write_text("old")
    os.link(tmp_path / "one", tmp_path / "two")
    io.atomic_write(tmp_path / "one", "new")
    assert ((tmp_path / "one").read_text(), (tmp_path / "two").read_text()) == ("new", "old")


def test_a_write_protected_file_is_refused(tmp_path):
    (tmp_path / "kept").write_text("old")
    (tmp_path / "kept").chmod(0o444)
    with pytest.raises(OSError, match=r"kept: cannot be written \(it is write-protected\)"):
        io.atomic_write(tmp_path / "kept", "new")
    assert (tmp_path / "kept").read_text() == "old"
    assert names(tmp_path) == ["kept"]


def test_devices_and_pipes_are_written_and_never_replaced(tmp_path):
    before = os.stat("/dev/null")
    io.atomic_write("/dev/null", "text")
    assert os.path.samestat(before, os.stat("/dev/null"))
    with pytest.raises(OSError, match=r"/dev/full: cannot be written \(No space left on device\)"):
        io.atomic_write("/dev/full", "text")
    assert stat.S_ISCHR(os.stat("/dev/full").st_mode)
    pipe = tmp_path / "pipe"
    os.mkfifo(pipe)
    with pytest.raises(OSError, match=r"pipe: cannot be written \(nobody reads this pipe\)"):
        io.atomic_write(pipe, "text")
    reader = subprocess.Popen(["cat", str(pipe)], stdout=subprocess.PIPE)
    deadline = time.monotonic() + 30.0
    while True:
        try:
            io.atomic_write(pipe, "text")
            break
        except OSError:
            assert time.monotonic() < deadline  # cat has not opened it yet
    assert reader.communicate()[0] == b"text"
    assert stat.S_ISFIFO(pipe.stat().st_mode)
    assert names(tmp_path) == ["pipe"]


@pytest.mark.parametrize("redirected", [False, True], ids=["pipe", "file"])
def test_the_standard_output_is_a_place_to_write(files, tmp_path, redirected):
    words = [sys.executable, "-m", "accelcal", "fit", "run.csv", "-o", "/dev/stdout", "--json"]
    out = (tmp_path / "out").open("wb") if redirected else subprocess.PIPE
    done = subprocess.run(words, cwd=files, stdout=out, stderr=subprocess.PIPE, timeout=300)
    assert done.returncode == 0, done.stderr
    text = (tmp_path / "out").read_text() if redirected else done.stdout.decode()
    first, second = json.JSONDecoder().raw_decode(text)
    assert json.loads(text[second:]) == first


def test_parts_of_dead_writers_are_swept_and_those_of_living_ones_are_not(tmp_path):
    def part(digits: str, age: float = 0.0) -> Path:
        path = tmp_path / f".accelcal-{digits}.part"
        path.write_text("half")
        os.utime(path, (time.time() - age,) * 2)
        return path

    dead = part(locks.MACHINE + "0" * 16)
    foreign = f"{int(locks.MACHINE, 16) ^ 1:08x}"
    young, old = part(foreign + "1" * 16, age=3600.0), part(foreign + "2" * 16, age=2 * locks.DAY)
    other = tmp_path / ".accelcal-notes.part"
    other.write_text("mine")
    alive = tmp_path / f".accelcal-{locks.MACHINE}{'3' * 16}.part"
    held = locks.create(alive)
    assert held is not None
    io.atomic_write(tmp_path / "made", "text")
    os.close(held)
    assert (dead.exists(), young.exists(), old.exists(), alive.exists()) == (False, True, False, True)
    assert other.read_text() == "mine"


def test_a_scratch_folder_of_a_dead_process_goes_with_the_next(tmp_path, monkeypatch):
    monkeypatch.setattr("tempfile.tempdir", str(tmp_path))
    code = "import os\nfrom accelcal._support.locks import scratch_folder\n"
    code += "with scratch_folder() as folder:\n    (folder / 'x').write_text('x')\n    os._exit(9)\n"
    subprocess.run([sys.executable, "-c", code], env={**os.environ, "TMPDIR": str(tmp_path)}, check=False, timeout=60)
    assert len(names(tmp_path)) == 2
    with scratch_folder() as mine, scratch_folder():
        assert mine.exists()
        assert len(names(tmp_path)) == 4
    assert not names(tmp_path)


def test_outputs_that_belong_together_are_all_old_or_all_new(tmp_path):
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")

    def compute(fail: bool) -> None:
        with io.together():
            for name in ("a", "b", "c"):
                io.atomic_write(tmp_path / name, "new")
            assert (tmp_path / "a").read_text() == "old"  # nothing appears before the end
            if fail:
                raise ArithmeticError

    with pytest.raises(ArithmeticError):
        compute(fail=True)
    assert {name: (tmp_path / name).read_text() for name in names(tmp_path)} == {"a": "old", "b": "old"}
    compute(fail=False)
    assert {(tmp_path / name).read_text() for name in ("a", "b", "c")} == {"new"}
    assert names(tmp_path) == ["a", "b", "c"]


@pytest.mark.parametrize("failing", [1, 2, 3])
@pytest.mark.parametrize("kind", [OSError, KeyboardInterrupt])
def test_a_failure_between_two_renames_brings_back_what_was_there(tmp_path, monkeypatch, failing, kind):
    for name in ("a", "b"):
        (tmp_path / name).write_text("old")
    rename, calls = os.replace, []

    def replace(source: Path, target: Path) -> None:
        calls.append(target)
        if len(calls) == failing:
            raise kind(5, "broken") if kind is OSError else kind
        rename(source, target)

    monkeypatch.setattr(os, "replace", replace)

    def write() -> None:
        with io.together():
            for name in ("a", "b", "c"):
                io.atomic_write(tmp_path / name, "new")

    with pytest.raises(kind):
        write()
    assert {name: (tmp_path / name).read_text() for name in names(tmp_path)} == {"a": "old", "b": "old"}


def test_a_command_with_several_outputs_writes_all_or_none(files, tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "a.h").write_text("old")
    (tmp_path / "a.rs").mkdir()
    monkeypatch.setattr(Path, "is_dir", lambda self: self.name != "a.rs" and os.path.isdir(self))  # made meanwhile
    with pytest.raises(SystemExit) as ended:
        app(["export", str(files / "m.json"), "--c", "a.h", "--dcc", "a.xml", "--rust", "a.rs"])
    assert ended.value.code in (2, 3)
    assert (tmp_path / "a.h").read_text() == "old"
    assert names(tmp_path) == ["a.h", "a.rs"]
    assert capsys.readouterr().err.count("\n") == 1


def limited() -> None:
    """No file above 20 kB from here on: what a full disk does, without one."""
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, 20_000))


def test_two_measurements_that_begin_at_once_do_not_replace_each_other(tmp_path):
    path = tmp_path / "run.parquet"
    with GrowingParquet(path, {"t": "s"}) as first, GrowingParquet(path, {"t": "s"}) as other:
        first.append({"t": np.array([0.0, 1.0])})
        with pytest.raises(OSError, match=r"run\.parquet: another program has begun to write it; give one of them"):
            other.append({"t": np.array([5.0])})
        first.append({"t": np.array([2.0])})
    assert parquet.read_table(path)["t"].to_pylist() == [0.0, 1.0, 2.0]
    with GrowingParquet(path, {"t": "s"}) as later:  # the twin: what was there before is replaced, as its writer asks
        later.append({"t": np.array([5.0])})
    assert parquet.read_table(path)["t"].to_pylist() == [5.0]


def test_a_page_is_written_again_by_its_command_and_a_page_of_the_user_is_not(files, tmp_path):
    words = ["report", str(files / "m.json"), str(files / "run.csv"), "-o", str(tmp_path / "r.html")]
    for _ in range(2):
        assert accelcal(*words, cwd=tmp_path).returncode == 0
    turned = tmp_path / "\u202egnp.csv"
    shutil.copy(files / "run.csv", turned)
    shutil.copy(files / "run.toml", turned.with_suffix(".toml"))
    assert accelcal(*words[:2], str(turned), *words[3:], cwd=tmp_path).returncode == 0
    assert r"\u202egnp.csv" in (page := (tmp_path / "r.html").read_text("utf-8"))
    assert "\u202e" not in page
    (tmp_path / "r.html").write_text("<!DOCTYPE html><title>mine</title>")
    assert accelcal(*words, cwd=tmp_path).returncode == 2
    pages = [path.read_text("utf-8") for path in Path(ac.__file__).parent.rglob("*.html")]
    heads = [page for page in pages if "<!DOCTYPE" in page]
    assert len(heads) == sum('<meta name="generator" content="accelcal">' in page for page in heads) == 3


@pytest.mark.parametrize("old", [False, True], ids=["new", "replaced"])
def test_a_full_disk_leaves_what_was_there(files, tmp_path, old):
    target = tmp_path / "big.csv"
    if old:
        target.write_text("old")
    words = [sys.executable, "-m", "accelcal", "simulate", "--seconds", "5", "-o", str(target), "--force"]
    done = subprocess.run(words, capture_output=True, text=True, preexec_fn=limited, timeout=300)
    assert done.returncode == 3
    assert done.stderr.startswith(f"accelcal: {target}: cannot be written (")
    assert done.stderr.count("\n") == 1
    assert names(tmp_path) == (["big.csv"] if old else [])


@pytest.mark.skipif(os.geteuid() != 0, reason="a file system of its own needs root")
def test_a_full_or_read_only_file_system_is_one_sentence(files, tmp_path):
    disk = tmp_path / "disk"
    disk.mkdir()
    mounted = subprocess.run(["mount", "-t", "tmpfs", "-o", "size=100k", "tmpfs", str(disk)], capture_output=True)
    if mounted.returncode != 0:
        pytest.skip(f"no tmpfs here: {mounted.stderr.decode()}")
    try:
        for words in (["simulate", "--seconds", "5", "-o", f"{disk}/x.csv"], ["init", f"{disk}/bare.csv"]):
            if words[0] == "init":
                (disk / "bare.csv").write_text("t_s,accel_m_per_s2,position_m\n0,1,1\n0.1,1,1\n0.2,1,1\n")
                subprocess.run(["mount", "-o", "remount,ro", str(disk)], check=True)
            done = accelcal(*words)
            assert done.returncode == 3
            assert "cannot be written" in done.stderr
            assert done.stderr.count("\n") == 1
            assert [name for name in names(disk) if name != "bare.csv"] == []
    finally:
        subprocess.run(["umount", str(disk)], check=True)


def test_caches_that_cannot_be_written_do_not_matter(files, tmp_path):
    (tmp_path / "file").write_text("")
    places = {name: str(tmp_path / "file" / "below") for name in ("HOME", "XDG_CACHE_HOME", "XDG_CONFIG_HOME")}
    done = accelcal("fit", "run.csv", "-o", tmp_path / "m.json", cwd=files, env={**os.environ, **places})
    assert done.returncode == 0, done.stderr
    assert model_file.load(tmp_path / "m.json")
