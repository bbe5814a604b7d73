"""`accelcal live` as a user meets it: file, server, port; screen, lines, JSON; ended by signals and by kills."""

from __future__ import annotations

import json
import math
import os
import pty
import re
import signal
import socket
import subprocess
import sys
import threading
import time
import tty
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pyarrow import parquet

import accelcal as ac
from accelcal.cli import write_recording
from accelcal.data.recording import Channel
from accelcal.filters import run
from accelcal.io import load, read_sidecar
from accelcal.live import settings_of
from accelcal.live.session import DwellGuide
from accelcal.simulation import ADXL105_RIG
from tests.commands import accelcal
from tests.live.streams import RIG, Stream, stream
from tests.schemas import require_published

PACE = 0.02
"""Time between two pieces of a stream, s."""


MOST = 60.0
"""Longest wait for anything, s."""
_children: list[subprocess.Popen[str]] = []


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    (tmp_path / "rig.toml").write_text(RIG)
    return tmp_path


@pytest.fixture(autouse=True)
def no_child_outlives_its_test() -> Iterator[None]:
    yield
    while _children:
        with _children.pop() as child:
            child.kill()


def started(folder: Path, *words: str, stdout: Any = subprocess.PIPE) -> subprocess.Popen[str]:
    command = [sys.executable, "-m", "accelcal", "live", "--rig", "rig.toml", *words]
    _children.append(subprocess.Popen(command, cwd=folder, stdout=stdout, stderr=subprocess.PIPE, text=True))
    return _children[-1]


