"""Results as pandas DataFrames and xarray Datasets."""
