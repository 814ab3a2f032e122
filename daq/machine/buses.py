"""Buses and sources, as a machine file declares them: where channels come from. Fitting needs none of it."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, ClassVar, Literal, Self, TypeAlias, Union, get_args

from pydantic import (
    AfterValidator,
    BaseModel,
    ConfigDict,
    Discriminator,
    Field,
    Tag,
    ValidationInfo,
    field_validator,
    model_validator,
)

from daq.errors import BadValueError
from daq.machine.bus_places import SERIAL_INTERFACES, CanInterface, Host, PortNumber, SerialPort, check_can
from daq.machine.machine_file_errors import NAME_PATTERN, did_you_mean
from daq.messages import Sentence

Name = Annotated[str, Field(pattern=NAME_PATTERN, max_length=80)]
DataType = Literal[
    "int8", "uint8", "int16", "uint16", "int24", "uint24", "int32", "uint32", "int64", "uint64", "float32", "float64"
]  # fmt: skip


def _beside_the_machine_file(value: str, info: ValidationInfo) -> str:
    folder = info.context.get("folder") if isinstance(info.context, dict) else None
    return value if folder is None else str(Path(folder, value))


#: Of a field that names a file (:mod:`daq.machine.device_files`).
BESIDE = AfterValidator(_beside_the_machine_file)
#: A file that describes devices; a relative path begins at the machine file's folder.
DeviceFile = Annotated[str, Field(min_length=1, max_length=1000), BESIDE]


class FileModel(BaseModel):
    """Any part of a machine file: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Scaled(FileModel):
    """How a raw number becomes a value in the channel's unit: ``scale * raw + offset``."""

    known_by: ClassVar[frozenset[str]] = frozenset()  # keys of which a source of this kind has one, and no other has
    bus: Name
    scale: float = 1.0
    offset: float = 0.0
    sentinels: tuple[float, ...] = ()  # raw values that mean "no valid measurement"

    @property
    def device(self) -> str:
        """The device on its bus, as statistics call it; empty where nobody knows."""
        return ""


