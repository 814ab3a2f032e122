"""The OPC UA server, with the client of another project's making: it shows everything and takes nothing."""

from __future__ import annotations

import asyncio
from collections.abc import Callable, Coroutine, Iterator
from datetime import UTC, datetime, timedelta
from pathlib import Path
from typing import Any

import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import rsa
from cryptography.x509.oid import NameOID
from service_fakes import MACHINE, Fakes, running_service

from server.alarms.alarm_desk import Alarms
from server.machines.machine_desk import MachineDesk
from server.outward.opcua_server import NAMESPACE, OpcuaServer, opcua_server
from server.outward.outward_message import AlarmData, Message, ResultData, StateData
from server.outward.outward_resource import PUBLISHERS
from server.platform.errors import StartError
from server.platform.settings import Settings

asyncua = pytest.importorskip("asyncua", reason="asyncua is not installed: pip install 'hilfit[opcua]'")
from asyncua import Client, ua  # noqa: E402

pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore::DeprecationWarning:asyncua")]
TIME = "2026-03-01T12:00:00.000Z"
SAID = (
    Message("msg-1", "state", "lever", TIME, StateData("waiting", "the bus went away")),
    Message(
        "msg-2", "result", "lever", TIME,
        ResultData("job-1", "identification", "Monday", "done", None, "idn-1", "/api/v1/x", "ambiguous", None, TIME),
    ),
    Message(
        "msg-3", "alarm", None, TIME,
        AlarmData("alarm-1", "disk_full", "little disk", "warning", "active", False, None, None, TIME, None, 3),
    ),
)  # fmt: skip


@pytest.fixture(scope="module")
def serving() -> Iterator[OpcuaServer]:
    server = OpcuaServer("127.0.0.1", 0)
    server.start()
    try:
        for message in SAID:
            server.take(message)
        yield server
    finally:
        server.stop()


def asked(url: str, ask: Callable[[Client], Coroutine[Any, Any, Any]]) -> Any:
    async def run() -> Any:
        async with Client(url, timeout=60) as client:
            return await ask(client)

    return asyncio.run(run())


async def value(client: Client, path: str, wanted: Any) -> Any:
    """The value of a variable, read until it is what is wanted."""
    index = await client.get_namespace_index(NAMESPACE)
    for _ in range(1200):
        try:
            found = await client.get_node(f"ns={index};s={path}").read_value()
        except ua.uaerrors.BadNodeIdUnknown:
            found = None
        if found == wanted:
            break
        await asyncio.sleep(0.05)
    return found


def test_what_was_said_is_shown(serving: OpcuaServer) -> None:
    wanted = {
        "machines/lever/state/acquisition": "waiting",
        "machines/lever/state/error": "the bus went away",
        "machines/lever/result/verdict": "ambiguous",
        "machines/lever/result/error": "",
        "machines/lever/result/message": "msg-2",
        "service/alarms/disk_full/acknowledged": False,
        "service/alarms/disk_full/count": 3,
        "service/alarms/disk_full/timestamp": TIME,
    }

    async def ask(client: Client) -> dict[str, Any]:
        return {path: await value(client, path, expected) for path, expected in wanted.items()}

    assert asked(serving.url, ask) == wanted


def test_a_change_reaches_whoever_subscribed(serving: OpcuaServer) -> None:
    async def ask(client: Client) -> Any:
        heard: asyncio.Queue[Any] = asyncio.Queue()

        class Handler:
            def datachange_notification(self, node: Any, val: Any, data: Any) -> None:
                heard.put_nowait(val)

        serving.take(Message("msg-4", "state", "other", TIME, StateData("starting")))
        assert await value(client, "machines/other/state/acquisition", "starting") == "starting"
        index = await client.get_namespace_index(NAMESPACE)
        subscription = await client.create_subscription(50, Handler())
        await subscription.subscribe_data_change(client.get_node(f"ns={index};s=machines/other/state/acquisition"))
        assert await asyncio.wait_for(heard.get(), 60) == "starting"
        serving.take(Message("msg-5", "state", "other", TIME, StateData("running")))
        return await asyncio.wait_for(heard.get(), 60)

    assert asked(serving.url, ask) == "running"


