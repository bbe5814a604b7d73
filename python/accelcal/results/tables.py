"""Tables by kind of result: importing this module makes all of them known to `table`."""

from accelcal.results import comparisons, diagnoses, parameters, records  # noqa: F401  they register their tables
from accelcal.results.table import table

__all__ = ["table"]
