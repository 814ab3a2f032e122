"""Share of the data directory that hosts have in common: one folder or object store, with files named by their content.

Alone, a service needs none: every file is where it was written (:class:`DataFolder`). With ``storage_url`` whoever
makes a file that another host needs puts it there, and whoever needs one that is not in its own data directory fetches
it into a cache (:class:`SharedStorage`). Which content is meant the database says, by its SHA-256: nothing else is
taken, so a copy that broke off, or a file that somebody changed, is never read.
"""

from __future__ import annotations

import os
import secrets
import shutil
from collections.abc import Collection, Mapping
from contextlib import suppress
from pathlib import Path
from typing import Any

from daq.whole_files import digest_of, replacing
from server.platform.errors import InvalidError, StartError, UnavailableError

#: Storage without folders, by fsspec's names: to make one would be to make a bucket, of a name that was mistyped.
BUCKETS = frozenset({"s3", "s3a", "gs", "gcs", "az", "abfs", "abfss"})
#: Names the store that a storage belongs to.
IDENTITY = "identity"
#: s after which a connection to an object store counts as lost, and how often it is tried.
TIMEOUTS = {"connect_timeout": 5, "read_timeout": 20, "retries": {"max_attempts": 2}}


class StorageAwayError(UnavailableError):
    """The storage cannot be reached or written at the moment."""


class DataFolder:
    """The files of a data directory that all who need them see: nothing has to travel."""

    #: Whether hosts see it that do not see the data directory.
    shared = False

    def __init__(self, root: Path) -> None:
        self.root = root

    def check(self, store: str) -> str | None:
        """Explain why this cannot be used for the store of that identity, in one line; None if it can."""
        found = self._identity()
        if found == store:
            return None
        what = "is no data directory of a server" if found is None else "is the data directory of another store"
        return f"{self.root}: {what}; give workers on other hosts the server's storage_url"

    def claim(self, store: str) -> None:
        """Mark it as a store's; whose data directory it is, holds its lock."""
        (self.root / IDENTITY).write_text(store, encoding="utf-8")

    def put(self, path: Path, key: str) -> None:
        """Let other hosts find a file."""

    def local(self, wanted: Mapping[str, str]) -> dict[str, Path]:
        """Return where the files at some paths are here, by path, given the SHA-256 of each.

        Raises
        ------
        StorageAwayError
            If one cannot be fetched now.
        InvalidError
            If what is there is not what was meant.
        """
        return {key: self.root / key for key in wanted}

    def keep(self, directory: Path, folder: str) -> dict[str, str]:
        """Let other hosts find all files of a directory; SHA-256 by name below it. Nothing where all see them."""
        return {}

    def bring(self, directory: Path, folder: str, files: Mapping[str, str]) -> None:
        """Make a directory here of what :meth:`keep` gave, unless it is here."""

    def tidy(self, folder: str, keep: Collection[str]) -> None:
        """Remove what was kept in a folder but for some SHA-256."""

    def forget(self, sha256: str) -> None:
        """Remove an input for other hosts; nothing happens if it is not there, or the storage is not."""

    def __str__(self) -> str:
        return str(self.root)

    def _identity(self) -> str | None:
        try:
            return (self.root / IDENTITY).read_text(encoding="utf-8")
        except FileNotFoundError:
            return None


