"""The report of an identification: `report.json` for programs, `report.html` for people."""

from __future__ import annotations

from fitting.report.html import write_report
from fitting.report.presented import presented
from fitting.report.schema.definition import looked

__all__ = ["looked", "presented", "write_report"]
