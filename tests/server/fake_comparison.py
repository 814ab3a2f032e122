"""A comparison for tests: answers with the table in ``comparison.json`` of the data directory."""

from __future__ import annotations

import json
import sys
from pathlib import Path

if __name__ == "__main__":
    request = Path(sys.argv[1])
    content = json.loads(request.read_text())
    assert set(content) == {"active", "new"}
    print(json.dumps({"summary": json.loads((request.parents[3] / "comparison.json").read_text())}), flush=True)
