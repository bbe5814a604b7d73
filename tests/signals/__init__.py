"""Signals: what sampling holds of a motion."""
