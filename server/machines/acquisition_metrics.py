"""What acquisition counts, for Prometheus."""

from __future__ import annotations

from collections.abc import Iterator

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, Metric

from server.machines.acquisition import Acquisition

_STATES = ("off", "starting", "running", "waiting", "stopped")
_COUNTS = {
    "cycles": "Frames published.",
    "skipped": "Cycles that never happened because their time had passed.",
    "late": "Cycles that started more than a tenth of a period late.",
}


def acquisition_metrics(acquisition: Acquisition) -> Iterator[Metric]:
    """State, restarts and counts of every machine's acquisition."""
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
    for machine in acquisition.names():
        statistics = acquisition.statistics(machine)
        for state in _STATES:
            running.add_metric([machine, state], float(statistics["state"] == state))
        restarts.add_metric([machine], statistics.get("restarts", 0))
        found = statistics.get("counts", {})
        for name, family in counts.items():
            family.add_metric([machine], found.get(name, 0))
        for channel, by_quality in found.get("quality", {}).items():
            for name, number in by_quality.items():
                quality.add_metric([machine, channel, name], number)
    yield from (running, restarts, *counts.values(), quality)
