"""What is said beside a verdict: one remark for many faults, and every code on the page that explains it."""

import re
import string
from pathlib import Path

import pytest

from accelcal.diagnosis.faults import LISTED_SINGLY, Fault, fault_remarks
from accelcal.estimation.remarks import KINDS, remark

LOOP = Path(__file__).parents[2] / "docs" / "loop.md"


def gaps(count, length=0.1):
    return [Fault("dropout", "position", float(k), length * (1 + k), f"gap {k}") for k in range(count)]


def test_many_gaps_are_one_remark_with_count_share_and_the_longest():
    (message,) = fault_remarks(gaps(130, 1e-3), 1000.0, "run")
    longest, total = 0.130, 1e-3 * 130 * 131 / 2
    assert message.code == "dropout"
    assert message.values["count"] == 130
    assert message.values["share"] == pytest.approx(100.0 * total / 1000.0)
    assert (message.values["longest"], message.values["time"]) == (pytest.approx(longest), 129.0)
    assert "130 gaps" in message.sentence
    assert "0.13 s" in message.sentence


def test_few_gaps_have_their_own_sentences_and_other_channels_their_own_remark():
    few = gaps(LISTED_SINGLY)
    assert [r.sentence for r in fault_remarks(few, 10.0, "run")] == [f"run: {f.sentence}" for f in few]
    other = [Fault("dropout", "accel", 0.5, 0.2, "gap of the output")]
    assert [r.values["channel"] for r in fault_remarks([*gaps(5), *other], 10.0, "run")] == ["position", "accel"]
    assert fault_remarks([], 10.0, "run") == ()


def test_every_code_is_explained_and_its_sentence_has_its_values():
    explained = set(re.findall(r"`(\w+)`", LOOP.read_text(encoding="utf-8").partition("code of a remark")[2]))
    assert set(KINDS) <= explained
    for kind in KINDS.values():
        assert all(name is None or name.isidentifier() for _, name, _, _ in string.Formatter().parse(kind.text))
    with pytest.raises(KeyError, match="sigma"):
        remark("not_added", effect="cubic", reason="no fit")
    with pytest.raises(KeyError, match="unheard_of"):
        remark("unheard_of")
