"""Frequency response: sensitivity by frequency from sine steps, a sweep or any motion (ISO 16063-11, -21, -41)."""

from accelcal._support.values import listing
from accelcal.response.measure import FrequencyResponse, frequency_response, recorded_reference, stepped_response
from accelcal.response.parametric import ResponseModel, fit_response
from accelcal.response.sine import Point, Reference

__all__ = [
    "FrequencyResponse",
    "Point",
    "Reference",
    "ResponseModel",
    "fit_response",
    "frequency_response",
    "recorded_reference",
    "stepped_response",
]


__dir__ = listing(globals())
