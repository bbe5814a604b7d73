"""The firmware's tracker on the host, linked against nothing: it cannot panic, and its bits are written down."""

from __future__ import annotations

import numpy as np
import pytest

from . import build
from .run import on_host

pytestmark = pytest.mark.usefixtures("host_tools")

# Our own past output, because the promise is the bits themselves: a change of them breaks every device in the field's
# comparison with its log, so it must be meant.
GOLDEN = {"single": 0x0098B01AC910FF64, "double": 0x7D704680A5B13925}
FEATURES = {"single": (), "double": ("double",)}


@pytest.mark.parametrize("precision", GOLDEN)
def test_it_links_without_any_library_and_gives_the_bits_on_record(precision, tmp_path):
    outcome = on_host(build.library(tmp_path, *FEATURES[precision]))

    assert f"{outcome.digest:016x}" == f"{GOLDEN[precision]:016x}"


def test_instructions_of_this_very_processor_do_not_change_the_bits(tmp_path):
    outcome = on_host(build.library(tmp_path, flags=("-Ctarget-cpu=native",)))  # has fused multiply-add, most likely

    assert outcome.digest == GOLDEN["single"]


def test_what_could_panic_does_not_link(tmp_path):
    with pytest.raises(build.LinkError, match="this_image_can_panic"):
        build.library(tmp_path, "panic")


def test_a_single_step_more_changes_the_digest(tmp_path):
    library = build.library(tmp_path)

    assert len({on_host(library, steps).digest for steps in (0, 1, 2, 1999, 2000)}) == 5


def test_it_finds_the_sensor(tmp_path):
    outcome = on_host(build.library(tmp_path))
    sigma = np.sqrt(outcome.variance)

    def worst(sensor: np.ndarray) -> float:
        return np.max(np.abs(np.asarray(outcome.estimate) - sensor) / sigma)

    assert worst(np.asarray(outcome.truth)) < 4.0  # false alarms: 4 x 6e-5, on one record whose bits are fixed
    assert all(worst(np.asarray(outcome.truth) * scale) > 4.0 for scale in 1.0 + 0.5 * np.eye(4))  # each one half off
