"""Hostile input: mutated files, absurd arguments, killed runs. Each case is a function of its section and number."""