class SharedStorage(DataFolder):
    """Files at a URL, and a cache of them here.

    Parameters
    ----------
    url : ``s3://bucket/folder``, ``file:///mount/folder``, or whatever else fsspec knows
    cache_bytes : that fetched files may take; what was used last stays

    Raises
    ------
    StartError
        If there is nothing installed for such a URL, or it names no folder.
    """

    shared = True

    def __init__(self, url: str, root: Path, cache_bytes: int) -> None:
        super().__init__(root)
        self._url = url.rstrip("/")
        self._cache, self._cache_bytes = root / "cache", cache_bytes
        if not self._url.startswith("/") and "://" not in self._url:  # else fsspec takes it for a relative path
            raise StartError("server.storage_no_folder", url=url)
        try:
            from fsspec.core import url_to_fs  # an extra: only whoever shares needs it

            s3 = {"config_kwargs": TIMEOUTS} if self._url.startswith("s3") else {}
            # Listings are not remembered: another host writes there too.
            found: tuple[Any, str] = url_to_fs(self._url, use_listings_cache=False, skip_instance_cache=True, **s3)
        except (ImportError, ValueError) as error:
            reason = " ".join(str(error).split())
            raise StartError("server.storage_not_usable", url=url, reason=reason) from None
        self._files, self._base = found
        kinds = self._files.protocol
        self._has_folders = not BUCKETS & set([kinds] if isinstance(kinds, str) else kinds)

    def check(self, store: str) -> str | None:
        """Check as for a folder, and whether it can be reached."""
        try:
            found = self._identity()
        except StorageAwayError as error:
            return str(error)
        if found == store:
            return None
        what = "no server has used it yet" if found is None else "belongs to another store than the database"
        return f"{self}: {what}; give the server and its workers the same storage_url"

    def claim(self, store: str) -> None:
        """Mark it as a store's; StartError if it is another's, StorageAwayError if that cannot be read."""
        found = self._identity()
        if found is None:
            super().claim(store)
            self.put(self.root / IDENTITY, IDENTITY)
        elif found != store:
            raise StartError("server.storage_other_store", storage=self, file=IDENTITY)

    def put(self, path: Path, key: str) -> None:
        """Put a file there unless one of its size is; StorageAwayError if it cannot be reached or written."""
        target = f"{self._base}/{key}"
        try:
            if self._size(target) == path.stat().st_size:
                return
            if not self._has_folders:  # an object is there whole or not at all
                self._files.put_file(str(path), target)
                return
            self._files.makedirs(target.rpartition("/")[0], exist_ok=True)
            # Under another name first: a copy that broke off must not be taken for the file.
            partial = f"{target}.{secrets.token_hex(4)}.partial"
            self._files.put_file(str(path), partial)
            self._files.mv(partial, target)
        except Exception as error:  # each kind of storage has errors of its own
            raise self._away(key, error) from None

    def local(self, wanted: Mapping[str, str]) -> dict[str, Path]:
        """Return files of the data directory, or of the cache, which is filled; fetch one that was changed."""
        found: dict[str, Path] = {}
        for key, sha256 in wanted.items():
            own = self.root / key
            if own.is_file() and digest_of(own) == sha256:
                found[key] = own
                continue
            found[key] = self._cache / sha256 / Path(key).name
            if not found[key].is_file():
                self._fetch(input_key(sha256), sha256, found[key])
            os.utime(found[key].parent)
        self._bound(wanted.values())
        return found

    def keep(self, directory: Path, folder: str) -> dict[str, str]:
        """Put every file there under its SHA-256; what earlier stages left is there already."""
        files = {str(path.relative_to(directory)): path for path in sorted(directory.rglob("*")) if path.is_file()}
        sums = {name: digest_of(path) for name, path in files.items()}
        for name, sha256 in sums.items():
            self.put(files[name], f"{folder}/{sha256}")
        return sums

    def bring(self, directory: Path, folder: str, files: Mapping[str, str]) -> None:
        """Fetch what is not here; the directory is there whole or not at all."""
        if directory.is_dir() or not files:
            return
        partial = directory.with_name(f".{directory.name}.{secrets.token_hex(4)}")
        try:
            for name, sha256 in files.items():
                self._fetch(f"{folder}/{sha256}", sha256, partial / name)
            with suppress(FileExistsError):  # somebody else was quicker
                partial.rename(directory)
        finally:
            shutil.rmtree(partial, ignore_errors=True)

    def tidy(self, folder: str, keep: Collection[str]) -> None:
        """Remove what no result needs; what cannot be removed now remains."""
        with suppress(Exception):
            for place in self._files.ls(f"{self._base}/{folder}", detail=False):
                if str(place).rpartition("/")[2] not in keep:
                    self._files.rm_file(place)

    def forget(self, sha256: str) -> None:
        """Remove one."""
        with suppress(Exception):
            self._files.rm_file(f"{self._base}/{input_key(sha256)}")

    def __str__(self) -> str:
        return f"storage_url {self._url}"

    def _identity(self) -> str | None:
        try:
            return str(self._files.cat_file(f"{self._base}/{IDENTITY}").decode())
        except FileNotFoundError:
            return None
        except Exception as error:  # each kind of storage has errors of its own
            raise self._away(IDENTITY, error) from None

    def _fetch(self, key: str, sha256: str, path: Path) -> None:
        with replacing(path) as partial:
            try:
                self._files.get_file(f"{self._base}/{key}", str(partial))
            except Exception as error:  # each kind of storage has errors of its own
                raise self._away(key, error) from None
            if digest_of(partial) != sha256:
                raise InvalidError("server.not_stored_sha_differs", key=key, url=self._url)

    def _bound(self, needed: Collection[str]) -> None:
        """Remove what was used longest ago from the cache until it is within its bound; what is needed remains."""
        kept = sorted(self._cache.glob("*"), key=lambda path: path.stat().st_mtime, reverse=True)
        total = 0
        for place in kept:
            total += sum(path.stat().st_size for path in place.iterdir())
            if total > self._cache_bytes and place.name not in needed:
                shutil.rmtree(place, ignore_errors=True)

    def _size(self, place: str) -> int | None:
        try:
            return int(self._files.info(place)["size"])
        except FileNotFoundError:
            return None

    def _away(self, key: str, error: Exception) -> StorageAwayError:
        reason = " ".join(f"{type(error).__name__}: {error}".split())[:200]
        return StorageAwayError("server.storage_url_cannot_reached", url=self._url, key=key, reason=reason)


def input_key(sha256: str) -> str:
    """Return an input's key by its content, for a file of the data directory may be written again."""
    return f"inputs/{sha256}"
