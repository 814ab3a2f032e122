"""Recordings: files of any form read, checked, resampled and written."""
