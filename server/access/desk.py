"""Access control of a running service."""

from __future__ import annotations

from collections.abc import Iterable, Sequence

from server.access.machines import Thing, machines_of_jobs, refuse_foreign
from server.access.pairing import Code, PairingCodes
from server.access.principals import LOCAL, Principal, Role
from server.access.store import Holder, Holders
from server.audit import Audit
from server.errors import InvalidError
from server.store import Database, Machines

#: In whose name the code of the first admin is made.
FIRST_START = "first start"


class Access:
    """Who asks, and who may ask.

    Parameters
    ----------
    required : whether a request needs a token; otherwise everybody is :data:`LOCAL`
    """

    def __init__(self, database: Database, audit: Audit, required: bool) -> None:
        self.required = required
        self.holders = Holders(database)
        self._database = database
        self._machines = Machines(database)
        self._codes = PairingCodes(database)
        self._audit = audit

    def principal(self, token: str | None) -> Principal | None:
        """Whom a token stands for; None if it is missing or not known."""
        if not self.required:
            return LOCAL
        holder = None if token is None else self.holders.of_token(token)
        return None if holder is None else holder.principal

    def known(self, token: str) -> Principal | None:
        """Whom a token stands for if it was asked for before; never waits."""
        holder = self.holders.known(token)
        return None if holder is None else holder.principal

    def open_code(self, role: Role, machines: Sequence[str] | None, by: Principal) -> Code:
        """A pairing code for one device; InvalidError if a machine is not there."""
        return self._codes.make(role, self._checked(machines), by.name)

    def pair(self, digits: str, name: str) -> tuple[Holder, str]:
        """Make a device of an open code; the device, and its token, which is shown this once."""
        grant = self._codes.take(digits)
        holder, token = self.holders.add("device", name, grant.role, grant.machines, grant.created_by)
        self._audit.write(holder.principal, "access.pair", holder.id, {"role": holder.role, "by": grant.created_by})
        return holder, token

    def make_key(self, name: str, role: Role, machines: Sequence[str] | None, by: Principal) -> tuple[Holder, str]:
        """A new API key, which is shown this once."""
        return self.holders.add("key", name, role, self._checked(machines), by.name)

    def first_admin(self) -> Code | None:
        """A pairing code if access control is on and nobody could give one yet."""
        if not self.required or self.holders.has_admin():
            return None
        self._codes.withdraw(FIRST_START)  # of a start before, which nobody used: they must not pile up
        return self._codes.make("admin", None, FIRST_START)

    def refuse_foreign(self, principal: Principal, things: Iterable[Thing]) -> None:
        """NotFoundError if a thing belongs to a machine that does not exist for ``principal``."""
        refuse_foreign(self._database, principal, things)

    def machines_of_jobs(self, jobs: Iterable[str]) -> dict[str, str]:
        """The machine of each job."""
        return machines_of_jobs(self._database, jobs)

    def _checked(self, machines: Sequence[str] | None) -> tuple[str, ...] | None:
        if machines is None:
            return None
        for name in machines:
            if not self._machines.versions(name):
                raise InvalidError(f"machines: there is no machine '{name}'; upload its machine file first")
        return tuple(dict.fromkeys(machines))
