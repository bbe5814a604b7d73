"""The exported live filter: the estimates of `LiveModel`, equal bits on a device, its cost, builds, refusals."""

from __future__ import annotations

import ctypes
import dataclasses
import os
import shutil
import subprocess
from collections.abc import Callable
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from accelcal._support.errors import AccelcalError
from accelcal.calibration.export import calibrate, filter as export, header
from accelcal.calibration.export.calibration import NotExportable
from accelcal.calibration.export.filter import filter_files, program, replayed, with_held_as_states
from accelcal.calibration.export.symbols import FORMATS
from accelcal.data.rig import Rig, Sensor
from accelcal.effects import BUILT_IN
from accelcal.effects.own import from_expression
from accelcal.filters.live_model import LiveModel
from accelcal.live.tracker import running
from accelcal.model import Model, Prior
from accelcal.signals.signals import Origins
from accelcal.simulation.sensor import CXL02_RIG
from tests.firmware import build

from .device import STRICT, compiled, estimates_after, on_device, on_host, run, write
from .models import fit_of

PROCESS = {"start": 0.0, "length": 10.0}
LOW_PASS = dataclasses.replace(CXL02_RIG, resolution=None)
LONG, CHECKS = 3000, (2, 3, 10, 100, 1000, 2000, 3000)
"""Samples over which estimates are compared, and those after which they are."""


def with_process(name: str, std: float, **shape: float) -> Model:
    model = Model.linear().add(name, shapes={name: PROCESS | shape})
    priors = {term.name: Prior(0.0, std) for term in model.terms if term.effect.name == name}
    return Model(model.effects, shapes=model.shapes, priors=priors)


def with_effects(*names: str, **shapes: dict[str, float]) -> Model:
    return Model.linear().add(*names, shapes=shapes)


LEVEL = Rig()
MODELS: dict[str, tuple[Model, Rig]] = {
    "linear": (Model.linear(), LEVEL),
    "three effects": (with_effects("quadratic", "velocity"), LEVEL),  # the time offset is the third
    "cubic, no delay": (Model.cubic().freeze(time_offset=1e-5), LEVEL),
    "corners, upright and reversed": (with_effects("coulomb", "scale_asymmetry"), Rig(axis="up", mount="reversed")),
    "low-pass": (with_effects("quadratic"), LOW_PASS),
    "mechanism": (with_effects("self_heating", self_heating={"tau": 2.0, "start": 0.0}), LEVEL),
    "mechanism of the scale factor": (
        with_effects("scale_factor_follows_abs_v", scale_factor_follows_abs_v={"tau": 1.0, "start": 0.0}),
        LEVEL,
    ),
    "memory": (with_effects("ac_coupling", "creep", ac_coupling={"tau": 2.0}, creep={"tau": 0.5, "start": 0.0}), LEVEL),
    "temperature": (with_effects("temperature_bias", "temperature_scale"), LEVEL),
    "process": (with_process("bias_gauss_markov", 1e-3, tau=3.0), LEVEL),
    "walk of the scale factor": (with_process("scale_random_walk", 1e-4), LEVEL),
    "encoder": (with_effects("encoder_cyclic", encoder_cyclic={"period": 0.02, "harmonics": 1.0}), LEVEL),
    "time and position": (
        with_effects(
            "tone", "shape_of_position", tone={"frequency": 50.0}, shape_of_position={"low": -0.1, "high": 0.1}
        ),
        LEVEL,
    ),
}


def filter_of(model: Model, rig: Rig = LEVEL, *, rate: float = 1667.0, **others: Any) -> LiveModel:
    origins, covariance = Origins(t=0.1, temperature=20.0), np.array([[1e-4, 2e-4], [2e-4, 1e-2]])
    given = {"rate": rate, "q": 1e-8, "r_position": 1e-12, "position": 0.0, **others}
    return LiveModel(with_held_as_states(model), rig, origins=origins, covariance=covariance, **given)


def distances(folder, live: Callable[[], LiveModel], precision: str, checks=CHECKS) -> tuple[float, float]:
    """Largest distance of estimates and of standard deviations from the live filter's, in the latter."""
    program_of, fmt = program(live(), precision), FORMATS[precision]
    replay = replayed(program_of)
    library = compiled(folder, len(program_of.free), replay.arguments.shape[1], fmt.c)
    rows = replay.arguments.astype(np.float32 if precision == "f32" else np.float64)
    result = estimates_after(library, rows, checks, len(program_of.free))
    spread = np.abs(np.sqrt(result[:, 1]) / replay.std - 1.0)
    return float(np.max(np.abs(result[:, 0] - replay.values) / replay.std)), float(np.max(spread))


