"""Publishing at a real broker (mosquitto): what subscribers see, also those who come later, and while it was away."""

from __future__ import annotations

import json
import shutil
import socket
import subprocess
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import pytest
from service_fakes import API, MACHINE, Fakes, running_service

from server.alarms.alarm_desk import Alarms
from server.machines.machine_desk import MachineDesk
from server.outward.mqtt_publisher import MqttPublisher, mqtt_publisher
from server.outward.outward_message import Message, StateData
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.platform.settings import Settings
from server.platform.tls import certificate

pytest.importorskip("paho.mqtt.client", reason="paho-mqtt is not installed: pip install 'hilfit[mqtt]'")
from paho.mqtt.client import Client
from paho.mqtt.enums import CallbackAPIVersion

MOSQUITTO = shutil.which("mosquitto", path="/usr/sbin:/usr/bin:/usr/local/sbin:/usr/local/bin")
needs_broker = pytest.mark.skipif(MOSQUITTO is None, reason="there is no mosquitto: apt-get install mosquitto")
TIME = "2026-03-01T12:00:00.000Z"


def state(machine: str, acquisition: Any, error: str | None = None) -> Message:
    return Message(f"msg-{machine}-{acquisition}", "state", machine, TIME, StateData(acquisition, error))


def free_port() -> int:
    with socket.socket() as found:
        found.bind(("127.0.0.1", 0))
        return int(found.getsockname()[1])


