"""The page on the user's own data explains every key that the sidecar reader accepts, and no other."""

import re

import pytest

from accelcal.io import read_sidecar, sidecar

from .pages import DOCS, examples

PAGE = "your-data"


def known_and_given(texts, folder, monkeypatch):
    """Keys that the reader accepts and keys that it was given, by the table of checks that was applied.

    A nested table is reached when the page gives one; a page without it lacks the key that holds it.
    """
    declared, given = {}, {}
    check = sidecar._table

    def watched(result, where, checks):
        keys = tuple(sorted(set(checks) - {sidecar._ANY_OTHER}))
        declared[keys] = set(keys)
        given.setdefault(keys, set()).update(set(result) & set(keys))
        return check(result, where, checks)

    monkeypatch.setattr(sidecar, "_table", watched)
    for number, text in enumerate(texts):
        path = folder / f"{number}.toml"
        path.write_text(text)
        read_sidecar(path)
    return declared, given


def sidecars():
    return [example.text for example in examples(PAGE) if example.language == "toml"]


def test_the_examples_give_every_key(tmp_path, monkeypatch):
    declared, given = known_and_given(sidecars(), tmp_path, monkeypatch)
    assert len(declared) >= 10  # six tables, a clock, three kinds of channel, a low-pass
    assert given == declared


def test_every_key_is_in_a_table_of_the_page(tmp_path, monkeypatch):
    declared, _ = known_and_given(sidecars(), tmp_path, monkeypatch)
    text = (DOCS / f"{PAGE}.md").read_text(encoding="utf-8")
    rows = re.findall(r"^\| (`[^|]*`) \|", text, flags=re.MULTILINE)
    explained = {key for row in rows for key in re.findall(r"`(\w+)`", row)}
    assert set().union(*declared.values()) - {"accel", "position"} <= explained
    for table in sidecar.KEYS:
        assert f"`[{table}]`" in text
        assert table == "channels" or sidecar.markdown(table) in text, sidecar.markdown(table)


@pytest.mark.parametrize("key", ["serial", "tolerance = 0.05", "resolution", "gravity_along_axis", "misalignment"])
def test_a_key_that_the_page_omits_is_found(key, tmp_path, monkeypatch):
    texts = [re.sub(rf"^{key}.*\n|, {key}[^,}}]*", "", text, flags=re.MULTILINE) for text in sidecars()]
    assert texts != sidecars()
    declared, given = known_and_given(texts, tmp_path, monkeypatch)
    assert given != declared
