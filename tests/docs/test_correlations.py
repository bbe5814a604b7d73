"""The page on correlations: its table is what fits of simulated records print, and its closed forms hold."""

import pytest

from benches import correlations

from .pages import DOCS


@pytest.mark.parametrize("topic", correlations.TOPICS, ids=lambda topic: topic.__name__)
def test_closed_forms_hold_and_stand_on_the_page(topic):
    page = (DOCS / "correlations.md").read_text(encoding="utf-8")
    for row in topic():
        print(row.text)
        assert row.holds, row.text
        assert row.text.rsplit("|", 3)[0] in page, row.text  # claim and closed form; the fit may round otherwise
