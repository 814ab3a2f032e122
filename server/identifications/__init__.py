"""Identifications: orders that are checked, jobs that fit recordings, and the reports that they leave."""
