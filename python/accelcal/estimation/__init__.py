"""Estimation: one recording through the replay, and Gauss-Newton over all of them."""
