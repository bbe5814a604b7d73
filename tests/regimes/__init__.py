"""Honest records of every kind of rig, with exact motion: the product must name nothing that is not there."""
