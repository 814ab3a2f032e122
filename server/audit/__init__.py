"""Who did what: a table to which rows are only added, each with a hash of itself and of the row before."""

from server.audit.log import Audit, Entry, Verification

__all__ = ["Audit", "Entry", "Verification"]
