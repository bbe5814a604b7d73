#!/bin/sh
# Gives a Debian machine what the firmware needs: Rust with `core` for Cortex-M4F and M7, a C compiler and linker for ARM,
# QEMU, and what checks exported C.
# Debian ships Rust's sources but not this target, so `core` is built once and added to Debian's Rust. Run twice, it does
# nothing. Elsewhere: `rustup target add thumbv7em-none-eabihf`, and qemu-system-arm and arm-none-eabi-ld from anywhere.
set -eu

target=thumbv7em-none-eabihf
packages="rustc-web cargo-web rust-web-src qemu-system-arm binutils-arm-none-eabi gcc-arm-none-eabi cppcheck"
root() { if [ "$(id -u)" -eq 0 ]; then "$@"; else sudo "$@"; fi; }

work=$(mktemp -d)
trap 'rm -rf "$work"' EXIT
printf '#![no_std]\n' >"$work/seed.rs"
has_target() { "$1" --crate-type lib --target "$target" --out-dir "$work" "$work/seed.rs" 2>/dev/null; }

if command -v qemu-system-arm >/dev/null && command -v arm-none-eabi-gcc >/dev/null && command -v cppcheck >/dev/null; then
    for rustc in rustc /usr/bin/rustc; do
        if has_target "$rustc"; then
            echo "all there: $target for $("$rustc" --version)"
            exit 0
        fi
    done
fi

missing=""
for package in $packages; do
    dpkg-query -W -f '${Status}' "$package" 2>/dev/null | grep -q 'ok installed' || missing="$missing $package"
done
if [ -n "$missing" ]; then
    command -v apt-get >/dev/null || { echo "no apt-get here: see docs/embedded.md for rustup" >&2; exit 1; }
    echo "installing$missing"
    root apt-get update -qq
    # Nothing of the machine's own is removed, unless it says that it may be: a newer qemu-utils, say, is in the way.
    keep=--no-remove
    [ "${ACCELCAL_MAY_REMOVE_PACKAGES:-}" = 1 ] && keep=
    # shellcheck disable=SC2086 # a list of words
    root env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq $keep --no-install-recommends $missing >/dev/null || {
        echo "apt-get did not install$missing; if packages are in the way that this machine can spare, run again with" >&2
        echo "ACCELCAL_MAY_REMOVE_PACKAGES=1" >&2
        exit 1
    }
fi
if has_target /usr/bin/rustc; then exit 0; fi

# An empty crate, built with its own `core`, leaves that `core` behind. The registry is replaced by the crates that come
# with Rust's sources for this one build: nothing is downloaded. Bitcode lets the firmware optimise across `core`.
cd "$work"
rust=$(/usr/bin/rustc --print sysroot)/lib/rustlib
printf '[package]\nname = "seed"\nversion = "0.0.0"\nedition = "2024"\n[lib]\npath = "seed.rs"\n' >Cargo.toml
RUSTC_BOOTSTRAP=1 RUSTC=/usr/bin/rustc RUSTFLAGS=-Cembed-bitcode=yes CARGO_TARGET_DIR=target \
    /usr/bin/cargo build --quiet --release --offline -Zbuild-std=core --target "$target" \
    --config "source.crates-io.replace-with='sources'" \
    --config "source.sources.directory='$rust/src/rust/library/vendor'"
root rm -rf "$rust/$target" # of an older compiler
root mkdir -p "$rust/$target/lib"
for crate in core compiler_builtins; do
    root cp "target/$target/release/deps/lib$crate"-*.rlib "$rust/$target/lib/"
done
echo "added $target to $(/usr/bin/rustc --version)"