@pytest.mark.outside
@pytest.mark.parametrize("name", MODELS)
def test_estimates_are_those_of_the_live_filter(tmp_path, monkeypatch, name):
    model, rig = MODELS[name]
    for precision, most in (("f64", 1e-9), ("f32", 0.1)):
        for file, text in filter_files(filter_of(model, rig), "cal", "c", precision).items():
            (tmp_path / file).write_text(text)
        with monkeypatch.context() as patch:
            patch.setattr(export, "RECORD", LONG)
            patch.setattr(export, "CHECKS", CHECKS)
            off, spread = distances(tmp_path, lambda: filter_of(model, rig), precision)
        print(f"{name}, {precision}: off by {off:.2g} std, std by {spread:.2g} (at most {most:g})")
        assert off <= most
        assert spread <= most
        run(["cc", *STRICT, "cal.c", "cal_replay.c", "-o", "replay"], tmp_path)
        assert run(["./replay"], tmp_path).startswith("0 of ")


AN_HOUR = """
#include <math.h>
#include <stdio.h>
#include "single.h"
#include "twofold.h"

static uint32_t random = 0x12345678u;

static double noise(void)
{
    random ^= random << 13;
    random ^= random >> 17;
    random ^= random << 5;
    return (double)random / 1239850262.0 - 1.7320508;
}

int main(void)
{
    const double c = cos(3e-3), s = sin(3e-3);
    double x = 1.0, y = 0.0, most = 0.0;
    uint32_t i, j;
    single_filter f;
    twofold_filter g;
    single_init(&f, 0.0f);
    twofold_init(&g, 0.0);
    for (i = 1u; i <= 36000000u; ++i) {
        const double before = x;
        double u, z;
        x = c * x - s * y;
        y = s * before + c * y;
        u = 0.02 + 8.0 * x + 1e-2 * noise();
        z = i % 10u ? (double)NAN : (1.0 - x) * 8.0 / 900.0 + 1e-6 * noise();
        (void)single_step(&f, (float)u, (float)z);
        (void)twofold_step(&g, u, z);
    }
    for (j = 0u; j < TWOFOLD_PARAMETERS; ++j) {
        const double off = (double)single_estimate(&f, j) - twofold_estimate(&g, j);
        most = fmax(most, fabs(off) / sqrt(twofold_variance(&g, j)));
    }
    printf("%.3f", most);
    return 0;
}
"""


@pytest.mark.outside
def test_single_precision_follows_double_over_an_hour_at_ten_kilohertz(tmp_path):
    for name, precision in (("single", "f32"), ("twofold", "f64")):
        for file, text in filter_files(filter_of(Model.linear(), rate=1e4), name, "c", precision).items():
            (tmp_path / file).write_text(text)
    (tmp_path / "main.c").write_text(AN_HOUR)
    run(["cc", *STRICT, "main.c", "single.c", "twofold.c", "-lm", "-o", "hour"], tmp_path)
    off = float(run(["./hour"], tmp_path))
    print(f"off by {off} std (at most 0.3)")
    assert off <= 0.3


@pytest.mark.outside
def test_another_number_is_found_by_the_replay(tmp_path):
    # The twin that must fail: a prior mean that is off by a standard deviation.
    files = filter_files(filter_of(Model.linear()), "cal", "c", "f64")
    files["cal.c"] = files["cal.c"].replace("f->theta[0] = 0.0;", "f->D[0] = 1e-6;\n    f->theta[0] = 0.01;")
    for file, text in files.items():
        (tmp_path / file).write_text(text)
    run(["cc", *STRICT, "cal.c", "cal_replay.c", "-o", "replay"], tmp_path)
    done = subprocess.run(["./replay"], cwd=tmp_path, capture_output=True, text=True)
    assert done.returncode == 1
    assert not done.stdout.startswith("0 of ")


@pytest.mark.outside
def test_without_the_correction_for_noise_of_the_output_the_estimates_are_others(tmp_path, monkeypatch):
    # The twin that must fail: correction at no reading at all.
    monkeypatch.setattr(export, "EVERY", 10**6)
    for file, text in filter_files(filter_of(Model.linear()), "cal", "c", "f64").items():
        (tmp_path / file).write_text(text)
    assert max(distances(tmp_path, lambda: filter_of(Model.linear()), "f64", export.CHECKS)) > 1e-9


