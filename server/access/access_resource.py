"""The resource ``access``: devices and API keys."""

from __future__ import annotations

from server.access.access_desk import Access
from server.access.access_routes import router
from server.access.holder_store import principals
from server.access.pairing import PairingWork, pairing_codes
from server.audit.audit_log import Audit
from server.platform.database.engine import Database
from server.platform.parts import Parts
from server.platform.resource import Resource
from server.platform.settings import Settings


def _access(parts: Parts) -> Access:
    settings = parts[Settings]
    return Access(parts[Database], parts[Audit], settings.access == "required", settings.token_days)


def _pairing(parts: Parts) -> PairingWork:
    work = PairingWork()
    parts.at_close(work.close)
    return work


ACCESS = Resource(
    name="access",
    routers=(router,),
    tables=(principals, pairing_codes),
    provides={Access: _access, PairingWork: _pairing},
)
