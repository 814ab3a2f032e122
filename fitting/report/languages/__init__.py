"""Languages of `report.html`. A further one is a file like `german.json` and a line in :mod:`.spoken`."""

from __future__ import annotations

from fitting.report.languages.spoken import ENGLISH, Language, codes, content_of, language

__all__ = ["ENGLISH", "Language", "codes", "content_of", "language"]
