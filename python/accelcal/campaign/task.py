"""The task of a campaign: a function known by name, its parameters as text, and a batch of runs in whatever process."""

from __future__ import annotations

import hashlib
import importlib
import inspect
import json
import os
import traceback
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from accelcal._core import __version__
from accelcal.campaign.store import CampaignError, Outcome

Item = np.random.SeedSequence | str | os.PathLike[str]

PARAMETERS_LIMIT = 65_536
"""Characters of JSON; parameters beyond that are data."""


@dataclass(frozen=True, slots=True)
class Task:
    """What every run of a campaign does; a few lines of text, so it costs nothing to send."""

    function: str
    """`module:name`."""
    source: str
    """SHA-256 of the function's source."""
    parameters: str
    """JSON, keys sorted."""

    @classmethod
    def of(cls, function: Callable[..., Any], parameters: Mapping[str, Any]) -> Task:
        """Describe a function and its parameters.

        Raises
        ------
        CampaignError
            If another process could not import the function, or the parameters are not small JSON.
        """
        module, name = (getattr(function, part, None) for part in ("__module__", "__qualname__"))
        if module in (None, "__main__") or name is None or not name.isidentifier():
            raise CampaignError(
                f"{name or function!r} of {module} cannot be imported by a worker. Write the task as a function at the "
                "top of a file of its own, and import it from there."
            )
        try:
            text = json.dumps(dict(parameters), sort_keys=True, allow_nan=False)
        except (TypeError, ValueError) as error:
            raise CampaignError(
                f"parameters: {error}. Expected finite numbers, text, lists and dicts; write data to a file and "
                "pass its path."
            ) from None
        if len(text) > PARAMETERS_LIMIT:
            raise CampaignError(
                f"parameters: {len(text)} characters of JSON, {PARAMETERS_LIMIT} are allowed. Write data to a file and "
                "pass its path."
            )
        return cls(f"{module}:{name}", _digest(function), text)

    @property
    def identity(self) -> dict[str, str]:
        """What must be equal for results in one file."""
        return {
            "function": self.function,
            "source": self.source,
            "parameters": self.parameters,
            "version": __version__,
        }

    def found(self) -> Callable[..., Mapping[str, float]]:
        """The function, imported here.

        Raises
        ------
        CampaignError
            If its source is not the one that the campaign was started with.
        """
        module, _, name = self.function.partition(":")
        function: Callable[..., Mapping[str, float]] = getattr(importlib.import_module(module), name)
        if _digest(function) != self.source:
            raise CampaignError(
                f"{self.function} in process {os.getpid()} is not the function that the campaign was started with. "
                "Start the workers again, with the same files."
            )
        return function


def compute(task: Task, batch: Sequence[tuple[int, Item]]) -> list[Outcome]:
    """Outcomes of some runs, in this process."""
    function, parameters = task.found(), json.loads(task.parameters)
    return [_outcome(function, parameters, run, item) for run, item in batch]


def label(item: Item) -> str:
    """An item as text: `entropy:key` of a seed, a path as it was given."""
    if not isinstance(item, np.random.SeedSequence):
        return os.fspath(item)
    return f"{item.entropy}:{'.'.join(map(str, item.spawn_key))}"


def _outcome(
    function: Callable[..., Mapping[str, float]], parameters: Mapping[str, Any], run: int, item: Item
) -> Outcome:
    given = np.random.default_rng(item) if isinstance(item, np.random.SeedSequence) else Path(item)
    try:
        values = {str(name): float(value) for name, value in function(given, **parameters).items()}
    except Exception as error:
        return Outcome(run, label(item), {}, "".join(traceback.format_exception_only(error)).strip())
    return Outcome(run, label(item), values, None)


def _digest(function: Callable[..., Any]) -> str:
    """SHA-256 of a function's source; of nothing where it is compiled."""
    try:
        source = inspect.getsource(function)
    except (OSError, TypeError):
        source = ""
    return hashlib.sha256(source.encode()).hexdigest()
