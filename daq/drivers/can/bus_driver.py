"""What drivers of CAN buses have in common, whether they lead or listen: a controller whose state is told."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace

from daq.drivers.base import DriverContext, DriverStatistics
from daq.drivers.bus_driver import BusDriver
from daq.drivers.can.health import BusHealth
from daq.machine.machine_file import CanBus


class CanDriver(BusDriver):
    """Keeps one CAN bus open.

    Attributes
    ----------
    health : of its controller, through all ports
    """

    def __init__(self, config: CanBus, names: Sequence[str], context: DriverContext, counts: Iterable[str]) -> None:
        super().__init__(config, names, context, counts)
        self.health = BusHealth(config.name, context.events)

    def opened(self) -> None:
        """The controller was reset."""
        self.health.opened()

    def condition(self) -> tuple[str, str]:
        """As error frames say."""
        return self.health.state, self.health.line

    def statistics(self) -> DriverStatistics:
        """State of the bus and of every device, and counters since the start."""
        found = super().statistics()
        return replace(found, counts={**found.counts, "error_frames": self.health.error_frames})
