"""Languages of `report.html`. A further one is a file like `german.json` and a line in :mod:`.spoken`.

What codes are called stands in `english.json`; `german.json` translates that and all other texts.
"""

from __future__ import annotations

from fitting.report.languages.spoken import ENGLISH, NAMES, Language, codes, content_of, language

__all__ = ["ENGLISH", "NAMES", "Language", "codes", "content_of", "language"]
