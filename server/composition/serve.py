"""``hilfit serve``: one process that serves HTTP on this computer and starts all others."""

from __future__ import annotations

import signal
import socket
import sys
from collections.abc import Callable, Mapping
from types import FrameType
from typing import Any, NoReturn

import structlog
import uvicorn

from server.access.access_desk import Access
from server.access.pairing import pairing_url
from server.composition.app import create_app
from server.composition.declarations import RESOURCES
from server.platform import logs
from server.platform.errors import StartError
from server.platform.files import private_files
from server.platform.http.http_limits import BoundedHttp
from server.platform.processes.precedence import take_precedence
from server.platform.resource import Key
from server.platform.service import Service
from server.platform.settings import Settings, refuse_open_host

#: Seconds that open requests have to end when the service stops.
GRACE_S = 5
SIGNALS = (signal.SIGTERM, signal.SIGINT)
_log = structlog.stdlib.get_logger(__name__)


class _Server(uvicorn.Server):
    """Reports when it listens, and ends event streams as soon as it is ordered to stop.

    Open streams would hold it for the whole time of grace.
    """

    def __init__(self, config: uvicorn.Config, service: Service, ready: Callable[[], None]) -> None:
        super().__init__(config)
        self._service = service
        self._ready = ready

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """Start listening."""
        await super().startup(sockets)
        if self.started:
            self._ready()

    def handle_exit(self, sig: int, frame: FrameType | None) -> None:
        """Handle SIGTERM or SIGINT."""
        self._service.changes.close()
        super().handle_exit(sig, frame)


def serve(settings: Settings, ready: Callable[[str], None], given: Mapping[Key, Any] | None = None) -> None:
    """Serve until SIGTERM or SIGINT.

    Parameters
    ----------
    ready : called with the service's URL once it listens
    given : parts in the place of what is installed

    Raises
    ------
    StartError
        If the address is not of this computer only, or taken; or the data directory cannot be used.
    """
    refuse_open_host(settings)
    private_files()
    take_precedence()
    logs.configure()
    # uvicorn handles signals while it runs and raises them again when it is done; our children still have to
    # be ended then.
    for number in SIGNALS:
        signal.signal(number, _interrupt)
    with _listen(settings.host, settings.port) as listening:
        port = listening.getsockname()[1]
        url = settings.local_url(port)
        service = Service(settings, RESOURCES, given)
        try:
            service.start()
            tls = service.certificate
            config = uvicorn.Config(
                create_app(service),
                http=BoundedHttp,
                ssl_certfile=None if tls is None else tls.path,
                ssl_keyfile=None if tls is None else tls.key,
                log_config=None,
                access_log=False,
                # Nobody is believed who says for whom they ask, not even at this computer, unless they are named.
                proxy_headers=bool(settings.trusted_proxies),
                forwarded_allow_ips=list(settings.trusted_proxies),
                timeout_graceful_shutdown=GRACE_S,
                server_header=False,
                ws_max_size=4096,  # nothing that a client says is read
                ws_per_message_deflate=False,  # twenty clients are twenty times the work, for a few kB/s
            )
            _log.info("listening", url=url)
            first = service[Access].first_admin()

            def listens() -> None:
                ready(url)
                if first is not None:
                    address = pairing_url(settings.public_url(port), first.digits, service.fingerprint)
                    print(f"pair the first admin with {first.digits} within 15 minutes: {address}", file=sys.stderr)

            _Server(config, service, listens).run(sockets=[listening])
        except KeyboardInterrupt:
            _log.info("stopping")
        finally:
            # A second signal must not leave children behind; stopping takes a bounded time.
            for number in SIGNALS:
                signal.signal(number, signal.SIG_IGN)
            service.stop()


def _interrupt(_number: int, _frame: FrameType | None) -> NoReturn:
    raise KeyboardInterrupt


def _listen(host: str, port: int) -> socket.socket:
    # The protocol has to be named: asyncio switches Nagle's algorithm off only where it sees that this is TCP. Else
    # every answer on a kept connection waits 40 ms for an acknowledgement.
    family = socket.AF_INET6 if ":" in host else socket.AF_INET
    listening = socket.socket(family, socket.SOCK_STREAM, socket.IPPROTO_TCP)
    listening.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
    try:
        listening.bind((host, port))
    except OSError as error:
        listening.close()
        raise StartError("server.port_not_free", port=port, host=host, reason=error.strerror) from None
    return listening