@pytest.mark.parametrize("language", ["c", "rust"])
def test_the_top_of_a_file_states_signs_units_states_and_cost(language):
    rig = Rig(Sensor(scale=0.04, scale_unit="V", zero=2.5), axis="up", mount="reversed")
    files = filter_files(filter_of(with_effects("temperature_bias"), rig), "3 axis", language, "f32", "m.json")
    assert list(files) == (
        ["sensor_3_axis.rs", "sensor_3_axis_replay.rs"]
        if language == "rust"
        else ["sensor_3_axis.h", "sensor_3_axis.c", "sensor_3_axis_replay.c"]
    )
    assert language == "rust" or "__FINITE_MATH_ONLY__" in files["sensor_3_axis.c"]  # else NaN would be taken in
    text = " ".join(next(iter(files.values())).replace("\n//!", " ").replace("\n *", " ").split())
    for words in (
        "Live filter of m.json",
        "1667 outputs a second, in f32",
        "= -(acceleration of the stage + 9.80665 m/s^2)",
        "has k, K2 and K3 of the other sign to first order; this filter is not of that form",
        "the output (m/s^2, by the declared scale (V - 2.5) / 0.04)",
        "temperature (degC; parameters refer to 20)",
        "3 temperature_bias (m/s^2/K), prior 0 with standard deviation",
        "density of the output 1e-08 (m/s^2)^2/Hz, two-sided; variance of a reading 1e-12 m^2",
        "less than 0.0012 m/s^2 rms of acceleration",  # root of 2e-8 x 10.2 Hz / 0.15
        "arithmetic operations a step",
        "with every 16th",
        "bytes of state",
        "Behind a gap of more than 8 samples call resume",
        "-ffp-contract=off",
        "As a static library",
    ):
        assert words in text, words


def require(*tools: str) -> None:
    """Skip, or fail where a machine must have all tools of a device."""
    absent = [tool for tool in tools if shutil.which(tool) is None]
    lacking = build.lacking_for_the_device() if "arm-none-eabi-gcc" in tools else None
    if absent or lacking:
        reason = lacking or f"{', '.join(absent)} not installed: apt-get install {' '.join(absent)}"
        (pytest.fail if os.environ.get("ACCELCAL_REQUIRE_EMBEDDED") == "1" else pytest.skip)(reason)


@pytest.mark.outside
@pytest.mark.parametrize("name", MODELS)
def test_a_device_gives_the_bits_of_the_host(tmp_path, name):
    require("arm-none-eabi-gcc")
    model, rig = MODELS[name]
    write(tmp_path, lambda: filter_of(model, rig))
    host = on_host(tmp_path)
    reports = {language: on_device(tmp_path, language) for language in ("c", "rust")}
    for language, report in reports.items():
        print(
            f"{name}, {language}: at most {report.without:.0f} instructions a step, {report.with_reading:.0f} with a "
            f"reading and the correction, {report.mean:.0f} in the mean"
        )
        assert (report.digest, report.refused) == (host.digest, 0)
        assert 0.0 < report.without < report.with_reading
    if name == "three effects":
        assert reports["c"].mean <= 600.0


@pytest.mark.outside
def test_fused_multiplications_change_the_bits(tmp_path):
    # The twin that must fail: what the recipe switches off.
    write(tmp_path, lambda: filter_of(Model.linear()))
    if " fma " not in Path("/proc/cpuinfo").read_text():
        pytest.skip("this processor does not fuse")
    assert on_host(tmp_path, "-ffp-contract=fast", "-mfma").digest != on_host(tmp_path).digest


WATCHED: dict[str, tuple[str, tuple[str, ...]]] = {
    "linear": ("linear", ("cubic", "quadratic")),
    "three effects": ("three effects", ("cubic", "scale_asymmetry", "coulomb", "odd_quadratic")),
    "low-pass": ("low-pass", ("velocity", "bias_step")),
    "reversed": ("corners, upright and reversed", ("quadratic",)),
    "process": ("process", ("cubic",)),
}
"""Models and suspects."""
SLOW = 100.0
"""Outputs a second, Hz, at which a record of 3000 samples has several starts."""


def watched(name: str, rate: float = SLOW) -> LiveModel:
    model, suspects = WATCHED[name]
    return filter_of(*MODELS[model], rate=rate, watch=suspects)


@pytest.mark.outside
@pytest.mark.parametrize("name", WATCHED)
def test_the_watch_is_that_of_the_live_filter(tmp_path, monkeypatch, name):
    # Through the replay: f64 within 1e-6 of a standard deviation, f32 within 0.1, log_e within that or 2 % in f32.
    monkeypatch.setattr(export, "RECORD", LONG)
    monkeypatch.setattr(export, "CHECKS", (100, 1000, 1500, 2500, 2999))
    for precision in ("f64", "f32"):
        for language in ("c", "rust") if name == "linear" else ("c",):
            for file, text in filter_files(watched(name), "cal", language, precision).items():
                (tmp_path / file).write_text(text)
            recipe = ["cc", *STRICT, "cal.c", "cal_replay.c"]
            recipe = recipe if language == "c" else ["rustc", "--edition", "2021", "-D", "warnings", "cal_replay.rs"]
            run([*recipe, "-o", "replay"], tmp_path)
            assert run(["./replay"], tmp_path).startswith("0 of ")
    # The twin that must fail: a watch that begins anew at other times.
    changed = (tmp_path / "cal.c").read_text().replace("% 1000u", "% 700u")
    (tmp_path / "cal.c").write_text(changed)
    run(["cc", *STRICT, "cal.c", "cal_replay.c", "-o", "replay"], tmp_path)
    assert subprocess.run(["./replay"], cwd=tmp_path, capture_output=True, check=False).returncode == 1


