"""The bus check of an acquired machine: identity, units, mapping, latency, jitter, noise at rest, zero, drift."""
