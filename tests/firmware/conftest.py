"""Where tools are absent these tests are skipped with the reason; ACCELCAL_REQUIRE_EMBEDDED=1 makes that a failure."""

from __future__ import annotations

import os

import pytest

from . import build


def demand(lacking: str | None) -> None:
    if lacking is not None:
        (pytest.fail if os.environ.get("ACCELCAL_REQUIRE_EMBEDDED") == "1" else pytest.skip)(lacking)


@pytest.fixture
def host_tools() -> None:
    demand(build.lacking_for_the_host())


@pytest.fixture
def device_tools(host_tools: None) -> None:
    demand(build.lacking_for_the_device())
