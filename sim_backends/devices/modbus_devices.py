"""The process of all simulated Modbus transmitters of a machine, TCP and RTU, on pymodbus's server.

Registers hold the state latched at the last SYNC that was sent before the request: before it answers, a device asks
the hub with a barrier (see :mod:`sim_backends.devices.can_hub`). Requests that wait at the same time share one
barrier, but never one that was asked before they came.
"""

from __future__ import annotations

import asyncio
import os
import pty
import random
import socket
import tty
from collections.abc import Callable, Sequence
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import NoSuchIdException
from pymodbus.framer import FramerType
from pymodbus.pdu.device import ModbusDeviceIdentification
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from sim_backends import backplane
from sim_backends.child import Handler, Order, Orders, report
from sim_backends.devices.device_plans import RegisterSignal, UnitPlan, packed, units_from_dict
from sim_backends.devices.signal_faults import SignalFaults

BITS = 11  # of a character on the line: start, eight, parity or second stop bit, stop
PIECES = 4  # that an answer comes in when it trickles
#: Identity of the units; pymodbus keeps one for a process.
IDENTITY = {"VendorName": "hilfit", "ProductCode": "HF-MB4 transmitter", "MajorMinorRevision": "1.0"}
Garble = Callable[[int], bool]  # whether the next answer of a unit is garbled


