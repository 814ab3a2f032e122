"""Faults of signals and of nodes, and the files that say when they come."""
