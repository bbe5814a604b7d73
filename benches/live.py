"""Lines at 10 kHz from another process into `accelcal live`: what is lost, and what it costs.

Run from the top of the repository: python -m benches.live [--seconds 600] [--over tcp|pty] [--rate 10000]
Position is in every second line, encoder noise and sensor noise are those of the sidecar. The recording is read back
afterwards: every row that was sent must be in it, and the estimates must be those of `filters.run` on it, bit for bit.
Prints figure and threshold; exit code 1 when one is missed. --damaged 1500 follows so many streams that are damaged at
random instead: none may end early, none may lose intact rows over more than a second.
"""

from __future__ import annotations

import argparse
import json
import os
import resource
import socket
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

from accelcal.data.recording import Channel
from accelcal.filters import run
from accelcal.io import load, read_sidecar
from accelcal.live import settings_of
from tests.live.damage import LONGEST_LOSS
from tests.live.test_damaged_streams import outcomes

MOST_CPU = 0.7
"""Processor time of the command over real time: the sender and the rest of the machine need a core too."""
RIG = """
[sensor]
noise = "225 ug/sqrt(Hz)"
[channels]
time = { column = "t", unit = "s" }
accel = { column = "accel", unit = "g" }
position = { column = "position", unit = "mm", resolution = "1 um" }
"""
CHUNK = 0.01
"""Lines are sent together that fall into this time, s."""


def lines(start: int, stop: int, rate: float, rng: np.random.Generator) -> bytes:
    """Rows of a stage on two tones, with the noise of the sidecar."""
    t = np.arange(start, stop) / rate
    w1, w2, a1, a2 = 12.0, 55.0, 2.0, 8.0
    a = a1 * np.sin(w1 * t) + a2 * np.sin(w2 * t)
    p = -a1 / w1**2 * np.sin(w1 * t) - a2 / w2**2 * np.sin(w2 * t)
    noise = 225e-6 * 9.80665 * np.sqrt(rate / 2.0)
    u = (0.05 + 1.01 * a + noise * rng.standard_normal(len(t))) / 9.80665
    z = np.round(p / 1e-6) * 1e-3
    rows = zip(range(start, stop), t.tolist(), u.tolist(), z.tolist(), strict=True)
    return b"".join(b"%.4f,%.7f,%s\n" % (s, y, b"%.3f" % x if n % 2 == 0 else b"") for n, s, y, x in rows)


def send(write: Callable[[bytes], object], seconds: float, rate: float) -> int:
    """Send lines at their time; return how many."""
    rng = np.random.default_rng(1)
    began, sent, total = time.monotonic(), 0, int(seconds * rate)
    while sent < total:
        due = min(total, int((time.monotonic() - began + CHUNK) * rate))
        if due > sent:
            write(lines(sent, due, rate, rng))
            sent = due
        time.sleep(CHUNK / 2.0)
    return sent


def sender(arguments: argparse.Namespace) -> int:
    """The other process: serve one client, or write to a terminal."""
    if arguments.over == "tcp":
        with socket.create_server(("127.0.0.1", 0)) as server:
            print(server.getsockname()[1], flush=True)
            connection, _ = server.accept()
            with connection:
                send(connection.sendall, arguments.seconds, arguments.rate)
        return 0
    import pty
    import tty

    master, slave = pty.openpty()
    tty.setraw(slave)
    print(os.ttyname(slave), flush=True)
    sys.stdin.readline()  # the command has opened the port
    os.write(master, b"the first line of a port is skipped\n")
    send(lambda content: write_all(master, content), arguments.seconds, arguments.rate)
    time.sleep(2.0)  # what is still in the terminal is read before it closes
    return 0


def write_all(descriptor: int, content: bytes) -> None:
    """A terminal takes a part at a time."""
    while content:
        content = content[os.write(descriptor, content) :]


