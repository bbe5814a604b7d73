"""The firmware built for the host and for a Cortex-M, and what a machine lacks for it."""

from __future__ import annotations

import fcntl
import os
import shutil
import subprocess
import sys
import tempfile
from functools import cache
from pathlib import Path

FIRMWARE = Path(__file__).parents[2] / "firmware"
TARGET = "thumbv7em-none-eabihf"
LINKER = "arm-none-eabi-ld"
EMULATOR = "qemu-system-arm"
REMEDY = "firmware/install.sh (Debian), or rustup target add thumbv7em-none-eabihf"


class LinkError(Exception):
    """The linker refused; the message is its own."""


def lacking_for_the_host() -> str | None:
    """What the host build lacks, in words."""
    if sys.platform != "linux":
        return "the proof asks a GNU linker, on Linux"
    return next((f"no {tool} here" for tool in ("cargo", "cc") if shutil.which(tool) is None), None)


def lacking_for_the_device() -> str | None:
    """What the emulated run lacks, in words, and the remedy."""
    absent = [tool for tool in (LINKER, EMULATOR) if shutil.which(tool) is None]
    if toolchain() is None:
        absent.append(f"Rust with {TARGET}")
    return f"no {', no '.join(absent)} here; try {REMEDY}" if absent else None


@cache
def toolchain() -> tuple[str, str] | None:
    """Cargo and compiler that have `core` for the device: those on the path, or Debian's."""
    for cargo, rustc in (("cargo", "rustc"), ("/usr/bin/cargo", "/usr/bin/rustc")):
        if shutil.which(cargo) is None or shutil.which(rustc) is None:
            continue
        with tempfile.TemporaryDirectory() as folder:
            command = [rustc, "--crate-type", "lib", "--target", TARGET, "--out-dir", folder, "-"]
            tried = subprocess.run(command, input="#![no_std]", text=True, capture_output=True, check=False)
        if tried.returncode == 0:
            return cargo, rustc
    return None


def cargo_rustc(
    toolchain: tuple[str, str], text: str, keep: Path, *arguments: str, flags: tuple[str, ...] = ()
) -> Path:
    """Builds one variant and copies what was `made` to `keep`, before the next variant overwrites it.

    Raises
    ------
    LinkError
        It compiles, but does not link.
    """
    cargo, rustc = toolchain
    built = Path(os.environ.get("CARGO_TARGET_DIR", FIRMWARE.parent / "target")) / "firmware"
    built.mkdir(parents=True, exist_ok=True)
    # Flags and profiles of whoever calls are not the firmware's.
    foreign = ("RUSTFLAGS", "CARGO_ENCODED_RUSTFLAGS", "CARGO_BUILD_", "CARGO_PROFILE_")
    environment = {name: value for name, value in os.environ.items() if not name.startswith(foreign)} | {"RUSTC": rustc}
    command = [cargo, "rustc", "--quiet", "--release", "--locked", "--target-dir", str(built), *arguments, "--", *flags]
    with (built / "one-at-a-time").open("w") as turn:
        fcntl.flock(turn, fcntl.LOCK_EX)
        done = subprocess.run(command, cwd=FIRMWARE, env=environment, capture_output=True, text=True, check=False)
        if done.returncode != 0 and "undefined reference" in done.stderr:
            raise LinkError(done.stderr)
        assert done.returncode == 0, done.stderr
        return Path(shutil.copy(built / text, keep))


def library(folder: Path, *features: str, flags: tuple[str, ...] = ()) -> Path:
    """The tracker as a shared library that links against nothing: no libc, no Rust runtime.

    Raises
    ------
    LinkError
        Something is left to link: a panic, an allocation.
    """
    variant = ("--lib", "--crate-type", "staticlib", "--features", ",".join(features))
    archive = cargo_rustc(("cargo", "rustc"), "release/libfirmware.a", folder / "firmware.a", *variant, flags=flags)
    shared = folder / "firmware.so"
    sources = (str(FIRMWARE / "freestanding.c"), str(archive))
    command = [
        "cc",
        "-O0",
        "-fPIC",
        "-shared",
        "-nostdlib",
        "-Wl,-z,defs",
        "-Wl,-u,outcome",
        "-o",
        str(shared),
        *sources,
    ]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode != 0:
        raise LinkError(done.stderr)
    return shared


def image(folder: Path, *features: str, flags: tuple[str, ...] = ()) -> Path:
    """What would be flashed, as an ELF file.

    Raises
    ------
    LinkError
        Something is left to link: a panic, an allocation.
    """
    result = toolchain()
    assert result is not None
    variant = ("--bin", "device", "--target", TARGET, "--features", ",".join(features))
    return cargo_rustc(result, f"{TARGET}/release/device", folder / "device.elf", *variant, flags=flags)
