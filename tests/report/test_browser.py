"""The page in Chromium, with no network: it draws everything, complains of nothing, and no text runs into another."""

import pytest

from accelcal import report

BOXES = """() => [...document.querySelectorAll('.plot')].map(plot => {
  const frame = plot.getBoundingClientRect();
  const seen = [...plot.querySelectorAll(
    '.annotation-text, .legendtext, .xtitle, .ytitle, .x2title, .y2title, .g-xtitle text, .g-ytitle text')]
    .filter(e => e.textContent.trim() && e.getBoundingClientRect().width > 0)
    .map(e => { const r = e.getBoundingClientRect();
      return {text: e.textContent, left: r.left - frame.left, right: r.right - frame.left,
              top: r.top - frame.top, bottom: r.bottom - frame.top}; });
  return {name: plot.id, width: frame.width, height: frame.height, texts: seen};
})"""


@pytest.fixture(scope="module")
def files(pages, tmp_path_factory):
    folder = tmp_path_factory.mktemp("pages")
    for name, text in pages.items():
        report.write(text, folder / f"{name}.html")
    return folder


def opened(browser, path, width=1280, scheme="light"):
    """Open a page offline; return it with everything that it asked for and said."""
    context = browser.new_context(viewport={"width": width, "height": 900}, color_scheme=scheme, offline=True)
    page = context.new_page()
    asked, messages = [], []
    page.on("request", lambda request: asked.append(request.url))
    page.on("console", lambda message: messages.append(message.text))
    page.on("pageerror", lambda error: messages.append(str(error)))
    page.on("dialog", lambda dialog: (messages.append(f"dialog: {dialog.message}"), dialog.dismiss()))
    page.goto(path.as_uri())
    return page, asked, messages


def overlapping(plot):
    """Pairs of texts that cover each other by more than two pixels, and texts that leave the figure."""
    texts = plot["texts"]
    results = [
        (a["text"], b["text"])
        for i, a in enumerate(texts)
        for b in texts[i + 1 :]
        if min(a["right"], b["right"]) - max(a["left"], b["left"]) > 2
        and min(a["bottom"], b["bottom"]) - max(a["top"], b["top"]) > 2
    ]
    results += [
        (t["text"], "edge")
        for t in texts
        if t["left"] < -1 or t["top"] < -1 or t["right"] > plot["width"] + 1 or t["bottom"] > plot["height"] + 1
    ]
    return results


@pytest.mark.parametrize(("width", "scheme"), [(390, "light"), (1280, "light"), (1920, "dark")])
@pytest.mark.parametrize("which", ["lacking", "complete"])
def test_every_figure_is_drawn_without_network_or_complaint(browser, files, which, width, scheme):
    page, asked, message = opened(browser, files / f"{which}.html", width, scheme)
    page.wait_for_selector("html[data-ready=true]", state="attached", timeout=60_000)
    assert page.get_attribute("html", "data-theme") == scheme
    drawn, wanted = page.locator(".plot:has(.main-svg)").count(), page.locator(".plot").count()
    assert drawn == wanted >= 14
    assert asked == [(files / f"{which}.html").as_uri()]
    assert message == []
    plots = page.evaluate(BOXES)
    assert sum(len(p["texts"]) for p in plots) > 60
    assert {p["name"]: overlapping(p) for p in plots if overlapping(p)} == {}
    assert page.evaluate("() => document.documentElement.scrollWidth <= window.innerWidth")
    page.context.close()


def test_overlapping_and_clipped_texts_are_caught():
    # The sister: boxes that cover each other, and one that leaves the figure.
    box = {"text": "a", "left": 0, "right": 50, "top": 0, "bottom": 10}
    apart = {"width": 100, "height": 50, "texts": [box, box | {"left": 60, "right": 90}]}
    assert overlapping(apart) == []
    assert len(overlapping(apart | {"texts": [box, box | {"left": 40, "right": 90}]})) == 1
    assert len(overlapping(apart | {"texts": [box | {"right": 130}]})) == 1


def test_the_theme_turns_without_losing_data(browser, files):
    page, _, message = opened(browser, files / "complete.html")
    page.wait_for_selector("html[data-ready=true]", state="attached", timeout=60_000)
    before = page.evaluate("() => [...document.querySelectorAll('.plot')].map(p => p.data.map(t => t.name || t.type))")
    page.get_by_role("button", name="Dark theme").click()
    page.wait_for_selector("html[data-theme=dark][data-ready=true]", state="attached", timeout=60_000)
    after = page.evaluate("() => [...document.querySelectorAll('.plot')].map(p => p.data.map(t => t.name || t.type))")
    assert after == before
    colours = page.evaluate("() => [...document.querySelectorAll('.plot')].map(p => p.layout.paper_bgcolor)")
    assert set(colours) == {"#15171C"}
    assert message == []
    page.context.close()


def test_the_light_page_shows_its_pictures(browser, files):
    page, asked, message = opened(browser, files / "light.html")
    sizes = page.evaluate("() => [...document.images].map(i => [i.naturalWidth, i.naturalHeight])")
    assert len(sizes) >= 8
    assert all(w > 100 and h > 100 for w, h in sizes)
    assert [url for url in asked if not url.startswith("data:")] == [(files / "light.html").as_uri()]
    assert message == []
    page.context.close()


def test_the_first_page_of_a_printed_page_is_one_a4(browser, files):
    page, *_ = opened(browser, files / "light.html")
    page.set_viewport_size({"width": round((210 - 2 * 14) / 25.4 * 96), "height": 900})
    page.emulate_media(media="print")
    bottom = page.evaluate("() => document.getElementById('first').getBoundingClientRect().bottom")
    assert 0.6 < bottom / ((297 - 2 * 12) / 25.4 * 96) <= 1.0
    page.context.close()
