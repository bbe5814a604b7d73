"""Where the model fails is a place in the figure: a range, a button or a click leads there, marked and refined."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import pytest

from .conftest import write
from .test_browser import LONG, fit, load, opened, tab  # noqa: F401  (the fixture that opens a tab)
from .test_server import server  # noqa: F401  (the fixture that runs the workbench)

OUTPUT = """() => { const box = Array.from(document.querySelectorAll('.pictures'))
  .find(one => one.innerText.includes('Measured and simulated output'));
  return box ? box.querySelector('.js-plotly-plot') : null; }"""
"""The figure of the output; others are drawn above it in the meantime."""
SEEN = (
    f"""() => {{ const plot = ({OUTPUT})();"""
    + """
  if (!plot || !plot._fullLayout || !plot._fullLayout.xaxis) return null;
  const axes = ['xaxis', 'xaxis2', 'xaxis3'].map(name => plot._fullLayout[name].range);
  const [low, high] = axes[0];
  const x = Array.from(plot._fullData[0].x);
  return { axes, shown: x.filter(t => t >= low && t <= high).length,
           marks: (plot.layout.annotations || []).map(note => note.text),
           whole: (plot.layout.shapes || []).filter(s => s.yref === 'paper' && s.y0 === 0 && s.y1 === 1).length };
}"""
)


def drawn_axes(page: Any) -> dict[str, Any]:
    """What a figure shows."""
    evaluation: dict[str, Any] = page.evaluate(SEEN)
    return evaluation


def wait_for_width(page: Any, low: float, high: float) -> dict[str, Any]:
    """What a figure shows as soon as its time axis is that wide, s."""
    page.wait_for_function(
        f"() => {{ const found = ({SEEN})(); if (!found) return false;"
        f"const width = found.axes[0][1] - found.axes[0][0]; return width >= {low} && width <= {high}; }}",
        timeout=LONG,
    )
    return drawn_axes(page)


@pytest.fixture
def fitted(tab: Any, tmp_path: Path) -> Any:  # noqa: F811
    """A tab behind the first fit of a run with a hidden cubic, long enough for a figure of fewer points."""
    write(tmp_path / "cubic.csv", 21, seconds=40.0, cubic=4e-3)
    load(tab, tmp_path, "cubic")
    fit(tab)
    return tab


def test_the_worst_regions_are_places_in_the_first_figure(fitted: Any) -> None:
    page = fitted
    page.locator(".pictures", has_text="Measured and simulated").locator(".main-svg").first.wait_for(timeout=LONG)
    caption = page.locator(".pictures figcaption", has_text="Measured and simulated").first.inner_text()
    assert caption.startswith("Measured and simulated output (base): fit ")
    whole = wait_for_width(page, 8.0, 14.0)  # the held-out 12 s
    assert whole["marks"].count("chosen") == 0

    page.get_by_role("button", name="Largest residual 1").click()
    close = wait_for_width(page, 0.2, 2.0)
    assert close["axes"][0] == close["axes"][1] == close["axes"][2]
    assert "chosen" in close["marks"]
    assert close["whole"] >= 1  # the mark reaches over all panels
    assert close["shown"] > 1.3 * whole["shown"] * (close["axes"][0][1] - close["axes"][0][0]) / 12.0

    page.get_by_role("button", name="Whole record").click()
    again = wait_for_width(page, 8.0, 14.0)
    assert again["marks"] == whole["marks"]

    # By keyboard alone: open the table, go to its first range, press Enter.
    page.get_by_role("button", name="Where it fails").focus()
    page.keyboard.press("Enter")
    place = page.get_by_role("button", name="Show where acceleration is").first
    place.wait_for(timeout=LONG)
    place.focus()
    page.keyboard.press("Enter")
    wait_for_width(page, 0.2, 2.0)
    page.get_by_role("button", name="Whole record").click()
    wait_for_width(page, 8.0, 14.0)

    # A click into a stretch that is shaded.
    box = page.evaluate(
        f"""() => {{ const plot = ({OUTPUT})();"""
        + """
          const layout = plot._fullLayout, shape = plot.layout.shapes[0], area = plot.getBoundingClientRect();
          const t = 0.5 * (shape.x0 + shape.x1), data = plot._fullData[0];
          const i = Array.from(data.x).findIndex(x => x >= t);
          return [area.left + layout.xaxis._offset + layout.xaxis.d2p(data.x[i]),
                  area.top + layout.yaxis._offset + layout.yaxis.d2p(data.y[i])]; }"""
    )
    page.mouse.move(*box)
    page.mouse.click(*box)
    wait_for_width(page, 0.2, 2.0)
