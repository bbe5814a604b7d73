"""Streams of lines that are damaged on their way at random, and what a live view makes of them."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accelcal.data import RecordingError
from accelcal.io import read_sidecar
from accelcal.io.stream import ByteSource, Rows
from accelcal.live import LiveSession, settings_of
from tests.live.streams import RIG

HEADER = b"t,accel,position"
LONGEST_LOSS = 1.0
"""Most time over which intact rows in a row may be lost, s."""
Line = tuple[int, bytes]
"""Number of the row, -1 where it is none any more, and its bytes."""


@dataclass(frozen=True)
class Outcome:
    """What became of one stream."""

    ended: str
    """Why the view ended before the stream did; empty where it did not."""
    intact: int
    used: int
    """Of the intact rows."""
    lost: float
    """Longest time over which intact rows in a row were lost, s."""
    kinds: tuple[str, ...]


def stamps(line: bytes, change: Callable[[float], float]) -> bytes:
    """A line with another stamp."""
    first, _, rest = line.partition(b",")
    return b"%.6f," % change(float(first)) + rest


def flipped(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Bytes are replaced by others, also line ends."""
    i = int(rng.integers(len(lines)))
    while i < len(lines):
        line = bytearray(lines[i][1] + b"\n")
        line[int(rng.integers(len(line)))] = int(rng.integers(256))
        lines[i] = (-1, bytes(line[:-1]) if line[-1] == 10 else bytes(line))
        if line[-1] != 10 and i + 1 < len(lines):  # runs into the next
            lines[i : i + 2] = [(-1, bytes(line) + lines[i + 1][1])]
        i += 1 + int(rng.exponential(0.05 * len(lines)))