@contextmanager
def broker(directory: Path, port: int, *lines: str) -> Iterator[subprocess.Popen[bytes]]:
    """A broker that takes everybody unless ``lines`` say otherwise."""
    directory.mkdir(parents=True, exist_ok=True)
    config = directory / "mosquitto.conf"
    everybody = [] if lines else ["allow_anonymous true"]
    text = [f"listener {port} 127.0.0.1", "persistence false", "user root", *everybody, *lines]
    config.write_text("\n".join(text) + "\n")
    assert MOSQUITTO is not None
    process = subprocess.Popen([MOSQUITTO, "-c", str(config)], stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
    try:
        until(lambda: reachable(port) or process.poll() is not None)
        assert process.poll() is None, "mosquitto ended"
        yield process
    finally:
        process.terminate()
        process.wait(20)


def reachable(port: int) -> bool:
    with socket.socket() as probe:
        return probe.connect_ex(("127.0.0.1", port)) == 0


def until(true: Callable[[], object]) -> None:
    """Wait until something is true, for up to a minute."""
    end = time.monotonic() + 60
    while not true():
        assert time.monotonic() < end
        time.sleep(0.02)


class Subscriber:
    """Hears everything: the newest payload by topic, and all in their order."""

    def __init__(self, port: int, prepare: Callable[[Client], object] = lambda client: None) -> None:
        self.newest: dict[str, str] = {}
        self.heard: list[tuple[str, str]] = []
        self._here = threading.Event()
        self._client = Client(CallbackAPIVersion.VERSION2)
        prepare(self._client)
        self._client.on_connect = lambda client, *_: client.subscribe("#", 1)
        self._client.on_subscribe = lambda *_: self._here.set()
        self._client.on_message = self._on_message
        self._client.connect("127.0.0.1", port)
        self._client.loop_start()
        assert self._here.wait(20)

    def _on_message(self, client: Client, data: Any, message: Any) -> None:
        self.heard.append((message.topic, message.payload.decode()))
        self.newest[message.topic] = message.payload.decode()

    def close(self) -> None:
        self._client.disconnect()
        self._client.loop_stop()


@pytest.fixture
def publisher() -> Iterator[tuple[MqttPublisher, int]]:
    """Connects to a port where there may be a broker."""
    port = free_port()
    made = MqttPublisher("127.0.0.1", port, "site/hilfit", waiting=5)
    made._client.reconnect_delay_set(1, 1)
    made.start()
    yield made, port
    made.stop()


@needs_broker
@pytest.mark.slow
def test_states_are_there_for_whoever_subscribes_later(tmp_path: Path, publisher: tuple[MqttPublisher, int]) -> None:
    made, port = publisher
    with broker(tmp_path, port):
        made.take(state("lever", "starting"))
        made.take(state("lever", "running"))
        made.take(state("Arm 7/left+#", "waiting", "the bus went away"))
        first = Subscriber(port)
        until(lambda: "site/hilfit/machines/Arm%207%2Fleft%2B%23/state" in first.newest)
        later = Subscriber(port)
        until(lambda: len(later.newest) >= 3)
        assert later.newest["site/hilfit/online"] == "true"
        assert json.loads(later.newest["site/hilfit/machines/lever/state"]) == {
            "id": "msg-lever-running",
            "type": "state",
            "machine": "lever",
            "timestamp": TIME,
            "data": {"acquisition": "running", "error": None, "error_message": None},
        }
        made.stop()
        until(lambda: later.newest["site/hilfit/online"] == "false")
        first.close(), later.close()


@needs_broker
@pytest.mark.slow
def test_a_service_that_broke_off_is_offline_by_its_last_will(
    tmp_path: Path, publisher: tuple[MqttPublisher, int]
) -> None:
    made, port = publisher
    with broker(tmp_path, port):
        heard = Subscriber(port)
        until(lambda: heard.newest.get("site/hilfit/online") == "true")
        connection = made._client.socket()
        assert connection is not None
        connection.shutdown(socket.SHUT_RDWR)  # without a word, as whoever is killed
        until(lambda: ("site/hilfit/online", "false") in heard.heard)
        until(lambda: heard.newest["site/hilfit/online"] == "true")  # and it comes back by itself
        heard.close()


@needs_broker
@pytest.mark.slow
def test_a_broker_that_was_away_is_told_what_stands_in_every_topic(
    tmp_path: Path, publisher: tuple[MqttPublisher, int]
) -> None:
    made, port = publisher
    with broker(tmp_path, port):
        made.take(state("quiet", "running"))
        made.take(state("lever", "running"))
        heard = Subscriber(port)
        until(lambda: len(heard.newest) >= 3)
        heard.close()
    with broker(tmp_path / "second", port):  # one that remembers nothing
        heard = Subscriber(port)
        until(lambda: len(heard.newest) >= 3)
        assert json.loads(heard.newest["site/hilfit/machines/quiet/state"])["data"]["acquisition"] == "running"
        heard.close()


@needs_broker
@pytest.mark.slow
def test_without_a_broker_nobody_waits_and_the_newest_are_kept(
    tmp_path: Path, publisher: tuple[MqttPublisher, int]
) -> None:
    made, port = publisher
    for number in range(5000):
        made.take(state("lever", "starting" if number % 2 else "waiting"))
    made.take(state("first", "running"))
    for _ in range(5):
        made.take(state("lever", "running"))
    assert len(made._queue) == 5
    with broker(tmp_path, port):
        heard = Subscriber(port)
        until(lambda: "site/hilfit/machines/first/state" in heard.newest)
        until(lambda: "site/hilfit/machines/lever/state" in heard.newest)
        until(lambda: not made._queue)
        states = [
            json.loads(text)["data"]["acquisition"] for topic, text in heard.heard if topic.endswith("lever/state")
        ]
        assert set(states) == {"running"}
        heard.close()


@needs_broker
@pytest.mark.slow
# paho leaves a connection whose certificate was refused to the collector
@pytest.mark.filterwarnings("ignore:.*unclosed <ssl.SSLSocket:pytest.PytestUnraisableExceptionWarning")
@pytest.mark.filterwarnings("ignore:unclosed <ssl.SSLSocket:ResourceWarning")
def test_a_broker_with_tls_and_a_password_is_served_and_no_other(tmp_path: Path) -> None:
    own = certificate(Settings(data_dir=tmp_path / "data", tls="self-signed"), DataDirectory(tmp_path / "data"), now)
    assert own is not None
    users = tmp_path / "users"
    users.write_text("")
    subprocess.run(["mosquitto_passwd", "-b", str(users), "hilfit", "right"], check=True, capture_output=True)
    (tmp_path / "right").write_text("right\n")
    (tmp_path / "wrong").write_text("wrong\n")
    port = free_port()
    lines = (f"certfile {own.path}", f"keyfile {own.key}", "allow_anonymous false", f"password_file {users}")
    with broker(tmp_path / "broker", port, *lines):

        def made(password: str, authority: Path | None) -> MqttPublisher:
            found = mqtt_publisher(
                Settings(
                    mqtt_url=f"mqtts://localhost:{port}",
                    mqtt_user="hilfit",
                    mqtt_password_file=tmp_path / password,
                    mqtt_ca=authority,
                )
            )
            assert found is not None
            found.take(state(f"{password}-{authority is not None}", "running"))
            found.start()
            return found

        publishers = [made("right", own.path), made("wrong", own.path), made("right", None)]

        def prepare(client: Client) -> None:
            client.tls_set(str(own.path))
            client.tls_insecure_set(True)
            client.username_pw_set("hilfit", "right")

        heard = Subscriber(port, prepare)
        until(lambda: "hilfit/machines/right-True/state" in heard.newest)
        time.sleep(1.5)  # in which the others try again
        assert {topic for topic in heard.newest if "state" in topic} == {"hilfit/machines/right-True/state"}
        for publisher in publishers:
            publisher.stop()
        heard.close()


def now() -> datetime:
    return datetime.now(UTC)


@needs_broker
@pytest.mark.slow
def test_a_service_publishes_states_results_and_alarms(tmp_path: Path) -> None:
    port = free_port()
    with (
        broker(tmp_path / "broker", port, "allow_anonymous true"),
        running_service(tmp_path / "data", Fakes(), mqtt_url=f"mqtt://127.0.0.1:{port}") as running,
    ):
        heard = Subscriber(port)
        running.service[MachineDesk].upload(MACHINE.encode())
        running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
        running.service[Alarms].report("lever", "overload", "joint1 hit something", "critical", True)
        running.service[Alarms].report(None, "disk_full", "little", "warning", True)
        topics = {
            "hilfit/machines/lever/state",
            "hilfit/machines/lever/alarms/overload",
            "hilfit/service/alarms/disk_full",
        }
        until(lambda: topics | {"hilfit/machines/lever/state"} <= set(heard.newest))
        until(lambda: json.loads(heard.newest["hilfit/machines/lever/state"])["data"]["acquisition"] == "running")
        alarm = json.loads(heard.newest["hilfit/machines/lever/alarms/overload"])["data"]
        running.client.post(f"{API}/alarms/{alarm['id']}/acknowledge")
        until(lambda: json.loads(heard.newest["hilfit/machines/lever/alarms/overload"])["data"]["acknowledged"])
        heard.close()


@pytest.mark.parametrize(
    ("settings", "words"),
    [
        ({"mqtt_url": "http://a"}, "write mqtts://"),
        ({"mqtt_url": "mqtt://"}, "write mqtts://"),
        ({"mqtt_url": "mqtt://a/topic"}, "write mqtts://"),
        ({"mqtt_url": "mqtts://user:secret@a"}, "write mqtts://"),
        ({"mqtt_url": "mqtts://a:x"}, "write mqtts://"),
        ({"mqtt_url": "mqtts://broker.example", "mqtt_user": "a"}, "belong together"),
        ({"mqtt_url": "mqtts://a", "mqtt_password_file": "/nowhere"}, "mqtt_password_file /nowhere: cannot be read"),
        ({"mqtt_url": "mqtts://a", "mqtt_ca": "/nowhere"}, "/nowhere: cannot be read as PEM"),
    ],
)
def test_what_cannot_be_used_is_said_at_the_start(settings: dict[str, Any], words: str) -> None:
    with pytest.raises(StartError, match=words) as found:
        mqtt_publisher(Settings(**settings))
    assert "secret" not in str(found.value)


def test_no_password_goes_over_the_network_in_the_clear(tmp_path: Path) -> None:
    (tmp_path / "password").write_text("right\n")
    given: dict[str, Any] = {"mqtt_user": "a", "mqtt_password_file": tmp_path / "password"}
    with pytest.raises(StartError, match="in the clear"):
        mqtt_publisher(Settings(mqtt_url="mqtt://broker.example", **given))
    assert mqtt_publisher(Settings(mqtt_url="mqtt://localhost", **given)) is not None
    assert mqtt_publisher(Settings()) is None
