"""The audit log: who did what; entries are added, never changed, and chained by hashes."""
