"""Recordings on storage that hosts share: a directory, or S3, by the URL of fsspec.

The server keeps every recording as a local file. With ``recordings_url`` it also puts those that a job needs there
before the job is queued, so a worker needs no access to the server's recordings: it fetches what a stage reads into a
scratch directory of its own, checks the hash that the store knows, and removes it when the stage is over.
"""

from __future__ import annotations

import hashlib
import secrets
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

from server.platform.errors import StartError, UnavailableError
from server.recordings.recording_store import RecordingRow

#: Storage without folders, by fsspec's names: to make one would be to make a bucket, of a name that was mistyped.
BUCKETS = frozenset({"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss"})


class SharedRecordings:
    """Recordings at a URL.

    Parameters
    ----------
    url : ``s3://bucket/folder``, ``file:///mount/folder``, or whatever else fsspec knows

    Raises
    ------
    StartError
        If there is nothing installed for such a URL, or it names no folder.
    """

    def __init__(self, url: str) -> None:
        self._url = url.rstrip("/")
        if not self._url.startswith("/") and "://" not in self._url:  # else fsspec takes it for a relative path
            raise StartError(f"recordings_url {url}: names no folder; write s3://bucket/folder or file:///mount/folder")
        try:
            from fsspec.core import url_to_fs  # an extra: only whoever shares needs it

            found: tuple[Any, str] = url_to_fs(self._url)
        except (ImportError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise StartError(
                f"recordings_url {url}: cannot be used ({reason}); install hilfit[s3], or what fsspec needs for it"
            ) from None
        self._files, self._root = found
        kinds = self._files.protocol
        self._has_folders = not BUCKETS & set([kinds] if isinstance(kinds, str) else kinds)

    def put(self, row: RecordingRow, path: Path) -> bool:
        """Put a sealed recording there unless it is there already; whether it had to be.

        Raises
        ------
        UnavailableError
            If the storage cannot be reached or written.
        """
        target = self._place(row)
        try:
            if self._size(target) == row.bytes:
                return False
            if not self._has_folders:  # an object is there whole or not at all
                self._files.put_file(str(path), target)
                return True
            self._files.makedirs(self._root, exist_ok=True)
            # Under another name first: a copy that broke off must not be taken for a recording.
            partial = f"{target}.{secrets.token_hex(4)}.partial"
            self._files.put_file(str(path), partial)
            self._files.mv(partial, target)
            return True
        except Exception as error:  # each kind of storage has errors of its own
            raise self._unavailable(row, error) from None

    def remove(self, row: RecordingRow) -> None:
        """Remove a recording; nothing happens if it is not there, or the storage is not."""
        with suppress(Exception):
            self._files.rm_file(self._place(row))

    @contextmanager
    def fetched(self, rows: Sequence[RecordingRow], scratch: Path) -> Iterator[dict[str, Path]]:
        """Local copies of recordings, by id, in a directory below ``scratch`` that is gone afterwards.

        Raises
        ------
        UnavailableError
            If one cannot be fetched, or is not what the store says.
        """
        directory = scratch / secrets.token_hex(8)
        directory.mkdir(parents=True)
        try:
            found = {}
            for row in rows:
                path = directory / f"{row.id}.{row.format}"
                try:
                    self._files.get_file(self._place(row), str(path))
                except Exception as error:  # each kind of storage has errors of its own
                    raise self._unavailable(row, error) from None
                with path.open("rb") as file:
                    digest = hashlib.file_digest(file, "sha256").hexdigest()
                if digest != row.sha256:
                    raise UnavailableError(
                        f"recording '{row.id}' at {self._url} is not what was recorded (its SHA-256 differs); "
                        "remove it there and order again"
                    )
                found[row.id] = path
            yield found
        finally:
            shutil.rmtree(directory, ignore_errors=True)

    def _place(self, row: RecordingRow) -> str:
        return f"{self._root}/{row.id}.{row.format}"

    def _size(self, place: str) -> int | None:
        try:
            return int(self._files.info(place)["size"])
        except FileNotFoundError:
            return None

    def _unavailable(self, row: RecordingRow, error: Exception) -> UnavailableError:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return UnavailableError(f"recordings_url {self._url}: recording '{row.id}' cannot be reached ({reason})")
