"""A user's effect as it is passed on, to a worker or into a session file: its formula, never code."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from accelcal.app.session_content import Formula
from accelcal.effects import Own, from_expression
from accelcal.effects.formula import from_tried_expression


@dataclass(frozen=True, slots=True)
class OwnFormula:
    """What `accelcal.effects.from_expression` needs to make the effect again."""

    name: str
    expression: str
    unit: str
    port: Literal["output", "position"]
    channels: tuple[str, ...] = ()
    """Side channels that the formula uses."""

    @classmethod
    def of(cls, own: Own) -> OwnFormula:
        """The formula of an effect that is in the catalogue."""
        effect = own.effect
        return cls(effect.name, own.expression, effect.unit, effect.port, effect.needs)  # type: ignore[arg-type]

    @classmethod
    def of_stored(cls, stored: Formula) -> OwnFormula:
        """What a session file holds."""
        return cls(stored.name, stored.expression, stored.unit, stored.port, tuple(stored.channels))

    @property
    def stored(self) -> Formula:
        """As a session file holds it."""
        return Formula(
            name=self.name, expression=self.expression, unit=self.unit, port=self.port, channels=list(self.channels)
        )

    def try_out(self) -> None:
        """Evaluate the effect on ordinary motions, and enter it.

        Raises
        ------
        ExpressionError
            If the name is taken, anything in it is not allowed, or it is constant or not finite.
        """
        from_expression(self.name, self.expression, unit=self.unit, port=self.port, channels=self.channels)

    def enter(self) -> Own:
        """Enter the effect into the catalogue, without evaluating it; a second time changes nothing.

        Raises
        ------
        ExpressionError
            If the name is taken or anything in it is not allowed.
        """
        return from_tried_expression(self.name, self.expression, unit=self.unit, port=self.port, channels=self.channels)
