"""`report.json`, schema `hilfit/report/1`: its definition, its check and its published JSON schema."""

from __future__ import annotations

from fitting.report.schema.definition import SCHEMA, Report, ReportError, clean, json_schema, looked, validate_report
from fitting.report.schema.loop import ResolutionStep

__all__ = ["SCHEMA", "Report", "ReportError", "ResolutionStep", "clean", "json_schema", "looked", "validate_report"]
