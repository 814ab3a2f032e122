"""State of one Modbus unit in the driver: the blocks that it is read in, its last answers, its health."""

from __future__ import annotations

from collections import deque
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from statistics import median

from daq.drivers import wire
from daq.drivers.base import Spread
from daq.drivers.modbus.client import EXCEPTIONS, ILLEGAL_ADDRESS, Answer
from daq.drivers.wire import Decimals
from daq.machine.machine_file import Channel, ModbusSource
from daq.messages import Sentence

BLOCK_REGISTERS = 125  # the most that one read may ask for (Modbus application protocol V1.1b3, 6.3)
ROUNDS = 9  # whose median says whether a unit is slow: one answer that was late does not


@dataclass(frozen=True)
class Reading:
    """An answer, the cycle that it was asked in, and when it was sampled (halfway between question and answer)."""

    answer: Answer
    cycle: int
    sync_ns: int
    sampled_ns: int
    ordinal: int


@dataclass
class Block:
    """Registers that one request reads, and where their channels are in it: (position, first register, source).

    ``rate_hz`` is how often it is asked; None: in every cycle. The rest is its state.
    """

    table: str
    address: int
    count: int
    members: tuple[tuple[int, int, ModbusSource], ...]
    rate_hz: float | None = None
    reading: Reading | None = field(default=None, compare=False)
    asked: int = field(default=0, compare=False)
    taken: int = field(default=0, compare=False)
    next_cycle: int | None = field(default=None, compare=False)

    @property
    def registers(self) -> str:
        """Name in errors."""
        return Sentence(
            "daq.registers_from_to", table=self.table, first=self.address, last=self.address + self.count - 1
        )

    def parts(self) -> tuple[Block, ...]:
        """Split into blocks of the same channels without a register that no channel needs."""
        absolute = [(position, source) for position, _, source in self.members]
        return tuple(_grouped(self.table, self.rate_hz, absolute, maximum_gap=0))


def blocks(channels: Sequence[tuple[int, Channel]], maximum_gap: int = BLOCK_REGISTERS) -> tuple[Block, ...]:
    """Find the fewest blocks that cover one unit's channels.

    Parameters
    ----------
    channels : position in the driver's order, and the channel
    maximum_gap : registers that no channel needs and that are read all the same, to save a request

    A block holds registers of one table, of channels of one rate, and no more than 125 of them.
    """
    sources = [(position, c.source) for position, c in channels if isinstance(c.source, ModbusSource)]
    found: list[Block] = []
    for table in ("holding", "input"):
        in_table = [(position, source) for position, source in sources if source.table == table]
        for rate in sorted({source.rate_hz for _, source in in_table}, key=lambda rate: -(rate or float("inf"))):
            members = [(position, source) for position, source in in_table if source.rate_hz == rate]
            found += _grouped(table, rate, members, maximum_gap)
    return tuple(found)


def _grouped(
    table: str, rate: float | None, members: Sequence[tuple[int, ModbusSource]], maximum_gap: int
) -> Iterator[Block]:
    group: list[tuple[int, ModbusSource]] = []
    end = 0
    for member in sorted(members, key=lambda member: member[1].register_):
        start = member[1].register_
        last = start + wire.registers(member[1].data_type)
        if group and (last - group[0][1].register_ > BLOCK_REGISTERS or start - end > maximum_gap):
            yield _block(table, rate, group, end)
            group, end = [], 0
        group.append(member)
        end = max(end, last)
    if group:
        yield _block(table, rate, group, end)


def _block(table: str, rate: float | None, group: Sequence[tuple[int, ModbusSource]], end: int) -> Block:
    start = group[0][1].register_
    members = tuple((position, source.register_ - start, source) for position, source in group)
    return Block(table, start, end - start, members, rate)


