"""Lines of keys in a machine file, for findings that name them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import yaml

from daq import safe_yaml
from daq.machine.machine_file import Machine
from daq.machine.machine_file_errors import line_of
from daq.messages import Sentence


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
