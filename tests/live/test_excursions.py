"""Outputs and readings that jump and return are lost before a filter takes them in; honest samples are not."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from accelcal.io import read_sidecar, stream as lines_of
from accelcal.io.stream import ByteSource, Excursions, Rows
from accelcal.live import LiveSession, settings_of
from accelcal.live.session import LiveState

from .streams import BIAS, RIG, SCALE, Stream, stream


def followed(simulated: Stream, folder: Path, damaged: float = 0.0) -> LiveState:
    """What a live view knows at the end of lines, some of which have one other character."""
    (folder / "rig.toml").write_text(RIG)
    declared, rng = read_sidecar(folder / "rig.toml"), np.random.default_rng(3)
    lines = simulated.lines().splitlines(keepends=True)
    for i in np.flatnonzero(rng.random(len(lines)) < damaged):
        line = bytearray(lines[i])
        line[rng.integers(len(line) - 1)] = rng.choice(list(b"0123456789.-,"))
        lines[i] = bytes(line)
    chunks = iter([b"".join(lines[i : i + 400]) for i in range(0, len(lines), 400)])
    source = ByteSource("simulated", lambda: next(chunks, b""), lambda: None, True, True, ends_lines=True)
    with LiveSession(source, declared, settings_of(declared.rig)) as view:
        view.run(ends=lambda: False, on_alarm=lambda alarm: None, show=lambda: None)
        return view.state


def distances(state: LiveState) -> list[float]:
    """From the truth, in standard deviations; nothing where an estimate does not hold."""
    estimates = {e.name: e for e in state.estimates}
    return [
        abs(estimates[name].value - truth) / estimates[name].std if name in estimates else np.inf
        for name, truth in (("bias", BIAS), ("scale_factor", SCALE))
    ]


def with_false_samples() -> Stream:
    """Of outputs alone, in a row and with a good one between; of readings that the stage cannot have."""
    simulated = stream(20.0)
    simulated.u[[9001, 15001, 20001, 20002, 25001, 25003]] += [90.0, -5.0, 90.0, -40.0, 60.0, 90.0]
    simulated.z[[12000, 30000]] += [1.0, -0.01]
    return simulated


def as_they_come(self: Excursions, rows: Rows) -> Rows:
    """The twin of `Excursions.without`."""
    return rows


def test_false_samples_are_left_out_and_said(tmp_path: Path) -> None:
    """False-alarm rate 1e-4."""
    state = followed(with_false_samples(), tmp_path)
    assert (state.outputs_left_out, state.readings_left_out, state.alarms) == (6, 2, 0)
    assert state.sentences == [
        "6 outputs that jump and return are left out",
        "2 position readings that jump and return are left out",
    ]
    assert max(distances(state)) < 4.0


def test_false_samples_that_are_believed_are_worth_hundreds_of_standard_deviations(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The twin."""
    monkeypatch.setattr(Excursions, "without", as_they_come)
    state = followed(with_false_samples(), tmp_path)
    assert state.alarms > 3
    assert max(distances(state)) > 100.0


@pytest.mark.parametrize("judged", [True, False])
def test_a_line_in_fifty_with_another_character_leaves_the_estimates(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, judged: bool
) -> None:
    """With a twin that believes them all; false-alarm rate 1e-6."""
    if not judged:
        monkeypatch.setattr(Excursions, "without", as_they_come)
    state = followed(stream(20.0), tmp_path, damaged=0.02)
    assert (max(distances(state)) < 5.0) is judged


def honest(n: int, rng: np.random.Generator) -> Iterator[tuple[str, np.ndarray]]:
    """Ten kinds of samples with nothing false."""
    k, noise = np.arange(n), rng.standard_normal(n)
    ringing = np.zeros((3, n))
    for at in range(300, n - 60, 700):
        x = np.arange(60) + rng.random()
        for i, (share, damping) in enumerate(((0.25, 0.02), (0.1, 0.1), (0.4, 0.05))):
            ringing[i, at : at + 60] += rng.normal(0, 50.0) * np.exp(-damping * x) * np.sin(2 * np.pi * share * x)
    burst = np.sin(2.5 * k) * (k % 2000 < 200)
    pulse = np.where(k % 900 < 3, 80.0, 0.0)
    yield "noise", noise
    yield "two tones", 10 * np.sin(0.03 * k) + 4 * np.sin(0.15 * k) + 0.02 * noise
    yield "20 Hz at 50 Hz, saturating", np.clip(30 * np.sin(2 * np.pi * 20.03 / 50 * k) + 0.05 * noise, -20, 20)
    yield "coarse at rest", np.round(0.2 * noise + 0.3) * 0.1
    yield "coarse and slow", np.round(60 * np.sin(1e-3 * k) + 0.3 * noise)
    yield "steps", 5 * np.sign(np.sin(0.05 * k)) + 0.005 * noise
    yield "bursts", 30 * burst + 0.01 * noise
    yield "pulses of three", pulse + 0.02 * noise
    yield "held", np.repeat(5 * np.sin(0.2 * k[: n // 4]) + 0.02 * noise[: n // 4], 4)
    yield "chirp", 10 * np.sin(np.cumsum(np.pi * (k % 20000) / 20000)) + 0.01 * noise
    for share, y in zip(("a quarter", "a tenth", "four tenths"), ringing, strict=True):
        yield f"ringing at {share} of the rate", y + 0.02 * noise


def left_out(y: np.ndarray) -> int:
    """Samples of a series that are lost as outputs, and as readings."""
    finder, t = Excursions(), 1e-3 * np.arange(len(y))
    finder.without(Rows(t, y, y))
    return finder.outputs + finder.readings


def test_honest_samples_are_kept() -> None:
    """At most one in 10⁶: false-alarm rate 0.04 were it so many, and it is one in 10⁸."""
    for kind, y in honest(20_000, np.random.default_rng(1)):
        assert left_out(y) == 0, kind


def test_honest_samples_are_not_kept_where_the_samples_around_do_not_count(monkeypatch: pytest.MonkeyPatch) -> None:
    """The twin: an excursion is what bends more than usual."""
    monkeypatch.setattr(lines_of, "RATIO", 0.5)
    lost = [kind for kind, y in honest(20_000, np.random.default_rng(1)) if left_out(y)]
    assert len(lost) >= 3, lost


def test_blocks_and_the_end_make_no_difference() -> None:
    rng, simulated = np.random.default_rng(2), with_false_samples()
    whole, parts = Excursions(), Excursions()
    together = Rows.joined([whole.without(Rows(simulated.t, simulated.u, simulated.z)), whole.rest()])
    cuts = [0, *np.sort(rng.integers(0, len(simulated.t), 1000)).tolist(), len(simulated.t)]
    pieces = [parts.without(Rows(simulated.t[a:b], simulated.u[a:b], simulated.z[a:b])) for a, b in pairwise(cuts)]
    apart = Rows.joined([*pieces, parts.rest()])
    for name in ("t", "accel", "position"):
        np.testing.assert_array_equal(getattr(together, name), getattr(apart, name))
    assert np.flatnonzero(np.isnan(apart.accel)).tolist() == [9001, 15001, 20001, 20002, 25001, 25003]


def test_rows_do_not_wait_for_a_channel_that_falls_silent() -> None:
    n = np.arange(1000.0)
    finder = Excursions()
    rows = finder.without(Rows(n, np.where(n < 300, np.sin(n), np.nan), np.where(n < 500, n, np.nan)))
    assert len(rows) == 1000