@pytest.mark.outside
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_a_cubic_of_ten_standard_deviations_is_named_and_an_honest_record_names_nothing(
    tmp_path, monkeypatch, precision
):
    # An honest record names anything with a probability of 0.005 at most.
    monkeypatch.setattr(export, "RECORD", LONG)
    for file, text in filter_files(watched("linear"), "cal", "c", precision).items():
        (tmp_path / file).write_text(text)
    library = compiled(tmp_path, 3, 2, FORMATS[precision].c, watch=True)
    honest = watched("linear")
    rows = replayed(program(honest, precision)).arguments
    std = 1.0 / np.sqrt(honest._filter.evidence[0, -1])
    planted = filter_of(Model.linear().add("cubic").freeze(cubic=10.0 * std), rate=SLOW)
    answers = []
    for record in (rows, replayed(program(planted, precision)).arguments):
        record = np.ascontiguousarray(record.astype(np.float32 if precision == "f32" else np.float64))
        library.begin()
        library.rows(record.ctypes.data_as(ctypes.c_void_p), len(record))
        y = np.zeros(4, record.dtype)
        assert library.watch(0, y.ctypes.data_as(ctypes.c_void_p)) == 0
        assert library.watch(2, y.ctypes.data_as(ctypes.c_void_p)) == 1
        answers.append((library.named(), y.astype(np.float64)))
        print(f"{precision}: named {answers[-1][0]}, log_e {y[0]:.3g}, size {y[1] / std:.3g} std, {y[3]:.3g} s")
    assert [named for named, _ in answers] == [-1, 0]
    assert answers[1][1][1] == pytest.approx(10.0 * std, abs=4.0 * std)


@pytest.mark.outside
def test_a_watch_on_a_device_has_the_bits_of_the_host_and_a_known_cost(tmp_path):
    require("arm-none-eabi-gcc")
    model, suspects = Model.linear().add("velocity"), ("cubic", "quadratic", "coulomb", "scale_asymmetry")
    means: dict[tuple[str, int], float] = {}
    for count in (0, 1, 4):
        write(tmp_path, partial(filter_of, model, watch=suspects[:count]))
        host = on_host(tmp_path)
        for language in ("c", "rust"):
            report = on_device(tmp_path, language)
            assert (report.digest, report.refused) == (host.digest, 0)
            means[language, count] = report.mean
            print(
                f"{language}, {count} suspects: {report.without:.0f} instructions a step without a reading, "
                f"{report.with_reading:.0f} at most, {report.mean:.0f} in the mean"
            )
    for language in ("c", "rust"):
        a_suspect = (means[language, 4] - means[language, 1]) / 3.0
        whitening = means[language, 1] - means[language, 0] - a_suspect
        print(f"{language}: a suspect {a_suspect:.0f} instructions a step, whitening {whitening:.0f}")
        assert a_suspect <= 400.0
        assert whitening <= 400.0


def test_what_cannot_be_watched_is_refused_by_name():
    for name, message in (
        ("cubic_jerk_that_is_none", "cubic_jerk_that_is_none"),
        ("noise", "noise"),
        ("quadratic", "quadratic cannot be watched: the model has it already"),
        ("hysteresis", "hysteresis cannot be watched: it has shape parameters"),
    ):
        with pytest.raises(AccelcalError, match=message):
            filter_of(with_effects("quadratic"), watch=(name,))


@pytest.mark.parametrize("name", ["stdint", "self", "Loop"])
def test_a_name_that_a_language_has_for_itself_is_made_longer(name):
    for language in ("c", "rust"):
        for file in filter_files(filter_of(Model.linear()), name, language, "f32"):
            assert file.startswith(f"sensor_{name.lower()}")


