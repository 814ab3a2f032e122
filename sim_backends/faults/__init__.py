"""Faults of signals and of nodes, and the files that give their times."""
