"""Exported filters built and run: on this machine through ctypes, on a Cortex-M4F in QEMU, from C and from Rust."""

from __future__ import annotations

import ctypes
import re
import shutil
import subprocess
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from accelcal.calibration.export.filter import filter_files
from accelcal.filters.live_model import LiveModel
from tests.firmware import build
from tests.firmware.run import TICKS_PER_INSTRUCTION

from .compiled import FIRMWARE

STRICT = ("-std=c99", "-O2", "-Wall", "-Wextra", "-Wpedantic", "-Werror", "-ffp-contract=off", *FIRMWARE)
M4F = ("-mcpu=cortex-m4", "-mthumb", "-mfloat-abi=hard", "-mfpu=fpv4-sp-d16", "-ffreestanding")
STEPS = 20_000
RECORD = """\
#include <stdint.h>
#include "cal.h"

/* Two tones and noise by products and sums of single precision: the same on every machine. */
struct record {{ float c1, s1, c2, s2, warm; uint32_t random, n; float u, z; }};

static float noise(struct record *r)
{{
    int32_t sum = -131070;
    int i;
    for (i = 0; i < 4; ++i) {{
        r->random ^= r->random << 13;
        r->random ^= r->random >> 17;
        r->random ^= r->random << 5;
        sum += (int32_t)(r->random >> 16);
    }}
    return (float)sum * (1.0f / 37837.0f);
}}

static void turn(float *c, float *s, float cosine, float sine)
{{
    const float before = *c;
    *c = cosine * before - sine * *s;
    *s = sine * before + cosine * *s;
}}

static void draw(struct record *r)
{{
    turn(&r->c1, &r->s1, 0.99995558f, 0.0094243f);
    turn(&r->c2, &r->s2, 0.99999289f, 0.0037699f);
    r->u = 0.05f - 9.97f * r->s1 - 1.994f * r->s2 + 0.004f * noise(r);
    r->z = 0.04f * r->s1 + 0.05f * r->s2 + 1e-6f * noise(r);
    r->warm = r->n % 8000u < 4000u ? r->warm + 1e-3f : r->warm - 1e-3f;
    ++r->n;
    r->z = r->n % 2u ? r->z : 1.0f / (r->z - r->z); /* every second one is read */
}}

static uint64_t digest_of(const cal_filter *f, uint64_t digest)
{{
    const uint32_t *words = (const uint32_t *)(const void *)f;
    unsigned i;
    for (i = 0u; i < sizeof *f / 4u; ++i) {{
        digest = (digest ^ words[i]) * UINT64_C(0x100000001b3);
    }}
    return digest;
}}

#define BEGIN {{ 1.0f, 0.0f, 1.0f, 0.0f, 20.0f, 0x12345678u, 0u, 0.0f, 0.0f }}
#define STEP cal_step(&f, r.u, r.z{side})
#define STEPS {steps}
#define GAP if (i == STEPS / 2) refused += cal_resume(&f, 0.02f, 100u)
"""
HOST_MAIN = """
#include <stdio.h>
int main(void)
{
    struct record r = BEGIN;
    cal_filter f;
    uint64_t digest = UINT64_C(0xcbf29ce484222325);
    int i, refused = 0;
    cal_init(&f, 0.0f);
    for (i = 0; i < STEPS; ++i) {
        GAP;
        draw(&r);
        refused += STEP;
        digest = digest_of(&f, digest);
    }
    printf("%016llx %d %g\\n", (unsigned long long)digest, refused, (double)cal_variance(&f, 0u));
    return 0;
}
"""
DEVICE_MAIN = """
extern int main(void);
__asm__(".section .vectors, \\"a\\", %progbits\\n.word stack_top, reset\\n.rept 14\\n.word fault\\n.endr\\n"
    ".section .text.reset, \\"ax\\", %progbits\\n.thumb_func\\n.global reset\\nreset:\\n"
    "ldr r0, =0xE000ED88\\nldr r1, [r0]\\norr r1, r1, #0xF00000\\nstr r1, [r0]\\ndsb\\nisb\\nbl main\\n"
    ".thumb_func\\nfault:\\nmovs r0, #0x18\\nldr r1, =0x20023\\nbkpt 0xAB\\nb .\\n.ltorg\\n.text\\n");

static void semihost(int operation, const void *argument)
{
    register int r0 __asm__("r0") = operation;
    register const void *r1 __asm__("r1") = argument;
    __asm__ volatile("bkpt 0xAB" : "+r"(r0) : "r"(r1) : "memory");
}

static void report(const char *name, uint64_t value)
{
    int i;
    semihost(4, name);
    for (i = 0; i < 16; ++i) {
        const char letter = "0123456789abcdef"[(value >> (60 - 4 * i)) & 15u];
        semihost(3, &letter);
    }
    semihost(4, "\\n");
}

#define TIMER ((volatile uint32_t *)0xE000E010)

int main(void)
{
    struct record r = BEGIN;
    cal_filter f;
    uint64_t digest = UINT64_C(0xcbf29ce484222325), without = 0u, with = 0u, refused = 0u, total = 0u;
    int i;
    TIMER[1] = 0x00FFFFFFu;
    TIMER[2] = 0u;
    TIMER[0] = 5u;
    cal_init(&f, 0.0f);
    for (i = 0; i < STEPS; ++i) {
        uint32_t before, overhead, ticks;
        GAP;
        draw(&r);
        before = TIMER[2];
        overhead = (before - TIMER[2]) & 0x00FFFFFFu;
        before = TIMER[2];
        refused += (uint64_t)STEP;
        ticks = ((before - TIMER[2]) & 0x00FFFFFFu) - overhead;
        total += ticks;
        if (r.n % 2u && ticks > with) with = ticks;
        if (!(r.n % 2u) && ticks > without) without = ticks;
        digest = digest_of(&f, digest);
    }
    refused += (uint64_t)(cal_variance(&f, r.n) < 0.0f); /* of any place: an image that could panic does not link */
    report("digest ", digest);
    report("refused ", refused);
    report("without ", without);
    report("with ", with);
    report("total ", total);
    semihost(0x18, (const void *)0x20026);
    return 0;
}
"""
LINKER_SCRIPT = """
MEMORY { FLASH (rx) : ORIGIN = 0, LENGTH = 1M  RAM (rw) : ORIGIN = 0x20000000, LENGTH = 64K }
stack_top = ORIGIN(RAM) + LENGTH(RAM);
ENTRY(reset)
SECTIONS {
  .text : { KEEP(*(.vectors)) *(.text .text.* .rodata .rodata.*) } > FLASH
  .data : { *(.data .data.* .bss .bss.* COMMON) } > RAM
  ASSERT(SIZEOF(.data) == 0, "the filter has no static variables")
  /DISCARD/ : { *(.ARM.exidx*) }
}
"""
RUST_LIBRARY = """
#![no_std]
mod cal;

extern "C" {{ fn this_image_can_panic() -> !; }}

/// An image that could reach it does not link.
#[panic_handler]
fn refuse(_: &core::panic::PanicInfo) -> ! {{ unsafe {{ this_image_can_panic() }} }}

#[no_mangle]
pub extern "C" fn cal_init(f: &mut cal::Filter, position: f32) {{ *f = cal::Filter::new(position); }}

#[no_mangle]
pub extern "C" fn cal_step(f: &mut cal::Filter, output: f32, position: f32{parameters}) -> i32 {{
    i32::from(f.step(output, position{arguments}).is_err())
}}

#[no_mangle]
pub extern "C" fn cal_resume(f: &mut cal::Filter, position: f32, missed: u32) -> i32 {{
    i32::from(f.resume(position, missed).is_err())
}}

#[no_mangle]
pub extern "C" fn cal_variance(f: &cal::Filter, parameter: u32) -> f32 {{ f.variance(parameter as usize) }}
"""
"""What a static library for C needs around the module; its `Filter` is laid out as the header says."""


