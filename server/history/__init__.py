"""The history of a machine: what was changed, found and wrong, as one time line."""
