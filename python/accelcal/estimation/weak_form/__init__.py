"""The weak form of the regression: rows from smooth test functions of compact support (derivations 6.15)."""
