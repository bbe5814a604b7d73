"""`python -m accelcal.effects > docs/effects.md`"""

from accelcal.effects import BUILT_IN, cards

print(cards(BUILT_IN), end="")
