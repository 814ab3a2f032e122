"""Principals who ask, and what each may do."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Literal

Role = Literal["viewer", "operator", "engineer", "admin"]
Scope = Literal["read", "operate", "engineer", "admin"]
Kind = Literal["device", "key", "local", "service"]
#: Each role may do what those before it may.
ROLES: tuple[Role, ...] = ("viewer", "operator", "engineer", "admin")
#: The least role that each scope asks for.
LEAST_ROLE: dict[Scope, Role] = {"read": "viewer", "operate": "operator", "engineer": "engineer", "admin": "admin"}


@dataclass(frozen=True)
class Principal:
    """Whoever a request comes from.

    Attributes
    ----------
    id, name : the id never comes again, the name is for people
    role : what it may do, see :data:`LEAST_ROLE`
    machines : names of the only machines that exist for it; None: all
    kind : paired device, API key, this computer without access control, or the service itself
    """

    id: str
    name: str
    role: Role
    machines: tuple[str, ...] | None
    kind: Kind

    def may(self, scope: Scope) -> bool:
        """Test whether the role is enough for ``scope``."""
        return ROLES.index(self.role) >= ROLES.index(LEAST_ROLE[scope])

    def may_see(self, machine: str | None) -> bool:
        """Test whether a machine exists for it; what belongs to no machine is for those who see all."""
        return self.machines is None or machine in self.machines

    def visible(self, by_machine: dict[str, Any]) -> dict[str, Any]:
        """Return the entries of the machines that exist for it."""
        return {name: value for name, value in by_machine.items() if self.may_see(name)}


#: Without access control: whoever is at this computer.
LOCAL = Principal("local", "local", "admin", None, "local")
#: What the service does by itself: schedules, policies, recovery.
SERVICE = Principal("service", "service", "admin", None, "service")
