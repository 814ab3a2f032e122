"""Faults of the simulated machine, for training."""
