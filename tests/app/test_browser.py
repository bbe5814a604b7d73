"""The whole loop in Chromium: drop, fit, Add, the error falls, undo, reload, a second tab; no request goes out."""

import json
import subprocess
import tomllib
from pathlib import Path
from xml.etree import ElementTree

import pytest

import accelcal as ac
from accelcal import verbs
from accelcal.estimation.estimate import estimate
from tests.commands import accelcal

from .conftest import with_delay
from .test_server import HOST, server  # noqa: F401  (the fixture that runs the workbench)
from .user import area_for_files, require_screen, require_stillness

LONG = 300_000
"""ms; a loaded machine takes its time."""


@pytest.fixture
def tab(browser, server):  # noqa: F811
    """Return a fresh tab on a fresh workbench; everything that it asks for and complains of is kept."""
    context = browser.new_context(viewport={"width": 1280, "height": 900}, accept_downloads=True)
    page = opened(context, server[0])
    yield page
    assert {url.split("/")[2] for url in page.asked} == {f"{HOST}:{server[0]}"}
    assert page.complaints == []
    context.close()


def opened(context, port):
    page = context.new_page()
    page.asked, page.complaints = [], []
    page.on("request", lambda request: page.asked.append(request.url) if "://" in request.url else None)
    page.on("websocket", lambda socket: page.asked.append(socket.url))
    page.on("pageerror", lambda error: page.complaints.append(str(error)))
    page.goto(f"http://{HOST}:{port}/", timeout=LONG)
    page.get_by_text("Drop a recording here").wait_for(timeout=LONG)
    return page


def drop(page, *paths):
    area_for_files(page).set_input_files([str(p) for p in paths])


def load(page, files, name):
    drop(page, files / f"{name}.csv", files / f"{name}.toml")
    page.get_by_role("button", name="Fit the linear model").wait_for(timeout=LONG)


def fit(page):
    page.get_by_role("button", name="Fit the linear model").click()
    page.locator("[data-verdict]").wait_for(timeout=LONG)


def number(page, name):
    return float(page.locator(f"[data-number={name}]").get_attribute("data-value"))


def expected(files, name="cubic"):
    """Errors on the held-out part by the library alone: of the base model by itself, and of it and + cubic."""
    data = ac.load(files / f"{name}.csv")
    end = max(data.accel.t[-1], data.position.t[-1])
    used = data.position.t[0], data.position.t[-1]
    split = round(used[1] - verbs.HELD_OUT * (used[1] - used[0]), 3)
    train, unseen = data.without((split, end)), data.part(split, end)
    base = estimate(ac.Model.linear(), train)
    fits = [base, verbs.add(base, train, "cubic")]
    return [*ac.compare(base, unseen).errors, *ac.compare(fits, unseen).errors]


def test_the_loop_from_drop_to_report(tab, files):
    load(tab, files, "cubic")
    tab.locator(".plot .main-svg").first.wait_for(timeout=LONG)
    fit(tab)
    alone, before, after = expected(files)
    assert number(tab, "error") == alone
    assert tab.locator("[data-verdict]").get_attribute("data-verdict") in ("named", "tied")
    tab.locator(".candidate figcaption", has_text="on held-out data against the effect").wait_for(timeout=LONG)
    tab.get_by_role("button", name="Add cubic", exact=True).click()
    tab.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    assert (number(tab, "before"), number(tab, "error")) == (before, after)
    assert after < before
    assert tab.get_by_text("Detection limits: no missing effect is larger than").is_visible()
    assert tab.get_by_role("button", name="Add", exact=False).count() == 0
    # The previous residual stands behind the new one.
    tab.locator(".plot .main-svg").nth(2).wait_for(timeout=LONG)
    names = tab.evaluate("() => [...document.querySelectorAll('.plot')].flatMap(p => p.data.map(t => t.name))")
    assert names.count("before") == 2
    # Reload keeps the work, undo takes it back.
    tab.reload()
    tab.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    assert number(tab, "error") == after
    tab.get_by_role("button", name="Undo").click()
    tab.get_by_role("button", name="Add cubic", exact=True).wait_for(timeout=LONG)
    assert number(tab, "error") == alone
    tab.get_by_role("button", name="Redo").click()
    tab.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    # Download.
    tab.get_by_role("tab", name="Export").click()
    with tab.expect_download(timeout=LONG) as model:
        tab.get_by_role("button", name="Model (.json)").click()
    content = json.loads(Path(model.value.path()).read_text(encoding="utf-8"))
    assert content["model"]["effects"][-1] == "cubic"
    with tab.expect_download(timeout=LONG) as report:
        tab.get_by_role("button", name="Report (.html)").click()
    assert report.value.suggested_filename == "cubic.html"
    assert "cubic" in Path(report.value.path()).read_text(encoding="utf-8")


def downloaded(page, button, folder):
    with page.expect_download(timeout=LONG) as download:
        page.get_by_role("button", name=button).click()
    path = folder / download.value.suggested_filename
    download.value.save_as(path)
    return path


