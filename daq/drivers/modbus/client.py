"""Block reads from Modbus units.

The only module that touches pymodbus, whose interface changes with every minor version.
"""

from __future__ import annotations

import contextlib
import logging
import select
import socket
import struct
import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import serial
from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.framer import FramerType
from pymodbus.pdu import ExceptionResponse

from daq.errors import BusError
from daq.machine.bus_places import serial_port
from daq.machine.machine_file import ModbusRtuBus, ModbusTcpBus
from daq.messages import Sentence

ILLEGAL_ADDRESS, DEVICE_FAILURE = 2, 4  # exception codes (Modbus application protocol V1.1b3, section 7)
HOLDING, INPUT = 3, 4  # function codes
#: Objects of the basic device identification (V1.1b3, 6.21), which every unit that tells anything has.
IDENTITY = {0: "vendor", 1: "product", 2: "revision"}
EXCEPTIONS = {
    1: "illegal function",
    2: "illegal register address",
    3: "illegal value",
    4: "device failure",
    5: "acknowledge",
    6: "device busy",
    10: "gateway path unavailable",
    11: "gateway target does not answer",
}
GATEWAY_EXCEPTIONS = (10, 11)  # of the gateway, not of a unit behind it


@dataclass(frozen=True)
class Answer:
    """Answer of a device: registers, or its exception code, or a line about why nothing came."""

    registers: tuple[int, ...] = ()
    exception: int | None = None
    failure: str | None = None

    @property
    def good(self) -> bool:
        """True where it brought registers."""
        return self.exception is None and self.failure is None


class _SerialClient(ModbusSerialClient):
    """Opens a port of the operating system; pymodbus's own reads URLs, and some of them write files."""

    def connect(self) -> bool:
        """Open the port, unless it is open."""
        parameters = self.comm_params
        try:
            self.socket = self.socket or serial.Serial(
                parameters.host,
                timeout=parameters.timeout_connect,
                write_timeout=parameters.timeout_connect,
                bytesize=parameters.bytesize,
                stopbits=parameters.stopbits,
                baudrate=parameters.baudrate,
                parity=parameters.parity,
                inter_byte_timeout=self.inter_byte_timeout,
                exclusive=True,
            )
        except Exception:  # pyserial lets errors of termios and of the driver through
            self.close()  # type: ignore[no-untyped-call]
        return self.socket is not None