def measured(arguments: argparse.Namespace, folder: Path) -> bool:
    """Run both processes, print what was found, and say whether all is well."""
    (folder / "rig.toml").write_text(RIG)
    me = [sys.executable, "-m", "benches.live", "--sender", "--over", arguments.over]
    options = ["--seconds", str(arguments.seconds), "--rate", str(arguments.rate)]
    other = subprocess.Popen([*me, *options], stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True)
    assert other.stdout is not None
    assert other.stdin is not None
    place = other.stdout.readline().strip()
    source = ["--tcp", f"127.0.0.1:{place}"] if arguments.over == "tcp" else ["--serial", place, "--baud", "4000000"]
    command = [sys.executable, "-m", "accelcal", "live", *source, "--rig", str(folder / "rig.toml")]
    with (folder / "said.jsonl").open("w") as log:
        before = resource.getrusage(resource.RUSAGE_CHILDREN)
        live = subprocess.Popen([*command, "-o", str(folder / "got.parquet"), "--json", "--every", "1 s"], stdout=log)
        while not (folder / "said.jsonl").stat().st_size:  # the source is open when something is said of it
            time.sleep(0.1)
        other.stdin.write("\n")
        other.stdin.close()
        live.wait()
        _, _, usage = (None, None, resource.getrusage(resource.RUSAGE_CHILDREN))
    other.wait()
    end = json.loads((folder / "said.jsonl").read_text().splitlines()[-1])
    used = usage.ru_utime + usage.ru_stime - before.ru_utime - before.ru_stime
    return judged(arguments, folder, end, used)


def judged(arguments: argparse.Namespace, folder: Path, end: dict[str, object], used: float) -> bool:
    """Print figures beside their limits."""
    total = int(arguments.seconds * arguments.rate)
    recording = load(folder / "got.parquet")
    counts = end["state"]
    assert isinstance(counts, dict)
    lost = total - len(recording.accel)
    share = used / arguments.seconds
    skipped = 1 if arguments.over == "pty" else 0
    print(f"{arguments.over}, {arguments.rate:g} lines a second for {arguments.seconds:g} s: {counts}")
    print(f"rows sent {total}, lost {lost}, limit 0; bytes dropped {counts['dropped_bytes']}, limit 0")
    print(f"broken {counts['broken']}, limit {skipped}; events refused {counts['refused']}, limit 0")
    print(f"processor time over real time {share:.3f}, limit {MOST_CPU:g}")
    print(f"blocks alarmed {counts['alarms']} of {counts['blocks']}; NIS {counts['nis']}")
    same = equals_run(folder)
    print(f"estimates are those of filters.run on the recording, bit for bit: {same}")
    fine = not (lost or counts["dropped_bytes"] or counts["refused"]) and counts["broken"] == skipped
    ok = fine and share <= MOST_CPU and same
    print("ok" if ok else "MISSED")
    return ok


def equals_run(folder: Path) -> bool:
    """Whether the last estimates of the stream are those of the record."""
    recording = load(folder / "got.parquet")
    settings = settings_of(read_sidecar(folder / "rig.toml").rig)
    accel = Channel("accel", recording.accel.t, settings.stage_output(recording.accel.y), "m/s^2")
    x0, P0 = settings.start(float(recording.position.y[0]), 0.0)
    q, r = settings.q, settings.r_position
    outcome = run(settings.choice, accel, recording.position, q=q, r_position=r, x0=x0, P0=P0)
    end = json.loads((folder / "said.jsonl").read_text().splitlines()[-1])
    covariance = outcome.covariance
    estimates = settings.estimates(outcome.states[-1], covariance)
    shown = [(e["name"], e["value"], e["std"]) for e in end["state"]["estimates"]]
    return shown == [(e.name, e.value, e.std) for e in estimates]


def main() -> int:
    """Either process."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--seconds", type=float, default=600.0)
    parser.add_argument("--rate", type=float, default=10_000.0)
    parser.add_argument("--over", choices=("tcp", "pty"), default="tcp")
    parser.add_argument("--damaged", type=int, default=0, help="follow so many damaged streams")
    parser.add_argument("--sender", action="store_true", help=argparse.SUPPRESS)
    arguments = parser.parse_args()
    if arguments.sender:
        return sender(arguments)
    with tempfile.TemporaryDirectory() as folder:
        if arguments.damaged:
            damaged = outcomes(range(10_000, 10_000 + arguments.damaged), Path(folder))
            return int(any(outcome.ended or outcome.lost > LONGEST_LOSS for outcome in damaged))
        return 0 if measured(arguments, Path(folder)) else 1


if __name__ == "__main__":
    raise SystemExit(main())
