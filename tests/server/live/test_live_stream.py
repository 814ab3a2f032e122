"""The live stream: what its messages say, who gets them in which order, and what happens to those who are slow."""

from __future__ import annotations

import asyncio
import json
import math
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from service_fakes import API, MACHINE, Running, wait_for_change
from starlette.websockets import WebSocketDisconnect

from daq import Machine, parse_machine
from daq.acquisition.ring import RingWriter, ring_buffer
from daq.frames.frame import Frame, frame_from_row, row_dtype, row_from_frame
from server.live import live_messages as messages
from server.live.live_reader import HEARTBEAT_S, PERIOD_S, Client, Hub, _Stream
from server.machines.acquisition import Acquisition
from server.platform.errors import UnavailableError

#: With the host, which a test client makes up otherwise: pages from elsewhere are refused.
SOCKET = f"ws://127.0.0.1:8350{API}/live/stream"


def rows(*times: float, angle: float = 0.5, quality: int = 0) -> np.ndarray:
    made = [
        row_from_frame(
            Frame(
                cycle=round(time * 50),
                monotonic_ns=0,
                utc_ns=7,
                time=time,
                values=np.array([angle, math.nan]),
                ages=np.array([0.001, math.nan]),
                quality=np.array([quality, 2], dtype=np.uint8),
            )
        )
        for time in times
    ]
    return np.concatenate(made)


class Source:
    """An acquisition whose ring a test fills by hand."""

    def __init__(self) -> None:
        self.machine = parse_machine(MACHINE)
        self.ring_name: str | None = None

    def feed(self, name: str) -> tuple[Machine, Source]:
        if self.ring_name is None:
            raise UnavailableError("it does not run")
        return self.machine, self

    def names(self) -> tuple[str, ...]:
        return ("lever",)

    def state(self, name: str) -> str:
        return "waiting" if self.ring_name is None else "running"

    @contextmanager
    def running(self) -> Iterator[RingWriter]:
        with ring_buffer(row_dtype(2), 64) as name, RingWriter(name) as writer:
            self.ring_name = name
            try:
                yield writer
            finally:
                self.ring_name = None


class Recipient:
    """Stands for a client; keeps everything."""

    def __init__(self) -> None:
        self.got: list[dict] = []
        self.dropped = False

    def offer(self, message: str) -> None:
        self.got.append(json.loads(message))

    def drop(self) -> None:
        self.dropped = True

    def kinds(self) -> list[str]:
        return [message["type"] for message in self.got]


def write(writer: RingWriter, table: np.ndarray) -> None:
    for row in table:
        writer.write(frame_from_row(row))


def test_values_are_in_the_channels_units_and_what_is_unknown_is_null() -> None:
    channels = messages.Channels.of(parse_machine(MACHINE))
    sent = json.loads(messages.frames(5, channels, rows(0.02, 0.04, angle=math.pi / 6, quality=1), missed=3))
    assert sent["type"] == "frames"
    assert (sent["seq"], sent["missed"], sent["channels"]) == (5, 3, ["joint1.angle", "joint1.torque"])
    assert [sample["t"] for sample in sent["samples"]] == [0.02, 0.04]
    assert sent["samples"][0]["values"] == [pytest.approx(30.0), None]
    assert sent["quality"] == ["stale", "missing"]
    assert sent["age_s"] == [0.001, None]


def test_offset_units_are_converted_in_both_forms_alike() -> None:
    text = MACHINE.replace(
        "buses:",
        "  - {name: oil, quantity: oil_temperature, unit: degC, "
        "source: {bus: can, node: 3, object: 0x6130, data_type: float32}}\nbuses:",
    )
    machine = parse_machine(text)
    channels = messages.Channels.of(machine)
    row = np.zeros(1, dtype=row_dtype(3))
    row["values"] = [[0.0, 0.0, 313.15]]
    assert json.loads(messages.snapshot(0, "running", channels, row))["channels"]["oil"]["value"] == pytest.approx(40.0)
    assert json.loads(messages.frames(1, channels, row))["samples"][0]["values"][2] == pytest.approx(40.0)


def test_a_client_gets_a_snapshot_and_then_every_sample_once_with_numbers_without_a_hole() -> None:
    source, now = Source(), [0.0]
    stream, first, second = _Stream("lever", source, lambda: now[0]), Recipient(), Recipient()
    with source.running() as writer:
        write(writer, rows(0.02))
        stream.add(first)
        stream.step()
        write(writer, rows(0.04, 0.06))
        stream.step()
        stream.add(second)
        stream.step()
        for tick in range(1, 101):
            now[0] = tick * PERIOD_S
            write(writer, rows(*(0.06 + 0.1 * tick - 0.02 * k for k in range(4, -1, -1))))
            stream.step()
        stream.close()
    for client in (first, second):
        assert client.kinds()[0] == "snapshot"
        assert client.kinds().count("snapshot") == 1
        numbers = [message["seq"] for message in client.got]
        assert numbers == list(range(numbers[0], numbers[0] + len(numbers)))
        assert client.kinds().count("heartbeat") == round(100 * PERIOD_S / HEARTBEAT_S)
    times = [s["t"] for m in first.got if m["type"] == "frames" for s in m["samples"]]
    np.testing.assert_allclose(times, 0.04 + 0.02 * np.arange(502))
    assert first.got[0]["channels"]["joint1.angle"]["unit"] == "deg"
    assert second.got[0]["time"] == 0.06


