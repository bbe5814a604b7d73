"""Simulation: motion of a stage, the paper's sensors, and records drawn from the model of a filter."""