class ModbusConnection:
    """A connection, opened when it is needed and closed after everything but a good answer.

    RTU has no transaction numbers, and gateways mix them up: after a time-out the late answer to the old request could
    be taken for that to the new one. Three things keep that from happening. On a serial line a request follows only
    after the silent interval, and what came unasked before it is dropped. A unit that timed out is asked at first for
    one register less (for two, where it is one): an answer to the old request then has a length that does not fit, and
    answers come in order, so once the other length is there, or an exception, all older ones are gone.
    """

    def __init__(self, bus: ModbusTcpBus | ModbusRtuBus, timeout_s: float) -> None:
        # It logs every time-out as an error; what matters is in the answer.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        self._client: Any
        self.timeout_s = timeout_s
        self._silence = 0.0
        self._spoke = 0.0
        self._suspect: set[int] = set()
        if isinstance(bus, ModbusTcpBus):
            self.place = f"{bus.host}:{bus.port}"
            self._client = ModbusTcpClient(
                bus.host,
                port=bus.port,
                framer=FramerType.RTU if bus.framing == "rtu" else FramerType.SOCKET,
                timeout=timeout_s,
                retries=0,
                reconnect_delay=0.1,
                reconnect_delay_max=1,
            )
        else:
            self.place = bus.port
            # Modbus over serial line V1.02, 2.5.1.1: 3.5 characters of 11 bits; above 19200 baud 1.75 ms.
            self._silence = max(3.5 * 11 / bus.baudrate, 0.00175)
            self._client = _SerialClient(
                serial_port(bus.port),
                baudrate=bus.baudrate,
                parity=bus.parity,
                stopbits=bus.stopbits,
                timeout=timeout_s,
                retries=0,
            )

    def open(self) -> None:
        """Open the connection.

        Raises
        ------
        BusError
            If the other end or the port is not there.
        """
        if not self._client.connect():
            raise BusError("daq.cannot_opened", place=self.place)

    def read(self, unit: int, table: str, address: int, count: int) -> Answer:
        """Read one block of registers; never raises, and takes no longer than three time-outs."""
        if unit in self._suspect:
            # An exception is an answer as well; one that was late itself puts a wrong length under the next request.
            probe = self._ask(unit, table, address, count - 1 if count > 1 else 2)
            if probe.failure is not None:
                return probe
            self._suspect.discard(unit)
        answer = self._ask(unit, table, address, count)
        if answer.failure is not None:
            self._suspect.add(unit)
        return answer

    def _ask(self, unit: int, table: str, address: int, count: int) -> Answer:
        function = self._client.read_holding_registers if table == "holding" else self._client.read_input_registers
        response = self._talk(lambda: function(address, count=count, device_id=unit))
        if isinstance(response, str):
            return Answer(failure=response)
        expected = HOLDING if table == "holding" else INPUT
        if response.function_code & 0x7F != expected:
            self.close()
            return Answer(
                failure=Sentence("daq.answers_other_function", function_code=response.function_code, expected=expected)
            )
        if isinstance(response, ExceptionResponse):
            return Answer(exception=int(response.exception_code))
        registers = getattr(response, "registers", None)
        if response.isError() or registers is None or len(registers) != count:
            self.close()
            return Answer(failure=Sentence("daq.answers_fewer_registers", count=len(registers or ()), wanted=count))
        return Answer(registers=tuple(registers))

    def identity(self, unit: int) -> dict[str, str]:
        """Read ``vendor``, ``product`` and ``revision`` from the unit (function 43, 14); what it does not have is left
        out. Never raises, and takes no longer than a time-out.
        """
        ask = self._client.read_device_information
        response = self._talk(lambda: ask(read_code=1, object_id=0, device_id=unit))
        refused = isinstance(response, str) or response.isError()
        objects = {} if refused else getattr(response, "information", None) or {}
        words = {name: _words(objects[key]) for key, name in IDENTITY.items() if key in objects}
        return {name: text for name, text in words.items() if text}

    def _talk(self, ask: Callable[[], Any]) -> Any:
        """Return the answer to a question that follows on silence; a line without one."""
        try:
            if not self._client.connect():
                return Sentence("daq.gateway_not_reached", place=self.place)
            self._drop()
            time.sleep(max(0.0, self._spoke + self._silence - time.monotonic()))
            return ask()
        except (ModbusException, OSError, ValueError, struct.error, IndexError, TypeError, AttributeError) as error:
            self.close()  # the last four are what pymodbus makes of frames that contradict themselves
            return _reason(error)
        finally:
            self._spoke = time.monotonic()

    def _drop(self) -> None:
        """Throw away what came and nobody asked for."""
        with contextlib.suppress(OSError, ValueError, TypeError):
            while select.select([self._client.socket], [], [], 0.0)[0]:
                line = self._client.socket
                if not (line.recv(4096) if isinstance(line, socket.socket) else line.read(line.in_waiting or 1)):
                    self.close()  # the other end has closed it; pymodbus opens it again
                    return

    def close(self) -> None:
        """Close the connection; the next read opens it again."""
        with contextlib.suppress(OSError):
            self._client.close()


def _words(objects: Any) -> str:
    """Return a device's text as one line that can be shown; pymodbus lists an object that comes twice."""
    content = objects[0] if isinstance(objects, list) and objects else objects
    text = content.decode("latin-1") if isinstance(content, bytes) else ""
    return " ".join("".join(c if c.isprintable() else " " for c in text).split())[:60]


def _reason(error: Exception) -> str:
    text = str(error)
    if "No response" in text:
        return "does not answer in time"
    return " ".join(text.split())[:120] or type(error).__name__
