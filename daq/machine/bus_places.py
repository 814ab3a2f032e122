"""Where a machine file may lead: closed grammars of serial ports, CAN interfaces and hosts, and who may go there.

A machine file is data, and anybody may have written it. pyserial and python-can read addresses as URLs, with handlers
that write files and open sockets; so no string of a machine file comes to them that does not fit a grammar here, and
none of these has a ``://``. What fits is a *place*, and a service goes only to those that its administrator lists:

============================  =====================================  ==============================================
place                         of                                     an entry of the list
============================  =====================================  ==============================================
``can:INTERFACE:CHANNEL``     CAN controllers of this computer       ``can:socketcan:can0``, ``can:socketcan:can*``
``serial:PORT``               ``modbus_rtu``, ``slcan``, ``serial``  ``serial:/dev/ttyUSB0``, ``serial:/dev/serial/*``
``tcp:HOST:PORT``             ``modbus_tcp``, ``socketcand``         ``tcp:192.0.2.10:502``, ``tcp:192.0.2.0/24:*``
``driver:TYPE``               whatever says no other place           ``driver:ethercat``
============================  =====================================  ==============================================

A network in an entry is for addresses alone: a name says nothing of where it leads, and has to be listed itself.
"""

from __future__ import annotations

import ipaddress
import re
from collections.abc import Collection, Mapping
from fnmatch import fnmatchcase
from typing import Annotated, Any, Literal, get_args

from pydantic import AfterValidator, BaseModel, ConfigDict, Field, ValidationError, create_model

from daq.errors import BadValueError

_SERIAL = re.compile(r"/dev/tty[A-Za-z0-9_.\-]*|/dev/pts/[0-9]+|/dev/serial/by-(id|path)/[A-Za-z0-9][^/\s]*|COM[0-9]+")
_NAME = re.compile(r"[A-Za-z0-9]([A-Za-z0-9.\-]*[A-Za-z0-9])?")
_CHANNEL = re.compile(r"[A-Za-z0-9_][A-Za-z0-9_., \-]{0,63}")
_KINDS = ("can", "serial", "tcp", "driver")

#: CAN interfaces of python-can that a machine file may name.
CanInterface = Literal[
    "socketcan", "socketcand", "pcan", "kvaser", "vector", "ixxat", "gs_usb", "slcan", "serial", "virtual"
]
CAN_INTERFACES: tuple[str, ...] = get_args(CanInterface)
SERIAL_INTERFACES = ("slcan", "serial")


def serial_port(text: str) -> str:
    """Check a serial port's name in the operating system (ValueError if none)."""
    if not _SERIAL.fullmatch(text):
        raise BadValueError("daq.no_serial_port", text=text)
    return text


def host_name(text: str) -> str:
    """Check a host's name or address (ValueError for anything else)."""
    if len(text) > 253 or not (_NAME.fullmatch(text) or _address(text)):
        raise BadValueError("daq.no_host", text=text)
    return text


SerialPort = Annotated[str, AfterValidator(serial_port)]
Host = Annotated[str, AfterValidator(host_name)]
PortNumber = Annotated[int, Field(ge=1, le=65535)]


_BAUD = Annotated[int, Field(ge=300, le=4_000_000)]


def _options(**kinds: Any) -> type[BaseModel]:
    """Return the model of a CAN interface's options; python-can knows more. ``host`` and ``port`` it must."""
    keys: dict[str, Any] = {name: (kind, ... if name in ("host", "port") else None) for name, kind in kinds.items()}
    return create_model("Options", __config__=ConfigDict(extra="forbid", strict=True), **keys)


_OPTIONS: Mapping[str, type[BaseModel]] = {
    "socketcan": _options(receive_own_messages=bool, local_loopback=bool),
    "socketcand": _options(host=Host, port=PortNumber, tcp_tune=bool),
    "pcan": _options(auto_reset=bool, device_id=int),
    "kvaser": _options(
        driver_mode=bool, single_handle=bool, accept_virtual=bool, no_samp=int, tseg1=int, tseg2=int, sjw=int
    ),
    "vector": _options(app_name=Annotated[str, Field(pattern=r"^[A-Za-z0-9 _.\-]{1,32}$")], serial=int),
    "ixxat": _options(unique_hardware_id=Annotated[str, Field(pattern=r"^[A-Za-z0-9]{1,32}$")], extended=bool),
    "gs_usb": _options(index=int, bus=int, address=int),
    "slcan": _options(tty_baudrate=_BAUD, rtscts=bool, sleep_after_open=Annotated[float, Field(ge=0, le=10)]),
    "serial": _options(baudrate=_BAUD, rtscts=bool),
    "virtual": _options(receive_own_messages=bool),
}


def check_can(interface: str, channel: str, options: Mapping[str, object]) -> None:
    """See that a channel and options are some that a CAN interface takes (ValueError, one line)."""
    if interface in SERIAL_INTERFACES:
        serial_port(channel)
    elif not _CHANNEL.fullmatch(channel):
        raise BadValueError("daq.channel_none", at=("channel",), channel=channel, interface=interface)
    try:
        _OPTIONS[interface].model_validate(dict(options))
    except ValidationError as error:
        first = error.errors(include_url=False)[0]
        key = ".".join(str(part) for part in first["loc"])
        known = ", ".join(_OPTIONS[interface].model_fields)
        raise BadValueError(
            "daq.options_takes",
            at=("options", *first["loc"]),
            key=key,
            lower=first["msg"].lower(),
            interface=interface,
            known=known,
        ) from None


def check_entry(entry: str) -> str:
    """See that an entry of the list is one (ValueError, one line)."""
    kind, _, what = entry.partition(":")
    host, _, port = what.rpartition(":")
    if kind not in _KINDS or not what or (kind == "tcp" and not (host and (port == "*" or port.isdecimal()))):
        raise BadValueError("daq.no_place", entry=entry)
    return entry


def is_listed(place: str, entries: Collection[str]) -> bool:
    """Return whether one of ``entries`` is about ``place``."""
    return any(_is_about(entry, place) for entry in entries)


def _is_about(entry: str, place: str) -> bool:
    kind, _, what = place.partition(":")
    wanted_kind, _, wanted = entry.partition(":")
    if kind != wanted_kind:
        return False
    if kind != "tcp":
        return fnmatchcase(what, wanted)
    host, _, port = what.rpartition(":")
    wanted_host, _, wanted_port = wanted.rpartition(":")
    if wanted_port not in ("*", port):
        return False
    address = _address(host)
    if address is None:
        return host.lower() == wanted_host.lower()
    try:
        return address in ipaddress.ip_network(wanted_host.strip("[]"), strict=False)
    except ValueError:  # a name
        return False


def _address(text: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        found = ipaddress.ip_address(text)
    except ValueError:
        return None
    return None if "%" in text else found
