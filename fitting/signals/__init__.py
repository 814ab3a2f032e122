"""Measured signals: filters, preparation, spectra."""