def test_without_acquisition_there_is_a_snapshot_of_nothing_and_a_new_one_when_it_starts() -> None:
    source, now = Source(), [0.0]
    stream, client = _Stream("lever", source, lambda: now[0]), Recipient()
    stream.add(client)
    stream.step()
    assert client.got[0] == {"type": "snapshot", "seq": 0, "acquisition": "waiting", "time": None, "channels": {}}
    now[0] = HEARTBEAT_S
    stream.step()
    with source.running() as writer:
        write(writer, rows(0.02))
        stream.step()
        write(writer, rows(0.04))
        stream.step()
    stream.step()  # and away again: what is shown must not look alive
    with source.running() as writer:
        write(writer, rows(0.02))
        stream.step()
    stream.close()
    assert client.kinds() == ["snapshot", "heartbeat", "snapshot", "frames", "snapshot", "snapshot"]
    assert [message["seq"] for message in client.got] == list(range(6))
    assert client.got[1]["acquisition"] == "waiting"
    gone = client.got[4]
    assert (gone["acquisition"], gone["channels"]["joint1.angle"]["quality"]) == ("waiting", "missing")


def test_a_reader_that_was_held_up_says_how_many_samples_are_lost() -> None:
    source = Source()
    stream, client = _Stream("lever", source, lambda: 0.0), Recipient()
    with source.running() as writer:
        stream.add(client)
        stream.step()
        write(writer, rows(*(0.02 * k for k in range(1, 101))))  # the ring holds 64
        stream.step()
        stream.close()
    assert client.got[-1]["missed"] == 36
    assert len(client.got[-1]["samples"]) == 64


def test_a_client_that_does_not_keep_up_is_dropped_and_the_others_get_everything() -> None:
    async def run() -> tuple[bool, bool, list[str]]:
        slow, quick = Client(behind=2), Client(behind=50)
        for number in range(10):
            for client in (slow, quick):
                client.offer(str(number))
        await asyncio.sleep(0)
        got = [await quick.next() for _ in range(10)]
        return slow.dropped.is_set(), quick.dropped.is_set(), got

    assert asyncio.run(run()) == (True, False, [str(number) for number in range(10)])


def test_offers_to_a_client_whose_loop_has_ended_raise_nothing() -> None:
    async def make() -> Client:
        return Client()

    client = asyncio.run(make())
    client.offer("late")
    client.drop()


def test_a_machine_is_read_while_it_has_clients() -> None:
    async def run() -> tuple[tuple[str, ...], ...]:
        hub = Hub(Source(), lambda: False)
        client, other = Client(), Client()
        with hub.client("lever", client), hub.client("lever", other):
            await client.next()
            inside = hub.machines()
        return inside, hub.machines()

    assert asyncio.run(run()) == (("lever",), ())


def test_clients_are_let_go_when_the_service_stops_or_the_reader_breaks() -> None:
    class Broken(Source):
        def feed(self, name: str) -> tuple[Machine, Source]:
            raise ZeroDivisionError

    async def run(hub: Hub) -> bool:
        client = Client()
        with hub.client("lever", client):
            await asyncio.wait_for(client.dropped.wait(), 30)
        return hub.machines() == ()

    assert asyncio.run(run(Hub(Source(), lambda: True)))
    assert asyncio.run(run(Hub(Broken(), lambda: False)))


@pytest.mark.slow
def test_the_socket_speaks_the_protocol(running: Running) -> None:
    running.client.post(f"{API}/machines", content=MACHINE)
    running.fakes.acquisition.up.clear()
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": True})
    assert running.fakes.acquisition.up.wait(30)
    while not running.service[Acquisition].running("lever"):
        wait_for_change(running.service, running.service.changes.number, 0.1)
    with running.client.websocket_connect(f"{SOCKET}?machine=lever", ["hilfit.v1"]) as socket:
        assert socket.accepted_subprotocol == "hilfit.v1"
        first = socket.receive_json()
        socket.send_text("a command that nobody reads")
        second = socket.receive_json()
    assert first["channels"]["joint1.angle"] == {
        "value": pytest.approx(30),
        "unit": "deg",
        "quality": "fresh",
        "age_s": 0.001,
    }
    assert second["seq"] == first["seq"] + 1
    running.client.put(f"{API}/machines/lever/acquisition", json={"enabled": False})


def test_a_machine_that_is_not_there_is_refused(running: Running) -> None:
    with (
        running.client.websocket_connect(f"{SOCKET}?machine=nobody") as socket,
        pytest.raises(WebSocketDisconnect) as refused,
    ):
        socket.receive_json()
    assert refused.value.code == 1008
