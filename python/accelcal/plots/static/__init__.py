"""Figures of matplotlib, for paper and mail."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
