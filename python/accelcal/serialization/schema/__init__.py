"""Schemas of the files and results that are written as JSON. Importing one of its files imports pydantic."""