@pytest.mark.outside
def test_filter_and_calibration_of_one_name_go_into_one_program(tmp_path):
    (tmp_path / "static.h").write_text(header(calibrate(fit_of({"bias": 0.1})), "cal.h"))
    for file, text in filter_files(filter_of(Model.linear()), "cal", "c", "f32").items():
        (tmp_path / file).write_text(text)
    (tmp_path / "main.c").write_text("""
#include "static.h"
#include "cal.h"
int main(void)
{
    cal_filter f;
    double a;
    cal_init(&f, 0.0f);
    return cal_acceleration(2.5, &a) != 0u || cal_step(&f, (float)a, 0.0f);
}
""")
    run(["cc", *STRICT, "main.c", "cal.c", "-o", "both"], tmp_path)
    run(["./both"], tmp_path)


GAP_IN_RUST = """
mod cal;
fn main() {
    let mut filter = cal::Filter::new(0.0);
    assert!(filter.step(0.1, 0.0).is_ok());
    let before = filter;
    for position in [KIND::NAN, KIND::INFINITY, KIND::NEG_INFINITY] {
        assert_eq!(filter.resume(position, 10), Err(cal::Refused));
        assert_eq!(filter, before);
    }
    assert_eq!(filter.resume(0.5, 10), Ok(()));
    assert_eq!((filter.n, filter.earlier, filter.missing), (0, 1, 10));
    filter.n = u32::MAX;
    assert_eq!(filter.resume(0.5, u32::MAX), Ok(()));
    assert_eq!((filter.n, filter.earlier, filter.missing), (0, u32::MAX, u32::MAX));
    let mut fresh = cal::Filter::new(0.5);
    assert_eq!(fresh.resume(0.0, 10), Ok(()));
    assert_eq!((fresh, fresh.missing), (cal::Filter::new(0.0), 0));
    assert!(fresh.is_finite());
    fresh.D[1] = KIND::NAN;
    assert!(!fresh.is_finite());
}
"""


@pytest.mark.outside
@pytest.mark.parametrize("precision", ["f32", "f64"])
def test_rust_builds_without_a_warning_and_replays(tmp_path, precision):
    model, rig = MODELS["low-pass"]
    for file, text in filter_files(filter_of(model, rig), "cal", "rust", precision).items():
        (tmp_path / file).write_text(text)
    run(["rustc", "--edition", "2021", "-D", "warnings", "-O", "cal_replay.rs", "-o", "replay"], tmp_path)
    assert run(["./replay"], tmp_path).startswith("0 of ")
    (tmp_path / "gap.rs").write_text(GAP_IN_RUST.replace("KIND", precision))
    run(["rustc", "--edition", "2021", "-D", "warnings", "gap.rs"], tmp_path)
    run(["./gap"], tmp_path)
    (tmp_path / "lib.rs").write_text("#![no_std]\npub mod cal;\n")
    command = ["--edition", "2021", "--crate-type", "lib", "-D", "warnings", "--emit", "metadata", "lib.rs"]
    run(["rustc", *command], tmp_path)
    if shutil.which("clippy-driver"):
        run(["clippy-driver", *command], tmp_path)


@pytest.mark.outside
def test_cppcheck_has_nothing_to_say(tmp_path):
    require("cppcheck")
    for name in ("corners, upright and reversed", "process", "temperature"):
        for file, text in filter_files(filter_of(*MODELS[name]), "cal", "c", "f32").items():
            (tmp_path / file).write_text(text)
        options = ["--enable=warning,style,performance,portability", "--std=c99", "--error-exitcode=1", "--quiet"]
        run(["cppcheck", *options, "--suppress=missingIncludeSystem", "cal.c", "cal_replay.c"], tmp_path)


@pytest.mark.outside
def test_a_reading_or_an_output_that_is_none_changes_nothing(tmp_path):
    for file, text in filter_files(filter_of(Model.linear()), "cal", "c", "f64").items():
        (tmp_path / file).write_text(text)
    library = compiled(tmp_path, 3, 2, "double")
    rows = np.column_stack([np.sin(np.arange(50.0)), 1e-3 * np.cos(np.arange(50.0))])
    plain = estimates_after(library, rows, (50,), 3)
    for output in (np.nan, np.inf, -np.inf):
        library.begin()
        more = np.insert(rows, 20, [output, 0.0], axis=0)
        assert library.rows(more.ctypes.data_as(ctypes.c_void_p), 51) == 1
        y = np.zeros((2, 3))
        library.estimates(y.ctypes.data_as(ctypes.c_void_p))
        assert np.array_equal(y, plain[0])
    for position in (np.nan, np.inf, -np.inf):  # behind a gap as well
        library.begin()
        library.rows(rows.ctypes.data_as(ctypes.c_void_p), 20)
        assert library.resume(ctypes.c_double(position), ctypes.c_uint32(100)) == 1
        library.rows(rows[20:].ctypes.data_as(ctypes.c_void_p), 30)
        library.estimates(y.ctypes.data_as(ctypes.c_void_p))
        assert np.array_equal(y, plain[0])
    gap = rows.copy()
    gap[10, 1] = np.inf
    absent = rows.copy()
    absent[10, 1] = np.nan
    assert np.array_equal(estimates_after(library, gap, (50,), 3), estimates_after(library, absent, (50,), 3))


