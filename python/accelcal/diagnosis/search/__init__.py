"""Search: which effects of the catalogue explain what a model leaves."""
