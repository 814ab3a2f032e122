"""Block reads from Modbus units.

The only module that touches pymodbus, whose interface changes with every minor version.
"""

from __future__ import annotations

import contextlib
import logging
from dataclasses import dataclass
from typing import Any

from pymodbus.client import ModbusSerialClient, ModbusTcpClient
from pymodbus.exceptions import ModbusException
from pymodbus.pdu import ExceptionResponse

from daq.errors import BusError
from daq.machine_file import ModbusRtuBus, ModbusTcpBus

DEVICE_FAILURE = 4  # exception codes (Modbus application protocol V1.1b3, section 7)
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


@dataclass(frozen=True)
class Answer:
    """What came back: registers, or the device's exception code, or a line about why nothing did."""

    registers: tuple[int, ...] = ()
    exception: int | None = None
    failure: str | None = None


class ModbusConnection:
    """A connection, opened when it is needed and closed after everything but a good answer.

    Closing is what makes the next answer trustworthy: after a time-out the late answer to the old request would
    otherwise be taken for that to the new one (RTU has no transaction numbers, and gateways mix them up).
    """

    def __init__(self, bus: ModbusTcpBus | ModbusRtuBus, timeout_s: float) -> None:
        # It logs every time-out as an error; what matters is in the answer.
        logging.getLogger("pymodbus").setLevel(logging.CRITICAL)
        self._client: Any
        if isinstance(bus, ModbusTcpBus):
            self.place = f"{bus.host}:{bus.port}"
            self._client = ModbusTcpClient(
                bus.host,
                port=bus.port,
                timeout=timeout_s,
                retries=0,
                reconnect_delay=0.1,
                reconnect_delay_max=1,
            )
        else:
            self.place = bus.port
            self._client = ModbusSerialClient(
                bus.port,
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
            raise BusError(f"{self.place} cannot be opened; check address and cable, and that the device is on")

    def read(self, unit: int, table: str, address: int, count: int) -> Answer:
        """One block of registers; never raises, never longer than the time-out (twice, if it has to connect)."""
        try:
            if not self._client.connect():
                return Answer(failure=f"{self.place} cannot be reached")
            function = self._client.read_holding_registers if table == "holding" else self._client.read_input_registers
            response = function(address, count=count, device_id=unit)
        except (ModbusException, OSError, ValueError) as error:
            self.close()
            return Answer(failure=_reason(error))
        if isinstance(response, ExceptionResponse):
            return Answer(exception=int(response.exception_code))
        registers = getattr(response, "registers", None)
        if response.isError() or registers is None or len(registers) != count:
            self.close()
            return Answer(failure=f"answers with {len(registers or ())} of {count} registers")
        return Answer(registers=tuple(registers))

    def close(self) -> None:
        """Close the connection; the next read opens it again."""
        with contextlib.suppress(OSError):
            self._client.close()


def _reason(error: Exception) -> str:
    text = str(error)
    if "No response" in text:
        return "does not answer in time"
    return " ".join(text.split())[:120] or type(error).__name__
