"""`python -m accelcal.effects > docs/effects.md`"""

from accelcal.effects import HOUSE, cards

print(cards(HOUSE), end="")
