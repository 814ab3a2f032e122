"""Which terms are missing: one criterion, a search, a gate."""
