"""The firmware run: on the host through ctypes, on a Cortex-M in QEMU. As a program, the table of `make embedded`."""

from __future__ import annotations

import ctypes
import subprocess
import sys
import tempfile
from dataclasses import dataclass
from pathlib import Path

from . import build

STEPS = 20_000
"""As in `firmware/src/device.rs`; the digests would differ."""
TICKS_PER_INSTRUCTION = 25.6
"""QEMU's `-icount shift=10` gives every instruction 1024 ns, and the system timer of these boards runs at 25 MHz."""


@dataclass(frozen=True)
class Machine:
    """A processor, the board that QEMU puts it on, the image for it."""

    name: str
    board: str
    features: tuple[str, ...] = ()
    flags: tuple[str, ...] = ()


MACHINES = (
    Machine("Cortex-M4F, single", "mps2-an386"),
    Machine("Cortex-M7, single", "mps2-an500"),
    Machine("Cortex-M4F, opt-level s", "mps2-an386", flags=("-Copt-level=s",)),
    Machine("Cortex-M4F, double in software", "mps2-an386", ("double",)),
    Machine("Cortex-M7, double in hardware", "mps2-an500", ("double",), ("-Ctarget-cpu=cortex-m7",)),
)


class Outcome(ctypes.Structure):
    """What the host's run returns; `Outcome` of `firmware/src/outcome.rs`."""

    _fields_ = (
        ("digest", ctypes.c_uint64),
        ("estimate", ctypes.c_double * 4),
        ("variance", ctypes.c_double * 4),
        ("truth", ctypes.c_double * 4),
    )


@dataclass(frozen=True)
class Report:
    """What the device said; instructions are emulated ones, the most of any step."""

    digest: int
    predict: float
    predict_update: float
    stack: int
    state: int
    flash: int


def on_host(library: Path, steps: int = STEPS) -> Outcome:
    """The run of a shared library."""
    outcome = ctypes.CDLL(str(library)).outcome
    outcome.restype, outcome.argtypes = Outcome, [ctypes.c_uint32]
    result: Outcome = outcome(steps)
    return result


def emulated(image: Path, board: str) -> Report:
    """The run of an image in QEMU."""
    command = [build.EMULATOR, "-M", board, "-display", "none", "-monitor", "none", "-serial", "none"]
    command += ["-icount", "shift=10,sleep=off", "-semihosting-config", "enable=on,target=native"]
    done = subprocess.run([*command, "-kernel", str(image)], capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, f"the device stopped at a fault: {done.stderr}"
    sizes = {name: int(value, 16) for name, value in (line.split() for line in done.stderr.splitlines())}
    return Report(
        sizes["digest"],
        sizes["ticks_predict"] / TICKS_PER_INSTRUCTION,
        sizes["ticks_predict_update"] / TICKS_PER_INSTRUCTION,
        sizes["stack"],
        sizes["state"],
        flash(image),
    )


def flash(image: Path) -> int:
    """Bytes of the whole image in flash: vectors, code, constants."""
    listed = subprocess.run(["arm-none-eabi-size", str(image)], capture_output=True, text=True, check=True).stdout
    text, data, *_ = listed.splitlines()[1].split()
    return int(text) + int(data)


def main() -> None:
    """Prints the table."""
    if lacking := build.lacking_for_the_host() or build.lacking_for_the_device():
        sys.exit(lacking)
    print(f"{STEPS} steps of [p v k K0 K2 K3]; emulated instructions (QEMU icount), bytes")
    print(f"{'':31} predict  predict+update  flash  stack  state  bits")
    for machine in MACHINES:
        with tempfile.TemporaryDirectory() as folder:
            host = on_host(build.library(Path(folder), *machine.features))
            device = emulated(build.image(Path(folder), *machine.features, flags=machine.flags), machine.board)
        same = "as the host" if device.digest == host.digest else "DIFFER"
        print(
            f"{machine.name:31} {device.predict:7.0f} {device.predict_update:15.0f}"
            f" {device.flash:6} {device.stack:6} {device.state:6}  {same}"
        )


if __name__ == "__main__":
    main()
