"""Exported files compiled and run: readings in, accelerations and flags out, as the machine computes them."""

from __future__ import annotations

import shutil
import subprocess
from collections.abc import Sequence
from pathlib import Path

import numpy as np

from accelcal.calibration.export import Calibration, header, module

STRICT = ("-std=c99", "-Wall", "-Wextra", "-pedantic", "-Werror", "-ffp-contract=off")
FIRMWARE = ("-Wconversion", "-Wdouble-promotion", "-Wshadow", "-Wfloat-conversion", "-Wundef")
"""Warnings that firmware is built with."""

C_MAIN = """
#include <stdio.h>
#include <stdlib.h>
{includes}
static void emit(double a, unsigned outside, unsigned failed)
{{
    const double row[3] = {{ a, (double)outside, (double)failed }};
    fwrite(row, sizeof row, 1, stdout);
}}
int main(int argc, char **argv)
{{
    double in[2];
    const int which = argc > 1 ? atoi(argv[1]) : 0;
    while (fread(in, sizeof in, 1, stdin) == 1) {{
        double a = 0.0;
        float b = 0.0f;
        unsigned outside = 0u;
        switch (which) {{
{cases}
        default: return 1;
        }}
    }}
    return 0;
}}
"""
C_CASE = """\
        case {double}: outside = m{i}_acceleration(in[0]{warm}, &a); emit(a, outside, m{i}_self_test()); break;
        case {single}: outside = m{i}_acceleration_f((float)in[0]{warm_f}, &b);
            emit((double)b, outside, m{i}_self_test_f()); break;
"""
RUST_MAIN = """
use std::io::{{Read, Write}};
{modules}
fn main() {{
    let which: u32 = std::env::args().nth(1).unwrap().parse().unwrap();
    let mut bytes = Vec::new();
    std::io::stdin().read_to_end(&mut bytes).unwrap();
    let mut out = Vec::new();
    for pair in bytes.chunks_exact(16) {{
        let number = |at: usize| f64::from_le_bytes(pair[at..at + 8].try_into().unwrap());
        let (reading, temperature) = (number(0), number(8));
        let (a, outside, failed) = match which {{
{cases}
            _ => std::process::exit(1),
        }};
        let _ = temperature;
        for value in [a, f64::from(outside), failed as f64] {{
            out.extend_from_slice(&value.to_le_bytes());
        }}
    }}
    std::io::stdout().write_all(&out).unwrap();
}}
"""
RUST_CASE = """\
            {double} => {{ let r = m{i}::acceleration(reading{warm}); (r.acceleration, r.outside, m{i}::self_test()) }}
            {single} => {{
                let r = m{i}::acceleration_f32(reading as f32{warm_f});
                (f64::from(r.acceleration), r.outside, m{i}::self_test_f32())
            }}
"""


def c_program(folder: Path, calibrations: Sequence[Calibration], *flags: str, compiler: str = "cc") -> Path:
    """Compile headers into one program; any warning fails."""
    for i, calibration in enumerate(calibrations):
        (folder / f"m{i}.h").write_text(header(calibration, f"m{i}.h"))
    return c_build(folder, calibrations, *flags, compiler=compiler)


def c_build(folder: Path, calibrations: Sequence[Calibration], *flags: str, compiler: str = "cc") -> Path:
    """Compile the headers m0.h, m1.h, ... that a folder holds."""
    cases = [
        C_CASE.format(double=2 * i, single=2 * i + 1, i=i, warm=", in[1]" * warm, warm_f=", (float)in[1]" * warm)
        for i, warm in enumerate(calibration.double.inverse.warmth is not None for calibration in calibrations)
    ]
    includes = "\n".join(f'#include "m{i}.h"' for i in range(len(calibrations)))
    (folder / "main.c").write_text(C_MAIN.format(includes=includes, cases="".join(cases)))
    return _built([compiler, *(flags or STRICT), "main.c", "-o", "from_c"], folder / "from_c")


def rust_program(folder: Path, calibrations: Sequence[Calibration]) -> Path:
    """Compile modules into one program; any warning fails, and so does a failing test vector."""
    for i, calibration in enumerate(calibrations):
        (folder / f"m{i}.rs").write_text(module(calibration))
    cases = [
        RUST_CASE.format(
            double=2 * i, single=2 * i + 1, i=i, warm=", temperature" * warm, warm_f=", temperature as f32" * warm
        )
        for i, warm in enumerate(calibration.double.inverse.warmth is not None for calibration in calibrations)
    ]
    modules = "\n".join(f"mod m{i};" for i in range(len(calibrations)))
    (folder / "main.rs").write_text(RUST_MAIN.format(modules=modules, cases="".join(cases)))
    return _built(
        ["rustc", "--edition", "2021", "-D", "warnings", "-O", "main.rs", "-o", "from_rust"], folder / "from_rust"
    )


def _built(command: list[str], program: Path) -> Path:
    assert shutil.which(command[0]), f"{command[0]} is needed to build the package, and for this test"
    done = subprocess.run(command, cwd=program.parent, capture_output=True, text=True, timeout=300)
    assert done.returncode == 0, done.stderr
    assert not done.stderr, done.stderr
    return program


def run(program: Path, which: int, reading: np.ndarray, temperature: np.ndarray) -> np.ndarray:
    """Acceleration, flags and failures of the self-test, (n, 3); `which` is twice the model, one more for float."""
    given = np.column_stack([reading, temperature]).astype("<f8").tobytes()
    done = subprocess.run([program, str(which)], input=given, capture_output=True, check=True, timeout=120)
    return np.frombuffer(done.stdout, dtype="<f8").reshape(-1, 3)