def test_exports_are_downloaded_and_can_be_used(tab, files, tmp_path):
    load(tab, files, "cubic")
    fit(tab)
    tab.get_by_role("button", name="Add cubic", exact=True).click()
    tab.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    tab.get_by_role("tab", name="Export").click()
    header = downloaded(tab, "For firmware, C (.h)", tmp_path)
    module = downloaded(tab, "For firmware, Rust (.rs)", tmp_path)
    content = json.loads(downloaded(tab, "Calibration (.json)", tmp_path).read_text(encoding="utf-8"))
    certificate = ElementTree.parse(downloaded(tab, "Draft certificate (.xml)", tmp_path)).getroot()
    assert [*content["characteristic"]["coefficients"]] == ["bias", "scale_factor", "cubic"]
    assert certificate.tag == "{https://ptb.de/dcc}digitalCalibrationCertificate"
    assert (header.name, module.name) == ("cubic_sensor.h", "cubic_sensor.rs")
    (tmp_path / "main.c").write_text(f'#include "{header.name}"\nint main(void) {{ return 0; }}\n')
    strict = ["-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror"]
    subprocess.run(["cc", *strict, "main.c", "-o", "main", "-lm"], cwd=tmp_path, check=True, timeout=60)
    crate = ["rustc", "--edition=2021", "--crate-type=lib", "-D", "warnings", "--emit=metadata"]
    subprocess.run([*crate, module.name], cwd=tmp_path, check=True, timeout=60)


def test_nothing_missing_offers_nothing(tab, files):
    # False-alarm rate of a record: alpha = 0.005; the sister is the test above, where the same button is offered.
    load(tab, files, "null")
    fit(tab)
    assert tab.locator("[data-verdict]").get_attribute("data-verdict") == "adequate"
    assert tab.get_by_role("button", name="Add", exact=False).count() == 0
    assert tab.get_by_text("No effect is missing", exact=True).is_visible()


def saved(tab, name, path):
    """What a button saves, as the file `path`."""
    with tab.expect_download(timeout=LONG) as waiting:
        tab.get_by_role("button", name=name).first.dispatch_event("click")  # wherever the page is scrolled to
    waiting.value.save_as(path)
    return path


def test_what_is_declared_is_exported_and_a_second_file_asks_nothing(tab, tmp_path):
    """The walk of a metrologist: declare, fit, take the low-pass that is offered, add, then drop another day's file."""
    drop(tab, with_delay(tmp_path / "one.csv", cutoff=200.0))
    tab.get_by_role("button", name="Fit the linear model").wait_for(timeout=LONG)
    tab.get_by_text("assumptions").click()
    tab.get_by_label("Encoder resolution", exact=True).fill("0.2 um")
    tab.get_by_role("combobox", name="Axis of the stage").click()
    tab.get_by_role("option", name="at an angle", exact=True).click()
    tab.get_by_label("Gravity along the axis", exact=True).fill("0.01 m/s^2")
    tab.get_by_role("button", name="Use these declarations").click()
    tab.get_by_text("4 assumptions").wait_for(timeout=LONG)
    fit(tab)
    tab.get_by_role("button", name="Declare RC 200 Hz").click(timeout=LONG)
    tab.get_by_role("button", name="Declare RC 200 Hz").wait_for(state="detached", timeout=LONG)
    tab.get_by_role("button", name="Add cubic", exact=True).click(timeout=LONG)
    tab.get_by_text("+ cubic: the residual against acceleration goes from").wait_for(timeout=LONG)
    picture = saved(tab, "Save as PNG: + cubic", tmp_path / "step.png").read_bytes()
    assert picture.startswith(b"\x89PNG")
    assert len(picture) > 10_000
    tab.get_by_role("tab", name="Export").click()
    declared = tomllib.loads(saved(tab, "Sidecar (.toml)", tmp_path / "one.toml").read_text())
    assert declared["channels"]["accel"]["lowpass"] == {"kind": "RC", "fc": "200 Hz"}
    assert declared["channels"]["position"]["resolution"] == "0.2 um"
    assert declared["rig"] == {"gravity_along_axis": "0.01 m/s^2"}
    assert 'ac.load("one.csv", "one.toml")' in saved(tab, "Script (.py)", tmp_path / "steps.py").read_text()
    tab.get_by_role("tab", name="Data").click()
    require_screen(tab, "Data")
    drop(tab, with_delay(tmp_path / "two.csv", cutoff=200.0, seed=73))
    tab.get_by_text("two.csv: sensor and rig as declared for one.csv.").wait_for(timeout=LONG)
    assert tab.get_by_role("combobox", name="Use of two.csv").input_value() == "hold out"
    assert tab.get_by_text("Current model: base + cubic.").is_visible()


def test_a_second_tab_is_independent(tab, files, server):  # noqa: F811
    load(tab, files, "cubic")
    second = opened(tab.context, server[0])
    load(second, files, "null")
    fit(second)
    assert tab.get_by_role("button", name="Fit the linear model").inner_text().endswith("Fit")
    assert tab.locator(".file").inner_text() == "cubic.csv"
    assert second.locator(".file").inner_text() == "null.csv"
    assert second.url != tab.url


