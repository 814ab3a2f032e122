"""Models of small arms with known parameters, and sessions that they are handed over from."""

from __future__ import annotations

import sys
from pathlib import Path

# Arms, motions and recordings are those of the tests of the identification.
sys.path.insert(0, str(Path(__file__).parents[1] / "fitting"))
