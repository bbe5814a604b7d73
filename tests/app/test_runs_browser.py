"""Several recordings in Chromium: drop three and a table of dwells, hold one out, fit, see each, save and reopen."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .test_tasks import EVERY
from .user import LONG, LOOKS, arrives


@pytest.mark.parametrize(("width", "scheme"), LOOKS if EVERY else [(390, "dark")])
def test_three_recordings_and_dwells_are_fitted_together(
    browser: Any,
    server: Any,  # noqa: F811
    several: Path,
    tmp_path: Path,
    width: int,
    scheme: str,
) -> None:
    user = arrives(browser, f"http://{HOST}:{server[0]}", f"several-{width}-{scheme}", width, scheme)
    user.drop(*sorted(several.iterdir()))
    user.button("Fit the linear model").wait_for(timeout=LONG)
    user.click("Use of run1.csv", "combobox")
    user.click("hold out", "option")
    user.page.get_by_text("all of it", exact=True).nth(1).wait_for(timeout=LONG)
    user.settles(figures=1)
    user.look("roles")
    assert user.fit() in ("named", "tied")
    assert user.clicks == 3  # one of them the fit, as with one recording
    user.add("cubic")
    user.sees("on 2 held-out recordings together")
    errors = user.page.get_by_role("table", name="Error on each held-out recording")
    assert [row.split("\t")[0].strip() for row in errors.locator("tbody tr").all_inner_texts()] == [
        "run1.csv",
        "run2.csv",
        "together",
    ]
    user.settles(figures=4)
    user.look("errors")
    user.click("Undo")
    user.page.locator("[data-verdict=named], [data-verdict=tied]").wait_for(timeout=LONG)
    user.click("Redo")
    user.click("Model", "tab")
    user.sees("dwells.csv: 8 dwells")
    user.click("Compare on held-out data")
    user.page.get_by_role("table", name="Errors of two models on held-out data").wait_for(timeout=LONG)
    user.look("side by side")
    user.click("Export", "tab")
    with user.page.expect_download(timeout=LONG) as waiting:
        user.click("Save session (.accelcal)")
    waiting.value.save_as(tmp_path / "work.accelcal")

    user.page.goto(f"http://{HOST}:{server[0]}/", timeout=LONG)
    user.sees("Drop a recording here")
    user.drop(tmp_path / "work.accelcal")
    user.sees("on 2 held-out recordings together")
    user.click("Data", "tab")
    assert user.page.get_by_role("combobox", name="Use of run1.csv").input_value() == "hold out"
    assert user.outside == []
    assert user.complaints == []
    user.page.context.close()
