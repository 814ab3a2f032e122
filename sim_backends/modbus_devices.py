"""The process of all simulated Modbus TCP transmitters of a machine, on pymodbus's server.

Registers hold the state latched at the last SYNC that was sent before the request: before it answers, a device asks
the hub with a barrier (see :mod:`sim_backends.can_hub`). Requests that wait at the same time share one barrier, but
never one that was asked before they came.
"""

from __future__ import annotations

import asyncio
import math
import os
import socket
import struct
from typing import Any

from pymodbus.constants import ExcCodes
from pymodbus.exceptions import NoSuchIdException
from pymodbus.server import ModbusTcpServer
from pymodbus.simulator import DataType, SimData, SimDevice

from sim_backends import backplane
from sim_backends.child import Order, Orders, report
from sim_backends.device_plans import STRUCT_CODES, RegisterSignal, UnitPlan, units_from_dict, whole_limits

State = tuple[float, ...]


class Latch:
    """Asks the hub for the state; concurrent askers share the next barrier."""

    def __init__(self, hub: socket.socket) -> None:
        hub.setblocking(False)
        self._hub = hub
        self._waiting: list[asyncio.Future[State]] = []
        self._asking: asyncio.Task[None] | None = None
        self.barriers = 0

    async def state(self) -> State:
        """The state latched at the last SYNC before now."""
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


class Unit:
    """One transmitter: its registers, and what is wrong with it."""

    def __init__(self, plan: UnitPlan, latch: Latch) -> None:
        self._plan = plan
        self._latch = latch
        self.size = 1 + max(item.register + len(_words(item, 0.0)) for item in plan.registers)
        self.silent = False
        self.frozen = False
        self.delay = 0.0  # s
        self.exception: ExcCodes | None = None
        self.override: float | None = None  # raw value instead of every measured one, NaN for instance

    def device(self) -> SimDevice:
        """What pymodbus serves for it; holding and input registers are the same."""
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
        if self.silent:
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
            raw = signal.raw(state) if self.override is None else self.override
            words = _words(item, raw)
            registers[item.register : item.register + len(words)] = words

    def fault(self, order: Order) -> None:
        """One of the faults of :mod:`sim_backends.faults`."""
        kind = order["kind"]
        if kind == "silence":
            self.silent = bool(order["on"])
        elif kind == "freeze":
            self.frozen = bool(order["on"])
        elif kind == "delay":
            self.delay = float(order["seconds"])
        elif kind == "exception":
            self.exception = None if order["code"] is None else ExcCodes(int(order["code"]))
        elif kind == "override":
            self.override = None if order["raw"] is None else float(order["raw"])
        else:
            raise ValueError(f"no fault '{kind}'")


def _words(item: RegisterSignal, raw: float) -> list[int]:
    """Registers of a raw value: bytes in a register big endian, words in the unit's order; integers saturate."""
    code = STRUCT_CODES[item.signal.data_type]
    limits = whole_limits(code)
    if limits is not None:
        raw = limits[0] if math.isnan(raw) else min(max(round(raw), limits[0]), limits[1])
    data = struct.pack(">" + code, raw)
    if len(data) == 1:
        data = (b"\xff" if data[0] > 127 and code == "b" else b"\x00") + data
    words = [int.from_bytes(data[k : k + 2], "big") for k in range(0, len(data), 2)]
    return words if item.word_order == "big" else words[::-1]


async def _serve(configuration: dict[str, Any], orders: Orders) -> None:
    latch = Latch(backplane.adopt(configuration["hub"]))
    units: dict[tuple[str, int], Unit] = {}
    servers, ports = [], {}
    for bus, content in configuration["buses"].items():
        held = {plan.unit: Unit(plan, latch) for plan in units_from_dict(content)}
        units |= {(bus, number): unit for number, unit in held.items()}
        server = ModbusTcpServer(
            [unit.device() for unit in held.values()], address=("127.0.0.1", 0), ignore_missing_devices=True
        )
        await server.listen()
        servers.append(server)
        transport: Any = server.transport
        ports[bus] = transport.sockets[0].getsockname()[1]
    ended = asyncio.Event()

    def fault(order: Order) -> None:
        units[order["bus"], int(order["unit"])].fault(order)

    def on_order() -> None:
        orders.work_off({"fault": fault, "counts": lambda order: {"barriers": latch.barriers}})
        if orders.closed:
            ended.set()

    os.set_blocking(orders.fileno(), False)
    asyncio.get_running_loop().add_reader(orders.fileno(), on_order)
    report({"ready": {"ports": ports}})
    await ended.wait()
    for server in servers:
        server.close()  # what its untyped shutdown() comes down to


def main() -> None:
    """Entry of the Modbus devices' process."""
    orders = Orders()
    asyncio.run(_serve(orders.configuration(), orders))


if __name__ == "__main__":
    main()
