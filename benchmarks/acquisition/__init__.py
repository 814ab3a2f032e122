"""Benchmarks of acquisition: faults, soak, channels."""
