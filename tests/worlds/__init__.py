"""Independent worlds: simulated rigs with hidden effects, to try the product on.

Nothing here imports the product or shares a formula with it. `World` -> `record()` -> `write(directory)`; `strength`
says how strong a hidden effect is (`d2`) and sets it (`at_d`).
"""

from .beyond import BEYOND
from .catalogue import CATALOGUE, Effect
from .motion import MOTIONS
from .outside import FAULTS, OUTSIDE
from .scene import Scene
from .strength import at_d, d2, signatures
from .world import EFFECTS, SENSORS, Hidden, Nuisances, Record, World

__all__ = [
    "BEYOND",
    "CATALOGUE",
    "EFFECTS",
    "FAULTS",
    "MOTIONS",
    "OUTSIDE",
    "SENSORS",
    "Effect",
    "Hidden",
    "Nuisances",
    "Record",
    "Scene",
    "World",
    "at_d",
    "d2",
    "signatures",
]
