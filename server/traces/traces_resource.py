"""The resource ``traces``: signals over time, of machines and of recordings."""

from __future__ import annotations

from collections.abc import Iterator

from server.machines.acquisition import Acquisition
from server.platform.files import DataDirectory
from server.platform.parts import Parts
from server.platform.resource import Phase, Resource, Running
from server.recordings.formats.exports import Exports
from server.traces.recorded_signals import RecordedSignals
from server.traces.signal_collector import SignalCollector
from server.traces.trace_routes import of_recordings, router


def _running(parts: Parts) -> Iterator[Running]:
    collector = parts[SignalCollector]
    yield Running(Phase.WATCHING, collector.start, collector.stop)


TRACES = Resource(
    name="traces",
    routers=(router, of_recordings),
    provides={
        SignalCollector: lambda parts: SignalCollector(parts[Acquisition]),
        RecordedSignals: lambda parts: RecordedSignals(parts[DataDirectory], parts[Exports]),
    },
    running=_running,
)
