"""The site: built from the repository without a warning, with valid links, and nothing fetched when it is read."""

import importlib
import re
import subprocess
import sys
from pathlib import Path

import nbformat
import pytest

from accelcal.cli import app
from accelcal.effects import BUILT_IN

from .site import broken, read, remote
from .test_tutorial import TUTORIAL, outputs

DOCS = Path(__file__).parents[2] / "docs"
PUBLIC = (
    "accelcal",
    "accelcal.diagnosis.experiment",
    "accelcal.fleet.campaign",
    "accelcal.io",
    "accelcal.plots",
    "accelcal.plots.interactive",
    "accelcal.report",
)
"""Packages of whose `__all__` every name must be on the pages of the Python interface."""
SEEN = ("index", "effects", "tutorial", "api/loop")
"""Pages that are opened in a browser."""


@pytest.fixture(scope="module")
def built(tmp_path_factory):
    """Build as `make docs` does: warnings are errors."""
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "sphinx", "-W", "-E", "-q", "-b", "html", "-d", folder / "doctrees"]
    done = subprocess.run([*command, DOCS, folder / "docs"], capture_output=True, text=True, timeout=1500)
    assert done.returncode == 0, done.stderr
    return folder / "docs"


def check_links(site):
    assert list(broken(site)) == []


def check_offline(site):
    assert list(remote(site)) == []


def check_pages(site):
    for source in DOCS.rglob("*"):
        if source.suffix in (".md", ".rst", ".ipynb"):
            assert (site / source.relative_to(DOCS).with_suffix(".html")).is_file(), source


def check_cards(site):
    page = (site / "effects.html").read_text(encoding="utf-8")
    symptoms = read(site / "symptoms.html")
    for effect in BUILT_IN:
        for theme in ("light", "dark"):
            assert f"{effect.name}-{theme}.png" in page
            assert (site / "_images" / f"{effect.name}-{theme}.png").stat().st_size > 5000
        if not effect.family:
            assert f"effects.html#{effect.name.replace('_', '-')}" in symptoms.links, effect.name


def check_interface(site):
    documented = set().union(*(read(path).anchors for path in (site / "api").glob("*.html")))
    for package in PUBLIC:
        module = importlib.import_module(package)
        for name in set(module.__all__) - {"__version__"}:
            if callable(getattr(module, name)):
                assert f"{package}.{name}" in documented, f"{package}.{name} is public and not on any page"


def check_commands(site):
    page = (site / "quick-start.html").read_text(encoding="utf-8")
    for command in app.registered_commands:
        name = command.name or command.callback.__name__
        assert f'<span class="pre">{name}</span>' in page, name


def check_tutorial(site):
    """What was hidden is found, as the cells that the build has run show; their own claims fail the build."""
    notebook = nbformat.read(site.parent / "jupyter_execute" / TUTORIAL.name, as_version=4)
    html = [out.data["text/html"] for out in outputs(notebook) if "text/html" in out.get("data", {})]
    cards = [card for card in html if 'class="accelcal"' in card]
    for title in ("Recording", "Fit of", "Model against", "Diagnosis: an effect is missing", "base, base + "):
        assert any(title in card for card in cards), title
    assert "Diagnosis: no effect is missing" in " ".join(cards)
    assert sum("image/png" in out.get("data", {}) for out in outputs(notebook)) == 3
    printed = next(out.text for out in outputs(notebook) if out.get("text", "").startswith("hidden:"))
    hidden, result = re.findall(r"^(?:hidden|found):\s+(\w+), (\S+)", printed, flags=re.MULTILINE)
    assert hidden[0] == result[0]
    assert float(result[1]) == pytest.approx(float(hidden[1]), rel=0.2)  # 20 sigma or more
    assert any(re.match(r"report\.html: [\d.]+ MB", out.get("text", "")) for out in outputs(notebook))


def check_browser(site, browser):
    page = browser.new_page(viewport={"width": 1280, "height": 900})
    fetched, wrong = [], []
    page.on("request", lambda request: fetched.append(request.url))
    page.on("pageerror", lambda error: wrong.append(str(error)))
    for name in SEEN:
        page.goto((site / f"{name}.html").as_uri())
        width = page.evaluate("document.documentElement.scrollWidth")
        assert width <= 1280, f"{name} is {width} pixels wide"
    assert fetched
    assert [url for url in fetched if not url.startswith(("file:", "data:"))] == []
    assert wrong == []


def test_the_site_is_whole_and_needs_no_network(built, request):
    """One test, because the site is built once; the browser comes last, because it may be absent."""
    for check in (
        check_links,
        check_offline,
        check_pages,
        check_cards,
        check_interface,
        check_commands,
        check_tutorial,
    ):
        check(built)
    check_browser(built, request.getfixturevalue("browser"))


PAGE = '<html><body><h1 id="top">x</h1>{}</body></html>'


@pytest.mark.parametrize(
    "part",
    [
        '<script src="https://example.org/a.js"></script>',
        '<link rel="stylesheet" href="//example.org/a.css">',
        '<img src="http://example.org/a.png">',
        "<style>@import 'https://example.org/a.css';</style>",
        '<p style="background: url(https://example.org/a.png)">x</p>',
    ],
)
def test_what_a_network_would_deliver_is_found(tmp_path, part):
    (tmp_path / "page.html").write_text(PAGE.format(part))
    assert len(list(remote(tmp_path))) == 1


def test_a_link_to_read_is_no_load(tmp_path):
    (tmp_path / "page.html").write_text(PAGE.format('<a href="https://example.org/">x</a><img src="a.png">'))
    assert list(remote(tmp_path)) == []


@pytest.mark.parametrize("address", ["absent.html", "page.html#nowhere", "#nowhere"])
def test_a_link_that_leads_nowhere_is_found(tmp_path, address):
    (tmp_path / "page.html").write_text(PAGE.format(f'<a href="{address}">x</a><a href="page.html#top">y</a>'))
    assert len(list(broken(tmp_path))) == 1


def test_a_warning_stops_the_build(tmp_path):
    (tmp_path / "conf.py").write_text('extensions = ["myst_parser"]\n')
    (tmp_path / "index.md").write_text("# Page\n\n[nowhere](absent.md)\n")
    command = [sys.executable, "-m", "sphinx", "-W", "-q", "-b", "html", tmp_path, tmp_path / "out"]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode != 0
    assert "absent" in done.stderr
