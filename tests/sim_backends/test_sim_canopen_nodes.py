"""The CANopen nodes: over the bus with canopen's own client, and one node by itself where timing would blur it."""

from __future__ import annotations

import struct
from dataclasses import asdict, replace
from pathlib import Path

import can
import canopen
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sim_bus_client import SYNC, receive

import sim_backends
from sim_backends import default_machine
from sim_backends.devices.canopen_device import OPERATIONAL, PRE_OPERATIONAL, STOPPED, SimulatedNode
from sim_backends.devices.device_plans import NodeObject, NodePlan, Signal, nodes_from_dict
from sim_backends.devices.wiring import wire

pytestmark = pytest.mark.slow

EDS = Path(sim_backends.__file__).parent / "devices" / "eds"
ENCODER, CYLINDER, PRESSURE = 11, 21, 31
NOT_VALID = 1 << 31
MACHINE, _ = default_machine()
PLANS = wire(MACHINE).nodes


class Bench:
    """One node on the table: frames that it sends, a clock that is set by hand."""

    def __init__(self, number: int = PRESSURE, **changes) -> None:
        plan = next(p for p in PLANS if p.node == number)
        self.sent: list[tuple[int, bytes]] = []
        self.node = SimulatedNode(replace(plan, **changes), lambda cob, data: self.sent.append((cob, data)), 50.0)
        self.node.power_on(0.0)

    def nmt(self, command: int, node: int | None = None, now: float = 0.0) -> None:
        self.node.on_frame(0, bytes([command, self.node.id if node is None else node]), now)

    def write(self, index: int, subindex: int, data: bytes) -> int:
        """Expedited SDO download; the abort code, 0 if it was taken."""
        self.sent.clear()
        head = struct.pack("<BHB", 0x23 | (4 - len(data)) << 2, index, subindex)
        self.node.on_frame(0x600 + self.node.id, (head + data).ljust(8, b"\0"), 0.0)
        (cob, answer) = self.sent.pop(0)
        assert cob == 0x580 + self.node.id
        return 0 if answer[0] == 0x60 else struct.unpack_from("<I", answer, 4)[0]

    def sync(self, *values: float) -> list[tuple[int, bytes]]:
        """TPDOs that a SYNC with this state brings."""
        self.sent.clear()
        self.node.on_sync(values)
        return self.sent


def state(**columns: float) -> tuple[float, ...]:
    """A state of the default machine with some channels set."""
    names = [channel.name for channel in MACHINE.channels]
    values = [0.0] * len(names)
    for name, value in columns.items():
        values[names.index(name.replace("__", "."))] = value
    return tuple(values)


@pytest.mark.parametrize("path", sorted(EDS.glob("*.eds")), ids=lambda p: p.stem)
def test_every_eds_is_read_by_canopen_and_tells_its_profile(path):
    dictionary = canopen.import_od(str(path), 5)
    profiles = {"rotary_encoder": 406, "linear_encoder": 406, "pressure_transducer": 404, "generic": 0}
    profile = {**profiles, "inclinometer": 410}[path.stem]
    assert dictionary[0x1000].default & 0xFFFF == profile
    assert dictionary[0x1800][1].default & 0x7F == 5
    for number in range(4):
        mapped = [dictionary[0x1A00 + number][k].default for k in range(1, dictionary[0x1A00 + number][0].default + 1)]
        for entry in mapped:
            variable = dictionary[entry >> 16]
            variable = variable[entry >> 8 & 0xFF] if entry >> 8 & 0xFF else variable
            assert variable.pdo_mappable and len(variable) == entry & 0xFF


def test_identity_strings_and_values_by_sdo(simulated, network):
    """Expedited and segmented uploads, by canopen's client with the device's own EDS."""
    node = network.add_node(PRESSURE, str(EDS / "pressure_transducer.eds"))
    assert node.sdo[0x1000].raw == 0x00020194
    assert node.sdo[0x1008].raw == "HF-PT250 dual pressure transducer"
    assert node.sdo[0x1018][1].raw == 0x48494C46
    assert node.sdo[0x6131][1].raw == 0x004E0000
    with pytest.raises(canopen.SdoAbortedError) as caught:
        node.sdo.upload(0x2000, 0)
    assert caught.value.code == 0x06020000
    with pytest.raises(canopen.SdoAbortedError) as caught:
        node.sdo.download(0x1000, 0, b"\0\0\0\0")
    assert caught.value.code == 0x06010002


