"""Benchmarks of the service: tablets, start, identifications per hour."""