class Word(Scaled):
    """A number of a CANopen object or of Modbus registers: ``scale 10^-decimals (raw - zero) + offset``.

    With ``mask`` raw is only what these bits hold, with ``modulo`` the difference is taken the short way round.
    """

    data_type: DataType
    decimals_key: ClassVar[str] = ""  # the key that says where the device has them
    mask: Annotated[int, Field(gt=0, lt=2**53)] | None = None  # bits in one piece, 0x00FFFFFF; integers only
    modulo: Annotated[float, Field(gt=0)] | None = None  # raw units of a turn, after which an encoder begins anew
    zero: float = 0.0  # raw value where the channel is `offset`
    decimals: Annotated[int, Field(ge=0, le=9)] = 0

    @field_validator("mask", mode="before")
    @classmethod
    def _hexadecimal_mask(cls, value: Any) -> Any:
        return _number(value, Sentence("daq.mask_write_ffffff"))

    @model_validator(mode="after")
    def _bits_there_are(self) -> Word:
        if self.mask is None:
            return self
        if self.data_type.startswith("float"):
            raise BadValueError("daq.mask_integers", at=("mask",), data_type=self.data_type)
        if self.mask >> (int(self.data_type.lstrip("uint"))):
            raise BadValueError("daq.mask_more_bits", at=("mask",), mask=f"{self.mask:X}", data_type=self.data_type)
        if (low := self.mask & -self.mask) and (self.mask // low + 1) & self.mask // low:
            raise BadValueError("daq.mask_gap", at=("mask",), mask=f"{self.mask:X}")
        return self

    @property
    def asks_decimals(self) -> bool:
        """True if the device is asked how many decimals there are."""
        return bool(self.decimals_key) and getattr(self, self.decimals_key) is not None

    @model_validator(mode="after")
    def _decimals_from_one(self) -> Word:
        beside = [key for key in ("decimals", "mask", "modulo", "zero") if getattr(self, key)]
        if self.asks_decimals and beside:
            key = self.decimals_key
            raise BadValueError("daq.not_go_together", at=(key,), decimals_key=key, beside=beside[0])
        return self


def _number(value: Any, what: str) -> Any:
    """Parse a number that may be written in hexadecimal."""
    if isinstance(value, str):
        try:
            return int(value, 0)
        except ValueError:
            raise BadValueError("daq.is_none", value=value, what=what) from None
    return value


def object_of(text: str) -> tuple[int, int]:
    """Parse index and subindex of ``0x6132:1`` (ValueError if it is no object)."""
    index, _, subindex = text.partition(":")
    return int(index, 0), int(subindex or "0", 0)


class CanSource(Word):
    """Where a channel comes from on a CANopen bus: an object of a node, mapped into a TPDO."""

    decimals_key = "decimals_object"
    node: Annotated[int, Field(ge=1, le=127)]
    object: Annotated[int, Field(ge=0x1000, le=0xFFFF)]
    subindex: Annotated[int, Field(ge=0, le=255)] = 0
    decimals_object: str | None = None  # of the node, "0x6132:1": holds the decimals, and is read at commissioning
    cob_id: Annotated[int, Field(ge=0x001, le=0x7FF)] | None = None  # listen_only: the PDO that carries it, as it is
    byte: Annotated[int, Field(ge=0, le=7)] = 0  # listen_only: where in that PDO
    synchronous: bool = False  # listen_only: that PDO is sampled at SYNC; an EDS says so itself

    @property
    def device(self) -> str:
        """``node 5``."""
        return Sentence("daq.node_number", number=self.node)

    @field_validator("object", mode="before")
    @classmethod
    def _hexadecimal(cls, value: Any) -> Any:
        return _number(value, Sentence("daq.object_index"))

    @field_validator("decimals_object")
    @classmethod
    def _an_object(cls, value: str | None) -> str | None:
        try:
            if value is not None:
                object_of(value)
        except ValueError:
            raise BadValueError("daq.no_object", value=value) from None
        return value


class ModbusSource(Word):
    """Where a channel comes from on a Modbus bus: registers of a unit, read in one block per unit and cycle."""

    known_by = frozenset({"unit", "register"})
    decimals_key = "decimals_register"
    unit: Annotated[int, Field(ge=0, le=255)]  # 1 to 247; 0 or 255 is a TCP device itself
    register_: Annotated[int, Field(ge=0, le=0xFFFF, alias="register")]  # zero-based protocol address
    table: Literal["holding", "input"] = "holding"
    word_order: Literal["big", "little"] = "big"
    byte_order: Literal["big", "little"] = "big"  # within a register; the protocol's is big
    rate_hz: Annotated[float, Field(gt=0)] | None = None  # asked so often; None: in every cycle
    decimals_register: Annotated[int, Field(ge=0, le=0xFFFF)] | None = None  # of the table; read whenever it comes back

    @property
    def device(self) -> str:
        """``unit 3``."""
        return Sentence("daq.unit_number", number=self.unit)


class SignalSource(Scaled):
    """Where a channel comes from on a bus of plain CAN or J1939: a signal of a message that a DBC file describes.

    Raw values (also ``sentinels``) are those in the DBC file's unit.
    """

    known_by = frozenset({"signal"})
    signal: Annotated[str, Field(min_length=1)]
    message: str | None = None  # its name; None: the only one that has the signal
    pgn: Annotated[int, Field(ge=0, le=0x3FFFF)] | None = None  # J1939: instead of the message's name
    source_address: Annotated[int, Field(ge=0, le=253)] | None = None  # J1939: of the device; None: there is only one

    @model_validator(mode="after")
    def _one_name(self) -> SignalSource:
        if self.message is not None and self.pgn is not None:
            raise BadValueError("daq.message_pgn_both_say", at=("message",), signal=self.signal)
        return self


class OtherSource(Scaled):
    """Where a channel comes from on a bus that another package's driver serves; only that driver knows addresses."""

    known_by = frozenset({"address"})
    address: dict[str, Any]


class CanNode(FileModel):
    """What a CANopen node must be, and how it is set up at commissioning."""

    node: Annotated[int, Field(ge=1, le=127)]
    eds: DeviceFile | None = None  # EDS or DCF; listen_only: its PDOs as they are
    device_type: int | None = None  # 0x1000
    vendor_id: int | None = None  # 0x1018:1
    product_code: int | None = None  # 0x1018:2
    revision_number: int | None = None  # 0x1018:3
    serial_number: int | None = None  # 0x1018:4
    firmware: str | None = None  # 0x100A
    heartbeat_ms: Annotated[int, Field(ge=20, le=5000)] = 100
    boot_up_s: Annotated[float, Field(ge=0, le=60)] = 3.0  # from power to its first answer
    settings: dict[str, float] = Field(default_factory=dict)  # "0x6131:1 uint32": value, written before operation

    @field_validator("settings")
    @classmethod
    def _objects(cls, value: dict[str, float]) -> dict[str, float]:
        for key in value:
            place, _, data_type = key.partition(" ")
            try:
                object_of(place)
            except ValueError:
                raise BadValueError("daq.no_object_write", key=key) from None
            if data_type and data_type.strip() not in get_args(DataType):
                raise BadValueError("daq.unknown_data_type", key=key)
        return value


class AnyBus(FileModel):
    """What every bus has: a name, and in ``type`` which kind it is.

    Attributes
    ----------
    source : where channels on it come from
    place : where it leads (:mod:`daq.machine.bus_places`); by default its driver, which alone knows
    """

    source: ClassVar[type[Scaled]]
    name: Name
    if TYPE_CHECKING:
        type: str

    @property
    def place(self) -> str:
        return f"driver:{self.type}"


class _CanBus(AnyBus):
    """A bus behind one of python-can's interfaces."""

    interface: CanInterface
    channel: Annotated[str, Field(min_length=1, max_length=200)]  # as the interface names it: can0, PCAN_USBBUS1
    bitrate: Annotated[int, Field(ge=1, le=10_000_000)] | None = None
    options: dict[str, str | int | float | bool] = Field(default_factory=dict)  # those that the interface takes

    @model_validator(mode="after")
    def _a_place(self) -> Self:
        check_can(self.interface, self.channel, self.options)
        return self

    @property
    def place(self) -> str:
        """A gateway, a serial line, or a controller of this computer."""
        if self.interface == "socketcand":
            return f"tcp:{self.options['host']}:{self.options['port']}"
        serial = self.interface in SERIAL_INTERFACES
        return f"serial:{self.channel}" if serial else f"can:{self.interface}:{self.channel}"


class CanopenBus(_CanBus):
    """A CANopen bus behind one of python-can's interfaces."""

    source = CanSource
    type: Literal["canopen"]
    nodes: tuple[CanNode, ...] = ()
    listen_only: bool = False  # nothing is ever sent: another master leads, and its PDOs are taken as they come
    listen_s: Annotated[float, Field(ge=0, le=60)] = 2.0  # before leading: whether another master is there
    sync: Literal["own", "external"] = "own"  # listen_only: external: the cycle is that of the other master's SYNC

    @model_validator(mode="after")
    def _led_by_one(self) -> CanopenBus:
        if self.sync == "external" and not self.listen_only:
            raise BadValueError("daq.sync_external_means_another", at=("sync",))
        return self


class CanSignalsBus(_CanBus):
    """A bus of plain CAN or J1939 that is only listened to; its messages are those of DBC files."""

    source = SignalSource
    type: Literal["can_signals"]
    dbc: Annotated[tuple[DeviceFile, ...], Field(min_length=1)]

    @property
    def listen_only(self) -> bool:
        """True: it sends nothing, ever."""
        return True


CanBus = CanopenBus | CanSignalsBus


class _ModbusBus(AnyBus):
    """A bus of Modbus units."""

    source = ModbusSource
    timeout_s: Annotated[float, Field(gt=0, le=5)] = 0.1
    maximum_gap: Annotated[int, Field(ge=0, le=125)] = 125  # registers read along to save a request; 0: none are there


class ModbusTcpBus(_ModbusBus):
    """Modbus TCP transmitters or a gateway."""

    type: Literal["modbus_tcp"]
    host: Host
    port: PortNumber = 502
    framing: Literal["tcp", "rtu"] = "tcp"  # rtu: a gateway that passes serial frames through as they are
    connections: Literal["per_unit", "shared"] = "per_unit"  # shared: a gateway that allows only one

    @property
    def place(self) -> str:
        """Host and port."""
        return f"tcp:{self.host}:{self.port}"


class ModbusRtuBus(_ModbusBus):
    """Modbus transmitters on a serial line."""

    type: Literal["modbus_rtu"]
    port: SerialPort
    baudrate: int = 115200
    parity: Literal["N", "E", "O"] = "E"
    stopbits: Literal[1, 2] = 1

    @property
    def place(self) -> str:
        """The line's port."""
        return f"serial:{self.port}"


class OtherBus(AnyBus):
    """A bus of a type that another package brings a driver for (entry points ``hilfit.drivers``)."""

    source = OtherSource
    type: Name
    options: dict[str, Any] = Field(default_factory=dict)  # the driver checks them

    @model_validator(mode="before")
    @classmethod
    def _refuse_a_misspelt_type(cls, value: Any) -> Any:
        kind = value.get("type") if isinstance(value, dict) else None
        hint = did_you_mean(str(kind), BUS_TYPES)
        if hint:
            raise BadValueError("daq.no_bus_type", at=("type",), kind=kind, hint=hint)
        return value


class KnownDelay(FileModel):
    """By how much what comes over one bus is behind what comes over another, as ``hilfit bus check`` estimates it."""

    bus: Name
    behind: Name
    seconds: Annotated[float, Field(ge=-1, le=1)]
    std: Annotated[float, Field(gt=0, le=1)]  # s, standard deviation

    @model_validator(mode="after")
    def _two_buses(self) -> KnownDelay:
        if self.bus == self.behind:
            raise BadValueError("daq.bus_cannot_behind_itself", at=("bus",), bus=self.bus)
        return self


@dataclass(frozen=True)
class BusKind:
    """A kind of bus that is known here.

    Attributes
    ----------
    bus : its keys
    driver : ``module:name`` of what makes its driver, loaded where one is made
    example : such a bus, but for its name and type; tests try what else may stand at its places
    source : where a channel on it comes from, but for the bus's name
    """

    bus: type[AnyBus]
    driver: str
    example: Mapping[str, Any]
    source: Mapping[str, Any]

    @property
    def tag(self) -> str:
        """What ``type:`` of such a bus says."""
        return str(get_args(self.bus.model_fields["type"].annotation)[0])


_REGISTER = {"unit": 1, "register": 6, "data_type": "float32"}
#: All kinds of buses that are known here. What else there is are entry points ``hilfit.drivers`` of other packages.
BUSES: tuple[BusKind, ...] = (
    BusKind(CanopenBus, "daq.drivers.canopen.driver:canopen_driver",
            {"interface": "socketcand", "channel": "can0", "options": {"host": "192.0.2.10", "port": 29536},
             "nodes": [{"node": 5}]},
            {"node": 5, "object": 0x6004, "data_type": "uint32"}),
    BusKind(CanSignalsBus, "daq.drivers.can.signals:CanSignalsDriver",
            {"interface": "slcan", "channel": "/dev/ttyACM0", "options": {"tty_baudrate": 115200}, "dbc": ["arm.dbc"]},
            {"signal": "Angle"}),
    BusKind(ModbusTcpBus, "daq.drivers.modbus.driver:ModbusTcpDriver", {"host": "192.0.2.10"}, _REGISTER),
    BusKind(ModbusRtuBus, "daq.drivers.modbus.driver:ModbusRtuDriver", {"port": "/dev/ttyUSB0"}, _REGISTER),
)  # fmt: skip

_TAGGED: dict[str, type[AnyBus]] = {kind.tag: kind.bus for kind in BUSES}
BUS_TYPES = tuple(_TAGGED)
_SOURCES: tuple[type[Scaled], ...] = tuple(dict.fromkeys((OtherSource, *(kind.bus.source for kind in BUSES))))


def source_of(value: Any) -> Any:
    """Parse a source of the kind that its keys show; of CANopen, where they show none."""
    if not isinstance(value, dict):
        return value
    kinds = (kind for kind in _SOURCES if kind.known_by & value.keys())
    return next(kinds, CanSource).model_validate(value)


def _bus_type(value: Any) -> str:
    kind = value.get("type") if isinstance(value, dict) else getattr(value, "type", None)
    return kind if kind in BUS_TYPES else "other"


if TYPE_CHECKING:
    Source: TypeAlias = Scaled
    Bus: TypeAlias = AnyBus
else:  # alternatives, each with its own keys
    Source = Union[_SOURCES]  # noqa: UP007
    Bus = Annotated[
        Union[tuple(Annotated[bus, Tag(tag)] for tag, bus in {**_TAGGED, "other": OtherBus}.items())],  # noqa: UP007
        Discriminator(_bus_type),
    ]
