"""`accelcal export` as a user meets it."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest

from accelcal.calibration.export import Calibration, calibrate, header, module, read_laboratory
from accelcal.results import json as results_json, model_file
from tests.commands import accelcal

from .models import fit_of

PAGE = Path(__file__).parents[3] / "docs" / "export.md"
VALUES = {"bias": 0.05, "scale_factor": 0.01, "cubic": 1e-5}


@pytest.fixture(scope="module")
def folder(tmp_path_factory):
    path = tmp_path_factory.mktemp("export")
    model_file.save(fit_of(VALUES), path / "m.json")
    model_file.save(fit_of({**VALUES, "hysteresis": 1e-3}), path / "memory.json")
    return path


def test_everything_is_written_from_one_calibration(folder):
    done = accelcal("export", "m.json", "--c", "s.h", "--rust", "s.rs", "--dcc", "d.xml", "--json", cwd=folder)
    assert done.returncode == 0, done.stderr
    calibration = calibrate(model_file.load(folder / "m.json"), source="m.json")
    content = json.loads(done.stdout)
    assert content == results_json.content(calibration)
    assert content["schema"] == "accelcal/export/5"
    assert (folder / "s.h").read_text() == header(calibration, "s.h")
    assert (folder / "s.rs").read_text() == module(calibration)
    assert "d.xml is a draft; missing: certificate.identifier" in done.stderr
    assert not list(folder.glob(".*.part"))


def test_json_holds_every_number_of_the_code_exactly(folder):
    calibration = calibrate(model_file.load(folder / "m.json"))
    content = json.loads(calibration.to_json())
    again = Calibration.from_json(calibration.to_json())
    for key, code, read in (("double", calibration.double, again.double), ("single", calibration.single, again.single)):
        held = content[key]
        assert read == code
        assert [tuple(map(tuple, s["coefficients"])) for s in held["proven"]["inverse"]["segments"]] == [
            s.coefficients for s in code.inverse.segments
        ]
        assert held["bound"] == code.bound
        assert [e["acceleration"] for e in held["vector"]] == [e.acceleration for e in code.vector]
    assert [*content["characteristic"]["coefficients"]] == ["bias", "scale_factor", "cubic"]


def test_what_is_left_out_is_said(folder):
    done = accelcal("export", "m.json", "--c", "t.h", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "not exported: time_offset belongs to timing, not to the sensor" in done.stdout
    assert "note: bias is K0 + g0 tilt + g0 misalignment" in done.stdout
    assert "wrote t.h" in done.stderr


@pytest.mark.parametrize(
    ("arguments", "code", "message"),
    [
        (["m.json"], 2, "nothing to write"),
        (["m.json", "--c", "x.h", "--schema", "dcc.xsd"], 2, "add --dcc draft.xml"),
        (["m.json", "--dcc", "x.pdf"], 2, "--dcc x.pdf: expected a name that ends in .xml"),
        (["m.json", "--c", "x.rs"], 2, "--c x.rs: expected a name that ends in .h or .c"),
        (["m.json", "--dcc", "x.xml", "--schema", "absent.xsd"], 3, "absent.xsd: there is no such file"),
        (["m.json", "--dcc", "x.xml", "--lab", "absent.toml"], 3, "absent.toml: no such file"),
        (["memory.json", "--c", "x.h", "--dcc", "x.xml"], 3, "hysteresis depends on earlier readings"),
        (["absent.json", "--c", "x.h"], 3, "absent.json: no such file"),
        (["m.json", "--filter", "c"], 2, "--filter c (or rust) and --rate 1667 go together"),
        (["m.json", "--rate", "100", "--c", "x.h"], 2, "and with no other form of export"),
        (["m.json", "--filter", "c", "--rate", "100", "-o", "x"], 3, "knows neither the noise of the position"),
        (["m.json", "--c", "x.h", "--without", "creep"], 3, "'creep' is not among what cannot be exported"),
    ],
)
def test_mistakes_end_in_one_sentence_and_write_nothing(folder, arguments, code, message):
    done = accelcal("export", *arguments, cwd=folder)
    assert done.returncode == code, done.stderr
    assert message in " ".join(done.stderr.split())
    assert "Traceback" not in done.stderr
    assert not list(folder.glob("x.*"))


def test_a_memory_is_left_out_knowingly(folder):
    done = accelcal("export", "memory.json", "--c", "y.h", "--without", "hysteresis", cwd=folder)
    assert done.returncode == 0, done.stderr
    assert "not exported: hysteresis depends on earlier readings" in done.stdout
    assert "left out by request" in (folder / "y.h").read_text()


def test_a_missing_extra_is_named(folder):
    (folder / "dcc.xsd").write_text("<x/>")
    script = (
        "import sys; sys.modules['xmlschema'] = None; sys.argv = ['accelcal', 'export', 'm.json', '--dcc', 'z.xml', "
        "'--schema', 'dcc.xsd']; from accelcal.cli import main; main()"
    )
    done = subprocess.run([sys.executable, "-c", script], cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 3
    assert 'pip install "accelcal[dcc]"' in done.stderr
    assert not (folder / "z.xml").exists()


def blocks(language):
    return re.findall(rf"^```{language}\n(.*?)^```", PAGE.read_text(), flags=re.M | re.S)


@pytest.mark.outside
def test_the_examples_of_the_page_run(tmp_path):
    for line in "".join(blocks("sh")).splitlines():
        if line.startswith("accelcal"):
            done = accelcal(*shlex.split(line)[1:], cwd=tmp_path)
        else:
            done = subprocess.run(line, shell=True, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, f"{line}: {done.stderr}"
    begun = "tracker_filter f; int named; tracker_init(&f, 0.0f);"
    variables = ("double volts = 0.0;", "float position = 0.0f, output = 0.0f, k;", begun)
    for code, declared in zip(blocks("c"), variables, strict=True):
        include, body = code.split("\n\n")
        (tmp_path / "main.c").write_text(f"{include}\nint main(void)\n{{\n{declared}\n{body}\nreturn 0;\n}}\n")
        command = ["cc", "-std=c99", "main.c", "-L.", "-ltracker", "-o", "main"]
        subprocess.run(command, cwd=tmp_path, check=True, timeout=60)
    (tmp_path / "lab.toml").write_text(*blocks("toml"))
    assert read_laboratory(tmp_path / "lab.toml").missing == ()


def test_help_has_an_example(folder):
    done = accelcal("export", "-h", cwd=folder)
    assert done.returncode == 0
    assert "accelcal export m.json --c sensor.h" in " ".join(done.stdout.replace("│", " ").split())