@pytest.mark.outside
@pytest.mark.parametrize("column", [0, 1], ids=["output", "position"])
def test_a_filter_that_an_absurd_number_has_broken_says_so(tmp_path, column):
    for file, text in filter_files(filter_of(with_effects("cubic")), "cal", "c", "f32").items():
        (tmp_path / file).write_text(text)
    library = compiled(tmp_path, 3, 2, "float")
    rows = np.zeros((50, 2), np.float32)
    for value, finite in ((1e-6, 1), (1e20, 0)):
        rows[20, column] = value
        library.begin()
        assert library.rows(rows.ctypes.data_as(ctypes.c_void_p), 50) == 0  # no argument was refused
        assert library.finite() == finite
    library.begin()
    assert library.finite() == 1


@pytest.mark.outside
def test_a_broken_filter_answers_without_undefined_behaviour(tmp_path):
    for file, text in filter_files(filter_of(Model.linear(), watch=("cubic",)), "cal", "c", "f32").items():
        (tmp_path / file).write_text(text)
    (tmp_path / "main.c").write_text("""
#include "cal.h"
int main(void)
{
    cal_filter f;
    float log_e = 0.0f, size, std, since;
    int i;
    cal_init(&f, 0.0f);
    for (i = 0; i < 50; ++i) {
        (void)cal_step(&f, i == 20 ? 1e20f : 1.0f, 0.0f);
    }
    (void)cal_watch(&f, 0u, &log_e, &size, &std, &since);
    return cal_finite(&f) || log_e == log_e || cal_named(&f) != -1; /* not a number, and none is named */
}
""")
    undefined = ("-fsanitize=undefined,float-cast-overflow", "-fno-sanitize-recover")
    run(["cc", *STRICT, *undefined, "main.c", "cal.c", "-o", "broken"], tmp_path)
    run(["./broken"], tmp_path)


@pytest.mark.outside
@pytest.mark.parametrize("watch", [(), ("cubic",)], ids=["alone", "watch"])
def test_counts_of_samples_end_at_the_largest_and_begin_with_the_first(tmp_path, watch):
    # With counts that wrapped to zero, the sample behind the next gap would be taken for the first of all.
    for file, text in filter_files(filter_of(Model.linear(), watch=watch), "cal", "c", "f64").items():
        (tmp_path / file).write_text(text)
    library, most = compiled(tmp_path, 3, 2, "double", watch=bool(watch)), 2**32 - 1
    library.counts.restype = ctypes.POINTER(ctypes.c_uint32 * 4)
    row, since, places = np.array([[0.1, 0.0]]), np.zeros(4), (0, 2, 3)

    def counts() -> list[int]:
        return [library.counts().contents[j] for j in places]

    library.begin()
    assert library.resume(ctypes.c_double(0.0), ctypes.c_uint32(100)) == 0
    assert counts() == [0, 0, 0]
    library.rows(row.ctypes.data_as(ctypes.c_void_p), 1)
    assert library.resume(ctypes.c_double(0.0), ctypes.c_uint32(100)) == 0
    assert counts() == [0, 1, 100]
    library.counts().contents[0] = most
    assert library.resume(ctypes.c_double(0.0), ctypes.c_uint32(most)) == 0
    assert counts() == [0, most, most]
    library.rows(row.ctypes.data_as(ctypes.c_void_p), 1)
    assert counts() == [1, most, most]
    if watch:
        assert library.watch(0, since.ctypes.data_as(ctypes.c_void_p)) == 0
        assert since[3] == pytest.approx(most / 1667.0)


SHAPES = {"start": 0.0, "length": 30.0, "low": -0.1, "high": 0.1, "tau": 5.0, "instant": 0.1, "period": 0.02}
SHAPES |= {"width": 0.05, "level": 20.0, "centre": 0.0, "ripple": 0.0, "frequency": 20.0, "harmonics": 1.0}


@pytest.mark.parametrize(
    "effect", [e for e in BUILT_IN if e.port != "noise" and e.name not in Model.linear().effects], ids=lambda e: e.name
)
def test_every_effect_that_the_page_lists_can_be_traced(effect):
    answer = running(effect, "export")
    shape = {name: SHAPES[name] for name in effect.shapes}
    model = (
        with_process(effect.name, 1e-3, **shape)
        if effect.port == "process"
        else with_effects(effect.name, **({effect.name: shape} if shape else {}))
    )
    if answer.how == "refused":
        with pytest.raises(NotExportable, match=f"^{effect.name} "):
            program(filter_of(model), "f32")
        return
    traced = program(filter_of(model), "f32")
    assert len(traced.names) > 3