class Unit:
    """One Modbus unit.

    Readings are kept by the polling thread and taken by the collecting one, both under the poller's lock.
    """

    def __init__(
        self, number: int, place: str, name: str, channels: Sequence[tuple[int, Channel]], maximum_gap: int
    ) -> None:
        self.number = number
        self.place = place
        self.name = name  # in the event log
        self.blocks = blocks(channels, maximum_gap)
        self.names = {position: channel.name for position, channel in channels}
        self.latency = Spread()  # of its answers
        self.decimals: dict[int, Decimals] = {}  # by position, of channels whose decimals the unit tells
        self._decimals_at: dict[tuple[str, int], list[Decimals]] = {}  # by table and register
        for position, channel in channels:
            source = channel.source
            if isinstance(source, ModbusSource) and source.decimals_register is not None:
                made = self.decimals[position] = Decimals(source.sentinels)
                self._decimals_at.setdefault((source.table, source.decimals_register), []).append(made)
        self.state, self.detail, self.cause = "commissioning", "", ""
        self.away = ""
        self.identity: dict[str, str] = {}  # what it says it is
        self.unnamed = True  # whether it is to be asked that
        self.failures = 0
        self.not_before_ns = 0
        self.requests = self.timeouts = self.exceptions = 0
        self.cycles = 1.0  # that its answers take; 1 for a unit that keeps up
        self._milliseconds = 0.0
        self._rounds: deque[tuple[int, float]] = deque(maxlen=ROUNDS)  # cycles and ms that each took

    def unknown_decimals(self) -> list[tuple[str, int]]:
        """List table and register of decimals that have to be asked for."""
        return [place for place, held in self._decimals_at.items() if not held[0].known]

    def learn_decimals(self, table: str, register: int, answer: Answer) -> str:
        """Take what such a register holds; a line if it is nothing that can be."""
        what = Sentence("daq.register_decimals", table=table, register=register)
        if answer.failure is not None:
            return Sentence("daq.check_power_address_cable", place=self.place, failure=answer.failure, what=what)
        if answer.exception is not None:
            meaning = EXCEPTIONS.get(answer.exception, "unknown")
            return Sentence(
                "daq.decimals_exception", place=self.place, exception=answer.exception, meaning=meaning, what=what
            )
        learnt = [decimals.learn(answer.registers[0]) for decimals in self._decimals_at[table, register]]
        if not all(learnt):
            return Sentence("daq.holds_cannot", place=self.place, what=what, register=answer.registers[0])
        return ""

    def forget_decimals(self) -> None:
        """Forget decimals: the unit may be set up anew when it is back."""
        for decimals in self.decimals.values():
            decimals.forget()

    def due(self, cycle: int) -> list[Block]:
        """Return the blocks to be asked in this cycle."""
        return [block for block in self.blocks if block.next_cycle is None or cycle >= block.next_cycle]

    def took(self, cycles: int, milliseconds: float) -> None:
        """Note how many cycles began while a round was answered."""
        self._rounds.append((cycles, milliseconds))
        self.cycles = float(median(cycles for cycles, _ in self._rounds))
        self._milliseconds = median(milliseconds for _, milliseconds in self._rounds)

    @property
    def slow(self) -> bool:
        """True if it does not keep up with the cycle."""
        return self.cycles > 1.0

    def slowness(self, rate_hz: float) -> str:
        """Word that in a line, or nothing."""
        if not self.slow:
            return ""
        rate = Sentence("daq.times_a_second", rate=rate_hz / self.cycles, wanted=rate_hz)
        return Sentence("daq.answers_ms_values_come", place=self.place, milliseconds=self._milliseconds, rate=rate)

    def split(self, block: Block) -> bool:
        """Ask for a block's parts one by one, as some registers do not exist; return whether it had parts."""
        parts = block.parts()
        if len(parts) < 2:
            return False
        self.blocks = tuple(b for a in self.blocks for b in (parts if a is block else (a,)))
        return True

    def problem(self, block: Block, answer: Answer) -> str | None:
        """Return one line on what is wrong with an answer, or None."""
        if answer.failure is not None:
            return Sentence(
                "daq.check_power_address_cable", place=self.place, failure=answer.failure, what=block.registers
            )
        if answer.exception is not None:
            meaning = EXCEPTIONS.get(answer.exception, "unknown")
            return Sentence(
                "daq.exception_answer",
                place=self.place,
                exception=answer.exception,
                meaning=meaning,
                registers=block.registers,
            )
        return None

    def forget(self) -> None:
        """Forget what came until now: it belongs to no cycle."""
        for block in self.blocks:
            block.taken = block.asked

    def lost(self) -> tuple[str, ...]:
        """Return the channels whose last answer was no measurement."""
        return tuple(
            self.names[position]
            for block in self.blocks
            if block.reading is None or not block.reading.answer.good
            for position, _, _ in block.members
        )


def gap_is_to_blame(answer: Answer) -> bool:
    """Return whether the answer is a unit's for a register that it does not have."""
    return answer.exception == ILLEGAL_ADDRESS