@dataclass(frozen=True)
class Report:
    """What a run said: the digest of all states, steps that were refused, instructions of a step: most and mean."""

    digest: int
    refused: int
    without: float = 0.0
    with_reading: float = 0.0
    mean: float = 0.0


def write(folder: Path, live: Callable[[], LiveModel]) -> None:
    """Write a filter in both languages, in single precision, and the record that it is run over."""
    for language in ("c", "rust"):
        for name, text in filter_files(live(), "cal", language, "f32").items():
            (folder / name).write_text(text)
    header = (folder / "cal.h").read_text()
    (listed,) = re.findall(r"cal_step\(cal_filter \*f, ([^)]*)\)", header)
    side = listed.split(", ")[2:]
    record = RECORD.format(side=", r.warm" * len(side), steps=STEPS)
    (folder / "host.c").write_text(record + HOST_MAIN)
    (folder / "device.c").write_text(record + DEVICE_MAIN)
    (folder / "memory.x").write_text(LINKER_SCRIPT)
    names = [argument.split()[1] for argument in side]
    library = RUST_LIBRARY.format(
        parameters="".join(f", {name}: f32" for name in names), arguments="".join(f", {name}" for name in names)
    )
    (folder / "lib.rs").write_text(library)


def on_host(folder: Path, *flags: str) -> Report:
    """The C filter as a static library, and a program that has header and library alone, on this machine."""
    run(["cc", *STRICT, *flags, "-c", "cal.c", "-o", "cal.o"], folder)
    run(["ar", "rcs", "libcal.a", "cal.o"], folder)
    user = folder / "user"
    user.mkdir(exist_ok=True)
    for name in ("cal.h", "libcal.a", "host.c"):
        shutil.copy(folder / name, user / name)
    run(["cc", *STRICT, "host.c", "-L.", "-lcal", "-o", "host"], user)
    digest, refused, _ = run(["./host"], user).split()
    return Report(int(digest, 16), int(refused))


