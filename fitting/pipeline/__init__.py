"""From recordings to the report: the stages, their program, the verdict."""
