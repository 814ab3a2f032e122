"""Forecasts of a motion: detection limits, and the next experiment."""
