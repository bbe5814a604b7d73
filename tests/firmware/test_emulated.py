"""The firmware on a Cortex-M4F and a Cortex-M7 in QEMU: the host's bits, within the budget, no way to panic.

Counts are emulated instructions. They move by a tenth when a compiler places code differently, and the budget of
instructions, 600, is 1.9 times what was counted when it was set.
"""

from __future__ import annotations

import re
import subprocess

import pytest

from . import build
from .run import MACHINES, emulated, on_host

pytestmark = pytest.mark.usefixtures("device_tools")

REFUSED = re.compile("panic|unwind|alloc", re.IGNORECASE)


def symbols(image) -> list[str]:
    listed = subprocess.run(["arm-none-eabi-nm", "-C", str(image)], capture_output=True, text=True, check=True)
    return listed.stdout.splitlines()


@pytest.mark.parametrize("machine", MACHINES, ids=lambda machine: machine.name)
def test_the_device_gives_the_bits_of_the_host_within_its_budget(machine, tmp_path):
    image = build.image(tmp_path, *machine.features, flags=machine.flags)
    device = emulated(image, machine.board)

    assert device.digest == on_host(build.library(tmp_path, *machine.features)).digest
    assert not [line for line in symbols(image) if REFUSED.search(line)]
    if not (machine.features or machine.flags):
        assert 0 < device.predict < device.predict_update <= 600
        assert 0 < device.stack <= 256
        assert device.flash <= 4096


def test_an_image_that_could_panic_does_not_link(tmp_path):
    with pytest.raises(build.LinkError, match="this_image_can_panic"):
        build.image(tmp_path, "panic")


def test_its_symbols_would_show_a_panic(tmp_path):
    forced = build.image(tmp_path, "panic", flags=("-Clink-arg=--defsym=this_image_can_panic=0",))

    assert [line for line in symbols(forced) if REFUSED.search(line) and "this_image" not in line]
