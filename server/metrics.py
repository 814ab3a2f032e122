"""``/metrics``: what Prometheus reads; one registry per service, filled when it is read.

Names follow Prometheus' conventions: base units, ``_total`` for counters. There is no label with an id in it: every
machine and every kind is a series, not every recording.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Mapping
from itertools import accumulate

from prometheus_client import CollectorRegistry, Histogram
from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.exposition import generate_latest
from prometheus_client.registry import Collector
from prometheus_client.utils import floatToGoString
from starlette.types import ASGIApp, Message, Receive, Scope, Send

from server.service import Service

#: Text format 0.0.4, which every Prometheus reads.
MEDIA_TYPE = "text/plain; version=0.0.4; charset=utf-8"
_BUCKETS = (0.002, 0.005, 0.01, 0.02, 0.05, 0.1, 0.2, 0.5, 1.0, 2.0, 5.0)
_STATES = ("off", "starting", "running", "waiting", "stopped")
_COUNTS = {
    "cycles": "Frames published.",
    "skipped": "Cycles that never happened because their time had passed.",
    "late": "Cycles that started more than a tenth of a period late.",
    "utc_jumps": "Times that the computer's clock was set.",
}


class _Service(Collector):
    """Reads the service when Prometheus asks."""

    def __init__(self, service: Service) -> None:
        self._service = service

    def collect(self) -> Iterator[Metric]:
        """Everything about the service that is counted elsewhere."""
        yield from self._acquisition()
        yield from self._monitors()
        jobs = GaugeMetricFamily("hilfit_jobs", "Jobs in each state.", labels=["state"])
        for state, number in self._service.jobs.counts().items():
            jobs.add_metric([state], number)
        yield jobs
        alarms = GaugeMetricFamily("hilfit_alarms_active", "Active alarms.", labels=["machine", "kind", "severity"])
        for alarm in self._service.alarms.active():
            alarms.add_metric([alarm.machine or "", alarm.kind, alarm.severity], 1)
        yield alarms
        yield GaugeMetricFamily(
            "hilfit_disk_free_bytes", "Bytes that are free for recordings.", value=self._service.free_bytes()
        )

    def _acquisition(self) -> Iterator[Metric]:
        running = GaugeMetricFamily(
            "hilfit_acquisition_state",
            "1 for the state that a machine's acquisition is in.",
            labels=["machine", "state"],
        )
        restarts = CounterMetricFamily("hilfit_acquisition_restarts", "Restarts of acquisition.", labels=["machine"])
        counts = {
            name: CounterMetricFamily(f"hilfit_acquisition_{name}", text, labels=["machine"])
            for name, text in _COUNTS.items()
        }
        quality = CounterMetricFamily(
            "hilfit_channel_frames", "Frames of a channel by quality.", labels=["machine", "channel", "quality"]
        )
        lateness = HistogramMetricFamily(
            "hilfit_acquisition_lateness_seconds", "How late cycles started.", labels=["machine"]
        )
        for machine in self._service.acquisition.names():
            statistics = self._service.acquisition.statistics(machine)
            for state in _STATES:
                running.add_metric([machine, state], float(statistics["state"] == state))
            restarts.add_metric([machine], statistics.get("restarts", 0))
            found = statistics.get("counts", {})
            for name, family in counts.items():
                family.add_metric([machine], found.get(name, 0))
            if found.get("lateness"):
                lateness.add_metric([machine], _buckets(found["lateness"]), found["lateness_ms"] / 1e3)
            for channel, by_quality in found.get("quality", {}).items():
                for name, number in by_quality.items():
                    quality.add_metric([machine, channel, name], number)
        yield from (running, restarts, *counts.values(), lateness, quality)

    def _monitors(self) -> Iterator[Metric]:
        labels = ["machine", "joint"]
        residual = GaugeMetricFamily(
            "hilfit_residual", "Root mean square residual, in the joint's effort unit.", labels=labels
        )
        share = GaugeMetricFamily(
            "hilfit_residual_cusum_ratio",
            "Largest cumulative sum over its threshold; a drift begins at 1.",
            labels=labels,
        )
        for machine in self._service.acquisition.names():
            for joint in self._service.monitors.state(machine).get("joints", ()):
                if joint["residual"] is not None:
                    residual.add_metric([machine, joint["joint"]], joint["residual"])
                share.add_metric([machine, joint["joint"]], joint["cusum"] / joint["threshold"])
        yield from (residual, share)


def _buckets(lateness: Mapping[str, int]) -> list[tuple[str, float]]:
    """Bounds in s and how many are not above each, as Prometheus wants them, of counts between bounds in ms."""
    bounds = (floatToGoString(float(bound) / 1e3) for bound in lateness)  # type: ignore[no-untyped-call]
    return list(zip(bounds, accumulate(lateness.values()), strict=True))


class Metrics:
    """The registry of one service."""

    def __init__(self, service: Service) -> None:
        self._registry = CollectorRegistry()
        self._registry.register(_Service(service))
        self.requests = Histogram(
            "hilfit_http_request_seconds",
            "Time from a request's first byte to its response's last one.",
            ("method", "route", "status"),
            buckets=_BUCKETS,
            registry=self._registry,
        )

    def text(self) -> bytes:
        """Everything, as Prometheus reads it."""
        return generate_latest(self._registry)


class RequestTimes:
    """Measures requests by route; streams are not measured.

    A route is named by the path that its router declares: ids make no series.
    """

    def __init__(self, app: ASGIApp, metrics: Metrics, clock: Callable[[], float] = time.perf_counter) -> None:
        self._app = app
        self._metrics = metrics
        self._clock = clock

    async def __call__(self, scope: Scope, receive: Receive, send: Send) -> None:
        """Pass the request on and time it."""
        if scope["type"] != "http":
            await self._app(scope, receive, send)
            return
        began = self._clock()
        status, stream = 500, False

        async def sending(message: Message) -> None:
            nonlocal status, stream
            if message["type"] == "http.response.start":
                status = message["status"]
                stream = any(value.startswith(b"text/event-stream") for _, value in message["headers"])
            await send(message)

        try:
            await self._app(scope, receive, sending)
        finally:
            if not stream:
                route = getattr(scope.get("route"), "path", "none")
                method = scope["method"] if route != "none" else "none"
                self._metrics.requests.labels(method, route, str(status)).observe(self._clock() - began)
