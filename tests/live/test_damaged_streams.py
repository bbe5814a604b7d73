"""Damaged streams: no line ends a measurement, and behind damaged rows the stream is taken up again.

The bench takes 1 500: python -m benches.live --damaged 1500
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from accelcal.io import read_sidecar, stream
from accelcal.io.stream import ByteSource
from accelcal.live import LiveSession, settings_of

from .damage import LONGEST_LOSS, Outcome, followed
from .streams import BIAS, RIG, SCALE, Stream, stream as stream_of


def outcomes(seeds: range, folder: Path) -> list[Outcome]:
    """What becomes of some streams, with a line that says it."""
    results = [followed(seed, folder) for seed in seeds]
    ended, lost = sum(bool(o.ended) for o in results), sum(o.lost > LONGEST_LOSS for o in results)
    rows = f"{sum(o.used for o in results)} of {sum(o.intact for o in results)} intact rows used"
    print(f"{len(results)} streams: {ended} ended, limit 0; {lost} lost more than {LONGEST_LOSS:g} s, limit 0; {rows}")
    return results


@pytest.mark.parametrize("part", [0, pytest.param(1, marks=pytest.mark.slow), pytest.param(2, marks=pytest.mark.slow)])
def test_damaged_streams_are_followed_to_their_end(tmp_path: Path, part: int) -> None:
    first, last = ((0, 20), (20, 160), (160, 300))[part]
    for outcome in outcomes(range(first, last), tmp_path):
        assert not outcome.ended, outcome
        assert outcome.lost <= LONGEST_LOSS, outcome
        assert outcome.used > 0.5 * outcome.intact, outcome


def test_rows_that_need_no_agreement_lose_the_stream(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """The twin: a row that is ahead is believed at once, and none behind is."""
    monkeypatch.setattr(stream, "FEWEST", 1)
    monkeypatch.setattr(stream, "SEVERAL", 1)
    monkeypatch.setattr(stream, "SHORT", 0.0)
    monkeypatch.setattr(stream, "BEHIND", float("inf"))
    assert sum(outcome.lost > LONGEST_LOSS for outcome in outcomes(range(20), tmp_path)) >= 5


def test_a_device_that_was_away_and_begins_its_clock_anew_leaves_the_parameters(tmp_path: Path) -> None:
    """Meanwhile the stage has moved; false-alarm rate 6e-5 for each of two parameters."""
    (tmp_path / "rig.toml").write_text(RIG)
    declared, sent = read_sidecar(tmp_path / "rig.toml"), stream_of(12.0, seed=8)
    later = sent.t > 6.0
    lines = Stream(np.where(later, sent.t - 6.0, sent.t), sent.u, sent.z).lines().splitlines(keepends=True)
    there = np.flatnonzero((sent.t < 4.7) | later)
    chunks = iter([b"".join(lines[i] for i in part) for part in np.array_split(there, 100)])
    source = ByteSource("made", lambda: next(chunks, b""), lambda: None, True, True, ends_lines=True)
    with LiveSession(source, declared, settings_of(declared.rig)) as view:
        view.run(ends=lambda: False, on_alarm=lambda alarm: None, show=lambda: None)
        state = view.state
    assert (state.restarts, state.alarms, state.missing) == (1, 0, 0)
    for estimate, truth in zip(sorted(state.estimates, key=lambda e: e.name), (BIAS, SCALE), strict=True):
        assert abs(estimate.value - truth) < 4.0 * estimate.std, (estimate, truth)
