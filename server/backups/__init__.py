"""Backups: everything that cannot be made again, as plain files in a directory of its own."""
