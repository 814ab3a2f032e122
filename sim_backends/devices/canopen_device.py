"""One simulated CANopen sensor: object dictionary, SDO server, NMT states, heartbeat, TPDOs on SYNC, EMCY.

The SDO protocol is canopen's own server; everything that its ``LocalNode`` leaves out is here: boot-up after reset,
NMT states that count, transmission types, PDO mapping by the rules of CiA 301 (7.5.2.36), restored defaults.

::

    power-on / reset --boot-up--> pre-operational <--NMT--> operational   (TPDOs)
                                        ^                        |
                                        +-------- stopped <------+        (heartbeat only)
"""

from __future__ import annotations

import math
import struct
from collections.abc import Callable
from typing import Any

from canopen.objectdictionary import ODVariable
from canopen.sdo import SdoServer
from canopen.sdo.exceptions import SdoAbortedError

from sim_backends.devices.device_plans import NodePlan, Signal, packed
from sim_backends.devices.object_dictionaries import object_dictionary, type_name
from sim_backends.devices.signal_faults import SignalFaults

Emit = Callable[[int, bytes], None]  # COB-ID, data

BOOT_UP, STOPPED, OPERATIONAL, PRE_OPERATIONAL = 0x00, 0x04, 0x05, 0x7F
NOT_VALID = 1 << 31
TPDOS = 4

# Abort codes (CiA 301, table 22)
NOT_IN_DICTIONARY, NOT_MAPPABLE, TOO_LONG = 0x06020000, 0x06040041, 0x06040042
UNSUPPORTED, NO_SUBINDEX, OUT_OF_RANGE = 0x06010000, 0x06090011, 0x06090030

# 0x6131 (CiA 303-2): factor from the unit to bar
PRESSURE_UNITS = {0x004E0000: 1.0, 0x00220000: 1.0e-5, 0x03220000: 1.0e-2, 0x06220000: 10.0}


class _Network:
    """The bus, as canopen's SDO server sees it."""

    def __init__(self, emit: Emit) -> None:
        self._emit = emit

    def send_message(self, can_id: int, data: bytes | bytearray, remote: bool = False) -> None:
        self._emit(can_id, bytes(data))


class _Tpdo:
    """A TPDO that is valid and mapped, ready to send."""

    def __init__(self, cob_id: int, kind: int, sources: list[Callable[[], float]], data_types: list[str]) -> None:
        self.cob_id, self.kind, self.sources, self.data_types = cob_id, kind, sources, data_types
        self.due = 0
        self.last = b""

    def data(self) -> bytes:
        """Pack the bytes for the latched values; integers are rounded and saturate."""
        pairs = zip(self.data_types, self.sources, strict=True)
        return b"".join([packed(data_type, source(), "little") for data_type, source in pairs])