class Wire(ModbusTcpServer):
    """A Modbus TCP server whose answers can go wrong on their way: trickle, be garbled, meet half a connection.

    Parameters
    ----------
    devices : what it serves
    garble : asked before each answer
    """

    def __init__(self, devices: Sequence[SimDevice], garble: Garble, framer: FramerType) -> None:
        super().__init__(
            list(devices), address=("127.0.0.1", 0), ignore_missing_devices=True, framer=framer,
            identity=ModbusDeviceIdentification(info_name=IDENTITY),  # type: ignore[no-untyped-call]
        )  # fmt: skip
        self._garble = garble
        self._serial = framer is FramerType.RTU
        self.slow = 0.0  # s that an answer takes from its first to its last byte
        self.half_open = False

    def callback_new_connection(self) -> Any:
        """Return the handler of a connection, which sends through :meth:`_send`."""
        handler: Any = super().callback_new_connection()  # type: ignore[no-untyped-call]
        send = handler.low_level_send
        handler.low_level_send = lambda data, addr=None: self._send(send, data)
        return handler

    def _send(self, send: Callable[[bytes], None], data: bytes) -> None:
        if self.half_open:
            return
        if self._garble(data[0 if self._serial else 6]):
            # On a serial line a bit of the check sum; over TCP, which has a check sum of its own, the gateway's header.
            at = len(data) - 1 if self._serial else 0
            data = data[:at] + bytes([data[at] ^ 0x40]) + data[at + 1 :]
        if not self.slow:
            send(data)
            return
        size = -(-len(data) // PIECES)
        for piece in range(PIECES):
            part = data[piece * size : (piece + 1) * size]
            if part:
                self.loop.call_later(self.slow * piece / (PIECES - 1), send, part)

    def set_half_open(self, on: bool) -> None:
        """Cut the gateway's power; its connections remain; when it is back it knows none of them."""
        self.half_open = on
        if not on:
            for handler in list(self.active_connections.values()):
                transport: Any = handler.transport
                if transport is not None:
                    transport.abort()


class SerialLine:
    """Units on a pseudo-terminal; a pty ignores the baud rate, so answers are held back for as long as they would take.

    Attributes
    ----------
    port : path that a client opens
    """

    def __init__(self, wire: Wire, baudrate: int) -> None:
        self._master, self._slave = pty.openpty()  # the slave side stays open: a reader never sees the line end
        tty.setraw(self._slave)
        os.set_blocking(self._master, False)
        self.port = os.ttyname(self._slave)
        self._seconds_per_byte = BITS / baudrate
        self._loop = asyncio.get_running_loop()
        self._sent = 0.0  # loop time at which the last byte of what was written has left
        self._handler = wire.callback_new_connection()
        self._handler.connection_made(self)
        self._loop.add_reader(self._master, self._read)

    def _read(self) -> None:
        try:
            data = os.read(self._master, 512)
        except OSError:
            return
        self._handler.data_received(data)

    def write(self, data: bytes) -> None:
        """Write like an asyncio transport; called by pymodbus with an answer. What is written later leaves later."""
        self._sent = max(self._loop.time(), self._sent) + self._seconds_per_byte * len(data)
        self._loop.call_at(self._sent, self._put, data)

    def _put(self, data: bytes) -> None:
        try:
            os.write(self._master, data)
        except BlockingIOError:  # nobody reads, and the line has no buffer
            return

    def close(self) -> None:
        """Close like an asyncio transport."""
        self._loop.remove_reader(self._master)
        os.close(self._master)
        os.close(self._slave)


State = tuple[float, ...]
DECIMALS = 2  # that a unit with a register for them has


class _Latch:
    """Asks the hub for the state; concurrent askers share the next barrier."""

    def __init__(self, hub: socket.socket) -> None:
        hub.setblocking(False)
        self._hub = hub
        self._waiting: list[asyncio.Future[State]] = []
        self._asking: asyncio.Task[None] | None = None
        self.barriers = 0

    async def state(self) -> State:
        """Return the state latched at the last SYNC before now."""
        future: asyncio.Future[State] = asyncio.get_running_loop().create_future()
        self._waiting.append(future)
        if self._asking is None or self._asking.done():
            self._asking = asyncio.create_task(self._ask())
        return await future

    async def _ask(self) -> None:
        loop = asyncio.get_running_loop()
        while self._waiting:
            served, self._waiting = self._waiting, []
            self.barriers += 1
            await loop.sock_sendall(self._hub, backplane.BARRIER)
            packet = await loop.sock_recv(self._hub, backplane.PACKET)
            if not packet:
                raise SystemExit("modbus: the hub is gone")
            _, values = backplane.unpack_state(packet[1:])
            for future in served:
                if not future.done():
                    future.set_result(values)


class _Unit:
    """One transmitter: its registers, and what is wrong with it."""

    def __init__(self, plan: UnitPlan, latch: _Latch) -> None:
        self._plan = plan
        self._latch = latch
        ends = [item.register + len(_words(item, 0.0)) for item in plan.registers]
        self.size = 1 + max(ends + [item.signal.decimals[0] for item in plan.registers if item.signal.decimals])
        self.silent = False
        self.frozen = False
        self.delay = 0.0  # s
        self.exception: ExcCodes | None = None
        self.override: float | None = None  # raw value instead of every measured one, NaN for instance
        self.drop = self.corrupt = 0.0  # shares of its answers that do not come, or are garbled
        self.signal_faults = SignalFaults(plan.unit)
        self._random = random.Random(plan.unit)

    def device(self) -> SimDevice:
        """Build what pymodbus serves for it; holding and input registers are the same."""
        registers = SimData(0, count=self.size, values=0, datatype=DataType.REGISTERS)
        return SimDevice(id=self._plan.unit, simdata=[registers], action=self._access)

    async def _access(
        self,
        function_code: int,
        start_address: int,
        address: int,
        count: int,
        registers: list[int],
        written: list[int] | list[bool] | None,
    ) -> ExcCodes | None:
        if written is not None:
            return ExcCodes.ILLEGAL_FUNCTION  # nothing here is to be written
        if self.silent or (self.drop and self._random.random() < self.drop):
            raise NoSuchIdException  # the server then sends nothing
        if self.delay:
            await asyncio.sleep(self.delay)
        if self.exception is not None:
            return self.exception
        if not self.frozen:
            self._fill(registers, await self._latch.state())
        return None

    def _fill(self, registers: list[int], state: State) -> None:
        for item in self._plan.registers:
            signal = item.signal
            raw = (
                self.signal_faults.apply(signal.channel, signal.raw(state)) if self.override is None else self.override
            )
            if signal.decimals is not None:
                raw, registers[signal.decimals[0]] = raw * 10.0**DECIMALS, DECIMALS
            words = _words(item, raw)
            registers[item.register : item.register + len(words)] = words

    def garbled(self) -> bool:
        """Test whether its next answer is garbled on its way."""
        return bool(self.corrupt) and self._random.random() < self.corrupt

    def fault(self, order: Order) -> None:
        """Order one of the faults of :mod:`sim_backends.faults.fault_runner` and of tests."""
        kind = order["kind"]
        if kind == "silence":
            self.silent = bool(order["on"])
        elif kind == "freeze":
            self.frozen = bool(order["on"])
        elif kind == "delay":
            self.delay = float(order["seconds"])
        elif kind == "exception":
            self.exception = None if order["code"] is None else ExcCodes(int(order["code"]))
        elif kind in ("drop", "corrupt"):
            setattr(self, kind, float(order["value"]))
        elif kind == "signal":
            self.signal_faults.set(order["channel"], order["what"], float(order["size"]), bool(order["on"]))
        elif kind == "override":
            self.override = None if order["raw"] is None else float(order["raw"])
        else:
            raise ValueError(f"no fault '{kind}'")


def _words(item: RegisterSignal, raw: float) -> list[int]:
    """Split a raw value into registers: bytes big endian, words in the unit's order; integers saturate."""
    data = packed(item.signal.data_type, raw, "big")
    if len(data) % 2:
        data = (b"\xff" if data[0] > 127 and not item.signal.data_type.startswith("u") else b"\x00") + data
    words = [int.from_bytes(data[k : k + 2], "big") for k in range(0, len(data), 2)]
    return words if item.word_order == "big" else words[::-1]


async def _serve(configuration: dict[str, Any], orders: Orders) -> None:
    latch = _Latch(backplane.adopt(configuration["hub"]))
    units: dict[tuple[str, int], _Unit] = {}
    wires: dict[str, Wire] = {}
    lines: list[SerialLine] = []
    ports: dict[str, int | str] = {}
    for bus, content in configuration["buses"].items():
        held = {plan.unit: _Unit(plan, latch) for plan in units_from_dict(content["units"])}
        units |= {(bus, number): unit for number, unit in held.items()}
        serial = content["baudrate"] is not None
        wires[bus] = wire = Wire(
            [unit.device() for unit in held.values()],
            lambda number, held=held: number in held and held[number].garbled(),  # type: ignore[misc]
            FramerType.RTU if serial else FramerType.SOCKET,
        )
        if serial:
            lines.append(SerialLine(wire, content["baudrate"]))
            ports[bus] = lines[-1].port
        else:
            await wire.listen()
            transport: Any = wire.transport
            ports[bus] = transport.sockets[0].getsockname()[1]
    ended = asyncio.Event()

    def fault(order: Order) -> None:
        units[order["bus"], int(order["unit"])].fault(order)

    def slow(order: Order) -> None:
        wires[order["bus"]].slow = float(order["seconds"])

    def half_open(order: Order) -> None:
        wires[order["bus"]].set_half_open(bool(order["on"]))

    handlers: dict[str, Handler] = {
        "fault": fault, "slow": slow, "half_open": half_open, "counts": lambda order: {"barriers": latch.barriers},
    }  # fmt: skip

    def on_order() -> None:
        orders.work_off(handlers)
        if orders.closed:
            ended.set()

    os.set_blocking(orders.fileno(), False)
    asyncio.get_running_loop().add_reader(orders.fileno(), on_order)
    report({"ready": {"ports": ports}})
    await ended.wait()
    for line in lines:
        line.close()
    for wire in wires.values():
        wire.close()  # what its untyped shutdown() comes down to


def main() -> None:
    """Run the Modbus devices' process."""
    orders = Orders()
    asyncio.run(_serve(orders.configuration(), orders))


if __name__ == "__main__":
    main()
