"""Results as people and programs read them: words, tables, data frames."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