class SimulatedNode:
    """One node.

    Parameters
    ----------
    plan : NodePlan
    emit : callable
        Sends a frame: COB-ID and data.
    rate_hz : float
        SYNCs per second of machine time: speed objects are differences between SYNCs.
    """

    def __init__(self, plan: NodePlan, emit: Emit, rate_hz: float) -> None:
        self.id = plan.node
        self.plan = plan
        self.object_dictionary = object_dictionary(plan)
        self._bus = emit
        self._rate = rate_hz
        self._signals = {(item.index, item.subindex): item.signal for item in plan.objects}
        self._values: tuple[float, ...] = ()
        self._before: tuple[float, ...] = ()
        self.alive = True
        self.frozen = False
        self.short: int | None = None  # bytes that a fault cuts TPDOs to
        self.silent = False
        self.not_a_number = False  # every measured value that can be NaN is
        self.signal_faults = SignalFaults(plan.node)
        self.state = BOOT_UP
        self.heartbeat_due: float | None = None
        self._store: dict[tuple[int, int], bytes] = {}
        self._tpdos: list[_Tpdo] = []
        self._errors: list[int] = []
        self.sdo = SdoServer(0x600 + self.id, 0x580 + self.id, self)
        self.sdo.network = _Network(self._emit)
        self._declared = self._declared_calibration()
        self._defaults()

    def _emit(self, cob_id: int, data: bytes) -> None:
        if self.alive:
            self._bus(cob_id, data)

    # Life

    def power_on(self, now: float) -> None:
        """Boot: defaults, boot-up message, pre-operational."""
        self.alive, self.frozen, self.short, self.silent, self.not_a_number = True, False, None, False, False
        self._defaults()
        self._boot(now)

    def _boot(self, now: float) -> None:
        self.state = PRE_OPERATIONAL
        self.heartbeat_due = None
        self._emit(0x700 + self.id, bytes([BOOT_UP]))
        self._schedule_heartbeat(now)

    def _defaults(self) -> None:
        self._store = {}
        for entry in self.object_dictionary.values():
            for variable in [entry] if isinstance(entry, ODVariable) else entry.values():
                if variable.default is not None and variable.access_type != "wo":
                    key = (variable.index, 0 if isinstance(entry, ODVariable) else variable.subindex)
                    self._store[key] = bytes(variable.encode_raw(variable.default))
        self._errors = []
        self._recalibrate()
        self._rebuild()

    def on_nmt(self, command: int, now: float) -> None:
        """Obey an NMT command (CiA 301, 7.2.8.3.1)."""
        if command in (0x81, 0x82):  # reset node, reset communication: what was written is forgotten
            self._defaults()
            self._boot(now)
            return
        states = {0x01: OPERATIONAL, 0x02: STOPPED, 0x80: PRE_OPERATIONAL}
        if command in states:
            self.state = states[command]
            for tpdo in self._tpdos:
                tpdo.due = 0

    def on_frame(self, cob_id: int, data: bytes, now: float) -> None:
        """Handle a frame from the bus that concerns this node."""
        if not self.alive:
            return
        if cob_id == 0:
            if len(data) >= 2 and data[1] in (0, self.id):
                self.on_nmt(data[0], now)
        elif cob_id == 0x600 + self.id and len(data) == 8 and self.state != STOPPED:
            self.sdo.on_request(cob_id, data, now)

    def _schedule_heartbeat(self, now: float) -> None:
        milliseconds = self.number(0x1017)
        self.heartbeat_due = now + milliseconds / 1000.0 if milliseconds else None

    def on_time(self, now: float) -> None:
        """Send the heartbeat if it is due."""
        if self.heartbeat_due is not None and now >= self.heartbeat_due:
            self._emit(0x700 + self.id, bytes([self.state]))
            period = self.number(0x1017) / 1000.0
            self.heartbeat_due = max(self.heartbeat_due + period, now + 0.5 * period)

    def emergency(self, code: int, register: int, vendor: bytes = b"") -> None:
        """Send an EMCY message; code 0 means that the error is gone (CiA 301, 7.2.7)."""
        self._store[0x1001, 0] = bytes([register])
        self._errors = [code, *self._errors][:4] if code else []
        if not self.number(0x1014) & NOT_VALID:
            self._emit(self.number(0x1014) & 0x7FF, struct.pack("<HB5s", code, register, vendor[:5]))

    # Process values

    def latch(self, values: tuple[float, ...]) -> None:
        """Latch values of this SYNC, for TPDOs and for SDO reads."""
        if not self.frozen:
            self._before = self._values or values
            self._values = values

    def on_sync(self, values: tuple[float, ...]) -> None:
        """Latch, then send the TPDOs that this SYNC asks for."""
        self.latch(values)
        if self.state != OPERATIONAL or not self.alive or self.silent:
            return
        for tpdo in self._tpdos:
            if 1 <= tpdo.kind <= 240:
                tpdo.due += 1
                if tpdo.due < tpdo.kind:
                    continue
                tpdo.due = 0
                data = tpdo.data()
            else:  # 0: at SYNC, but only after a change; 254, 255: on change, which here happens at SYNC
                data = tpdo.data()
                if data == tpdo.last:
                    continue
            tpdo.last = data
            self._emit(tpdo.cob_id, data if self.short is None else data[: self.short])

    def _process_value(self, index: int, subindex: int) -> Callable[[], float] | None:
        signal = self._signals.get((index, subindex))
        if signal is not None:
            key = (index, subindex)
            floating = signal.data_type.startswith("float")

            def value() -> float:
                if self.not_a_number and floating:
                    return math.nan
                if not self._values:
                    return 0.0
                right = signal.raw(self._values)
                if signal.decimals is not None:
                    right *= 10.0 ** self.number(*signal.decimals)
                return self.signal_faults.apply(signal.channel, right) * self._factors.get(key, 1.0)

            return value
        if index == 0x6030:
            position = self._signals.get((0x6020, subindex)) or self._signals.get((0x6004, 0))
            if position is not None:
                return lambda: self._speed(position)
        return None

    def _speed(self, position: Signal) -> float:
        if not self._values:
            return 0.0
        step = position.factor * (self._values[position.column] - self._before[position.column])
        if self.plan.kind == "linear_encoder":  # CiA 406: speed steps of 0x6005:2 in 0.01 mm/s
            metres = step * self._rate * self.number(0x6005, 1) * 1e-9
            return metres / (self.number(0x6005, 2) * 1e-5)
        return step * self._rate

    def _calibration(self, setting: Callable[[int, int], float]) -> dict[tuple[int, int], float]:
        """Compute raw units per physical unit of the process values from units and steps set."""
        if self.plan.kind == "pressure_transducer":
            return {(0x6130, channel): 1.0 / PRESSURE_UNITS[int(setting(0x6131, channel))] for channel in (1, 2)}
        if self.plan.kind == "rotary_encoder":
            return {(0x6004, 0): setting(0x6001, 0)}
        if self.plan.kind == "linear_encoder":
            return {(0x6020, 1): 1.0 / setting(0x6005, 1)}
        if self.plan.kind == "inclinometer":  # CiA 410: steps of 0.001 degrees
            return {(axis, 0): 1000.0 / setting(0x6000, 0) for axis in (0x6010, 0x6020)}
        return {}

    def _declared_calibration(self) -> dict[tuple[int, int], float]:
        """Return the calibration that the machine file's scaling is for: its settings, else defaults."""
        wanted = {_object(key): value for key, value in self.plan.settings.items()}
        return self._calibration(lambda index, subindex: wanted.get((index, subindex), self._default(index, subindex)))

    def _recalibrate(self) -> None:
        now = self._calibration(lambda index, subindex: float(self.number(index, subindex)))
        self._factors = {key: value / self._declared[key] for key, value in now.items()}

    # Object dictionary

    def _default(self, index: int, subindex: int) -> float:
        entry = self.object_dictionary[index]
        variable = entry if isinstance(entry, ODVariable) else entry[subindex]
        return float(variable.default or 0)

    def number(self, index: int, subindex: int = 0) -> int:
        """Read an unsigned value of the store (0 if it is not there)."""
        return int.from_bytes(self._store.get((index, subindex), b""), "little")

    def _find(self, index: int, subindex: int) -> Any:
        entry = self.object_dictionary.get(index)
        if entry is None:
            raise SdoAbortedError(NOT_IN_DICTIONARY)
        if isinstance(entry, ODVariable):
            if subindex:
                raise SdoAbortedError(NO_SUBINDEX)
            return entry
        if subindex not in entry:
            raise SdoAbortedError(NO_SUBINDEX)
        return entry[subindex]

    def get_data(self, index: int, subindex: int, check_readable: bool = False) -> bytes:
        """Return the bytes of an object, as canopen's SDO server asks for them."""
        variable = self._find(index, subindex)
        if check_readable and not variable.readable:
            raise SdoAbortedError(0x06010001)
        value = self._process_value(index, subindex)
        if value is not None:
            data_type = type_name(variable.data_type)
            assert data_type is not None
            return packed(data_type, value(), "little")
        if index == 0x1003:
            if subindex == 0:
                return bytes([len(self._errors)])
            if subindex > len(self._errors):
                raise SdoAbortedError(0x08000024)
            return struct.pack("<I", self._errors[subindex - 1])
        try:
            return self._store[index, subindex]
        except KeyError:
            raise SdoAbortedError(0x060A0023) from None

    def set_data(self, index: int, subindex: int, data: bytes, check_writable: bool = False) -> None:
        """Write an object, as canopen's SDO server asks for it, by the rules of the profile."""
        variable = self._find(index, subindex)
        if check_writable and not variable.writable:
            raise SdoAbortedError(0x06010002)
        size = ODVariable.STRUCT_TYPES.get(variable.data_type)
        if size is not None and len(data) != size.size:
            raise SdoAbortedError(0x06070010)
        value = int.from_bytes(data, "little")
        if index == 0x1003:
            if subindex or value:
                raise SdoAbortedError(0x06090030)
            self._errors = []
            return
        self._check(index, subindex, value)
        self._store[index, subindex] = bytes(data)
        if 0x1800 <= index < 0x1C00:
            self._rebuild()
        elif index == 0x1017:
            self.heartbeat_due = 0.0 if value else None
        elif index in (0x6000, 0x6001, 0x6005, 0x6131):
            self._recalibrate()

    def _check(self, index: int, subindex: int, value: int) -> None:
        if index == 0x6131 and value not in PRESSURE_UNITS:
            raise SdoAbortedError(OUT_OF_RANGE)
        if index in (0x6001, 0x6005) and value == 0:
            raise SdoAbortedError(OUT_OF_RANGE)
        if index == 0x6000 and self.plan.kind == "inclinometer" and value not in (1, 10, 100, 1000):
            raise SdoAbortedError(OUT_OF_RANGE)
        if index == 0x1014 and (value & 0x7FF) == 0:
            raise SdoAbortedError(OUT_OF_RANGE)
        if 0x1800 <= index < 0x1800 + TPDOS:
            valid = not self.number(index, 1) & NOT_VALID
            if subindex == 1 and valid and not value & NOT_VALID and value != self.number(index, 1):
                raise SdoAbortedError(OUT_OF_RANGE)  # the identifier changes only while the PDO is not valid
            if subindex == 2 and value in range(241, 254):
                raise SdoAbortedError(OUT_OF_RANGE)  # reserved, and remote requests, which the hub does not carry
        if 0x1A00 <= index < 0x1A00 + TPDOS:
            self._check_mapping(index, subindex, value)

    def _check_mapping(self, index: int, subindex: int, value: int) -> None:
        if not self.number(index - 0x200, 1) & NOT_VALID:
            raise SdoAbortedError(UNSUPPORTED)
        if subindex == 0:
            if value > 4:
                raise SdoAbortedError(TOO_LONG)
            entries = [self.number(index, k) for k in range(1, value + 1)]
            if sum(entry & 0xFF for entry in entries) > 64:
                raise SdoAbortedError(TOO_LONG)
            return
        if self.number(index, 0):
            raise SdoAbortedError(UNSUPPORTED)  # the number of entries has to be 0 first
        if value:
            self._mapped(value)

    def _mapped(self, entry: int) -> tuple[int, int, str]:
        """Split a mapping entry ``index << 16 | subindex << 8 | bits`` into index, subindex and data type."""
        index, subindex, bits = entry >> 16, entry >> 8 & 0xFF, entry & 0xFF
        try:
            variable = self._find(index, subindex)
        except SdoAbortedError:
            raise SdoAbortedError(NOT_MAPPABLE) from None
        layout = ODVariable.STRUCT_TYPES.get(variable.data_type)
        data_type = type_name(variable.data_type)
        if not variable.pdo_mappable or layout is None or data_type is None or 8 * layout.size != bits:
            raise SdoAbortedError(NOT_MAPPABLE)
        return index, subindex, data_type

    def _rebuild(self) -> None:
        """Rebuild the TPDOs that are valid, ready to send."""
        self._tpdos = []
        for number in range(TPDOS):
            cob_id, count = self.number(0x1800 + number, 1), self.number(0x1A00 + number, 0)
            if cob_id & NOT_VALID or not count or (0x1800 + number) not in self.object_dictionary:
                continue
            sources: list[Callable[[], float]] = []
            data_types = []
            for k in range(1, count + 1):
                index, subindex, data_type = self._mapped(self.number(0x1A00 + number, k))
                sources.append(self._process_value(index, subindex) or _constant(self, index, subindex))
                data_types.append(data_type)
            self._tpdos.append(_Tpdo(cob_id & 0x7FF, self.number(0x1800 + number, 2), sources, data_types))


def _constant(node: SimulatedNode, index: int, subindex: int) -> Callable[[], float]:
    return lambda: float(node.number(index, subindex))


def _object(key: str) -> tuple[int, int]:
    index, _, subindex = key.split()[0].partition(":")
    return int(index, 0), int(subindex or "0", 0)
