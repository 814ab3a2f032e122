"""Publishes at a broker what the service says: retained, so that who subscribes later knows it too.

====================================  ======================================================================
topic, below the prefix               payload
====================================  ======================================================================
``online``                            ``true``; ``false`` when the service has ended (by the last will, if it broke off)
``machines/NAME/state``               the newest message of that type
``machines/NAME/result``              the last job of the machine that is over
``machines/NAME/alarms/KIND``         the newest alarm of that kind, also when it was acknowledged or is cleared
``service/alarms/KIND``               as before, of the service as a whole
====================================  ======================================================================

A thread of its own sends one message after another, at least once (QoS 1), in their order. While the broker is away the
newest :data:`WAITING` wait; whenever it comes back it gets all that is in the topics again.
"""

from __future__ import annotations

import secrets
import ssl
import threading
from collections import deque
from typing import TYPE_CHECKING, Any
from urllib.parse import quote, urlsplit

import structlog

from server.outward.outward_message import Message
from server.outward.webhook_post import receivers_tls
from server.platform.errors import StartError
from server.platform.settings import Settings, is_loopback

if TYPE_CHECKING:
    from paho.mqtt.client import Client

#: Messages that wait for a broker; the oldest goes first. What stands in the topics at last is not lost with it.
WAITING = 1000
#: s: sign of life, longest pause before the next attempt to connect, and a look whether to stop.
KEEPALIVE_S, LONGEST_PAUSE_S, LOOK_S = 30, 60, 0.5
LEAVING_S = 2.0
_PORTS = {"mqtt": 1883, "mqtts": 8883}
_log = structlog.stdlib.get_logger(__name__)


def mqtt_publisher(settings: Settings) -> MqttPublisher | None:
    """Build the publisher that the settings ask for; None without one.

    Raises
    ------
    StartError
        If the settings cannot be used, or the extra is not installed.
    """
    if settings.mqtt_url is None:
        return None
    try:
        parts = urlsplit(settings.mqtt_url)
        host, port = parts.hostname or "", parts.port or _PORTS[parts.scheme]
        if not host or "@" in parts.netloc or parts.path.strip("/") or parts.query or parts.fragment:
            raise ValueError
    except (ValueError, KeyError):
        # It is not repeated: somebody may have written a password into it.
        raise StartError("server.mqtt_no_broker") from None
    password = settings.password("mqtt")
    if (settings.mqtt_user is None) != (password is None):
        raise StartError("server.belong_together", names=["mqtt_user", "mqtt_password_file"])
    if settings.mqtt_user is not None and parts.scheme == "mqtt" and not is_loopback(host):
        raise StartError("server.mqtt_password_in_clear")
    return MqttPublisher(
        host,
        port,
        settings.mqtt_prefix,
        tls=receivers_tls(settings.mqtt_ca) if parts.scheme == "mqtts" else None,
        user=settings.mqtt_user,
        password=password,
    )


class MqttPublisher:
    """Takes messages and publishes them.

    Parameters
    ----------
    waiting : most messages that wait
    """

    def __init__(
        self,
        host: str,
        port: int,
        prefix: str,
        *,
        tls: ssl.SSLContext | None = None,
        user: str | None = None,
        password: str | None = None,
        waiting: int = WAITING,
    ) -> None:
        self._host, self._port, self._prefix = host, port, prefix
        self._client = _client(tls, user, password)
        self._client.will_set(f"{prefix}/online", "false", qos=1, retain=True)
        self._client.on_connect = self._on_connect
        self._client.on_disconnect = self._on_disconnect
        self._lock = threading.Condition()
        self._queue: deque[tuple[str, bytes]] = deque(maxlen=waiting)
        self._first: deque[tuple[str, bytes]] = deque()  # what a broker that came back gets before
        self._newest: dict[str, bytes] = {}
        self._connected = self._stopping = False
        self._dropped = 0
        self._thread = threading.Thread(target=self._run, name="mqtt", daemon=True)

    def start(self) -> None:
        """Connect in the background, now and whenever the connection is lost; returns at once."""
        self._client.connect_async(self._host, self._port, KEEPALIVE_S)
        self._client.loop_start()
        self._thread.start()

    def stop(self) -> None:
        """Publish that the service has ended, and leave; also if it never started."""
        with self._lock:
            self._stopping = True
            self._lock.notify_all()
        if self._thread.is_alive():
            self._thread.join()
            if self._connected:
                self._client.publish(f"{self._prefix}/online", "false", qos=1, retain=True).wait_for_publish(LEAVING_S)
        self._client.disconnect()
        self._client.loop_stop()

    def take(self, message: Message) -> None:
        """Publish a message as soon as there is a broker; never waits."""
        topic = "/".join((self._prefix, *(quote(part, safe="") for part in message.place)))
        with self._lock:
            self._newest[topic] = message.body()
            self._dropped += len(self._queue) == self._queue.maxlen
            self._queue.append((topic, self._newest[topic]))
            self._lock.notify_all()

    def _on_connect(self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        if reason.is_failure:
            _log.warning("mqtt_refused", host=self._host, reason=str(reason))
            return
        with self._lock:
            waiting = {topic for topic, _ in self._queue}
            retained = [entry for entry in self._newest.items() if entry[0] not in waiting]
            self._first = deque([(f"{self._prefix}/online", b"true"), *retained])
            self._connected = True
            dropped, self._dropped = self._dropped, 0
            self._lock.notify_all()
        _log.info("mqtt_connected", host=self._host, port=self._port, dropped=dropped)

    def _on_disconnect(self, _client: Client, _data: Any, _flags: Any, reason: Any, _properties: Any) -> None:
        with self._lock:
            self._connected = False
        if not self._stopping:
            _log.warning("mqtt_away", host=self._host, port=self._port, reason=str(reason))

    def _run(self) -> None:
        while True:
            with self._lock:
                self._lock.wait_for(lambda: self._stopping or (self._connected and (self._first or self._queue)))
                if self._stopping:
                    return
                queue = self._first or self._queue
                entry = queue[0]
            if self._publish(*entry):
                with self._lock:
                    if queue and queue[0] is entry:  # else it was the oldest of too many, meanwhile
                        queue.popleft()

    def _publish(self, topic: str, payload: bytes) -> bool:
        """Publish and wait until the broker has it; False if the connection was lost just now."""
        sent = self._client.publish(topic, payload, qos=1, retain=True)
        if sent.rc != 0:
            self._connected = self._client.is_connected()
            return False
        while not sent.is_published() and not self._stopping:
            sent.wait_for_publish(LOOK_S)
        return True


def _client(tls: ssl.SSLContext | None, user: str | None, password: str | None) -> Client:
    try:
        from paho.mqtt.client import Client  # an extra: only whoever publishes needs it
        from paho.mqtt.enums import CallbackAPIVersion
    except ImportError:
        raise StartError("server.mqtt_needs_extra") from None
    client = Client(CallbackAPIVersion.VERSION2, f"hilfit-{secrets.token_hex(4)}")
    client.reconnect_delay_set(1, LONGEST_PAUSE_S)
    if tls is not None:
        client.tls_set_context(tls)
    if user is not None:
        client.username_pw_set(user, password)
    return client