def ahead(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Rows in a row have stamps that are too late, all by as much or each by its own."""
    _moved(rng, lines, rate, 1.0)


def back(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Rows in a row have stamps that are too early."""
    _moved(rng, lines, rate, -1.0)


def _moved(rng: np.random.Generator, lines: list[Line], rate: float, sign: float) -> None:
    most = max(1, min(200, int(0.35 * rate)))
    count = int(rng.integers(1, 4)) if rng.random() < 0.5 else int(rng.integers(1, most + 1))
    begin, together = int(rng.integers(max(1, len(lines) - count))), rng.random() < 0.5
    by = 10.0 ** rng.uniform(-3.0, 7.0, count)
    for k, i in enumerate(range(begin, min(begin + count, len(lines)))):
        if lines[i][0] >= 0:
            shift = sign * float(by[0] if together else by[k])
            lines[i] = (-1, stamps(lines[i][1], lambda t, shift=shift: t + shift))


def removed(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Lines are lost: one, some, or a second of them."""
    begin = int(rng.integers(len(lines)))
    del lines[begin : begin + int(rng.integers(1, max(2, int(rate))))]


def repeated(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """A block is sent twice."""
    begin, count = int(rng.integers(len(lines))), int(rng.integers(1, max(2, int(0.5 * rate))))
    block = [(-1, line) for _, line in lines[begin : begin + count]]
    lines[begin + count : begin + count] = block


def swapped(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Two neighbours change places."""
    i = int(rng.integers(1, len(lines)))
    lines[i - 1], lines[i] = (-1, lines[i][1]), (-1, lines[i - 1][1])


def burst(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Noise between two lines, some of it long."""
    i = int(rng.integers(len(lines) + 1))
    lines.insert(i, (-1, rng.bytes(int(10.0 ** rng.uniform(0.0, 4.0)))))


def odd(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """Lines that no device should send."""
    texts = [b"", b",,", b"nan,nan,nan", b"1e308,1,1", b"-1e308,1,1", b"1e11,1e5,1e5", b"1e-310,1,1", b"0,0,0", HEADER]
    texts += [b"\0" * 50, b"," * 300, b"9" * 5000, b"# restart", "٣,1,1".encode(), b"1;2;3", b"inf,1,1", b"0x10,1,1"]
    for _ in range(int(rng.integers(1, 6))):
        lines.insert(int(rng.integers(len(lines) + 1)), (-1, texts[int(rng.integers(len(texts)))]))


def anew(rng: np.random.Generator, lines: list[Line], rate: float) -> None:
    """The clock of the device begins anew."""
    i = int(rng.integers(len(lines)))
    numbered = [line for line in lines[i:] if line[0] >= 0]
    if numbered:
        zero = float(numbered[0][1].partition(b",")[0])
        lines[i:] = [(n, stamps(line, lambda t: t - zero) if n >= 0 else line) for n, line in lines[i:]]


KINDS = (flipped, flipped, ahead, ahead, back, removed, repeated, swapped, burst, odd)


def damaged(seed: int) -> tuple[bytes, dict[float, float], bool, tuple[str, ...]]:
    """A stream: its bytes, time by output (m/s²) of intact rows, whether it begins with a line, the damages."""
    rng = np.random.default_rng([4104, seed])
    rate = float(10.0 ** rng.uniform(1.0, 3.3))
    count = int(min(4000, max(300, rng.uniform(4.0, 20.0) * rate)))
    t = np.arange(count) / rate + rng.uniform(0.0, 1000.0)
    u = np.round(2.0 * np.sin(12.0 * t) + 0.02 * rng.standard_normal(count), 3) + 1e-8 * np.arange(count)
    z = -2e3 / 144.0 * np.sin(12.0 * t)
    lines: list[Line] = [(i, b"%.6f,%.8f,%.4f" % row) for i, row in enumerate(zip(t, u, z, strict=True))]
    kinds = [KINDS[int(rng.integers(len(KINDS)))] for _ in range(int(rng.integers(1, 6)))]
    if rng.random() < 0.1:
        kinds.insert(0, anew)
    for kind in kinds:
        kind(rng, lines, rate)
    named = [kind.__name__ for kind in kinds]
    chance = rng.random()
    if chance < 0.7:
        head = bytearray(HEADER)
        if chance < 0.2:
            head[int(rng.integers(len(head)))] = int(rng.choice([b for b in range(256) if b != 10]))
            named.append("header")
        lines.insert(0, (-1, bytes(head)))
    if chance < 0.05:
        lines.insert(0, (-1, rng.bytes(8).replace(b"\n", b"")))
    content = b"\n".join(line for _, line in lines) + b"\n"
    # Bytes of a burst or a flip may hold a line end: rows are as intact as their own bytes are.
    intact = {float(line.split(b",")[1]): i / rate for i, line in lines if i >= 0}
    return content, intact, chance < 0.7 or bool(rng.random() < 0.7), tuple(named)


class Watched(LiveSession):
    """A live view whose rows are kept."""

    def __init__(self, *given: object) -> None:
        super().__init__(*given)  # type: ignore[arg-type]
        self.outputs: set[float] = set()

    def _take(self, rows: Rows, on_alarm: Callable[..., None]) -> None:
        self.outputs.update(rows.accel.tolist())
        super()._take(rows, on_alarm)


def followed(seed: int, folder: Path) -> Outcome:
    """What a live view makes of one stream."""
    content, intact, whole, kinds = damaged(seed)
    rng = np.random.default_rng([4105, seed])
    (folder / "rig.toml").write_text(RIG)
    declared = read_sidecar(folder / "rig.toml")

    def pieces() -> Iterator[bytes]:
        i = 0
        while i < len(content):
            size = int(rng.integers(1, 5000))
            yield content[i : i + size]
            i += size

    chunks = pieces()
    source = ByteSource("made", lambda: next(chunks, b""), lambda: None, True, whole, ends_lines=True)
    ended = ""
    with np.errstate(all="ignore"), Watched(source, declared, settings_of(declared.rig)) as view:
        try:
            view.run(ends=lambda: False, on_alarm=lambda alarm: None, show=lambda: None)
        except RecordingError as error:
            ended = str(error)
    if not whole and intact:
        intact.pop(next(iter(intact)))
    longest, begun, used = 0.0, None, 0
    for u, t in intact.items():
        if u in view.outputs:
            used, begun = used + 1, None
        else:
            begun = t if begun is None else begun
            longest = max(longest, t - begun)
    return Outcome(ended, len(intact), used, longest, kinds)
