"""The report: one page that opens offline and evaluates a model on a recording, with the origin of every number."""

from accelcal._support.listing import listing
from accelcal.report.content import Content, gather
from accelcal.report.page import html, light, write
from accelcal.report.pdf import pdf

__all__ = ["Content", "gather", "html", "light", "pdf", "write"]


__dir__ = listing(globals())
