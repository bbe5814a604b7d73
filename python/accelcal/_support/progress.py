"""How far long work is: its share, the share of one part, and the time that is left."""

from __future__ import annotations

TYPE_CHECKING = False
if TYPE_CHECKING:
    from collections.abc import Callable
    from typing import TypeAlias

    Report: TypeAlias = Callable[[float], None]

LEAST_SHARE, LEAST_TIME = 0.02, 1.0
"""From which on the time that is left is estimated; s."""


def ignore(share: float) -> None:
    """For work whose progress nobody follows."""


def within(progress: Report, low: float, high: float) -> Report:
    """Report progress of one part of the work as progress of the whole."""
    return lambda share: progress(low + share * (high - low))


def time_left(elapsed: float, share: float) -> str:
    """What is left of work of which a share was done in some time, s; before that is known, how long it has taken.

    Examples
    --------
    >>> time_left(3.2, 0.0), time_left(4.0, 0.4), time_left(60.0, 0.1), time_left(60.0, 1.0)
    ('3 s so far', 'about 6 s left', 'about 9 min left', 'about 1 s left')
    """
    if share < LEAST_SHARE or elapsed < LEAST_TIME:
        return f"{elapsed:.0f} s so far"
    left = max(1.0, elapsed * (1.0 - share) / share)
    if left < 10.0:
        return f"about {left:.0f} s left"
    return f"about {5.0 * round(left / 5.0):.0f} s left" if left < 90.0 else f"about {left / 60.0:.0f} min left"
