"""What sets one run apart from another of the same sensor: when, how mounted, by whom."""

from __future__ import annotations

from dataclasses import dataclass
from datetime import UTC, date, datetime, timedelta

from accelcal._support.errors import AccelcalError
from accelcal.data.units import shown

EPOCH = datetime(1970, 1, 1, tzinfo=UTC)


@dataclass(frozen=True, slots=True)
class RunLabels:
    """Labels of one run; None or empty = not declared."""

    date: float | None = None
    """Days since 1970-01-01 UTC."""
    mounting: str = ""
    """Name of the mounting; runs between which the sensor stayed in place share it."""
    operator: str = ""

    @property
    def day(self) -> str:
        """The date as ISO 8601, with the time where one was declared; empty where nothing was.

        Examples
        --------
        >>> RunLabels(date=20760.0).day, RunLabels(date=20760.5).day
        ('2026-11-03', '2026-11-03 12:00 UTC')
        """
        if self.date is None:
            return ""
        at = EPOCH + timedelta(days=self.date)
        return f"{at:%Y-%m-%d}" if self.date == int(self.date) else f"{at:%Y-%m-%d %H:%M} UTC"


NO_LABELS = RunLabels()


def days_of(found: object) -> float:
    """Days since 1970 of a date, or a date with time, as TOML has them or as ISO 8601; UTC where no zone is given.

    Raises
    ------
    ValueError
        If it is no date.
    """
    if isinstance(found, str):
        try:
            found = datetime.fromisoformat(found)
        except ValueError:
            raise AccelcalError(
                f"found {shown(found)}, expected a date such as 2026-11-03 or 2026-11-03T14:30:00"
            ) from None
    if isinstance(found, datetime):
        at = found if found.tzinfo else found.replace(tzinfo=UTC)
        return (at - EPOCH) / timedelta(days=1)
    if isinstance(found, date):
        return float((found - date(1970, 1, 1)).days)
    raise AccelcalError(f"found {shown(found)}, expected a date such as 2026-11-03 or 2026-11-03T14:30:00")
