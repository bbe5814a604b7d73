"""Signals: smoothed motion and side channels, and the processing that makes them."""