def on_device(folder: Path, language: str, optimise: str = "-Os") -> Report:
    """Either filter on a Cortex-M4F in QEMU, whose instructions are counted."""
    arm = ["arm-none-eabi-gcc", *M4F, *optimise.split(), "-std=gnu99", "-ffp-contract=off"]
    if language == "c":
        run([*arm, "-c", "cal.c", "-o", "filter.o"], folder)
    else:
        result = build.toolchain()
        assert result is not None
        options = ["--edition", "2021", "--crate-type", "staticlib", "-D", "warnings", "-C", "opt-level=3"]
        options += ["-C", "panic=abort", "--target", build.TARGET, "-o", "filter.o"]
        run([result[1], *options, "lib.rs"], folder)
    linked = ["-nostdlib", "-Wl,-z,noexecstack,--gc-sections", "-T", "memory.x", "device.c", "filter.o", "-lgcc"]
    linked += ["-o", "device.elf"]
    run([*arm, "-fno-tree-loop-distribute-patterns", *linked], folder)
    command = [build.EMULATOR, "-M", "mps2-an386", "-display", "none", "-monitor", "none", "-serial", "none"]
    command += ["-icount", "shift=10,sleep=off", "-semihosting-config", "enable=on,target=native"]
    parts = {
        name: int(value, 16)
        for name, value in map(str.split, run([*command, "-kernel", "device.elf"], folder).splitlines())
    }
    counts = [parts[name] / TICKS_PER_INSTRUCTION for name in ("without", "with", "total")]
    return Report(parts["digest"], parts["refused"], counts[0], counts[1], counts[2] / STEPS)


def run(command: list[str], folder: Path) -> str:
    """What a command said.

    Raises
    ------
    AssertionError
        If it failed or complained.
    """
    done = subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout + done.stderr
    assert not done.stderr or command[0] == build.EMULATOR, done.stderr
    return done.stdout + done.stderr


def compiled(folder: Path, parameters: int, arguments: int, kind: str, *, watch: bool = False) -> ctypes.CDLL:
    """The C filter as a shared library, with functions over rows of arguments."""
    asked = f"int named(void) {{ return cal_named(&f); }}\nint watch(unsigned j, {kind} *y)"
    asked += " { return cal_watch(&f, j, y, y + 1, y + 2, y + 3); }\n"
    more = "".join(f", x[{j}]" for j in range(2, arguments))
    (folder / "rows.c").write_text(f"""\
#include "cal.h"
static cal_filter f;
void begin(void) {{ cal_init(&f, 0); }}
uint32_t *counts(void) {{ return &f.n; }} /* readings, earlier and missing are behind it */
int finite(void) {{ return cal_finite(&f); }}
int resume({kind} position, uint32_t missed) {{ return cal_resume(&f, position, missed); }}
int rows(const {kind} *x, int n)
{{
    int refused = 0;
    for (; n > 0; --n, x += {arguments}) refused += cal_step(&f, x[0], x[1]{more});
    return refused;
}}
void estimates({kind} *y)
{{
    unsigned j;
    for (j = 0u; j < {parameters}u; ++j) {{ y[j] = cal_estimate(&f, j); y[{parameters}u + j] = cal_variance(&f, j); }}
}}
{asked if watch else ""}""")
    run(["cc", *STRICT, "-shared", "-fPIC", "cal.c", "rows.c", "-o", f"{kind}.so"], folder)
    return ctypes.CDLL(str(folder / f"{kind}.so"))


def estimates_after(library: ctypes.CDLL, rows: np.ndarray, checks: tuple[int, ...], parameters: int) -> np.ndarray:
    """Estimates and variances after some of the rows, (checks, 2, m)."""
    library.begin()
    last, result = 0, []
    for n in checks:
        part = np.ascontiguousarray(rows[last:n])
        assert library.rows(part.ctypes.data_as(ctypes.c_void_p), len(part)) == 0
        y = np.zeros((2, parameters), dtype=rows.dtype)
        library.estimates(y.ctypes.data_as(ctypes.c_void_p))
        result.append(y.astype(np.float64))
        last = n
    return np.array(result)