async def every_node(node: Any, seen: dict[str, Any]) -> dict[str, Any]:
    """All nodes that can be browsed to from one, by id."""
    if node.nodeid.to_string() not in seen:
        seen[node.nodeid.to_string()] = node
        for child in await node.get_children():
            await every_node(child, seen)
    return seen


def test_every_write_to_every_node_is_refused(serving: OpcuaServer) -> None:
    """Of ours and of the server's own nodes, each attribute; refused as a request, whatever stands in it."""

    async def ask(client: Client) -> tuple[int, int]:
        await value(client, "service/alarms/disk_full/count", 3)
        nodes = await every_node(client.nodes.objects, {})
        ours = [id for id in nodes if "s=machines" in id or "s=service" in id]
        refused = 0
        for node in nodes.values():
            for attribute in (ua.AttributeIds.Value, ua.AttributeIds.DisplayName, ua.AttributeIds.UserAccessLevel):
                with pytest.raises((ua.uaerrors.BadUserAccessDenied, ua.uaerrors.BadNotWritable)):
                    await node.write_attribute(attribute, ua.DataValue(ua.Variant("x", ua.VariantType.String)))
                refused += 1
        assert await value(client, "service/alarms/disk_full/count", 3) == 3
        return len(ours), refused

    ours, refused = asked(serving.url, ask)
    assert ours > 30
    assert refused > 3 * ours


def test_our_variables_are_read_only_by_their_own_word(serving: OpcuaServer) -> None:
    """The second bolt: whoever came past the list of requests would find no variable that takes a value."""

    async def ask(client: Client) -> set[tuple[int, int]]:
        await value(client, "service/alarms/disk_full/count", 3)
        nodes = await every_node(client.nodes.objects, {})
        found = set()
        for node in nodes.values():
            if await node.read_node_class() == ua.NodeClass.Variable and node.nodeid.NamespaceIndex >= 2:
                both = ua.AttributeIds.AccessLevel, ua.AttributeIds.UserAccessLevel
                of_all, of_this = [(await node.read_attribute(kind)).Value.Value for kind in both]
                found.add((int(of_all), int(of_this)))
        return found

    assert asked(serving.url, ask) == {(1, 1)}  # CurrentRead and nothing else


def test_whatever_else_changes_something_is_refused(serving: OpcuaServer) -> None:
    denied = (ua.uaerrors.BadUserAccessDenied, ua.uaerrors.BadServiceUnsupported)

    async def ask(client: Client) -> None:
        index = await client.get_namespace_index(NAMESPACE)
        await value(client, "machines/lever/state/acquisition", "waiting")
        folder = client.get_node(f"ns={index};s=machines")
        for attempt in (
            lambda: folder.add_variable(f"ns={index};s=mine", f"{index}:mine", 1),
            lambda: folder.add_folder(f"ns={index};s=mine2", f"{index}:mine2"),
            lambda: client.delete_nodes([folder]),
            lambda: client.nodes.server.call_method("0:GetMonitoredItems", 1),
            lambda: client.register_server(_itself()),
            lambda: folder.add_reference(client.nodes.objects, ua.ObjectIds.Organizes),
        ):
            with pytest.raises(denied):
                await attempt()
        assert await value(client, "machines/lever/state/acquisition", "waiting") == "waiting"

    asked(serving.url, ask)


def _itself() -> Any:
    """What a client's ``register_server`` asks of a server."""

    class Itself:
        def get_application_uri(self) -> str:
            return "urn:stranger"

        product_uri, name, application_type = "urn:stranger", "stranger", ua.ApplicationType.Server
        endpoint = type("Endpoint", (), {"geturl": lambda self: "opc.tcp://127.0.0.1:1"})()

    return Itself()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"opcua": "0.0.0.0:4840"}, "opcua_cert, opcua_key"),
        ({"opcua": "0.0.0.0:4840", "opcua_cert": "a", "opcua_key": "b"}, "opcua_user, opcua_password_file"),
        ({"opcua": "127.0.0.1:4840", "opcua_cert": "a"}, "belong together"),
        ({"opcua": "127.0.0.1:4840", "opcua_user": "a"}, "belong together"),
        ({"opcua": "127.0.0.1:4840", "opcua_user": "a", "opcua_password_file": "{password}"}, "in the clear"),
        ({"opcua": "4840"}, "write 127.0.0.1:4840"),
        ({"opcua": "localhost:4840"}, "write 127.0.0.1:4840"),
        ({"opcua": "127.0.0.1:4840", "opcua_user": "a", "opcua_password_file": "/nowhere"}, "cannot be read"),
    ],
)
def test_settings_that_would_let_strangers_read_are_refused(
    tmp_path: Path, settings: dict[str, str], words: str
) -> None:
    (tmp_path / "password").write_text("secret")
    password = str(tmp_path / "password")
    given: dict[str, Any] = {name: text.replace("{password}", password) for name, text in settings.items()}
    with pytest.raises(StartError, match=words):
        opcua_server(Settings(**given))


