"""Threads behind the page: actions wait in theirs for a worker, figures are drawn in a few of their own."""

from __future__ import annotations

import asyncio
import contextvars
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from typing import TypeVar

Result = TypeVar("Result")
_ACTIONS = ThreadPoolExecutor(64, "action")
"""They wait, mostly, and each of a session's pages may have one that does."""
_DRAWING = ThreadPoolExecutor(2, "drawing")
"""They hold the interpreter, so that many of them would keep it from answering pages."""


async def act(action: Callable[..., Result], *args: object) -> Result:
    """Run an action, which may wait for long."""
    return await asyncio.get_running_loop().run_in_executor(_ACTIONS, action, *args)


async def draw(make: Callable[[], Result]) -> Result:
    """Make figures, with the catalogue of effects that the caller has."""
    return await asyncio.get_running_loop().run_in_executor(_DRAWING, contextvars.copy_context().run, make)
