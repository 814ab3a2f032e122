"""Looks at the newest frames of a running acquisition, as ``hilfit bus check`` does where nobody else acquires."""

from __future__ import annotations

from typing import TYPE_CHECKING

from daq.messages import Sentence
from server.machines.acquisition import Acquisition
from server.platform.errors import UnavailableError

if TYPE_CHECKING:
    from daq.commissioning.check import MachineCheck

LEAST_S = 2.0  # of frames, without which noise and drift say nothing


class BusChecks:
    """Checks machines that are acquired; the acquisition goes on undisturbed."""

    def __init__(self, acquisition: Acquisition) -> None:
        self._acquisition = acquisition

    def check(self, name: str, seconds: float, depressurised: bool) -> MachineCheck:
        """Check the last ``seconds`` of a machine, if so many; delays between its buses by the last minute.

        Raises
        ------
        ConflictError
            If it is not acquired.
        UnavailableError
            If its acquisition does not run at the moment, or has run for less than two seconds.
        """
        from daq.acquisition.ring import RingReader
        from server.bus_checks.running_check import check_running

        machine, feed = self._acquisition.feed(name)
        with RingReader(feed.ring_name, from_start=True) as ring:
            rows = ring.read().rows
        if len(rows) < LEAST_S * machine.rate_hz:
            raise UnavailableError(Sentence("server.machine_been_acquired_less", name=name, least_s=LEAST_S))
        return check_running(machine, rows, feed.statistics(), seconds=seconds, depressurised=depressurised)
