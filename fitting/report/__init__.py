"""The report of an identification: `report.json` for programs, `report.html` for people."""

from __future__ import annotations

from fitting.report.html import write_report
from fitting.report.model import Course, Figures, FrictionCurve, Scatter
from fitting.report.presented import presented
from fitting.report.schema import ReportError, clean, json_schema, looked, validate_report

__all__ = [
    "Course",
    "Figures",
    "FrictionCurve",
    "ReportError",
    "Scatter",
    "clean",
    "json_schema",
    "looked",
    "presented",
    "validate_report",
    "write_report",
]
