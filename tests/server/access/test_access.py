"""Pairing, tokens, keys, limits of rate, host names: who is let in, and for how long."""

from __future__ import annotations

from collections.abc import Iterator
from datetime import timedelta
from pathlib import Path

import pytest
from access_fakes import Clock, Guarded, guarded_service
from service_fakes import API

from server.access.access_desk import Access
from server.access.pairing import DIGITS, MOST_FAILURES, MOST_OPEN, PairingCodes, pairing_codes, pairing_url
from server.access.rates import Rate, Rates
from server.audit.audit_resource import Audit
from server.composition.declarations import TABLES
from server.platform.authorization.principals import SERVICE
from server.platform.database.engine import Database
from server.platform.errors import ForbiddenError, TooManyError

ACCESS = f"{API}/access"


@pytest.fixture(scope="module")
def guarded(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Guarded]:
    with guarded_service(tmp_path_factory.mktemp("data")) as service:
        yield service


@pytest.fixture
def clock() -> Clock:
    return Clock()


@pytest.fixture
def database(tmp_path: Path, clock: Clock) -> Iterator[Database]:
    found = Database(tmp_path / "store.sqlite", TABLES, clock=clock, changed=lambda: None)
    yield found
    found.close()


def numbered(*digits: str) -> Iterator[str]:
    yield from digits


@pytest.mark.slow
def test_a_device_is_paired_once_and_then_known(guarded: Guarded) -> None:
    order = {"role": "operator", "machines": ["lever"]}
    made = guarded.client.post(f"{ACCESS}/pairing-codes", json=order, headers=guarded.bearer("admin"))
    assert made.status_code == 201, made.text
    code = made.json()["code"]
    assert made.json()["url"] == f"http://127.0.0.1:8350/#pair={code}"
    assert made.json()["qr_svg"].startswith("<svg")
    assert made.headers["cache-control"] == "no-store"

    paired = guarded.client.post(f"{ACCESS}/pair", json={"code": code, "name": "tablet"})
    assert paired.status_code == 201, paired.text
    headers = {"Authorization": f"Bearer {paired.json()['token']}"}
    me = guarded.client.get(f"{ACCESS}/me", headers=headers).json()
    assert me == paired.json()["principal"]
    assert (me["name"], me["role"], me["machines"], me["kind"]) == ("tablet", "operator", ["lever"], "device")
    assert guarded.client.post(f"{ACCESS}/pair", json={"code": code, "name": "second"}).status_code == 403

    removed = guarded.client.delete(f"{ACCESS}/devices/{me['id']}", headers=guarded.bearer("admin"))
    assert removed.status_code == 204
    assert guarded.client.get(f"{ACCESS}/me", headers=headers).status_code == 401


def test_a_key_is_shown_once_and_is_worth_nothing_after_it_was_revoked(guarded: Guarded) -> None:
    admin = guarded.bearer("admin")
    made = guarded.client.post(f"{ACCESS}/keys", json={"name": "historian", "role": "viewer"}, headers=admin)
    key = made.json()["key"]
    headers = {"Authorization": f"Bearer {key}"}
    assert guarded.client.get(f"{API}/machines", headers=headers).status_code == 200
    shown = guarded.client.get(made.headers["location"], headers=admin).text
    listed = guarded.client.get(f"{ACCESS}/keys", headers=admin).text
    assert "historian" in shown and "historian" in listed
    assert key not in shown + listed
    assert guarded.client.delete(made.headers["location"], headers=admin).status_code == 204
    assert guarded.client.get(f"{API}/machines", headers=headers).status_code == 401


def test_no_secret_is_in_the_store(guarded: Guarded) -> None:
    token = guarded.bearer("viewer")["Authorization"].removeprefix("Bearer ")
    code = guarded.running.service[Access].open_code("viewer", None, SERVICE)
    content = guarded.running.service.files.database.read_bytes()
    assert token.encode() not in content
    assert f'"{code.digits}"'.encode() not in content
    assert b"$argon2id$" in content
    guarded.running.service[Access].pair(code.digits, "used up")


