"""Results as people and programs read them: words, tables, data frames."""

from accelcal._support.values import listing

__dir__ = listing(globals())
