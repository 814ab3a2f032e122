"""The commands below ``hilfit bench``, each benchmark's own options."""
