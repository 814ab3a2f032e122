"""Findings of checks: a mistake or a remark, where it is, and what to do about it."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import yaml

from daq import safe_yaml
from daq.machine.machine_file import Machine
from daq.machine.machine_file_errors import line_of
from daq.messages import Sentence, named, placeholders

#: `mistake`: more likely than any effect of the catalogue. `note`: reported, but harmless.
Severity = Literal["mistake", "note"]


@dataclass(frozen=True)
class Finding:
    """One thing that is wrong, or worth a remark.

    Attributes
    ----------
    code : what it is, as in ``docs/checks.md``
    text : what was seen, one sentence
    cure : what to do, one sentence; empty where the text states it
    joint, channel : where; None where it is not of one
    recording : file that it was seen in; None where it was in all
    severity : ``mistake`` or ``note``
    before, after : misfit (or another number that the text names) as the files are, and with the cure
    unit : of both
    factor : number that was interpreted (a gain, an offset, a delay), if there is one
    says : unit that values look like, where another was declared
    channels : all that it is about, where they are several
    alternatives : what explains the data as well, and cannot be separated by them
    strength : for the order of findings: natural logarithm of how much better the data fit with the cure
    """

    code: str
    text: str
    cure: str
    joint: str | None = None
    channel: str | None = None
    recording: str | None = None
    severity: Severity = "mistake"
    before: float | None = None
    after: float | None = None
    unit: str = ""
    factor: float | None = None
    says: str | None = None
    channels: tuple[str, ...] = ()
    alternatives: tuple[str, ...] = ()
    strength: float = 0.0

    def to_json(self) -> dict[str, Any]:
        """Return plain content."""
        return asdict(self)

    @property
    def line(self) -> str:
        """Text and cure in one line."""
        if not self.cure:
            return self.text
        others = Sentence("fitting.as_well", alternatives=[*self.alternatives]) if self.alternatives else ""
        return Sentence("fitting.finding", text=self.text, others=others, cure=self.cure)


#: What of the values in its texts a finding has as well.
_OWN = frozenset({"joint", "channel", "recording", "before", "after", "unit", "factor", "says"})
#: Values that a trial does not know yet.
_LEFT_OPEN = {"channel": "{channel}", "joint": "{joint}"}


def finding_of(
    key: str,
    *,
    severity: Severity = "mistake",
    alternatives: tuple[str, ...] = (),
    strength: float = 0.0,
    **values: Any,
) -> Finding:
    """Make a finding by the key of its texts; ``values`` fill them, or are the finding's own fields, or both.

    The recording, where it is of one, is named in front.
    """
    own = {name: value for name, value in values.items() if name in _OWN}
    code, text, cure = worded(key, **values)
    text = named(values["recording"], text) if values.get("recording") else text
    return Finding(code, text, cure, severity=severity, alternatives=alternatives, strength=strength, **own)


def worded(key: str, **values: Any) -> tuple[str, Sentence, Sentence]:
    """Return code, text and cure by key, ``code`` or ``code/variant``; a channel or joint without a value is left open.

    Texts are ``fitting.check_<key>`` and ``fitting.check_<key>_cure``.
    """
    code = f"fitting.check_{key.replace('/', '_')}"
    given = _LEFT_OPEN | values
    text, cure = (Sentence(own, **{name: given[name] for name in placeholders(own)}) for own in (code, f"{code}_cure"))
    return key.partition("/")[0], text, cure


def left_open(text: str) -> set[str]:
    """Return which of channel and joint are left open in a text."""
    values = text.values if isinstance(text, Sentence) else {}
    return {name for name, mark in _LEFT_OPEN.items() if values.get(name) == mark}


def says_line(text: object) -> bool:
    """Return whether a text, or one in it, is one of :class:`Places`."""
    if not isinstance(text, Sentence):
        return False
    return text.code in ("fitting.in_line", "fitting.in_lines") or any(map(says_line, text.values.values()))


def filled(text: str, **values: str) -> str:
    """Fill in what was left open in a text."""
    if not isinstance(text, Sentence):
        return text
    return Sentence(text.code, **{**text.values} | {name: own for name, own in values.items() if name in text.values})


@dataclass(frozen=True)
class Places:
    """Lines of a machine file; without a file there are none."""

    file: str = ""
    tree: yaml.Node | None = None

    @classmethod
    def of(cls, path: Path | None) -> Places:
        """Return the places of the file at ``path``; none if it cannot be read."""
        if path is None:
            return cls()
        try:
            return cls(path.name, safe_yaml.read(path.read_text(encoding="utf-8"))[0])
        except (OSError, UnicodeDecodeError, yaml.YAMLError):
            return cls()

    def key(self, location: Sequence[str | int]) -> str:
        """Return `` in machine.yaml line 12`` for a key, or nothing."""
        line = line_of(self.tree, list(location)) if self.tree is not None and location else None
        return Sentence("fitting.in_line", file=self.file, line=line) if line else ""

    def channels(self, machine: Machine, names: Sequence[str]) -> str:
        """Return `` in machine.yaml lines 88 and 89`` for channels, or nothing."""
        numbers = [k for k, channel in enumerate(machine.channels) if channel.name in names]
        lines = [line_of(self.tree, ["channels", k]) for k in numbers] if self.tree is not None else []
        known = [str(line) for line in lines if line]
        if len(known) > 1:
            return Sentence("fitting.in_lines", file=self.file, lines=known)
        return Sentence("fitting.in_line", file=self.file, line=known[0]) if known else ""
