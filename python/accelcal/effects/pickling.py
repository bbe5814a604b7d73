"""Effects in pickles and copies: by name, as in model files; no code travels."""

from __future__ import annotations

import copyreg
from collections.abc import Callable
from pickle import PicklingError

from accelcal.effects.processes import find
from accelcal.effects.registry import CATALOGUE, Effect


def by_name(effect: Effect) -> tuple[Callable[[str], Effect], tuple[str]]:
    """What a pickle of an effect holds: its name, under which the reader's catalogue has it.

    Raises
    ------
    PicklingError
        If the catalogue has no such effect, or another one of that name.
    """
    if CATALOGUE.get(effect.name) is not effect:
        raise PicklingError(
            f"the effect {effect.name} is not the one in the catalogue; enter it with @accelcal.effect or "
            "accelcal.load_effects, here and where it is read"
        )
    return find, (effect.name,)


copyreg.pickle(Effect, by_name)  # copies of an effect are the effect itself
