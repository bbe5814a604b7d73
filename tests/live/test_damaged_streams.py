"""Damaged streams: no line ends a measurement, and behind damaged rows the stream is taken up again.

The bench takes 1 500: python -m benches.live --damaged 1500
"""

from __future__ import annotations

from pathlib import Path

import pytest

from accelcal.io import stream

from .damage import LONGEST_LOSS, Outcome, followed


def outcomes(seeds: range, folder: Path) -> list[Outcome]:
    """What becomes of some streams, with a line that says it."""
    found = [followed(seed, folder) for seed in seeds]
    ended, lost = sum(bool(o.ended) for o in found), sum(o.lost > LONGEST_LOSS for o in found)
    rows = f"{sum(o.used for o in found)} of {sum(o.intact for o in found)} intact rows used"
    print(f"{len(found)} streams: {ended} ended, limit 0; {lost} lost more than {LONGEST_LOSS:g} s, limit 0; {rows}")
    return found


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
