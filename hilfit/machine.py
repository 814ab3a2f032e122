"""Machine files."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from daq.machine.machine_file import Machine as MachineFile
from daq.machine.machine_file import load_machine


@dataclass(frozen=True, repr=False)
class Machine:
    """A machine as its file describes it.

    Attributes
    ----------
    path : the file
    content : what it says, validated
    """

    path: Path
    content: MachineFile

    @classmethod
    def load(cls, path: str | Path) -> Machine:
        """Read a machine file.

        Parameters
        ----------
        path : of the YAML file

        Raises
        ------
        InputError
            With one line: file, line, key, what is wrong and what to do.
        """
        return cls(Path(path), load_machine(path))

    def __repr__(self) -> str:
        return f"Machine({self.name}: {', '.join(self.joints)})"

    @property
    def name(self) -> str:
        """Its name."""
        return self.content.name

    @property
    def joints(self) -> tuple[str, ...]:
        """Names of its joints, base to tip."""
        return tuple(joint.name for joint in self.content.joints)
