"""Benchmarks with targets: ``hilfit bench NAME``, in a checkout.

A distribution of its own (``benchmarks/pyproject.toml``) beside hilfit: it sees both sides, the simulated plant and the
fit that must not know it, and nothing of the product sees it. What an option means is in the help of its command; the
function that runs a benchmark takes it by the same name.
"""
