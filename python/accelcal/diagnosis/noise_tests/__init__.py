"""Noise tests: effects that act on noise, each tested with a stated null."""
