"""Validation: a fitted model against a recording."""
