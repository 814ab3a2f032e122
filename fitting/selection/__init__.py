"""Choice of the terms that are missing: one criterion, a search, a gate."""
