"""One-time codes that a person reads from one screen and types into another.

What protects ten digits: a code lives for minutes, each address may guess once in six seconds, all guesses are tried
one after the other against Argon2id hashes, and whoever steals the store finds only those. A stranger's wrong guesses
void nobody's code: only as many as no stranger makes from one place do.
"""

from __future__ import annotations

import io
import secrets
from collections.abc import Callable
from dataclasses import dataclass
from datetime import timedelta
from typing import Annotated

import argon2
import segno
import sqlalchemy as sa

from server.platform.authorization.principals import Role
from server.platform.database.engine import Database, later
from server.platform.database.stored import Kept, Stored
from server.platform.errors import ForbiddenError, TooManyError
from server.platform.processes.heavy_work import Heavy

LIFETIME = timedelta(minutes=15)
DIGITS = 10
#: Wrong codes that a code survives, sixty times what one address can send in its life. With :data:`MOST_OPEN` codes
#: the chance that one of so many guesses hits is 5 in a million, which is what six digits and five guesses had.
MOST_FAILURES = 10_000
#: Codes that are open at once; each makes a guess more likely, and each costs a hash per attempt.
MOST_OPEN = 5
#: OWASP's second choice for Argon2id: 19 MiB, two passes, about 30 ms.
HASHER = argon2.PasswordHasher(time_cost=2, memory_cost=19_456, parallelism=1)


class PairingCode(Stored, table="pairing_codes"):
    """An open pairing code, and the token that it is exchanged for.

    ``days``: that the device's token is good for. ``failures``: wrong codes that came while it was open.
    """

    id: Annotated[str, Kept(key=True)]
    code_hash: str  # Argon2id: digits are soon tried with a quick hash
    role: Role
    machines: tuple[str, ...] | None
    created_by: str
    expires: str
    failures: int = 0
    days: int | None


pairing_codes = PairingCode.table


@dataclass(frozen=True)
class Code:
    """An open pairing code; ``digits`` is known only to whoever made it."""

    digits: str
    role: Role
    machines: tuple[str, ...] | None
    expires: str


class PairingWork(Heavy):
    """Hashes codes, which takes long: one after the other, and not in the threads that answer reads."""

    def __init__(self) -> None:
        super().__init__(slots=1, places=16, share=4)


class PairingCodes:
    """Makes and takes codes."""

    def __init__(
        self, database: Database, digits: Callable[[], str] = lambda: f"{secrets.randbelow(10**DIGITS):0{DIGITS}}"
    ) -> None:
        self._database = database
        self._digits = digits

    def make(self, role: Role, machines: tuple[str, ...] | None, created_by: str, days: int | None = None) -> Code:
        """Make a code for a device with a token for ``days``; TooManyError if :data:`MOST_OPEN` are open."""
        digits, now = self._digits(), self._database.now()
        new = PairingCode(
            id=f"pair-{secrets.token_hex(8)}",
            code_hash=HASHER.hash(digits),
            role=role,
            machines=machines,
            created_by=created_by,
            expires=later(now, LIFETIME),
            days=days,
        )
        with self._database.write() as connection:
            connection.execute(pairing_codes.delete().where(_closed(now)))
            if connection.execute(sa.select(sa.func.count()).select_from(pairing_codes)).scalar_one() >= MOST_OPEN:
                raise TooManyError("server.pairing_codes_open", most_open=MOST_OPEN)
            connection.execute(pairing_codes.insert().values(**new.columns()))
        return Code(digits, role, machines, new.expires)

    def withdraw(self, created_by: str) -> None:
        """Close the open codes that were made in this name."""
        with self._database.write() as connection:
            connection.execute(pairing_codes.delete().where(pairing_codes.c.created_by == created_by))

    def take(self, digits: str) -> PairingCode:
        """Use a code up.

        Raises
        ------
        ForbiddenError
            If no open code is this one. Every open code counts that as a failure.
        """
        now = self._database.now()
        with self._database.read() as connection:
            rows = connection.execute(sa.select(pairing_codes).where(sa.not_(_closed(now)))).all()
        found = [row for row in rows if _is(row.code_hash, digits)]  # outside a transaction: hashing takes its time
        with self._database.write() as connection:
            for row in found:
                # Whoever deletes the row has the code; of two at once only one does.
                mine = pairing_codes.delete().where(pairing_codes.c.id == row.id, sa.not_(_closed(now)))
                if connection.execute(mine).rowcount == 1:
                    return PairingCode.read(row)
            connection.execute(pairing_codes.update().values(failures=pairing_codes.c.failures + 1))
        # Raised after the transaction: raised within, it would undo the count.
        raise ForbiddenError("server.no_open_pairing_code")


def pairing_url(base: str, digits: str, fingerprint: str | None = None) -> str:
    """Build the address of the page that pairs; the code, behind ``#``, reaches no server, log or referrer.

    Parameters
    ----------
    fingerprint : SHA-256 of the certificate, where nothing else vouches for it
    """
    return f"{base}/#pair={digits}" + (f"&sha256={fingerprint}" if fingerprint is not None else "")


def qr_svg(text: str) -> str:
    """Draw a QR code as an SVG element that a page can hold."""
    buffer = io.BytesIO()
    segno.make(text, error="m").save(buffer, kind="svg", xmldecl=False, svgns=True, scale=4, border=4, light="white")
    return buffer.getvalue().decode()


def qr_text(text: str) -> str:
    """Draw a QR code for a terminal."""
    buffer = io.StringIO()
    segno.make(text, error="m").terminal(buffer, compact=True)
    return buffer.getvalue()


def _closed(now: str) -> sa.ColumnElement[bool]:
    return sa.or_(pairing_codes.c.expires <= now, pairing_codes.c.failures >= MOST_FAILURES)


def _is(hashed: str, digits: str) -> bool:
    try:
        return HASHER.verify(hashed, digits)
    except argon2.exceptions.VerifyMismatchError:
        return False