def done(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    return accelcal("live", "--rig", "rig.toml", *words, cwd=folder)


def last(text: str) -> dict[str, Any]:
    """The last of the JSON lines, each of which follows the schema."""
    contents = [json.loads(line) for line in text.splitlines()]
    for content in contents:
        require_published(content)
    assert contents[-1]["event"] == "end"
    return dict(contents[-1])


@contextmanager
def server(content: bytes, *, keep: bool, seconds: float = 0.0) -> Iterator[str]:
    """Serve one client, spread over `seconds`; `keep` the connection open until the block ends."""
    over = threading.Event()

    def serve() -> None:
        pieces = max(1, int(seconds / PACE))
        size = -(-len(content) // pieces)
        with suppress(OSError), listening.accept()[0] as connection:  # the client never came, or was killed
            connection.settimeout(MOST)
            for i in range(pieces):
                connection.sendall(content[i * size : (i + 1) * size])
                time.sleep(PACE if seconds else 0.0)
            if keep:
                over.wait(MOST)

    with socket.create_server(("127.0.0.1", 0)) as listening:
        listening.settimeout(MOST)
        thread = threading.Thread(target=serve, daemon=True)
        thread.start()
        try:
            yield f"127.0.0.1:{listening.getsockname()[1]}"
        finally:
            over.set()
            thread.join(MOST)


def require_equal_to_record(folder: Path, end: dict[str, Any], samples: Stream, name: str = "got.parquet") -> None:
    """The recording holds the rows, and the estimates are those of `filters.run` on it, bit for bit."""
    recording = load(folder / name)
    n = len(recording.accel)
    assert np.array_equal(recording.accel.t, samples.t[:n])
    assert np.array_equal(recording.accel.y, samples.u[:n])
    settings = settings_of(read_sidecar(folder / "rig.toml").rig)
    accel = Channel("accel", recording.accel.t, settings.stage_output(recording.accel.y), "m/s^2")
    x0, P0 = settings.start(float(recording.position.y[0]), 0.0)
    q, r = settings.q, settings.r_position
    record = run(settings.choice, accel, recording.position, q=q, r_position=r, x0=x0, P0=P0)
    covariance = record.covariance
    estimates = settings.estimates(record.states[-1], covariance)
    assert [(e["name"], e["value"], e["std"]) for e in end["state"]["estimates"]] == [
        (e.name, e.value, e.std) for e in estimates
    ]
    assert n == end["state"]["used"] == end["state"]["recorded"]


def test_a_file_is_followed_recorded_and_equal_to_its_record(folder: Path) -> None:
    samples = stream(13.0)
    (folder / "lines.txt").write_bytes(samples.lines() + b"broken\n")
    result = done(folder, "--file", "lines.txt", "-o", "got.parquet", "--json")
    assert result.returncode == 0, result.stderr
    end = last(result.stdout)
    state = end["state"]
    assert [state[key] for key in ("used", "broken", "out_of_order", "missing")] == [len(samples.t), 1, 0, 0]
    assert (state["alarms"], state["holds"], end["ended"]) == (0, True, "the source has ended")
    require_equal_to_record(folder, end, samples)
    assert "wrote got.parquet" in result.stderr


def test_a_step_of_the_bias_raises_an_alarm_soon(folder: Path) -> None:
    for seed, step in ((1, 0.0), (2, 0.1)):  # without it none
        (folder / "lines.txt").write_bytes(stream(20.0, seed, step=step, at=12.0).lines())
        result = done(folder, "--file", "lines.txt", "--json")
        alarms = [content for line in result.stdout.splitlines() if (content := json.loads(line))["event"] == "alarm"]
        assert bool(alarms) == bool(step)
        if step:
            assert 12.0 < alarms[0]["alarm"]["t"] < 14.5
            assert not last(result.stdout)["state"]["holds"] or len(alarms) >= 2
            plain = done(folder, "--file", "lines.txt")
            assert plain.stderr.count("alarm: t = ") >= 1
            assert "blocks of innovations raised an alarm" in plain.stdout
            assert "; ± are 2 sigma; " in plain.stdout


def test_a_server_is_followed_to_its_end(folder: Path) -> None:
    samples = stream(4.0)
    with server(samples.lines(), keep=False, seconds=1.0) as place:
        result = done(folder, "--tcp", place, "-o", "got.parquet", "--json", "--every", "0.2 s")
    assert result.returncode == 0, result.stderr
    assert len(result.stdout.splitlines()) >= 3
    require_equal_to_record(folder, last(result.stdout), samples)


def test_a_port_is_followed_until_it_breaks_off(folder: Path) -> None:
    samples = stream(3.0)
    master, slave = pty.openpty()
    tty.setraw(slave)
    words = ("--serial", os.ttyname(slave), "--baud", "115200", "-o", "got.parquet", "--json", "--every", "0.1 s")
    child = started(folder, *words)
    assert child.stdout is not None
    assert child.stdout.readline()  # the port is open
    content = b"the end of a line\n" + samples.lines()
    while content:
        content = content[os.write(master, content[:1000]) :]
    began, used = time.monotonic(), 0
    while used < len(samples.t):
        used = json.loads(child.stdout.readline())["state"]["used"]
        assert time.monotonic() < began + MOST, used
    os.close(slave)
    os.close(master)
    message, errors = child.communicate(timeout=60)
    assert child.returncode == 0, errors
    end = last(message)
    assert end["state"]["broken"] == 1
    assert "broke off" in end["ended"]
    require_equal_to_record(folder, end, samples)
    assert end["state"]["used"] == len(samples.t)


@pytest.mark.parametrize(("sent", "code"), [(signal.SIGINT, 130), (signal.SIGTERM, 143)], ids=["Ctrl-C", "SIGTERM"])
def test_a_signal_ends_it_with_a_summary_and_whole_files(folder: Path, sent: signal.Signals, code: int) -> None:
    samples = stream(6.0)
    with server(samples.lines(), keep=True, seconds=6.0) as place:
        child = started(folder, "--tcp", place, "-o", "got.parquet", "--json", "--every", "0.1 s")
        assert child.stdout is not None
        first = [child.stdout.readline() for _ in range(8)]
        child.send_signal(sent)
        rest, errors = child.communicate(timeout=60)
    assert child.returncode == code, errors
    assert "Traceback" not in errors
    assert "no file was left half-written" in errors
    end = last("".join(first) + rest)
    assert end["ended"] == "stopped"
    assert 0 < end["state"]["used"] <= len(samples.t)
    require_equal_to_record(folder, end, samples)
    assert {path.name for path in folder.iterdir()} == {"rig.toml", "got.parquet", "got.toml"}


@pytest.mark.parametrize("moment", [0.5, 1.7, 3.2])
def test_a_kill_leaves_a_recording_that_is_whole(folder: Path, moment: float) -> None:
    samples = stream(12.0)
    with server(samples.lines(), keep=True, seconds=12.0) as place:
        child = started(folder, "--tcp", place, "-o", "got.parquet", "--json", "--every", "0.1 s")
        assert child.stdout is not None
        while not (folder / "got.parquet").exists():
            assert child.stdout.readline()
        time.sleep(moment)
        child.kill()
        child.wait(timeout=60)
    file = parquet.ParquetFile(folder / "got.parquet", page_checksum_verification=True)
    recording = load(folder / "got.parquet")
    n = len(recording.accel)
    print(f"killed {moment:g} s after the first: {n} rows in {file.num_row_groups} row groups")
    assert n > 0
    assert np.array_equal(recording.accel.y, samples.u[:n])
    fitted = accelcal("check", "got.parquet", cwd=folder)
    assert fitted.returncode == 0, fitted.stderr


def test_an_output_that_nobody_reads_ends_it_with_a_whole_recording(folder: Path) -> None:
    samples = stream(6.0)
    with server(samples.lines(), keep=True, seconds=6.0) as place:
        child = started(folder, "--tcp", place, "-o", "got.parquet", "--json", "--every", "0.1 s")
        assert child.stdout is not None
        for _ in range(5):
            child.stdout.readline()
        child.stdout.close()
        assert child.wait(timeout=60) == 141
    assert child.stderr is not None
    assert child.stderr.read() == ""
    recording = load(folder / "got.parquet")
    assert np.array_equal(recording.accel.y, samples.u[: len(recording.accel)])
    assert {path.name for path in folder.iterdir()} == {"rig.toml", "got.parquet", "got.toml"}


def test_plain_lines_reach_a_pipe_while_the_source_is_open(folder: Path) -> None:
    with server(stream(1.0).lines(), keep=True) as place, started(folder, "--tcp", place, "--every", "0.1 s") as child:
        assert child.stdout is not None
        shown = [child.stdout.readline() for _ in range(2)]
        assert child.poll() is None
        assert all("lines" in line and "bias" in line for line in shown)
        child.send_signal(signal.SIGINT)
        child.communicate(timeout=60)
    assert child.returncode == 130


def test_a_model_is_followed_and_saved(tmp_path: Path) -> None:
    truth = {"bias": 0.05, "scale_factor": 0.01, "time_offset": 2e-4}
    for seed, name in ((1, "one"), (2, "two")):
        rng = np.random.default_rng(seed)
        simulation = ac.simulate("tones", seconds=20.0, rig=ADXL105_RIG, parameters=truth, rng=rng)
        write_recording(simulation.recording, tmp_path / f"{name}.csv")
    accelcal("fit", "one.csv", "-o", "m.json", cwd=tmp_path, check=True)
    words = ["--file", "two.csv", "--rig", "two.toml", "--model", "m.json", "--save", "m2.json", "--json"]
    result = accelcal("live", *words, cwd=tmp_path)
    assert result.returncode == 0, result.stderr
    assert last(result.stdout)["state"]["alarms"] == 0
    before, after = (
        {p["name"]: p for p in json.loads((tmp_path / name).read_text())["estimates"]} for name in ("m.json", "m2.json")
    )
    for name in ("bias", "scale_factor"):
        assert after[name]["std"] < 0.8 * before[name]["std"]
        assert abs(after[name]["value"] - truth[name]) < 4.5 * after[name]["std"]  # false alarm 7e-6 each
    compared = accelcal("compare", "m2.json", "two.csv", cwd=tmp_path)
    assert compared.returncode == 0, compared.stderr
    assert "followed live" in (tmp_path / "m2.json").read_text()


def test_a_terminal_shows_a_screen(folder: Path) -> None:
    (folder / "lines.txt").write_bytes(stream(13.0).lines())
    master, slave = pty.openpty()
    child = started(folder, "--file", "lines.txt", stdout=slave)
    os.close(slave)
    shown = b""
    try:
        while piece := os.read(master, 4096):
            shown += piece
    except OSError:  # the other side has closed
        pass
    child.communicate(timeout=60)
    os.close(master)
    assert child.returncode == 0
    for word in ("± 2 sigma", "scale_factor", "the model holds", "NIS", "0 broken", "26000 lines", "source has ended"):
        assert word in shown.decode(), word


@pytest.mark.parametrize(
    ("words", "code", "text"),
    [
        ((), 2, "give one of --serial"),
        (("--tcp", "a:1", "--file", "x"), 2, "give one of --serial"),
        (("--serial", "/dev/absent"), 2, "belong together"),
        (("--file", "x", "--baud", "9600"), 2, "belong together"),
        (("--tcp", "nowhere"), 2, "expected HOST:PORT"),
        (("--tcp", "nowhere:99999"), 2, "expected HOST:PORT"),
        (("--file", "absent.txt"), 3, "absent.txt: no such file"),
        (("--serial", "/dev/absent", "--baud", "9600"), 3, "cannot be opened"),
        (("--tcp", "127.0.0.1:9"), 3, "no connection"),
        (("--file", "words.txt"), 3, "no line could be used (3 broken"),
        (("--file", "words.txt", "-o", "got.csv"), 2, "ends in .parquet"),
        (("--file", "words.txt", "--save", "m.json"), 2, "needs --model"),
        (("--file", "words.txt", "--every", "0"), 2, "expected a time above 0"),
        (("--file", "words.txt", "-o", "rig.parquet"), 2, "would be overwritten"),
    ],
    ids=str,
)
def test_mistakes_end_in_one_sentence(folder: Path, words: tuple[str, ...], code: int, text: str) -> None:
    (folder / "words.txt").write_text("no numbers\nat all\n1;2;3\n")
    result = done(folder, *words)
    assert result.returncode == code, result.stderr
    assert text in " ".join(result.stderr.split())
    assert "Traceback" not in result.stderr
    assert result.stdout == ""
    assert {path.name for path in folder.iterdir()} == {"rig.toml", "words.txt"}


@pytest.mark.parametrize(("there", "what"), [("got.parquet", "recording"), ("got.toml", "sidecar")])
def test_an_earlier_recording_is_never_replaced(folder: Path, there: str, what: str) -> None:
    (folder / "lines.txt").write_bytes(stream(1.0).lines())
    (folder / there).write_bytes(b"earlier")
    result = done(folder, "--file", "lines.txt", "-o", "got.parquet")
    assert result.returncode == 2, result.stderr
    assert f"{there}: there is a {what} already; give another name" in " ".join(result.stderr.split())
    assert (folder / there).read_bytes() == b"earlier"
    assert {path.name for path in folder.iterdir()} == {"rig.toml", "lines.txt", there}


GUIDED = """[channels]
time = { column = "t", unit = "s" }
accel_x = { column = "x", unit = "g" }
accel_y = { column = "y", unit = "g" }
accel_z = { column = "z", unit = "g" }
[dwell]
gravity = "9.81 m/s^2"
"""
SCALE, ZERO = np.array([1.01, 0.985, 1.02]), np.array([0.03, -0.05, 0.02])
"""Of the three outputs, the zero in g."""


def turned(faces: list[int], *, moving_first: bool = False, rate: float = 50.0) -> str:
    """Lines of a triad that is turned from face to face, 4 s on each: 0, 1, 2 is an axis up, 3, 4, 5 down."""
    rng, parts, before = np.random.default_rng(1), [], np.array([0.6, 0.0, 0.8])
    for face in faces:
        up = np.eye(3)[face % 3] * (1.0 if face < 3 else -1.0) + np.radians(2.0) * rng.standard_normal(3)
        up /= np.linalg.norm(up)
        if parts or moving_first:
            share = np.linspace(0.0, 1.0, 75)[:, None]
            parts.append((1.0 - share) * before + share * up + 0.2 * rng.standard_normal((75, 3)))
        parts.append(np.tile(up, (200, 1)))
        before = up
    f = np.concatenate(parts)
    y = SCALE * f * 9.81 / 9.80665 + ZERO + 1e-3 * rng.standard_normal(f.shape)
    rows = np.column_stack([np.arange(len(y)) / rate, y])
    return "\n".join(",".join(f"{x:.5f}" for x in row) for row in rows) + "\n"


def guided(folder: Path, *words: str) -> subprocess.Popen[str]:
    (folder / "triad.toml").write_text(GUIDED)
    command = [sys.executable, "-m", "accelcal", "dwells", "--guide", "--rig", "triad.toml", *words]
    pipes = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "stderr": subprocess.PIPE}
    _children.append(subprocess.Popen(command, cwd=folder, text=True, **pipes))
    return _children[-1]


def test_a_guided_session_ends_with_six_faces_and_their_fit(tmp_path: Path) -> None:
    """From a turning sensor on, with one face twice, which is no further position."""
    child = guided(tmp_path, "-", "-o", "positions.csv", "--json")
    out, message = child.communicate("t,x,y,z\n" + turned([2, 0, 0, 5, 1, 3, 4], moving_first=True), timeout=MOST)
    assert child.returncode == 0, message
    content = json.loads(out)
    require_published(content)
    assert np.array(content["K"]) == pytest.approx(1.0 / SCALE, abs=3e-4)
    assert np.array(content["b"]) == pytest.approx(9.80665 * ZERO, abs=3e-3)
    measured = [line for line in message.splitlines() if "is measured" in line]
    assert [line.partition("; ")[2].partition("not yet: ")[2] for line in measured] == [
        "x up, y up, x down, y down, z down",
        "y up, x down, y down, z down",
        "y up, x down, y down",
        "x down, y down",
        "y down",
        "",
    ]
    again = accelcal("dwells", "positions.csv", "--yes", "--json", cwd=tmp_path)
    assert json.loads(again.stdout)["K"] == content["K"]


def test_ctrl_c_in_a_guided_session_loses_no_position(tmp_path: Path) -> None:
    child = guided(tmp_path, "-", "-o", "positions.csv")
    assert child.stdin is not None
    assert child.stderr is not None
    child.stdin.write(turned([2, 0, 4]))
    child.stdin.flush()
    while "position 3 is measured" not in child.stderr.readline():
        pass
    child.send_signal(signal.SIGINT)
    child.stdin.close()
    assert child.wait(timeout=MOST) == 130
    assert len((tmp_path / "positions.csv").read_text().splitlines()) == 4


def test_a_guided_session_goes_on_to_positions_in_between() -> None:
    """Ten positions are wanted: after six faces one of an edge and three corners; a turn by 20 degrees is none."""
    guide, faces = DwellGuide(1.0, 10), [*np.eye(3), *-np.eye(3)]
    more = [np.array(f, dtype=float) for f in ((1, 1, 0), (1, -1, 1), (-1, 1, 1), (1, 1, -1))]
    near = np.array([math.sin(math.radians(20.0)), 0.0, math.cos(math.radians(20.0))])
    rng, t = np.random.default_rng(2), 0.0
    for face in (*faces, near, *more):
        for count, size in ((100, 3.0), (200, 0.01)):
            y = 9.81 * face / np.linalg.norm(face) + size * rng.standard_normal((count, 3))
            answer = guide.feed(np.column_stack([t + np.arange(count) / 100.0, y]))
            t += count / 100.0
        if face is near:
            assert len(guide.rests) == 6
            assert not any("measured" in text for text in answer)
            assert "in between" in guide.next
    assert len(guide.rests) == 10
    assert not guide.next


@pytest.mark.parametrize(
    ("lines", "words", "code", "text"),
    [
        ("1,2\n3,4\n", (), 3, "no line could be used"),
        (turned([0, 1, 2, 3]), (), 3, "4 positions; .* no position has y down, z down; add them"),
        ("", ("--serial", "/dev/null"), 2, "--serial and --baud belong together"),
    ],
)
def test_mistakes_of_a_guided_session_end_in_one_sentence(
    tmp_path: Path, lines: str, words: tuple[str, ...], code: int, text: str
) -> None:
    child = guided(tmp_path, *(words or ("-",)))
    _, err = child.communicate(lines, timeout=MOST)
    assert child.returncode == code
    assert re.search(text, err), err
    assert "Traceback" not in err
