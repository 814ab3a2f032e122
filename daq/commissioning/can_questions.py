"""Questions to a CANopen node: identity, TPDOs, scaling. Nothing is ever written."""

from __future__ import annotations

import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import partial

import can

from daq.drivers.canopen.eds import Pdo, pdos_of
from daq.drivers.canopen.link import CanLink, NoAnswerError, Sdo, SdoRefusedError
from daq.drivers.canopen.mapping import TPDO_COUNT
from daq.drivers.canopen.profiles import ask, profile_name
from daq.errors import BusError, first_line

ASK_EVERY_S = 0.005
ANSWERS_S = 0.4  # for the last one that was asked
_DEVICE_TYPE = bytes((0x40, 0, 0x10, 0, 0, 0, 0, 0))  # upload of 0x1000


@dataclass(frozen=True)
class FoundNode:
    """A CANopen node; what it was not asked, or does not have, is None.

    Attributes
    ----------
    node : node-ID
    state : by its heartbeat
    answers : that came to one question: two mean two devices
    objects : those of its profile that say how values are scaled
    """

    node: int
    state: str = ""
    answers: int = 0
    device_type: int | None = None
    profile: str = ""
    name: str | None = None
    hardware: str | None = None
    firmware: str | None = None
    vendor_id: int | None = None
    product_code: int | None = None
    revision_number: int | None = None
    serial_number: int | None = None
    heartbeat_ms: int | None = None
    pdos: tuple[Pdo, ...] = ()
    objects: dict[str, int] = field(default_factory=dict)


def answering(link: CanLink, nodes: Sequence[int]) -> dict[int, int]:
    """Return the node-IDs that answer for their device type, and how often each did."""
    answers: dict[int, int] = {}

    def counted(number: int) -> None:
        def receive(data: bytearray, at_ns: int) -> None:
            answers[number] = answers.get(number, 0) + 1

        link.handlers[0x580 + number] = receive

    for number in nodes:
        counted(number)
        request = can.Message(arbitration_id=0x600 + number, is_extended_id=False, data=_DEVICE_TYPE)
        try:
            link.send(request)
        except (can.CanError, OSError) as error:
            raise BusError("daq.bus_nothing_can_sent", link=link.name, error=first_line(error)) from None
        time.sleep(ASK_EVERY_S)
    time.sleep(ANSWERS_S)
    for number in nodes:
        link.handlers.pop(0x580 + number, None)
    return dict(sorted(answers.items()))


def described(number: int, objects: Mapping[str, int | str]) -> FoundNode:
    """Describe a node by its own objects (:func:`daq.drivers.canopen.profiles.ask`)."""
    numbers = {name: value for name, value in objects.items() if isinstance(value, int)}
    texts = {name: value for name, value in objects.items() if isinstance(value, str)}
    device_type = numbers.get("0x1000:0")
    return FoundNode(
        number, device_type=device_type, profile="" if device_type is None else profile_name(device_type),
        name=texts.get("0x1008:0"), hardware=texts.get("0x1009:0"), firmware=texts.get("0x100A:0"),
        vendor_id=numbers.get("0x1018:1"), product_code=numbers.get("0x1018:2"),
        revision_number=numbers.get("0x1018:3"), serial_number=numbers.get("0x1018:4"),
        objects={name: value for name, value in numbers.items() if not name.startswith("0x1")},
    )  # fmt: skip


def asked(link: CanLink, node: FoundNode) -> FoundNode:
    """Add a node's answers about itself; what it refuses is None."""
    sdo = link.sdo(node.node)
    try:
        answered = described(node.node, ask(sdo))
        heartbeat_ms, pdos = _number(sdo, 0x1017), tuple(pdos_of(partial(_number, sdo), TPDO_COUNT))
        return replace(answered, state=node.state, answers=node.answers, heartbeat_ms=heartbeat_ms, pdos=pdos)
    except NoAnswerError:  # it went away, or answers one question in two
        return node


def _number(sdo: Sdo, index: int, subindex: int = 0) -> int | None:
    try:
        return sdo.read_unsigned(index, subindex)
    except SdoRefusedError:
        return None
