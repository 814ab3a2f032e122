"""Benchmarks with targets: ``hilfit bench NAME``.

They stand in `server` because it is the one package that may see both sides: the simulated plant, and the fit that must
not know it.
"""
