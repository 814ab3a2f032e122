"""An OPC UA server that shows what the service says, and takes nothing.

::

    Objects/hilfit/machines/NAME/state/      acquisition, error, and the message's id and timestamp
                               /result/      the last job of the machine that is over
                               /alarms/KIND/ the newest alarm of that kind
                  /service/alarms/KIND/      as before, of the service as a whole

Every field is a variable with a string id (``ns=2;s=machines/lever/state/acquisition``). Variables can be read and
subscribed to. Whatever would change something is refused twice: requests that are not on the list below, whoever
asks, and by the access level of each variable. Beyond this computer there is no server without a certificate and a
user with a password, and then everything is signed and encrypted.
"""

from __future__ import annotations

import asyncio
import hmac
import ipaddress
import threading
from collections import deque
from collections.abc import Mapping
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

import structlog

from daq.messages import Sentence
from server.outward.outward_message import Message
from server.platform.errors import StartError
from server.platform.settings import Settings, is_loopback

if TYPE_CHECKING:
    from asyncua.server.server import Server

NAMESPACE = "urn:hilfit:outward"
#: Its clients find it in the certificate of the server, where that names one.
APPLICATION = "urn:hilfit"
#: Messages that wait for the server; s that starting and stopping it may take; bytes of a request.
WAITING, START_S, STOP_S, LARGEST = 1000, 60.0, 5.0, 2**20
#: All that a session may ask for (OPC UA part 4, without what writes, adds, deletes, calls or registers).
READING = (
    "CreateSession", "ActivateSession", "CloseSession", "CloseSecureChannel", "GetEndpoints", "FindServers", "Read",
    "Browse", "BrowseNext", "TranslateBrowsePathsToNodeIds", "CreateSubscription", "ModifySubscription",
    "DeleteSubscriptions", "CreateMonitoredItems", "ModifyMonitoredItems", "DeleteMonitoredItems", "Publish",
    "Republish", "SetMonitoringMode", "SetPublishingMode",
)  # fmt: skip
_log = structlog.stdlib.get_logger(__name__)


def opcua_server(settings: Settings) -> OpcuaServer | None:
    """Build the server that the settings ask for; None without one.

    Raises
    ------
    StartError
        If the settings cannot be used, would let strangers read, or the extra is not installed.
    """
    if settings.opcua is None:
        return None
    try:
        import asyncua  # noqa: F401  an extra: only whoever has OPC UA clients needs it
    except ImportError:
        raise StartError("server.opcua_needs_extra") from None
    host, _, port = settings.opcua.rpartition(":")
    try:
        ipaddress.ip_address(host.strip("[]"))
        number = int(port)
    except ValueError:
        raise StartError("server.opcua_no_address", address=settings.opcua) from None
    certificate = settings.opcua_cert, settings.opcua_key
    user = settings.opcua_user, settings.password("opcua")
    for pair, names in ((certificate, ["opcua_cert", "opcua_key"]), (user, ["opcua_user", "opcua_password_file"])):
        if any(pair) and not all(pair):
            raise StartError("server.belong_together", names=names)
        if not all(pair) and not is_loopback(host.strip("[]")):
            raise StartError("server.opcua_open", address=settings.opcua, names=names)
    if user[0] is not None and certificate[0] is None:
        raise StartError("server.opcua_password_in_clear")
    return OpcuaServer(host, number, certificate, user)


