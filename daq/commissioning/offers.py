"""Values that devices offer for channels: from a scan, from EDS or DCF files, from DBC files."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import Any

from canopen import objectdictionary

from daq.drivers.canopen.eds import Pdo, Place, pdo_places, read_eds, value_of, variable_of
from daq.drivers.canopen.profiles import ASKED, Measured, measured, profile_of
from daq.machine.buses import CanSignalsBus, object_of
from daq.machine.can_database import read_database
from daq.units import AS_SENT, conversion

#: Unit that tells the kind of a value.
_KINDS = {"rad": "angle", "m": "length", "Pa": "pressure", "K": "temperature", "N": "force", "N m": "torque"}
_TYPES = {
    objectdictionary.INTEGER8: "int8", objectdictionary.INTEGER16: "int16", objectdictionary.INTEGER24: "int24",
    objectdictionary.INTEGER32: "int32", objectdictionary.INTEGER64: "int64", objectdictionary.UNSIGNED8: "uint8",
    objectdictionary.UNSIGNED16: "uint16", objectdictionary.UNSIGNED24: "uint24",
    objectdictionary.UNSIGNED32: "uint32", objectdictionary.UNSIGNED64: "uint64", objectdictionary.REAL32: "float32",
    objectdictionary.REAL64: "float64",
}  # fmt: skip


@dataclass(frozen=True)
class Offer:
    """A value that may become a channel.

    Attributes
    ----------
    device : bus and device, for people
    what : what it is, for people
    kind : ``angle``, ``length``, ``pressure``, ``temperature``, ``tilt``, ``force``, ``torque``, ``sent`` (in a unit of
        amplifiers) or ``value``
    unit : of the channel, "" where nobody knows it
    source : the source's keys
    """

    device: str
    what: str
    kind: str
    unit: str
    source: Mapping[str, Any]


def of_nodes(bus: str, nodes: Iterable[Mapping[str, Any]], listen_only: bool) -> list[Offer]:
    """Offer nodes' measurements by profile (:class:`~daq.commissioning.can_questions.FoundNode` as JSON)."""
    found = []
    for node in nodes:
        if node.get("device_type") is None:
            continue
        objects = {object_of(text): value for text, value in node["objects"].items()}
        places = {key: place for pdo in node["pdos"] for key, place in Pdo(**pdo).places().items()}
        for own in measured(node["device_type"], objects):
            place = places.get((own.index, own.subindex)) if listen_only else None
            found.append(_of_object(bus, node["node"], node.get("name") or node["profile"], own, place))
    return found


def of_eds(bus: str, node: int, path: str, listen_only: bool) -> list[Offer]:
    """Offer what a node sends by its EDS or DCF: objects of its profile with scaling, others as they are.

    Raises
    ------
    MachineFileError
        If the file is no EDS.
    """
    dictionary = read_eds(path, node, f"bus '{bus}' node {node}: {path}")
    places = pdo_places(path, node, bus)
    device_type = value_of(dictionary, 0x1000, 0) or 0
    asked = ASKED.get(profile_of(device_type), ())
    objects = {key: value for key in asked if (value := value_of(dictionary, *key)) is not None}
    known = {(own.index, own.subindex): own for own in measured(device_type, objects)}
    name = str(getattr(dictionary.device_information, "product_name", "") or "")
    found = []
    for key, place in places.items():
        data_type = _data_type(dictionary, *key)
        if data_type is None:
            continue
        own = known.get(key) or Measured(*key, data_type, "", 1.0, "value")
        found.append(_of_object(bus, node, name, own, place if listen_only else None))
    return found


def of_dbc(bus: str, path: str) -> list[Offer]:
    """Offer signals of a DBC file in a unit of an angle, length, pressure, temperature, force, torque or command.

    Raises
    ------
    MachineFileError
        If the file cannot be read.
    """
    found = []
    messages = [message for message in read_database(path, bus).messages if not message.is_container]
    names = [signal.name for message in messages for signal in message.signals]
    for message in messages:
        for signal in message.signals:
            kind = _kind_of(signal.unit or "")
            if kind == "value":
                continue
            source: dict[str, Any] = {"bus": bus, "signal": signal.name}
            if names.count(signal.name) > 1:
                source["message"] = message.name
            found.append(Offer(f"{bus} {message.name}", signal.name, kind, signal.unit or "", source))
    return found


def _kind_of(unit: str) -> str:
    """Return what is measured in a unit."""
    for si, kind in _KINDS.items():
        try:
            conversion(unit, si)
        except ValueError:
            continue
        return kind
    return "sent" if unit in AS_SENT else "value"


def signals_bus(name: str, interface: str, channel: str, paths: Iterable[str]) -> dict[str, Any]:
    """Build the entry of ``buses:`` for DBC files."""
    settings = {"name": name, "type": "can_signals", "interface": interface, "channel": channel, "dbc": tuple(paths)}
    made = CanSignalsBus.model_validate(settings)
    return made.model_dump(mode="json", exclude_unset=True)


def _of_object(bus: str, node: int, device: str, own: Measured, place: Place | None) -> Offer:
    source: dict[str, Any] = {"bus": bus, "node": node, "object": own.index}
    if own.subindex:
        source["subindex"] = own.subindex
    source["data_type"] = own.data_type
    if own.scale != 1.0:
        source["scale"] = own.scale
    source |= own.more
    if place is not None:  # as it is sent now: nothing is mapped on a bus that is only listened to
        source |= {"cob_id": place.cob_id, "byte": place.bit // 8}
        source |= {"synchronous": True} if place.synchronous else {}
    what = f"0x{own.index:04X}:{own.subindex}"
    return Offer(f"{bus} node {node}" + (f" ({device})" if device else ""), what, own.kind, own.unit, source)


def _data_type(dictionary: Any, index: int, subindex: int) -> str | None:
    variable = variable_of(dictionary, index, subindex)
    return None if variable is None else _TYPES.get(variable.data_type)