def test_refusals_are_problem_documents_that_say_what_to_do(guarded: Guarded) -> None:
    unknown = guarded.client.get(f"{API}/machines")
    assert unknown.status_code == 401
    assert unknown.headers["www-authenticate"].startswith("Bearer")
    assert unknown.headers["content-type"] == "application/problem+json"
    assert "pair this device" in unknown.json()["detail"]
    low = guarded.client.get(f"{ACCESS}/devices", headers=guarded.bearer("viewer"))
    assert low.status_code == 403
    assert "needs the role admin" in low.json()["detail"]


def test_a_machine_that_is_not_there_cannot_be_bound_to(guarded: Guarded) -> None:
    order = {"role": "viewer", "machines": ["nowhere"]}
    answer = guarded.client.post(f"{ACCESS}/pairing-codes", json=order, headers=guarded.bearer("admin"))
    assert answer.status_code == 422
    assert "'nowhere'" in answer.json()["detail"]


def test_the_last_admin_stays(database: Database) -> None:
    access = Access(database, Audit(database), required=True)
    first, _ = access.make_key("first", "admin", None, SERVICE)
    from server.platform.errors import ConflictError

    with pytest.raises(ConflictError, match="last admin"):
        access.holders.remove(first.id, "key")
    access.make_key("second", "admin", None, SERVICE)
    access.holders.remove(first.id, "key")


@pytest.mark.slow
def test_the_first_start_has_a_code_for_an_admin_until_there_is_one(database: Database) -> None:
    access = Access(database, Audit(database), required=True)
    for _ in range(MOST_OPEN + 1):  # started again and again
        code = access.first_admin()
    assert code is not None and code.role == "admin"
    access.pair(code.digits, "tablet of the first admin")
    assert access.first_admin() is None
    assert Access(database, Audit(database), required=False).first_admin() is None


def test_a_code_expires(database: Database, clock: Clock) -> None:
    codes = PairingCodes(database)
    code = codes.make("viewer", None, "somebody")
    clock.now += timedelta(minutes=15)
    with pytest.raises(ForbiddenError):
        codes.take(code.digits)


@pytest.mark.slow
def test_wrong_pairing_codes_do_not_invalidate_the_code_of_another(database: Database) -> None:
    """One address may send 155 in the life of a code (five at once, then one in six seconds)."""
    codes = PairingCodes(database, lambda: "1111111111")
    codes.make("operator", ("lever",), "somebody")
    with database.write() as connection:
        connection.execute(pairing_codes.update().values(failures=155))
    for _ in range(5):
        with pytest.raises(ForbiddenError):
            codes.take("0000000000")
    grant = codes.take("1111111111")
    assert (grant.role, grant.machines, grant.created_by) == ("operator", ("lever",), "somebody")


def test_many_wrong_codes_void_every_open_code(database: Database) -> None:
    assert MOST_FAILURES * MOST_OPEN / 10**DIGITS < 1e-5
    codes = PairingCodes(database, lambda: "1111111111")
    codes.make("viewer", None, "somebody")
    with database.write() as connection:
        connection.execute(pairing_codes.update().values(failures=MOST_FAILURES - 1))
    with pytest.raises(ForbiddenError):
        codes.take("0000000000")
    with pytest.raises(ForbiddenError):
        codes.take("1111111111")


@pytest.mark.slow
def test_codes_that_are_open_at_once_are_few(database: Database, clock: Clock) -> None:
    codes = PairingCodes(database)
    for _ in range(MOST_OPEN):
        codes.make("viewer", None, "somebody")
    with pytest.raises(TooManyError):
        codes.make("viewer", None, "somebody")
    clock.now += timedelta(minutes=15)
    codes.make("viewer", None, "somebody")


def test_the_code_in_an_address_reaches_no_server() -> None:
    assert pairing_url("http://10.0.0.1:8350", "012345").partition("#")[2] == "pair=012345"


@pytest.mark.slow
def test_buckets_let_a_burst_through_and_then_the_rate() -> None:
    now = 0.0
    rates = Rates(lambda: now)
    rate = Rate(2.0, 3)
    assert [rates.wait("a", rate) for _ in range(4)] == [0, 0, 0, 1]
    assert rates.wait("b", rate) == 0, "each name has a bucket of its own"
    now = 0.5
    assert [rates.wait("a", rate) for _ in range(2)] == [0, 1]
    now = 1000.0
    assert [rates.wait("a", rate) for _ in range(4)] == [0, 0, 0, 1], "it does not fill beyond the burst"