def test_process_values_by_sdo_are_those_of_the_last_sync(simulated, network, idle_states):
    network.send_message(0x80, b"")
    node = network.add_node(PRESSURE, str(EDS / "pressure_transducer.eds"))
    value = node.sdo[0x6130][2].raw
    cycle = simulated.order("hub", "counts")["sync"]
    names = [channel.name for channel in MACHINE.channels]
    assert value == pytest.approx(idle_states[cycle, names.index("joint1.rod_pressure")] * 1e-5, rel=1e-7)


def test_all_fifteen_nodes_answer_a_sync_with_what_the_plant_latched(simulated, network, bus, idle_states):
    """Mapping and transmission type by SDO, operational by NMT, raw values decoded by the machine file's scaling."""
    for plan in PLANS:
        node = network.add_node(plan.node, str(EDS / f"{plan.kind}.eds"))
        node.tpdo.read()
        node.tpdo[1].trans_type = 1
        node.tpdo[1].enabled = True
        node.tpdo[1].save()
        network.send_message(0, bytes([1, plan.node]))
    network.send_message(0x7EF, b"")
    receive(bus, lambda m: m.arbitration_id == 0x7EF)
    bus.send(SYNC)
    frames = {}
    while len(frames) < len(PLANS):
        message = receive(bus, lambda m: 0x180 < m.arbitration_id < 0x200)
        frames[message.arbitration_id - 0x180] = bytes(message.data)
    latched = idle_states[simulated.order("hub", "counts")["sync"]]
    for column, channel in enumerate(MACHINE.channels):
        source = channel.source
        if source is None or source.bus != "can":
            continue
        data = frames[source.node]
        raw = {
            "uint32": lambda d, s: struct.unpack("<I", d)[0],
            "int32": lambda d, s: struct.unpack("<i", d)[0],
            "float32": lambda d, s: struct.unpack("<ff", d)[s - 1],
        }[source.data_type](data, source.subindex)
        value = MACHINE.conversion(channel).to_si(raw * source.scale + source.offset)
        step = source.scale * MACHINE.conversion(channel).factor
        tolerance = step if source.data_type != "float32" else 1e-7 * abs(value)
        assert value == pytest.approx(latched[column], abs=0.51 * tolerance + 1e-9)
    for plan in PLANS:
        network.send_message(0, bytes([0x81, plan.node]))  # as it was


def test_boot_up_heartbeat_and_reset_over_the_bus(simulated, network, bus):
    node = network.add_node(CYLINDER, str(EDS / "linear_encoder.eds"))
    node.sdo[0x1017].raw = 30
    wanted = 0x700 + CYLINDER
    assert bytes(receive(bus, lambda m: m.arbitration_id == wanted).data) == b"\x7f"
    network.send_message(0, bytes([1, CYLINDER]))
    receive(bus, lambda m: m.arbitration_id == wanted and bytes(m.data) == b"\x05")
    network.send_message(0, bytes([0x81, CYLINDER]))
    assert bytes(receive(bus, lambda m: m.arbitration_id == wanted and m.data[0] != 5).data) == b"\x00"
    assert node.sdo[0x1017].raw == 0, "what was written is forgotten"


def test_life_of_a_node():
    bench = Bench()
    assert bench.sent == [(0x700 + PRESSURE, b"\0")] and bench.node.state == PRE_OPERATIONAL
    for command, reached in ((1, OPERATIONAL), (2, STOPPED), (0x80, PRE_OPERATIONAL)):
        bench.nmt(command)
        assert bench.node.state == reached
    bench.nmt(1, node=0)  # to all
    assert bench.node.state == OPERATIONAL
    bench.nmt(2, node=99)  # to another one
    assert bench.node.state == OPERATIONAL
    bench.nmt(2)
    bench.sent.clear()
    bench.node.on_frame(0x600 + PRESSURE, struct.pack("<BHB4x", 0x40, 0x1000, 0), 0.0)
    assert bench.sent == [], "a stopped node has no SDO"
    bench.nmt(0x82)
    assert bench.sent == [(0x700 + PRESSURE, b"\0")]


