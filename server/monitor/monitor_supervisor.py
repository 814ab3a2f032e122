"""One monitor process per machine that is acquired and has an active calibration; alarms and recalibrations."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import structlog

from daq.errors import HilfitError
from daq.whole_files import write_whole
from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import ByPolicy
from server.identifications.identification_results import MODEL_FILE
from server.machines.acquisition import Acquisition
from server.machines.machine_store import Machines
from server.monitor.monitor_order import Order, Rules
from server.platform.files import DataDirectory
from server.platform.processes.children import run_child
from server.platform.processes.rounds import Rounds

LOOK_S = 1.0
#: Seconds before a monitor that failed is tried again.
PAUSE_S = 60.0
_log = structlog.stdlib.get_logger(__name__)


#: Asks for a recalibration of a machine; the second argument says in words why.
Recalibrate = Callable[[str, str], None]


@dataclass
class _Watch:
    """One monitor process and what it said last."""

    calibration: str
    ring_name: str
    stop: threading.Event = field(default_factory=threading.Event)
    thread: threading.Thread | None = None
    found: dict[str, Any] = field(default_factory=dict)
    since: str | None = None
    ended: float | None = None
    reason: str | None = None


class Monitors:
    """All monitors of a service.

    Parameters
    ----------
    results : directory of the files that an identification left
    recalibrate : asked once when a drift begins, if given
    """

    def __init__(
        self,
        calibrations: ByPolicy,
        acquisition: Acquisition,
        machines: Machines,
        files: DataDirectory,
        results: Callable[[str], Path],
        alarms: Alarms,
        now: Callable[[], str],
        *,
        recalibrate: Recalibrate | None = None,
        rules: Rules | None = None,
    ) -> None:
        self.recalibrate = recalibrate
        self._calibrations = calibrations
        self._acquisition = acquisition
        self._machines = machines
        self._files = files
        self._results = results
        self._directory = files.root / "monitor"
        self._alarms = alarms
        self._now = now
        self._rules = rules or Rules()
        self._lock = threading.Lock()
        self._watches: dict[str, _Watch] = {}
        # Machine -> calibration whose drift was told: a monitor that starts again remembers it, and is not heard twice.
        self._asked: dict[str, str] = {}
        self._rounds = Rounds("monitors", LOOK_S, self.look)

    def start(self) -> None:
        """Start supervising; returns at once."""
        self._rounds.start()

    def stop(self) -> None:
        """End all monitors; also if they never started."""
        self._rounds.stop()
        with self._lock:
            watches, self._watches = list(self._watches.values()), {}
        for watch in watches:
            _end(watch)

    def state(self, machine: str) -> dict[str, Any]:
        """What the monitor of a machine says: see ``GET /machines/{name}/monitor``."""
        with self._lock:
            watch = self._watches.get(machine)
            if watch is None:
                return {"state": "off", "reason": self._why_not(machine)}
            common = {"calibration": watch.calibration, "since": watch.since}
            if watch.ended is not None:
                return {"state": "off", **common, "reason": watch.reason}
            return {"state": "learning", **common, **watch.found, "reason": None}

    def _why_not(self, machine: str) -> str:
        if not self._acquisition.running(machine):
            return "the machine is not acquired at the moment"
        return "the machine has no active calibration"

    def look(self) -> None:
        """Start what should be watched, end what should not."""
        wanted = {name: found for name in self._acquisition.names() if (found := self._wanted(name)) is not None}
        with self._lock:
            gone = {m: w for m, w in self._watches.items() if wanted.get(m, (None,))[0] != (w.calibration, w.ring_name)}
            for machine in gone:
                del self._watches[machine]
        for machine, watch in gone.items():
            _end(watch)
            for kind in ("residual_drift", "overload"):
                self._alarms.report(machine, kind, "", "info", False)
        for machine, ((calibration, ring_name), model) in wanted.items():
            with self._lock:
                current = self._watches.get(machine)
                if current is not None and (current.ended is None or time.monotonic() - current.ended < PAUSE_S):
                    continue
                watch = _Watch(calibration, ring_name, since=self._now())
                self._watches[machine] = watch
            row = self._machines.get(machine)
            order = Order(
                model=model,
                machine=self._files.machine_file(machine, row.version),
                ring_name=ring_name,
                memory=self._directory / f"{calibration}.json",
                rules=self._rules,
            )
            watch.thread = threading.Thread(
                target=self._watch, args=(machine, watch, order), name=f"monitor-{machine}", daemon=True
            )
            watch.thread.start()

    def _wanted(self, machine: str) -> tuple[tuple[str, str], Path] | None:
        """(calibration, ring) and the model behind them; None if there is nothing to watch."""
        calibration = self._calibrations.active(machine)
        if calibration is None:
            return None
        try:
            _, feed = self._acquisition.feed(machine)
        except HilfitError:
            return None
        return (calibration.id, feed.ring_name), self._results(calibration.identification) / MODEL_FILE

    def _watch(self, machine: str, watch: _Watch, order: Order) -> None:
        path = self._directory / f"{machine}.order"
        try:
            write_whole(path, order.to_json().encode())
            result = run_child(
                [sys.executable, "-P", "-m", "server.monitor.monitor_child", str(path)],
                log=self._directory / f"{machine}.log",
                timeout_s=float("inf"),
                progress=lambda _, text: self._heard(machine, watch, json.loads(text)),
                should_stop=watch.stop.is_set,
            )
            reason = (result.error or "the acquisition ended").replace(f"{self._files.root}/", "")
        except Exception as error:
            _log.error("monitor_failed", machine=machine, exc_info=error)
            reason = "the monitor failed unexpectedly; the log of the service says why"
        with self._lock:
            watch.reason, watch.ended = reason, time.monotonic()
        if not watch.stop.is_set():
            self._alarms.report(machine, "overload", "", "info", False)  # nobody looks any more
            _log.warning("monitor_ended", machine=machine, reason=reason)

    def _heard(self, machine: str, watch: _Watch, found: dict[str, Any]) -> None:
        """Keep what a monitor said; tell of a drift or an overload that begins or ends."""
        if "overload" in found:
            self._heard_overload(machine, watch, found["overload"])
            return
        if "overload_joints" in found:
            with self._lock:
                watch.found |= found
            return
        drifting = found.pop("drifting")
        with self._lock:
            before = watch.found.get("state", "learning")
            watch.found = {key: watch.found[key] for key in _LASTING if key in watch.found} | found
            if found["state"] != before:
                watch.since = self._now()
        if watch.stop.is_set():
            return
        worst = [joint for joint in found["joints"] if joint["joint"] in drifting]
        text = "; ".join(f"{joint['joint']}: {WORDS[joint['statistic']]}" for joint in worst)
        text = f"measured and predicted effort drift apart: {text}; recalibrate, or look for the cause"
        self._alarms.report(machine, "residual_drift", text, "warning", bool(drifting))
        if found["state"] == "watching":
            self._asked.pop(machine, None)
        if found["state"] == "drift" and self._asked.get(machine) != watch.calibration and self.recalibrate is not None:
            self._asked[machine] = watch.calibration
            try:
                self.recalibrate(machine, text)
            except HilfitError as error:
                self._alarms.report(machine, "recalibration_failed", str(error), "warning", True)

    def _heard_overload(self, machine: str, watch: _Watch, hit: dict[str, Any]) -> None:
        with self._lock:
            watch.found["overload"] = hit if hit["on"] else None
        if not watch.stop.is_set():
            self._alarms.report(machine, "overload", as_text(hit) if hit["on"] else "", "critical", hit["on"])


#: What a monitor says once, or of its own accord, beside what it says of each block.
_LASTING = ("overload", "overload_joints", "overload_delay_s")
#: What a change of each statistic looks like to a person.
WORDS = {
    "offset": "a constant force more or less",
    "direction": "more or less force against the motion (friction)",
    "level": "a force that grows with the load (a gain, or another load)",
}


def as_text(hit: Mapping[str, Any]) -> str:
    """What an operator reads of an overload."""
    return (
        f"{hit['joint']}: measured and predicted effort differ by {hit['residual']:+.4g} {hit['unit']}, "
        f"{abs(hit['score']):.1f} times the band (limit {hit['threshold']:.1f}): a collision or an overload; look at "
        "the arm"
    )


def _end(watch: _Watch) -> None:
    watch.stop.set()
    if watch.thread is not None:
        watch.thread.join()
