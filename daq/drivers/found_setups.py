"""Set-ups of CANopen nodes before commissioning changed them, kept in the data directory until they are restored.

One JSON file per node, ``found/<machine>/<bus>-<node>.json``: the objects as they were found and as they were written,
as hexadecimal bytes, little endian. A node that is found as it was left keeps its file; one that somebody else has
changed since is a new find, and the file before is kept beside it.
"""

from __future__ import annotations

import contextlib
import json
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path

from daq.errors import CommissioningError
from daq.machine.buses import object_of
from daq.whole_files import replacing

Objects = Mapping[tuple[int, int], bytes]
FOLDER = "found"
SCHEMA = "hilfit/found/1"


@dataclass(frozen=True)
class FoundSetup:
    """One node.

    Attributes
    ----------
    found, wrote : its objects before and after commissioning, in the order in which they were read
    identity : objects that tell whether it is the same device
    state : NMT state by its heartbeat when it was found, -1 if it sent none
    """

    found: Objects
    wrote: Objects
    identity: Objects
    state: int = -1


class FoundSetups:
    """The files of one machine."""

    def __init__(self, data_directory: Path, machine: str) -> None:
        self.folder = data_directory / FOLDER / machine

    def path(self, bus: str, node: int) -> Path:
        """Return the path of a node's file, existing or not."""
        return self.folder / f"{bus}-{node}.json"

    def keep(self, bus: str, node: int, setup: FoundSetup) -> None:
        """Keep what a node was like, before it is changed.

        Raises
        ------
        CommissioningError
            If it cannot be kept: then nothing may be written to the node.
        """
        path = self.path(bus, node)
        try:
            before = self.read(bus, node)
            if before is not None:
                if all(setup.found.get(key) == value for key, value in before.wrote.items()):
                    return  # as we left it: what is kept is what it was like before
                path.replace(path.with_suffix(f".{datetime.now(UTC):%Y%m%dT%H%M%S%f}.json"))
            with replacing(path) as temporary:
                temporary.write_text(json.dumps(_content(setup), indent=1) + "\n", encoding="utf-8")
        except OSError as error:
            raise CommissioningError(
                "daq.found_not_kept", bus=bus, node=node, path=path, reason=error.strerror
            ) from None

    def leads(self, bus: str, nodes: Iterable[int]) -> None:
        """Record that these nodes will be made operational: known to whoever finds them after we were killed."""
        with contextlib.suppress(OSError):
            self.folder.mkdir(parents=True, exist_ok=True)
            self._mark(bus).write_text(" ".join(str(node) for node in sorted(nodes)) + "\n", encoding="utf-8")

    def started(self, bus: str) -> frozenset[int]:
        """Read the nodes that an earlier run made operational and did not put back."""
        try:
            return frozenset(int(word) for word in self._mark(bus).read_text(encoding="utf-8").split())
        except (OSError, ValueError):
            return frozenset()

    def left(self, bus: str) -> None:
        """Record that the nodes were put back to their found state."""
        with contextlib.suppress(OSError):
            self._mark(bus).unlink(missing_ok=True)

    def _mark(self, bus: str) -> Path:
        return self.folder / f"{bus}.started"

    def read(self, bus: str, node: int) -> FoundSetup | None:
        """Read what is kept of a node; None if nothing is, or nothing usable."""
        try:
            content = json.loads(self.path(bus, node).read_text(encoding="utf-8"))
            found, wrote, identity = (
                {object_of(key): bytes.fromhex(value) for key, value in content[name].items()}
                for name in ("found", "wrote", "identity")
            )
            return FoundSetup(found, wrote, identity, int(content["state"]))
        except FileNotFoundError:
            return None
        except (ValueError, KeyError, TypeError, AttributeError):
            return None

    def put_back(self, bus: str, node: int) -> None:
        """Rename the file of a node that is again what it was."""
        path = self.path(bus, node)
        path.replace(path.with_suffix(".restored"))


def _content(setup: FoundSetup) -> dict[str, object]:
    parts = {name: getattr(setup, name) for name in ("found", "wrote", "identity")}
    return {
        "schema": SCHEMA,
        "utc": datetime.now(UTC).isoformat(),
        "state": setup.state,
        **{
            name: {f"0x{index:04X}:{subindex}": data.hex() for (index, subindex), data in objects.items()}
            for name, objects in parts.items()
        },
    }