def test_heartbeats_are_paced_and_do_not_burst_after_a_stall():
    bench = Bench()
    assert bench.write(0x1017, 0, struct.pack("<H", 100)) == 0
    beats = []
    for k in range(1000):  # 10 s in steps of 10 ms, with a stall of 3 s
        now = 0.01 * k if k < 500 else 0.01 * k + 3.0
        bench.sent.clear()
        bench.node.on_time(now)
        beats += [now] * len(bench.sent)
    assert len(beats) == pytest.approx(100, abs=3)
    assert min(np.diff(beats)) > 0.04


@pytest.mark.parametrize("kind", [1, 3, 240])
def test_cyclic_transmission_types(kind):
    bench = Bench()
    assert bench.write(0x1800, 2, bytes([kind])) == 0
    bench.nmt(1)
    sent = [bool(bench.sync(*state())) for _ in range(2 * kind)]
    assert sent == ([False] * (kind - 1) + [True]) * 2


@pytest.mark.parametrize("kind", [0, 254, 255])
def test_types_that_send_on_change(kind):
    bench = Bench()
    bench.write(0x1800, 2, bytes([kind]))
    bench.nmt(1)
    assert len(bench.sync(*state())) == 1
    assert len(bench.sync(*state())) == 0
    assert len(bench.sync(*state(joint1__rod_pressure=2e5))) == 1


def test_tpdos_only_when_operational_and_valid():
    bench = Bench()
    bench.write(0x1800, 2, b"\1")
    assert bench.sync(*state()) == []
    bench.nmt(1)
    assert bench.sync(*state(joint1__head_pressure=12.5e5)) == [(0x180 + PRESSURE, struct.pack("<ff", 12.5, 0.0))]
    assert bench.write(0x1800, 1, struct.pack("<I", NOT_VALID | 0x180 + PRESSURE)) == 0
    assert bench.sync(*state()) == []


def test_mapping_follows_the_rules():
    """CiA 301, 7.5.2.36: off, count 0, entries, count, on; what breaks them is aborted with the code for it."""
    bench = Bench()
    entry = struct.Struct("<I").pack
    assert bench.write(0x1A00, 1, entry(0x61300220)) == 0x06010000, "the PDO is still valid"
    assert bench.write(0x1800, 1, entry(NOT_VALID | 0x180 + PRESSURE)) == 0
    assert bench.write(0x1A00, 1, entry(0x61300220)) == 0x06010000, "the count is not 0 yet"
    assert bench.write(0x1A00, 0, b"\0") == 0
    assert bench.write(0x1A00, 1, entry(0x10180120)) == 0x06040041, "identity cannot be mapped"
    assert bench.write(0x1A00, 1, entry(0x61300210)) == 0x06040041, "wrong length"
    assert bench.write(0x1A00, 1, entry(0x61300220)) == 0
    assert bench.write(0x1A00, 2, entry(0x61300120)) == 0
    assert bench.write(0x1A00, 3, entry(0x61500108)) == 0
    assert bench.write(0x1A00, 0, b"\3") == 0x06040042, "more than eight bytes"
    assert bench.write(0x1A00, 0, b"\2") == 0
    assert bench.write(0x1800, 2, b"\1") == 0
    assert bench.write(0x1800, 2, bytes([252])) == 0x06090030, "remote requests are not carried"
    assert bench.write(0x1800, 1, entry(0x180 + PRESSURE)) == 0
    assert bench.write(0x1800, 1, entry(0x190 + PRESSURE)) == 0x06090030, "an identifier of a valid PDO stays"
    bench.nmt(1)
    values = state(joint1__head_pressure=1e5, joint1__rod_pressure=2e5)
    assert bench.sync(*values) == [(0x180 + PRESSURE, struct.pack("<ff", 2.0, 1.0))]


def test_wrong_lengths_and_unknown_objects_are_aborted():
    bench = Bench()
    assert bench.write(0x1017, 0, b"\1\0\0\0") == 0x06070010
    assert bench.write(0x2222, 0, b"\1") == 0x06020000
    assert bench.write(0x1018, 9, b"\1") == 0x06090011
    assert bench.write(0x6131, 1, struct.pack("<I", 0x12340000)) == 0x06090030


def test_units_and_steps_change_what_is_sent():
    bench = Bench()
    bench.write(0x1800, 2, b"\1")
    assert bench.write(0x6131, 1, struct.pack("<I", 0x00220000)) == 0  # Pa instead of bar
    bench.nmt(1)
    assert bench.sync(*state(joint1__head_pressure=3e5))[0][1] == struct.pack("<ff", 3e5, 0.0)
    bench = Bench(CYLINDER)
    bench.write(0x1800, 2, b"\1")
    assert bench.write(0x6005, 1, struct.pack("<I", 10_000)) == 0  # 10 um instead of 5
    bench.nmt(1)
    assert bench.sync(*state(joint1__piston_position=0.1))[0][1] == struct.pack("<i", 10_000)


