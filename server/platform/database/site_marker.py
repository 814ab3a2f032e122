"""The site's marker: a file beside the store that knows which store is this site's, and how far its audit log came.

A store that was emptied, replaced or set back looks like any other; only what stands outside of it can tell. The file
is ``site.json`` in the data directory: the store's id, and number and hash of the last audit entry.
"""

from __future__ import annotations

import json
import threading
from dataclasses import dataclass
from pathlib import Path

from daq.messages import Sentence
from daq.whole_files import write_whole
from server.platform.errors import StartError

MARKER_FILE = "site.json"


@dataclass(frozen=True)
class Noted:
    """Content of the marker; ``number`` 0 and no hash: of no audit entry yet."""

    store: str
    number: int = 0
    hash: str = ""


class SiteMarker:
    """The marker of one data directory.

    Parameters
    ----------
    new_store : whether the administrator wants another store in the place of the one that was there
    """

    def __init__(self, root: Path, backups: Path, new_store: bool = False) -> None:
        self._root = root
        self._backups = backups
        self._new_store = new_store
        self._path = root / MARKER_FILE
        self._lock = threading.Lock()

    def read(self) -> Noted | None:
        """Read it; None if there is none. StartError if it has nothing readable."""
        try:
            return Noted(**json.loads(self._path.read_bytes()))
        except FileNotFoundError:
            return None
        except (OSError, ValueError, TypeError) as error:
            raise StartError("server.site_not_readable", path=self._path, error=error, cure=self._cure()) from None

    def refuse_emptied(self, name: str) -> None:
        """Raise StartError if a new store would be made where a site has been."""
        used = self._path.exists() or any(
            path.is_file() for folder in ("machines", "recordings", "identifications") for path in self._files(folder)
        )
        if used and not self._new_store:
            raise StartError("server.site_without_store", store=name, root=self._root, cure=self._cure())

    def claim(self, store: str, name: str) -> None:
        """Note which store this site has; StartError if it had another one."""
        known = None if self._new_store else self.read()
        if known is None:
            self._write(Noted(store))
        elif known.store != store:
            raise StartError("server.site_other_store", store=name, cure=self._cure())

    def note(self, number: int, hash: str) -> None:
        """Note how far the audit log has come; another process may have come farther."""
        with self._lock:
            known = self.read()
            if known is not None and known.number < number:
                self._write(Noted(known.store, number, hash))

    def forget(self) -> None:
        """Take whatever store is there at the next start: one was put there on purpose."""
        self._path.unlink(missing_ok=True)

    def _files(self, folder: str) -> list[Path]:
        return [path for path in (self._root / folder).rglob("*") if not path.name.startswith(".")]

    def _write(self, noted: Noted) -> None:
        write_whole(self._path, json.dumps(vars(noted)).encode())

    def _cure(self) -> Sentence:
        newest = max(self._backups.glob("*Z/manifest.json"), default=None)
        if newest is None:
            return Sentence("server.cure_some_backup")
        return Sentence("server.cure_newest_backup", backup=newest.parent)
