"""The report of an identification: `report.json` for programs, `report.html` for people."""
