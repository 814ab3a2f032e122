"""Benchmarks of the model outside its report: exports, their uses, the regressor."""
