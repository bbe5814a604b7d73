"""The report: one page that opens offline and says what a model is worth on a recording, numbers with their origin."""

from accelcal.report.content import Content, gather
from accelcal.report.page import html, light, write
from accelcal.report.pdf import pdf

__all__ = ["Content", "gather", "html", "light", "pdf", "write"]