class OpcuaServer:
    """Takes messages and shows the newest of each place.

    Parameters
    ----------
    port : 0: a free one
    certificate : files of certificate and key (PEM), or None and None
    user : name and password of whoever may read, or None and None: anybody
    """

    def __init__(
        self,
        host: str,
        port: int,
        certificate: tuple[Path | None, Path | None] = (None, None),
        user: tuple[str | None, str | None] = (None, None),
    ) -> None:
        self._host, self.port = host, port
        self._certificate = certificate
        self._user = user
        self._queue: deque[Message] = deque(maxlen=WAITING)
        self._started = threading.Event()
        self._error: Sentence | None = None
        self._loop: asyncio.AbstractEventLoop | None = None
        self._woken: asyncio.Event | None = None
        self._stopping = False
        self._thread = threading.Thread(target=self._run, name="opcua", daemon=True)

    @property
    def url(self) -> str:
        """Address for clients."""
        return f"opc.tcp://{self._host}:{self.port}/hilfit"

    def start(self) -> None:
        """Start serving; StartError if that is not possible."""
        self._thread.start()
        if not self._started.wait(START_S):
            self._error = Sentence("server.opcua_not_started", host=self._host, port=self.port, seconds=START_S)
        if self._error is not None:
            raise StartError(self._error)
        _log.info("opcua_serves", url=self.url)

    def stop(self) -> None:
        """Stop serving; also if it never started."""
        self._stopping = True
        self._wake()
        if self._thread.is_alive():
            self._thread.join(STOP_S)

    def take(self, message: Message) -> None:
        """Show a message soon; never waits."""
        self._queue.append(message)
        self._wake()

    def _wake(self) -> None:
        loop, woken = self._loop, self._woken
        if loop is not None and woken is not None and not loop.is_closed():
            loop.call_soon_threadsafe(woken.set)

    def _run(self) -> None:
        try:
            asyncio.run(self._serve())
        except (OSError, ValueError) as error:  # a port that is taken, a certificate that cannot be read
            reason = " ".join(str(error).split())
            self._error = Sentence("server.opcua_not_served", host=self._host, port=self.port, reason=reason)
        except Exception as error:  # of the library: the service goes on without it
            self._error = Sentence("server.opcua_failed", host=self._host, port=self.port)
            _log.error("opcua_failed", exc_info=error)
        finally:
            self._started.set()

    async def _serve(self) -> None:
        self._loop, self._woken = asyncio.get_running_loop(), asyncio.Event()
        server = await self._made()
        async with server:
            self.port = server.bserver._server.sockets[0].getsockname()[1]  # type: ignore[union-attr]
            tree = _Tree(server, await server.register_namespace(NAMESPACE))
            self._started.set()
            while not self._stopping:
                while self._queue:
                    await tree.show(self._queue.popleft())
                await self._woken.wait()
                self._woken.clear()

    async def _made(self) -> Server:
        from asyncua import ua
        from asyncua.common.connection import TransportLimits
        from asyncua.server.server import Server

        user, (certificate, key) = self._user, self._certificate
        server = Server(user_manager=_readers(*user))
        await server.init()
        await server.set_application_uri(APPLICATION)
        server.set_server_name("hilfit")
        server.set_endpoint(self.url)
        server.limits = TransportLimits(65535, 65535, LARGEST // 65535 + 1, LARGEST)
        policies = [ua.SecurityPolicyType.NoSecurity]
        if certificate is not None and key is not None:
            policies = [
                ua.SecurityPolicyType.Basic256Sha256_SignAndEncrypt,
                ua.SecurityPolicyType.Aes256Sha256RsaPss_SignAndEncrypt,
            ]
            await server.load_certificate(certificate, "pem")
            await server.load_private_key(key, format="pem")
        server.set_security_policy(policies, permission_ruleset=_read_only())
        server.set_identity_tokens([ua.AnonymousIdentityToken if user[0] is None else ua.UserNameIdentityToken])
        server.iserver.register_server = _refuse  # type: ignore[assignment,method-assign]  # it is asked for before any session
        return server


def _refuse(*_: Any) -> None:
    from asyncua import ua

    raise ua.uaerrors.BadServiceUnsupported


def _readers(name: str | None, secret: str | None) -> Any:
    """Define who may read; nobody may do more."""
    from asyncua.crypto.permission_rules import User, UserRole
    from asyncua.server.user_managers import UserManager

    wanted = f"{name}\0{secret}".encode()

    class Readers(UserManager):
        def get_user(
            self, iserver: Any, username: str | None = None, password: str | None = None, certificate: Any = None
        ) -> User | None:
            if name is not None and not hmac.compare_digest(f"{username}\0{password}".encode(), wanted):
                return None
            return User(UserRole.User, username)

    return Readers()


def _read_only() -> Any:
    """Define what may be called: only what reads."""
    from asyncua import ua
    from asyncua.crypto.permission_rules import PermissionRuleset
    from asyncua.ua.object_ids import ObjectIds

    allowed = {ua.NodeId(getattr(ObjectIds, f"{name}Request_Encoding_DefaultBinary")) for name in READING}

    class ReadOnly(PermissionRuleset):
        def check_validity(self, user: Any, action_type_id: Any, body: Any) -> bool:
            return action_type_id in allowed

    return ReadOnly()


class _Tree:
    """The nodes below ``Objects/hilfit``."""

    def __init__(self, server: Server, namespace: int) -> None:
        self._server = server
        self._namespace = namespace
        self._nodes: dict[str, Any] = {}

    async def show(self, message: Message) -> None:
        """Write a message into its place."""
        fields: Mapping[str, Any] = asdict(message.data)
        # Not "id": that of an alarm is another one.
        for name, value in {**fields, "message": message.id, "timestamp": message.timestamp}.items():
            await self._write((*message.place, name), "" if value is None else value)

    async def _write(self, place: tuple[str, ...], value: str | bool | int) -> None:
        key = "/".join(place)
        if key in self._nodes:
            await self._nodes[key].write_value(value)
            return
        folder = await self._folder(place[:-1])
        self._nodes[key] = await folder.add_variable(self._id(key), f"{self._namespace}:{place[-1]}", value)

    async def _folder(self, place: tuple[str, ...]) -> Any:
        key = "/".join(place)
        if key not in self._nodes:
            above = await self._folder(place[:-1]) if place else self._server.nodes.objects
            name = place[-1] if place else "hilfit"
            self._nodes[key] = await above.add_folder(self._id(key or "hilfit"), f"{self._namespace}:{name}")
        return self._nodes[key]

    def _id(self, key: str) -> str:
        return f"ns={self._namespace};s={key}"