@pytest.mark.outside
@pytest.mark.parametrize("name", ["parameters", "h"])  # names that the header has for itself
def test_a_formula_is_exported_whatever_its_name(tmp_path, name):
    from_expression(name, "v*abs(v) + 0.1*tanh(v/0.1)")
    for file, text in filter_files(filter_of(with_effects(name)), "cal", "c", "f64").items():
        (tmp_path / file).write_text(text)
    run(["cc", *STRICT, "cal.c", "cal_replay.c", "-o", "replay"], tmp_path)
    assert run(["./replay"], tmp_path).startswith("0 of ")


def test_what_cannot_be_traced_is_refused_by_name(monkeypatch):
    for function, message in (
        (lambda s: s.v if s.v[0] > 0.0 else -s.v, "decides by a value that only the running program knows"),
        (lambda s: np.log(s.v), "uses log, which exported code does not have"),
        (lambda s: s.v**2.5, "uses a power that is no small whole number"),
    ):
        live = filter_of(with_effects("quadratic", "velocity"))
        other = dataclasses.replace(live._parts[-1].effect)
        object.__setattr__(other, "function", function)  # as one of accelcal, which nothing guards
        live._parts = [*live._parts[:-1], dataclasses.replace(live._parts[-1], effect=other)]
        with pytest.raises(NotExportable, match=f"^velocity {message}"):
            program(live, "f32")


@pytest.mark.parametrize(("settings", "message"), [({"order": 2}, "first order"), ({"q": 0.0}, "noise of output")])
def test_a_setting_that_a_device_has_not_is_refused(settings, message):
    given = {"rate": 100.0, "q": 1e-8, "r_position": 1e-12, "position": 0.0} | settings
    with pytest.raises(NotExportable, match=message):
        program(LiveModel(Model.linear(), LEVEL, **given), "f32")


BEFORE, MISSED = 1000, 400
GAPS = ("three effects", "low-pass", "corners, upright and reversed", "mechanism", "process", "time and position")


@dataclasses.dataclass
class Gap:
    """A filter of a library, and a record in whose middle samples are missing."""

    library: ctypes.CDLL
    rows: np.ndarray
    parameters: int

    def device(self, missed: int = MISSED, last: int = LONG) -> np.ndarray:
        """Estimates and variances after a last row, (2, m), where the filter is told of that many missing samples."""
        after, rows, y = BEFORE + MISSED, self.rows, np.zeros((2, self.parameters), self.rows.dtype)
        number = ctypes.c_float if rows.dtype == np.float32 else ctypes.c_double
        self.library.begin()
        self.library.rows(rows.ctypes.data_as(ctypes.c_void_p), BEFORE)
        assert self.library.resume(number(rows[after, 1]), ctypes.c_uint32(missed)) == 0
        self.library.rows(rows[after:].ctypes.data_as(ctypes.c_void_p), last - after)
        self.library.estimates(y.ctypes.data_as(ctypes.c_void_p))
        return y.astype(np.float64)

    def live(self, live: LiveModel, missed: int = MISSED) -> None:
        """The same with the live filter of the model."""
        after = BEFORE + MISSED
        live.run(*self.rows[:BEFORE].T)
        live.restart(self.rows[after, 1], 0.0, live.settings["dt"] * (BEFORE + missed))
        live.run(*self.rows[after:].T)


def gap_of(folder: Path, monkeypatch: pytest.MonkeyPatch, live: Callable[[], LiveModel]) -> Gap:
    """Of a filter in double precision."""
    monkeypatch.setattr(export, "RECORD", LONG)
    monkeypatch.setattr(export, "CHECKS", (LONG,))
    for file, text in filter_files(live(), "cal", "c", "f64").items():
        (folder / file).write_text(text)
    plan = program(live(), "f64")
    rows = np.ascontiguousarray(replayed(plan).arguments)
    library = compiled(folder, len(plan.free), rows.shape[1], "double", watch=bool(plan.suspects))
    return Gap(library, rows, len(plan.free))


