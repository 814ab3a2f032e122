"""Mistakes that may have been made, and the trials that take each back on an arm that could exist."""
