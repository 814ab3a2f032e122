"""Access control of a running service."""

from __future__ import annotations

from collections.abc import Sequence

from server.access.connections import Connections
from server.access.holder_store import Holder, Holders
from server.access.pairing import Code, PairingCodes
from server.access.rates import Rate, Rates
from server.audit.audit_resource import Audit
from server.machines.machine_store import Machines
from server.platform.authorization.principals import LOCAL, Principal, Role
from server.platform.database.engine import Database
from server.platform.errors import ForbiddenError, InvalidError

#: In whose name the code of the first admin is made.
FIRST_START = "first start"
#: Failed pairings that get an entry each in the audit log; of those beyond the next entry says how many.
FAILURES = Rate(1 / 30, 30)


class Access:
    """Identifies the sender of a request and what that sender may ask.

    Parameters
    ----------
    required : whether a request needs a token; otherwise everybody is :data:`LOCAL`
    days : that a token is good for, unless who makes it says another number
    """

    def __init__(self, database: Database, audit: Audit, required: bool, days: int | None = None) -> None:
        self.required = required
        self.connections = Connections()
        self.holders = Holders(database, self.connections.end)
        self._days = days
        self._failures = Rates()
        self._unnoted = 0
        self._database = database
        self._machines = Machines(database)
        self._codes = PairingCodes(database)
        self._audit = audit

    def principal(self, token: str | None) -> Principal | None:
        """Return the principal of a token; None if it is missing or not known."""
        if not self.required:
            return LOCAL
        holder = None if token is None else self.holders.of_token(token)
        return None if holder is None else holder.principal

    def known(self, token: str) -> Principal | None:
        """Return the principal of a token asked for before; never wait."""
        holder = self.holders.known(token)
        return None if holder is None else holder.principal

    def expires(self, token: str) -> str | None:
        """Return when a token that is known expires; None if never."""
        holder = self.holders.known(token)
        return None if holder is None else holder.expires

    def now(self) -> str:
        """Return the time as the store writes it."""
        return self._database.now()

    def open_code(self, role: Role, machines: Sequence[str] | None, by: Principal, days: int | None = None) -> Code:
        """Open a pairing code for one device; InvalidError if a machine is not there."""
        return self._codes.make(role, self._checked(machines), by.name, days or self._days)

    def pair(self, digits: str, name: str, address: str = "") -> tuple[Holder, str]:
        """Make a device of an open code; the device, and its token, which is shown this once.

        Raises
        ------
        ForbiddenError
            If no open code is this one; the audit log has it, with the ``address`` that it came from.
        """
        try:
            grant = self._codes.take(digits)
        except ForbiddenError:
            self._note_failure(address, name)
            raise
        holder, token = self.holders.add("device", name, grant.role, grant.machines, grant.created_by, grant.days)
        self._audit.write(holder.principal, "access.pair", holder.id, {"role": holder.role, "by": grant.created_by})
        return holder, token

    def _note_failure(self, address: str, name: str) -> None:
        """Write it into the log, which is never shortened: who floods it finds that it only counts."""
        if self._failures.wait("failures", FAILURES):
            self._unnoted += 1
            return
        more, self._unnoted = self._unnoted, 0
        detail = {"name": name} | ({"more_before": more} if more else {})
        self._audit.write("nobody", "access.pair_failed", address, detail)

    def make_key(
        self, name: str, role: Role, machines: Sequence[str] | None, by: Principal, days: int | None = None
    ) -> tuple[Holder, str]:
        """Make a new API key, which is shown this once."""
        return self.holders.add("key", name, role, self._checked(machines), by.name, days or self._days)

    def first_admin(self) -> Code | None:
        """Open a pairing code if access control is on and nobody could give one yet."""
        if not self.required or self.holders.has_admin():
            return None
        self._codes.withdraw(FIRST_START)  # of a start before, which nobody used: they must not pile up
        return self._codes.make("admin", None, FIRST_START, self._days)

    def _checked(self, machines: Sequence[str] | None) -> tuple[str, ...] | None:
        if machines is None:
            return None
        for name in machines:
            if not self._machines.versions(name):
                raise InvalidError("server.machines_no_machine", name=name)
        return tuple(dict.fromkeys(machines))