@pytest.mark.outside
def test_the_gate_leaves_outliers_out_as_that_of_the_live_filter(tmp_path, monkeypatch):
    gate, places = 25.0, np.arange(400, LONG, 500)
    estimates = []
    for name, live in (
        ("gated", lambda: filter_of(Model.linear(), gate=gate)),
        ("open", lambda: filter_of(Model.linear())),
    ):
        (tmp_path / name).mkdir()
        gap = gap_of(tmp_path / name, monkeypatch, live)
        clean, read = gap.rows[:, 1].copy(), places[np.isfinite(gap.rows[places, 1])]
        gap.rows[read, 1] += 1e-3
        twin, without = live(), live()
        twin.run(*gap.rows.T)
        without.run(gap.rows[:, 0], np.where(np.isin(np.arange(LONG), read), np.nan, clean))
        std = np.sqrt(np.diag(twin.covariance))
        values = estimates_after(gap.library, gap.rows, (LONG,), gap.parameters)[0, 0]
        assert len(read) > 2
        assert np.max(np.abs(values - twin.values) / std) < 1e-9
        estimates.append(float(np.max(np.abs(values - without.values) / std)))
    assert estimates[0] < 1e-9  # as if they had not been read
    assert estimates[1] > 5.0  # the twin that must fail: without a gate
    for file, text in filter_files(filter_of(Model.linear(), gate=gate), "cal", "rust", "f64").items():
        (tmp_path / file).write_text(text)
    run(["rustc", "--edition", "2021", "-O", "cal_replay.rs", "-o", "replay"], tmp_path)
    assert run(["./replay"], tmp_path).startswith("0 of ")


@pytest.mark.outside
@pytest.mark.parametrize("name", GAPS)
def test_behind_a_gap_the_estimates_are_those_of_the_live_filter(tmp_path, monkeypatch, name):
    gap, live = gap_of(tmp_path, monkeypatch, lambda: filter_of(*MODELS[name])), filter_of(*MODELS[name])
    gap.live(live)
    free = list(program(filter_of(*MODELS[name]), "f64").free)
    values, variances = live.values[free], np.diag(live.covariance)[free]

    def off(y: np.ndarray) -> float:
        return float(np.max(np.abs(y[0] - values) / np.sqrt(variances) + np.abs(y[1] / variances - 1.0)))

    assert off(gap.device()) <= 1e-8
    if name in ("process", "time and position"):  # the twin that must fail: a gap that takes no time
        assert off(gap.device(missed=0)) > 1e-3


def with_two_processes() -> LiveModel:
    """A bias that forgets within seconds and a scale factor that walks."""
    shapes = {"bias_gauss_markov": PROCESS | {"tau": 3.0}, "scale_random_walk": PROCESS}
    model = Model.linear().add(*shapes, shapes=shapes)
    std = {"bias_gauss_markov": 1e-3, "scale_random_walk": 1e-6}
    priors = {term.name: Prior(0.0, std[term.effect.name]) for term in model.terms if term.effect.name in std}
    return filter_of(dataclasses.replace(model, priors=priors))


@pytest.mark.outside
def test_random_processes_go_on_over_a_gap_of_any_length(tmp_path, monkeypatch):
    # In one step: at 1667 Hz, 2^32 rounds took minutes, and in f32 lost what the scale factor walks in each.
    gap = gap_of(tmp_path, monkeypatch, with_two_processes)
    for name, text in filter_files(with_two_processes(), "cal", "c", "f32").items():
        (tmp_path / name).write_text(text)
    single = Gap(compiled(tmp_path, gap.parameters, 2, "float"), gap.rows.astype(np.float32), gap.parameters)
    free = list(program(with_two_processes(), "f64").free)
    for missed in (0, 9, 36_000_000, 2**32 - 1):
        live = with_two_processes()
        gap.live(live, missed)
        values, variances = live.values[free], np.diag(live.covariance)[free]
        for device, most in ((gap, 1e-8), (single, 0.1)):
            y = device.device(missed)
            off = np.abs(y[0] - values) / np.sqrt(variances) + np.abs(y[1] / variances - 1.0)
            assert np.max(off) <= most, (missed, off)
    here = BEFORE + MISSED
    grown = [device.device(36_000_000, here)[1] - device.device(0, here)[1] for device in (single, gap)]
    assert grown[0] == pytest.approx(grown[1], rel=1e-3)


@pytest.mark.outside
@pytest.mark.parametrize("name", ["linear", "low-pass", "process"])
def test_behind_a_gap_the_watch_is_that_of_the_live_filter(tmp_path, monkeypatch, name):
    gap, live = gap_of(tmp_path, monkeypatch, lambda: watched(name)), watched(name)
    gap.device()
    gap.live(live)
    for j, suspicion in enumerate(live.watched):
        y = np.zeros(4)
        assert gap.library.watch(j, y.ctypes.data_as(ctypes.c_void_p)) == 0
        assert y[:3] == pytest.approx([suspicion.log_e, suspicion.size, suspicion.std], rel=1e-6, abs=1e-6)