def test_speed_objects_are_differences_between_syncs():
    bench = Bench(CYLINDER)
    entry = struct.Struct("<I").pack
    for index, subindex, data in (
        (0x1801, 1, entry(NOT_VALID | 0x280 + CYLINDER)), (0x1801, 2, b"\1"), (0x1801, 1, entry(0x280 + CYLINDER)),
    ):  # fmt: skip
        assert bench.write(index, subindex, data) == 0
    bench.nmt(1)
    bench.sync(*state(joint1__piston_position=0.1))
    frames = dict(bench.sync(*state(joint1__piston_position=0.101)))
    # 1 mm in a period of 20 ms is 50 mm/s, in steps of 10 * 0.01 mm/s
    assert struct.unpack("<h", frames[0x280 + CYLINDER]) == (500,)


def test_emergency_messages_and_their_history():
    bench = Bench()
    bench.sent.clear()
    bench.node.emergency(0x5030, 0x81)
    assert bench.sent == [(0x80 + PRESSURE, struct.pack("<HB5x", 0x5030, 0x81))]
    assert bench.node.get_data(0x1001, 0) == b"\x81"
    assert bench.node.get_data(0x1003, 1) == struct.pack("<I", 0x5030)
    bench.node.emergency(0, 0)
    assert bench.node.get_data(0x1003, 0) == b"\0"


@given(position=st.floats(-10, 10), pressure=st.floats(-1e9, 1e9))
def test_integers_saturate_instead_of_wrapping(position, pressure):
    plan = NodePlan(
        9,
        "generic",
        (
            NodeObject(0x2000, 0, Signal("a", 0, 1000.0, 0.0, "int16")),
            NodeObject(0x2100, 3, Signal("b", 1, 1.0, 0.0, "uint8")),
        ),
        None,
        None,
        None,
        {},
    )
    assert nodes_from_dict([asdict(plan)]) == (plan,)
    node = SimulatedNode(plan, lambda cob, data: None, 50.0)
    node.latch((position, pressure))
    expected = min(max(round(1000 * position), -32768), 32767)
    assert struct.unpack("<h", node.get_data(0x2000, 0)) == (expected,)
    assert struct.unpack("<B", node.get_data(0x2100, 3)) == (min(max(round(pressure), 0), 255),)


def test_an_object_outside_every_profile_can_be_mapped():
    plan = NodePlan(9, "generic", (NodeObject(0x2000, 0, Signal("a", 0, 2.0, 1.0, "int32")),), 0x12, 7, 8, {})
    sent: list[tuple[int, bytes]] = []
    node = SimulatedNode(plan, lambda cob, data: sent.append((cob, data)), 50.0)
    node.power_on(0.0)
    for index, subindex, data in (
        (0x1A00, 1, struct.pack("<I", 0x20000020)), (0x1A00, 0, b"\1"), (0x1800, 2, b"\1"),
        (0x1800, 1, struct.pack("<I", 0x189)),
    ):  # fmt: skip
        node.set_data(index, subindex, data, check_writable=True)
    node.on_frame(0, b"\1\0", 0.0)
    sent.clear()
    node.on_sync((20.0,))
    assert sent == [(0x189, struct.pack("<i", 41))]
    assert node.get_data(0x1000, 0) == struct.pack("<I", 0x12)
    assert node.get_data(0x1018, 2) == struct.pack("<I", 8)


def test_a_message_of_another_kind_changes_nothing(simulated, bus):
    bus.send(can.Message(arbitration_id=0x700 + ENCODER, is_extended_id=False, data=[5]))
    bus.send(can.Message(arbitration_id=0x600 + 99, is_extended_id=False, data=bytes(8)))
    bus.send(can.Message(arbitration_id=0x000, is_extended_id=False, data=[1]))
    bus.send(can.Message(arbitration_id=0x600 + ENCODER, is_extended_id=False, data=[0x40, 0, 0x10, 0, 0, 0, 0, 0]))
    answer = receive(bus, lambda m: m.arbitration_id == 0x580 + ENCODER)
    assert bytes(answer.data)[4:] == struct.pack("<I", 0x00010196)
