"""Excitations: motions that are designed for a machine, in a process of their own."""
