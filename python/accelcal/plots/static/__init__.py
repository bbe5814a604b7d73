"""Figures of matplotlib, for paper and mail."""
