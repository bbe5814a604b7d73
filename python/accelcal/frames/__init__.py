"""Results as pandas DataFrames and xarray Datasets."""

from accelcal._support.listing import listing

__dir__ = listing(globals())
