"""Stakkeland, Prytz, Booij, Pedersen (2007), reproduced: each claim of the paper with the result of our filters.

Everything runs on simulated data with a stated seed. The row of a claim that does not hold in these runs
says so.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from accelcal.io import together
from papers.stakkeland2007.figures import STATEMENTS, Statement, coverage_text, draw, render
from papers.stakkeland2007.filter_consistency import (
    consistency_item,
    convergence_item,
    linear_filters_item,
    robustness_item,
)
from papers.stakkeland2007.models import (
    alignment_item,
    cross_axis_item,
    fourier_item,
    scale_update_item,
    three_axes_item,
)
from papers.stakkeland2007.question import (
    centrifuge_item,
    consider_item,
    mapping_item,
    question_item,
    standard_tests_item,
    tracks_item,
    varying_item,
)
from papers.stakkeland2007.rig import encoder_speed_item, gaps_item, vibration_item
from papers.stakkeland2007.rows import Item, Plan, Row

__all__ = ["Item", "Reproduction", "Row", "render", "reproduce"]

_ITEMS: tuple[Callable[[Plan], Item], ...] = (
    three_axes_item,
    encoder_speed_item,
    alignment_item,
    fourier_item,
    cross_axis_item,
    scale_update_item,
    consistency_item,
    convergence_item,
    robustness_item,
    vibration_item,
    gaps_item,
    question_item,
    varying_item,
    consider_item,
    linear_filters_item,
    standard_tests_item,
    centrifuge_item,
)


@dataclass(frozen=True, slots=True)
class Reproduction:
    """Every item with its rows, and the figures that were written."""

    derived: ClassVar[tuple[str, ...]] = ("holds", "statements")

    quick: bool
    seed: int
    items: tuple[Item, ...]
    figures: tuple[Path, ...]

    @property
    def rows(self) -> tuple[Row, ...]:
        """All rows in order."""
        return tuple(row for item in self.items for row in item.rows)

    @property
    def holds(self) -> int:
        """Number of rows that hold."""
        return sum(row.holds for row in self.rows)

    @property
    def statements(self) -> tuple[Statement, ...]:
        """The paper, statement by statement."""
        return STATEMENTS

    def to_text(self) -> str:
        """Tables, the list of what does not hold, and the paper statement by statement."""
        return render(self.items) + coverage_text()


def reproduce(
    quick: bool = False,
    seed: int = 2007,
    out: Path | None = None,
    *,
    progress: Callable[[str, float], None] | None = None,
) -> Reproduction:
    """Run every item of the paper.

    Parameters
    ----------
    quick : bool
        Fewer and shorter runs of the same experiments: below a minute on two cores, against a few minutes.
    seed : int
        Same seed, same figures, whatever the number of threads.
    out : Path, optional
        Directory for the PNG figures (needs the `plot` extra); created if absent. None draws nothing.
    progress : callable, optional
        Called with the name of the item that was finished and the share of items done.

    Raises
    ------
    ModuleNotFoundError
        `out` was given and matplotlib is not installed.
    """
    if out is not None:
        from accelcal.plots.matplotlib import require

        require()  # before the work, not after it
    plan = Plan(quick, seed, workers=max(1, os.cpu_count() or 1))
    makers: tuple[Callable[[Plan], Any], ...] = (*_ITEMS, mapping_item, tracks_item)  # the last two with their figures
    items: list[Item] = []
    drawn: list[Any] = []
    for make in makers:
        table_made = make(plan)
        item, *more = table_made if isinstance(table_made, tuple) else (table_made,)
        items.append(item)
        drawn += more
        if progress is not None:
            progress(item.name, len(items) / len(makers))
    figures: tuple[Path, ...] = ()
    if out is not None:
        fit, (linear, cubic) = drawn
        with together():
            figures = draw(fit, linear, cubic, out)
    return Reproduction(quick, seed, tuple(items), figures)
