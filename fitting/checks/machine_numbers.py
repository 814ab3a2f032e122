"""Numbers of the machine file that are hardly meant, whatever was recorded: degrees, millimetres, slipped decimals.

They are the doubts of ``hilfit machine check``; here each becomes a mistake where the number enters an identification,
and a note where it does not (limits, ranges).
"""

from __future__ import annotations

from typing import Any

from daq.machine.machine_file import Machine, machine_content
from daq.machine.plausible import Doubt, doubts
from fitting.checks.findings import Finding
from fitting.checks.places import Places

#: Last key of a number that enters an identification, and what the mistake is called.
_ENTER = {
    "gravity": "gravity",
    "a": "length",
    "d": "length",
    "alpha": "axis",
    "theta": "offset",
    "bore": "bore",
    "rod": "rod",
}
#: Above the misfits' strengths: nothing that efforts tell is worth a word while the file itself cannot be right.
_STRENGTH = 9.5


def machine_findings(machine: Machine, places: Places) -> list[Finding]:
    """Findings on the machine file alone."""
    content = machine_content(machine)
    found = list(doubts(content))
    bores = {doubt.place[:-1] for doubt in found if doubt.place[-1] == "bore"}
    # A rod is only compared with its bore.
    kept = [doubt for doubt in found if doubt.place[-1] != "rod" or doubt.place[:-1] not in bores]
    return [_finding(content, doubt, places) for doubt in kept]


def _finding(content: dict[str, Any], doubt: Doubt, places: Places) -> Finding:
    code = "linkage" if "linkage" in doubt.place else _ENTER.get(str(doubt.place[-1]))
    joint = content["joints"][doubt.place[1]]["name"] if doubt.place[0] == "joints" else None
    key = ".".join(str(part) for part in doubt.place if part != "joints" and not isinstance(part, int))
    return Finding(
        code or "machine_file",
        f"{joint + ': ' if joint else ''}{key}: {doubt.text}",
        doubt.cure + places.key(doubt.place),
        joint=joint,
        severity="mistake" if code and not doubt.slight else "note",
        strength=_STRENGTH if code and not doubt.slight else 0.0,
    )