def test_a_port_that_is_taken_is_said_in_one_line(serving: OpcuaServer) -> None:
    second = OpcuaServer("127.0.0.1", serving.port)
    with pytest.raises(StartError, match=f"opcua 127.0.0.1:{serving.port}: cannot be served"):
        second.start()
    second.stop()


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> tuple[Path, Path]:
    """A certificate with its key, as OPC UA wants it."""
    key = rsa.generate_private_key(public_exponent=65537, key_size=2048)
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "tests")])
    now = datetime.now(UTC)
    usage = x509.KeyUsage(True, True, True, True, False, False, False, False, False)
    made = (
        x509.CertificateBuilder()
        .subject_name(name)
        .issuer_name(name)
        .public_key(key.public_key())
        .serial_number(1)
        .not_valid_before(now - timedelta(days=1))
        .not_valid_after(now + timedelta(days=1))
        .add_extension(x509.SubjectAlternativeName([x509.UniformResourceIdentifier("urn:hilfit")]), False)
        .add_extension(usage, True)
        .sign(key, hashes.SHA256())
    )
    directory = tmp_path_factory.mktemp("certificate")
    paths = directory / "own.pem", directory / "key.pem"
    paths[0].write_bytes(made.public_bytes(serialization.Encoding.PEM))
    paths[1].write_bytes(
        key.private_bytes(serialization.Encoding.PEM, serialization.PrivateFormat.PKCS8, serialization.NoEncryption())
    )
    return paths


def test_with_a_certificate_nothing_goes_in_the_clear_and_only_the_user_reads(certificate: tuple[Path, Path]) -> None:
    server = OpcuaServer("127.0.0.1", 0, certificate, ("reader", "right"))
    server.start()
    server.take(SAID[0])

    async def read(user: str | None, password: str | None, secure: bool) -> Any:
        client = Client(server.url, timeout=60)
        client.application_uri = "urn:hilfit"
        if secure:
            await client.set_security_string(
                f"Basic256Sha256,SignAndEncrypt,{certificate[0]},{certificate[1]},{certificate[0]}"
            )
        if user is not None:
            client.set_user(user)
            client.set_password(password or "")
        async with client:
            return await value(client, "machines/lever/state/acquisition", "waiting")

    try:
        assert asyncio.run(read("reader", "right", True)) == "waiting"
        for user, password, secure in (
            ("reader", "wrong", True),
            ("other", "right", True),
            (None, None, True),
            ("reader", "right", False),
            (None, None, False),
        ):
            with pytest.raises((ua.uaerrors.UaError, ConnectionError, asyncio.TimeoutError)):
                asyncio.run(read(user, password, secure))
    finally:
        server.stop()


def test_a_service_shows_its_machines_and_alarms(tmp_path: Path) -> None:
    with running_service(tmp_path, Fakes(), opcua="127.0.0.1:0") as running:
        (server,) = running.service[PUBLISHERS]
        assert isinstance(server, OpcuaServer)
        running.service[MachineDesk].upload(MACHINE.encode())
        running.client.put("/api/v1/machines/lever/acquisition", json={"enabled": True})
        running.service[Alarms].report("lever", "overload", "joint1 hit something", "critical", True)

        async def ask(client: Client) -> tuple[Any, Any]:
            return (
                await value(client, "machines/lever/state/acquisition", "running"),
                await value(client, "machines/lever/alarms/overload/state", "active"),
            )

        assert asked(server.url, ask) == ("running", "active")
