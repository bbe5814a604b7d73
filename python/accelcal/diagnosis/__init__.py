"""Diagnosis: which physical effect a model lacks."""
