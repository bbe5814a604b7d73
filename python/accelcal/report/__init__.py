"""Reports: one page that opens offline, or a PDF, on a model and a recording, or on two calibrations of one sensor."""

from accelcal._support.values import listing
from accelcal.calibration.agreement import Agreement, agreement
from accelcal.report.content import AxesContent, Content, gather
from accelcal.report.page import agreement_html, agreement_pdf, html, light, pdf, write

__all__ = [
    "Agreement",
    "AxesContent",
    "Content",
    "agreement",
    "agreement_html",
    "agreement_pdf",
    "gather",
    "html",
    "light",
    "pdf",
    "write",
]


__dir__ = listing(globals())
