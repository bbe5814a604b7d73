"""Exported C and Rust against Python: the same bits, the stated bound, a test vector that notices a changed number."""

import os
import re
import shutil
import subprocess
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings, strategies as st

from accelcal.calibration.export import calibrate, header, module
from accelcal.calibration.export.approximate import evaluate

from .compiled import FIRMWARE, STRICT, c_build, c_program, run, rust_program
from .models import SENSORS, exact, fit_of, fits

pytestmark = pytest.mark.outside
CUBIC = {"bias": 0.05, "scale_factor": 0.01, "quadratic": 1e-4, "cubic": 1e-5}
WARM = {**CUBIC, "odd_quadratic": 1e-4, "temperature_bias": 1e-3, "temperature_scale": 1e-4}
NO_WARNINGS = {"deadline": None, "derandomize": True, "suppress_health_check": list(HealthCheck)}


def spread(code, rng, count):
    """Readings and temperatures of the format inside and around the range, and what no instrument should give."""
    inverse, w = code.inverse, code.inverse.warmth
    length = inverse.high - inverse.low
    reading = rng.uniform(inverse.low - 0.2 * length, inverse.high + 0.2 * length, count)
    reading[:5] = [np.nan, np.inf, -np.inf, inverse.low, inverse.high]
    T = rng.uniform(w.centre - 1.5 * w.half, w.centre + 1.5 * w.half, count) if w else np.zeros(count)
    T[5:7] = [np.nan, np.inf] if w else [0.0, 0.0]
    return inverse.format.array(reading), inverse.format.array(T)


def same_bits(first, second):
    return np.array_equal(np.asarray(first, dtype="<f8").view("<i8"), np.asarray(second, dtype="<f8").view("<i8"))


def check(program, fit_list, calibrations, count=400):
    """Bits and bound of every model in both formats."""
    rng = np.random.default_rng(3)
    for i, (fit, calibration) in enumerate(zip(fit_list, calibrations, strict=True)):
        for which, code in enumerate(calibration.codes):
            reading, T = spread(code, rng, count)
            outcome = run(program, 2 * i + which, reading, T)
            with np.errstate(invalid="ignore"):
                a, outside = evaluate(code.inverse, reading, T)
            assert np.array_equal(outcome[:, 1], outside)
            nan = np.isnan(a)
            assert np.array_equal(np.isnan(outcome[:, 0]), nan)
            assert same_bits(outcome[~nan, 0], a[~nan])
            assert not outcome[:, 2].any()
            for x, y, t in zip(outcome[outside == 0, 0][:40], reading[outside == 0], T[outside == 0], strict=False):
                assert abs(Decimal(float(x)) - exact(fit, float(y), float(t), float(x))) <= code.bound


@settings(max_examples=3, **NO_WARNINGS)
@given(st.lists(fits(), min_size=5, max_size=5))
def test_c_gives_the_bits_of_python_and_keeps_the_bound(tmp_path_factory, drawn):
    calibrations = [calibrate(fit) for fit in drawn]
    check(c_program(tmp_path_factory.mktemp("c"), calibrations, *STRICT, *FIRMWARE), drawn, calibrations)


@settings(max_examples=2, **NO_WARNINGS)
@given(st.lists(fits(), min_size=5, max_size=5))
def test_rust_gives_the_bits_of_python_and_keeps_the_bound(tmp_path_factory, drawn):
    calibrations = [calibrate(fit) for fit in drawn]
    check(rust_program(tmp_path_factory.mktemp("rust"), calibrations), drawn, calibrations)


@pytest.fixture(scope="module")
def warm():
    fit = fit_of(WARM, temperature=(15.0, 40.0))
    return fit, calibrate(fit)


def test_fused_operations_keep_the_bound_and_pass_the_self_test(tmp_path, warm):
    fit, calibration = warm
    program = c_program(tmp_path, [calibration], "-std=gnu99", "-O3", "-march=native", "-ffp-contract=fast")
    rng = np.random.default_rng(4)
    for which, code in enumerate(calibration.codes):
        reading, T = spread(code, rng, 200)
        outcome = run(program, which, reading, T)
        assert not outcome[:, 2].any()
        rows = zip(outcome[outcome[:, 1] == 0, 0], reading[outcome[:, 1] == 0], T[outcome[:, 1] == 0], strict=True)
        for x, y, t in rows:
            assert abs(Decimal(float(x)) - exact(fit, float(y), float(t), float(x))) <= code.bound


def test_the_header_is_valid_cplusplus_too(tmp_path, warm):
    if shutil.which("g++") is None:
        pytest.skip("g++ is not installed")
    c_program(
        tmp_path, [warm[1]], "-std=c++17", "-x", "c++", "-Wall", "-Wextra", "-pedantic", "-Werror", compiler="g++"
    )


