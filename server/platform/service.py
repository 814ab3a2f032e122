"""A running service: the parts that its resources declare, and what starts and stops them."""

from __future__ import annotations

import threading
from collections.abc import Mapping, Sequence
from typing import Any

import structlog
from sqlalchemy.exc import SQLAlchemyError

from daq.messages import Sentence
from server.platform.authorization.ownership import Ownership
from server.platform.changes import Changes
from server.platform.database.engine import Database, utc_now
from server.platform.database.idempotency import Replays
from server.platform.database.patience import Patience
from server.platform.errors import UnavailableError
from server.platform.files import DataDirectory
from server.platform.processes.heavy_work import Heavy
from server.platform.resource import TROUBLES, Key, Parts, Resource, providers_of, tables_of
from server.platform.settings import Settings
from server.platform.tls import Certificate, certificate

_log = structlog.stdlib.get_logger(__name__)


class Service(Parts):
    """A running service; call :meth:`start` once, then :meth:`stop`, also when starting failed.

    Parameters
    ----------
    resources : what it is composed of; their routers are tried in this order
    given : parts in the place of what a resource would make; tests put fakes here
    """

    def __init__(
        self, settings: Settings, resources: Sequence[Resource], given: Mapping[Key, Any] | None = None
    ) -> None:
        super().__init__(providers_of(resources))
        self.settings = settings
        self.resources = tuple(resources)
        self.changes = Changes()
        self.files = DataDirectory(settings.data_dir, settings.storage_url, settings.cache_bytes)
        self.replays = Replays()
        try:
            self._open()
            self.put({Service: self, Settings: settings, Changes: self.changes})
            self.put({DataDirectory: self.files, Database: self.database, TROUBLES: {}})
            self.put(given or {})
            self.look_for_damage()
            self.make_all()
            running = [running for resource in resources for running in resource.running(self)]
        except BaseException:
            self.close()
            raise
        self._running = sorted(running, key=lambda entry: entry.phase)

    def _open(self) -> None:
        # Before the database is touched: two servers must not even open one.
        self.entered(self.files.locked())
        self.files.clean()
        place, tables = self.settings.full_database_url or self.files.database, tables_of(self.resources)
        backups = self.settings.backup_dir or self.files.backups
        self.database = Database(
            place,
            tables,
            changed=self.changes.notify,
            backups=backups,
            pause=Patience(threading.Event()).database,
            site=self.settings.site(self.files),
        )
        self.at_close(self.database.close)
        self.entered(self.database.alone())
        self.certificate = certificate(self.settings, self.files, utc_now)
        self.ownership = Ownership(self.database, self.resources)
        self.heavy = Heavy()
        self.at_close(self.heavy.close)

    def start(self) -> None:
        """Start what the resources declare, phase by phase."""
        for running in self._running:
            running.start()
        _log.info("started", data_dir=str(self.files.root), simulate=self.settings.simulate)

    def stop(self) -> None:
        """Stop everything in the opposite order, end every child process, close the store."""
        self.changes.close()
        for running in reversed(self._running):
            running.stop()
        self.close()
        _log.info("stopped")

    def look_for_damage(self) -> None:
        """Look through the store; damage is a trouble, and the service is not ready."""
        self.database.look_for_damage()
        self[TROUBLES].pop("store_damaged", None)
        if self.database.damage is not None:
            self[TROUBLES]["store_damaged"] = Sentence("server.store_damaged", damage=self.database.damage)
            _log.critical("store_damaged", reason=self.database.damage)

    @property
    def fingerprint(self) -> str | None:
        """Fingerprint of the certificate that nothing else vouches for; None without such a one."""
        found: Certificate | None = self.certificate
        return found.fingerprint if found is not None and found.self_made else None

    def now(self) -> str:
        """Return the time as the store writes it."""
        return self.database.now()

    def check(self) -> None:
        """Raise UnavailableError if the store cannot be read, or the data directory not be written."""
        self.files.check()
        if self.database.is_sqlite and not self.files.database.is_file():
            raise UnavailableError("server.store_file_gone")
        if self.database.damage is not None:
            raise UnavailableError("server.store_damaged", damage=self.database.damage)
        try:
            self.database.check()
        except SQLAlchemyError as error:
            _log.error("store_unavailable", exc_info=error)
            raise UnavailableError("server.store_cannot_read") from None
