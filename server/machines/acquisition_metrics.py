"""What acquisition counts, for Prometheus."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from itertools import accumulate

from prometheus_client.core import CounterMetricFamily, GaugeMetricFamily, HistogramMetricFamily, Metric
from prometheus_client.utils import floatToGoString

from server.machines.acquisition import Acquisition

_STATES = ("off", "starting", "running", "waiting", "stopped")
_COUNTS = {
    "cycles": "Frames published.",
    "skipped": "Cycles that never happened because their time had passed.",
    "late": "Cycles that started more than a tenth of a period late.",
    "utc_jumps": "Times that the computer's clock was set.",
}


def acquisition_metrics(acquisition: Acquisition) -> Iterator[Metric]:
    """Yield state, restarts and counts of every machine's acquisition."""
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
    for machine in acquisition.names():
        statistics = acquisition.statistics(machine)
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


def _buckets(lateness: Mapping[str, int]) -> list[tuple[str, float]]:
    """Convert counts between bounds in ms to bounds in s and how many are not above each (Prometheus)."""
    bounds = (floatToGoString(float(bound) / 1e3) for bound in lateness)  # type: ignore[no-untyped-call]
    return list(zip(bounds, accumulate(lateness.values()), strict=True))
