"""The resource ``audit``: who did what."""

from __future__ import annotations

from server.audit.audit_log import Audit
from server.audit.audit_routes import router
from server.audit.audit_tables import audit_log
from server.platform.database.engine import Database
from server.platform.resource import Resource

AUDIT = Resource(
    name="audit",
    routers=(router,),
    tables=(audit_log,),
    provides={Audit: lambda parts: Audit(parts[Database])},
)