def test_bad_files_get_the_sentence_of_the_command_line(tab, files):
    for name in ("binary.csv", "bad.csv"):
        done = accelcal("check", name, cwd=files)
        drop(tab, files / name)
        tab.get_by_text(done.stderr.strip().removeprefix("accelcal: ")).first.wait_for(timeout=LONG)


def test_a_screen_that_is_rebuilt_before_the_browser_sends_loses_no_upload(tab, files):
    """The server hears of a new screen first, and of the file that was dropped on the old one a moment later."""
    text = (files / "cubic.csv").read_text()
    tab.evaluate(
        """text => {
            const files = new DataTransfer();
            files.items.add(new File([text], "cubic.csv"));
            const input = document.querySelector("input[type=file]");
            [...document.querySelectorAll("[role=tab]")].find(tab => tab.innerText.includes("Model")).click();
            setTimeout(() => { input.files = files.files; input.dispatchEvent(new Event("change")); }, 5);
        }""",
        text,
    )
    tab.locator(".file", has_text="cubic.csv").wait_for(timeout=LONG)


def test_a_click_on_a_tab_loses_no_upload(tab, files):
    on_their_way = []
    tab.route("**/upload/**", lambda route: on_their_way.append(route))
    with tab.expect_request("**/upload/**", timeout=LONG):
        drop(tab, files / "cubic.csv", files / "cubic.toml")
    tab.get_by_role("tab", name="Model").click()
    require_screen(tab, "Model")
    for request in on_their_way:
        request.continue_()
    tab.locator(".file", has_text="cubic.csv").wait_for(timeout=LONG)


def test_a_stretch_is_chosen_by_brushing(tab, files):
    load(tab, files, "cubic")
    tab.locator(".plot .nsewdrag").first.wait_for(timeout=LONG)
    require_stillness(tab)
    box = tab.locator(".plot .nsewdrag").first.bounding_box()
    y = box["y"] + box["height"] / 2
    tab.mouse.move(box["x"] + 0.25 * box["width"], y)
    tab.mouse.down()
    tab.mouse.move(box["x"] + 0.4 * box["width"], y, steps=8)
    tab.mouse.move(box["x"] + 0.5 * box["width"], y, steps=8)
    tab.mouse.up()
    tab.wait_for_function("() => document.querySelector('[aria-label=\"From, s\"]').value !== ''", timeout=LONG)
    start, end = (float(tab.get_by_label(label).input_value()) for label in ("From, s", "To, s"))
    assert start == pytest.approx(5.0, abs=0.25)  # of 20 s; a pixel is 0.03 s
    assert end == pytest.approx(10.0, abs=0.25)
    tab.get_by_role("button", name="Hold this stretch out").click()
    tab.get_by_text(f"Held out: {start:.6g} s to {end:.6g} s").wait_for(timeout=LONG)


def test_long_work_is_cancelled_and_a_file_that_came_meanwhile_is_read(tab, files):
    load(tab, files, "long")
    tab.get_by_role("button", name="Fit the linear model").click()
    tab.get_by_role("button", name="Cancel").wait_for(timeout=LONG)
    drop(tab, files / "cubic.csv", files / "cubic.toml")
    tab.get_by_text("; then comes cubic.csv, cubic.toml.").wait_for(timeout=LONG)
    assert tab.get_by_role("combobox", name="Use of cubic.csv").count() == 0
    tab.get_by_role("button", name="Cancel").dispatch_event(
        "click", timeout=LONG
    )  # a sentence moves it while work ends
    tab.get_by_role("combobox", name="Use of cubic.csv").wait_for(timeout=LONG)
    tab.locator(".job").wait_for(state="hidden", timeout=LONG)
    fit(tab)
    assert number(tab, "error") > 0.0


def test_the_keyboard_reaches_everything_that_matters(tab, files):
    load(tab, files, "cubic")
    wanted = {"Fit the linear model", "Hold this stretch out", "Exclude this stretch", "Undo"}
    reached = set()
    for _ in range(60):
        tab.keyboard.press("Tab")
        reached.add(
            tab.evaluate(
                "() => { const e = document.activeElement; return e.getAttribute('aria-label') || e.innerText || '' }"
            )
        )
    assert {w for w in wanted if not any(w in r for r in reached)} == set()


def test_an_effect_on_noise_has_a_card_and_is_added(tab, files):
    """Vibration has no mean: what shows is the log score on held-out data, and the verdict that is left."""
    load(tab, files, "shaken")
    fit(tab)
    tab.get_by_role("button", name="Add vibration", exact=True).click()
    tab.locator("[data-verdict=adequate]").wait_for(timeout=LONG)
    assert tab.get_by_text("Held out, vibration: log score of accel +").is_visible()
    tab.get_by_role("tab", name="Model").click()
    tab.get_by_text("vibration: noise of the output from").first.wait_for(timeout=LONG)
    assert tab.get_by_role("button", name="Remove vibration").is_visible()
