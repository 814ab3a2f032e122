"""Benchmarks with targets: ``hilfit bench NAME``, in a checkout.

A distribution of its own (``benchmarks/pyproject.toml``) beside hilfit: it sees both sides, the simulated plant and the
fit that must not know it, and nothing of the product sees it.
"""
