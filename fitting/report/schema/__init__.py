"""`report.json`, schema `hilfit/report/1`: its definition, its check and its published JSON schema."""