def test_fast_math_and_its_parts_are_refused(tmp_path, warm):
    (tmp_path / "m.h").write_text(header(warm[1], "m.h"))
    parts = ("-ffast-math", "-ffinite-math-only", "-freciprocal-math")
    parts = (*parts, "-D_M_FP_FAST", "-funsafe-math-optimizations -fno-signed-zeros -fno-trapping-math")
    for flags in ("", *parts):
        command = ["cc", *STRICT, *FIRMWARE, *flags.split(), "-xc", "-fsyntax-only", "m.h"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert ("without -ffast-math" in done.stderr) == (done.returncode != 0) == bool(flags), flags


def test_two_headers_of_any_name_live_in_one_file(tmp_path):
    calibration = calibrate(fit_of(CUBIC))
    for name in ("int.h", "3 axis-x.h", "Ünï.h", "--.h"):
        text = header(calibration, name)
        (tmp_path / "one.h").write_text(text)
        (tmp_path / "main.c").write_text('#include "one.h"\n#include "one.h"\nint main(void) { return 0; }\n')
        subprocess.run(["cc", *STRICT, "main.c", "-o", "main"], cwd=tmp_path, check=True, timeout=60)


def test_a_name_that_ends_a_comment_or_a_line_does_no_harm(tmp_path):
    from dataclasses import replace

    hostile = replace(SENSORS[1], model="*/ #error x\n#error y", serial="µ²\n//! z")
    calibration = calibrate(fit_of(CUBIC, sensor=hostile))
    check(c_program(tmp_path, [calibration]), [calibration.fit], [calibration], count=20)
    check(rust_program(tmp_path, [calibration]), [calibration.fit], [calibration], count=20)


def numbers(text, pattern, begin, end):
    """Every constant of one function of a file, where it stands."""
    return list(re.compile(pattern).finditer(text, text.index(begin), text.index(end)))


def test_a_changed_number_fails_the_self_test_of_c(tmp_path, warm):
    _, calibration = warm
    c_program(tmp_path, [calibration])
    text = (tmp_path / "m0.h").read_text()
    every = numbers(text, r"-?0x[0-9a-f.]+p[+-]\d+", "unsigned m0_acceleration(", "unsigned m0_acceleration_f(")
    results = [m for m in every if abs(float.fromhex(m[0])) > 1e-3]
    assert len(results) > 12
    for match in results:
        # A joint may move a little where both polynomials agree; every other number may not.
        joint = "start[" in text[: match.start()].rpartition("\n")[2]
        wrong = (float.fromhex(match[0]) * (1.0 + (5e-3 if joint else 1e-9))).hex()
        (tmp_path / "m0.h").write_text(text[: match.start()] + wrong + text[match.end() :])
        program = c_build(tmp_path, [calibration])
        assert run(program, 0, np.array([2.5]), np.array([20.0]))[0, 2] > 0, match[0]


def test_a_changed_number_does_not_compile_in_rust(tmp_path, warm):
    text = module(warm[1])
    every = numbers(text, r"f64::from_bits\((0x[0-9a-f_]+)\)", "fn acceleration(", "fn acceleration_f32(")
    results = [(m, int(m[1].replace("_", ""), 16)) for m in every]
    results = [(m, bits) for m, bits in results if abs(np.array([bits], dtype=np.uint64).view(np.float64)[0]) > 1e-3]
    assert len(results) > 12
    for match, bits in results[:: len(results) // 4]:
        wrong = f"f64::from_bits(0x{bits ^ (1 << 45):016x})"
        (tmp_path / "m.rs").write_text(text[: match.start()] + wrong + text[match.end() :])
        command = ["rustc", "--edition", "2021", "--crate-type", "lib", "--emit", "metadata", "m.rs"]
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode != 0, match[0]
        assert "its test vector fails" in done.stderr


def test_clippy_has_nothing_to_say(tmp_path, warm):
    if shutil.which("clippy-driver") is None:
        pytest.skip("clippy is not installed: rustup component add clippy")
    for calibration in (warm[1], calibrate(fit_of(CUBIC))):
        (tmp_path / "m.rs").write_text(module(calibration))
        command = ["clippy-driver", "--edition", "2021", "--crate-type", "lib", "-D", "warnings"]
        command += ["-W", "clippy::pedantic", "m.rs"]  # as firmware is often checked
        done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
        assert done.returncode == 0, done.stderr


def test_cortex_m_compiles_it_without_a_library_call_in_float(tmp_path, warm):
    if shutil.which("arm-none-eabi-gcc") is None:
        reason = "arm-none-eabi-gcc is not installed: apt-get install gcc-arm-none-eabi"
        if os.environ.get("ACCELCAL_REQUIRE_EMBEDDED") == "1":
            pytest.fail(reason)
        pytest.skip(reason)
    (tmp_path / "sensor.h").write_text(header(warm[1], "sensor.h"))
    (tmp_path / "main.c").write_text(
        '#include "sensor.h"\n'
        "unsigned correct(float reading, float temperature, float *a)\n"
        "{\n    return sensor_acceleration_f(reading, temperature, a);\n}\n"
    )
    target = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-O2", "-ffreestanding", "-c")
    command = ["arm-none-eabi-gcc", *STRICT, *FIRMWARE, *target, "main.c", "-o", "main.o"]
    done = subprocess.run(command, cwd=tmp_path, capture_output=True, text=True, timeout=60)
    assert done.returncode == 0, done.stderr
    undefined = subprocess.run(
        ["arm-none-eabi-nm", "--undefined-only", "main.o"], cwd=tmp_path, capture_output=True, text=True, check=True
    )
    assert undefined.stdout.strip() == ""
