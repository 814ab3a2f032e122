"""Plain CAN and J1939: frames decoded by DBC files, 11 and 29 bit, listened to only (:mod:`daq.drivers.listening`).

A message of J1939 is known by its PGN and, where the source says so, by its sender; of one that two devices send, and
no source address says which is meant, nothing is taken. A multiplexed message is several: each part has its own age.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import can

from daq.drivers.base import Answers, DriverContext
from daq.drivers.can.health import BusHealth, CanDriver
from daq.drivers.can.port import CanPort
from daq.drivers.listening import INBOX, Inbox, Listener, Stream
from daq.errors import MachineFileError
from daq.frames.clock import NS
from daq.machine.can_database import Listed, Wanted, decoded, listed_messages, not_available, pgn_of
from daq.machine.machine_file import CanSignalsBus, Channel
from daq.messages import Sentence
from daq.quality import Quality

FORGET_S = 2.0  # after so long without a frame another sender is not a second one


class _SignalsPort(CanPort):
    """Frames by whole identifier, or by PGN."""

    takes_extended = True

    def __init__(
        self, config: CanSignalsBus, context: DriverContext, health: BusHealth, of: Sequence[_Received]
    ) -> None:
        super().__init__(config, context, health)
        self._by_id: dict[tuple[bool, int], _Received] = {}
        self._by_pgn: dict[int, list[_Received]] = {}
        for received in of:
            message = received.listed.message
            if received.listed.j1939:
                self._by_pgn.setdefault(pgn_of(message.frame_id), []).append(received)
            else:
                self._by_id[message.is_extended_frame, message.frame_id] = received
        self.open()

    def dispatch(self, message: can.Message, at_ns: int) -> None:
        """Put it into the inbox of its message."""
        identifier = message.arbitration_id
        received = self._by_id.get((message.is_extended_id, identifier))
        if received is not None:
            received.inbox.receive(message.data, at_ns)
        if message.is_extended_id:
            sender = identifier & 0xFF
            for received in self._by_pgn.get(pgn_of(identifier), ()):
                if received.listed.source_address in (None, sender):
                    received.inbox.receive(message.data, at_ns, sender)


class _Received:
    """A message of a file, its frames, and its parts: which signals come together."""

    def __init__(self, listed: Listed) -> None:
        self.listed = listed
        self.inbox = Inbox(INBOX if listed.message.is_multiplexed() else 16)
        self.parts: list[tuple[Stream, list[Wanted]]] = []
        self.senders: dict[int, int] = {}  # and when each was heard last
        grouped: dict[tuple[str | None, tuple[int, ...]], list[Wanted]] = {}
        for wanted in listed.wanted:
            signal = wanted.signal
            key = (signal.multiplexer_signal, tuple(signal.multiplexer_ids or ()))
            grouped.setdefault(key, []).append(wanted)
        cycle_ms = listed.message.cycle_time
        for (selector, values), members in grouped.items():
            part = "" if selector is None else f", {selector} = {', '.join(map(str, values))}"
            # A file's cycle time is that of the message, not of each of its parts.
            declared = cycle_ms * 1e6 if cycle_ms and selector is None else None
            device, positions = f"message {listed.message.name}", [wanted.position for wanted in members]
            self.parts.append((Stream(listed.name + part, device, positions, declared), members))

    def mixed(self) -> bool:
        """Return whether more than one device sends it."""
        if len(self.senders) > 1:
            newest = max(self.senders.values())
            self.senders = {who: at for who, at in self.senders.items() if newest - at < FORGET_S * NS}
        return len(self.senders) > 1


class CanSignalsDriver(Listener, CanDriver):
    """Signals of DBC files (see :class:`daq.drivers.base.Driver`); nothing is ever sent."""

    def __init__(self, bus: CanSignalsBus, channels: Sequence[Channel], context: DriverContext) -> None:
        super().__init__(bus, [channel.name for channel in channels], context, ("not_available", "unknown_part"))
        listed, problems = listed_messages(bus, channels)
        if problems:
            raise MachineFileError("daq.on_bus", bus=bus.name, advice=problems[0][1])
        self._bus = bus
        self._received = [_Received(message) for message in listed]
        self.streams = [stream for received in self._received for stream, _ in received.parts]

    def connected(self) -> CanPort:
        """Connect the bus, its frames into the inboxes."""
        return _SignalsPort(self._bus, self.context, self.health, self._received)

    def decode(self, answers: Answers) -> None:
        """Decode all frames of multiplexed messages, of others the newest."""
        for received in self._received:
            frames = list(received.inbox.taken())
            for data, at_ns, _ in frames if received.listed.message.is_multiplexed() else frames[-1:]:
                self._frame(received, data, at_ns, answers)
            for _, at_ns, sender in frames:
                received.senders[sender] = at_ns
            if frames and received.mixed():
                self._refuse(received, answers)

    def _frame(self, received: _Received, data: bytes, at_ns: int, answers: Answers) -> None:
        message = received.listed.message
        raw = decoded(message, data)
        if raw is None:
            self.counts["unknown_part"] += 1
            return
        for stream, members in received.parts:
            present = [wanted for wanted in members if wanted.signal.name in raw]
            if not present and members[0].signal.multiplexer_ids:
                continue  # another part's frame
            quality = self.came(stream, at_ns, answers)
            for wanted in members:
                value = raw.get(wanted.signal.name)
                if value is None:
                    self.counts["short"] += 1
                    stream.fault = Sentence(
                        "daq.bytes_instead_right_file", stream=stream.name, bytes=len(data), length=message.length
                    )
                    answers.value(wanted.position, math.nan, Quality.INVALID)
                elif received.listed.j1939 and not_available(wanted.signal, value):
                    self.counts["not_available"] += 1
                    answers.value(wanted.position, math.nan, Quality.INVALID)
                else:
                    scaled: Any = wanted.signal.conversion.raw_to_scaled(value, decode_choices=False)
                    answers.value(wanted.position, float(scaled), quality)
            if quality != Quality.INVALID:
                self.alike(stream, answers)

    def _refuse(self, received: _Received, answers: Answers) -> None:
        """Refuse a message sent by two devices: nothing of it is a measurement."""
        self.counts["two_senders"] += 1
        senders = " and ".join(f"0x{sender:02X}" for sender in sorted(received.senders))
        for stream, members in received.parts:
            stream.fault = Sentence("daq.comes_from_senders", stream=stream.name, senders=senders)
            for wanted in members:
                if answers.quality[wanted.position] != Quality.MISSING:
                    answers.value(wanted.position, math.nan, Quality.INVALID)
