"""Validation: dead reckoning against integrators of its own and closed forms."""
