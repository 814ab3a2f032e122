"""One monitor process per active calibration of a machine that is acquired; alarms and recalibrations."""

from __future__ import annotations

import json
import sys
import threading
import time
from collections.abc import Callable, Mapping
from dataclasses import KW_ONLY, dataclass, field
from pathlib import Path
from typing import Any

import structlog

from daq.errors import HilfitError
from daq.messages import Sentence, message_of, named
from daq.whole_files import write_whole
from server.alarms.alarm_desk import Alarms
from server.calibrations.calibration_desk import ByPolicy
from server.calibrations.calibration_store import Of
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
    of: Of = "identification"
    stop: threading.Event = field(default_factory=threading.Event)
    thread: threading.Thread | None = None
    found: dict[str, Any] = field(default_factory=dict)
    since: str | None = None
    ended: float | None = None
    reason: str | None = None


@dataclass(eq=False)
class Monitors:
    """All monitors of a service.

    Attributes
    ----------
    models : by what a calibration may be of, the file to watch by of what it was made of
    recalibrate : asked once when a drift begins, if given
    """

    calibrations: ByPolicy
    acquisition: Acquisition
    machines: Machines
    files: DataDirectory
    models: Mapping[Of, Callable[[str], Path]]
    alarms: Alarms
    now: Callable[[], str]
    _: KW_ONLY
    recalibrate: Recalibrate | None = None
    rules: Rules = field(default_factory=Rules)

    def __post_init__(self) -> None:
        self._directory = self.files.root / "monitor"
        self._lock = threading.Lock()
        self._watches: dict[tuple[str, Of], _Watch] = {}
        # Machine -> calibration whose drift was reported: a monitor that starts again remembers it; once is enough.
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
        """Return the state of a machine's monitor: see ``GET /machines/{name}/monitor``."""
        return self._state(machine, "identification") | {"valves": self._state(machine, "valves")}

    def _state(self, machine: str, of: Of) -> dict[str, Any]:
        with self._lock:
            watch = self._watches.get((machine, of))
            if watch is None:
                return {"state": "off", **_because(self._why_not(machine, of))}
            common = {"calibration": watch.calibration, "since": watch.since}
            if watch.ended is not None:
                return {"state": "off", **common, **_because(watch.reason)}
            return {"state": "learning", **common, **watch.found, **_because(None)}

    def _why_not(self, machine: str, of: Of) -> str:
        if not self.acquisition.running(machine):
            return Sentence("server.not_acquired_now")
        return Sentence("server.no_valves_in_use" if of == "valves" else "server.no_calibration_in_use")

    def look(self) -> None:
        """Start what should be watched, end what should not."""
        keys = [(name, of) for name in self.acquisition.names() for of in self.models]
        wanted = {key: found for key in keys if (found := self._wanted(*key)) is not None}
        with self._lock:
            gone = {k: w for k, w in self._watches.items() if wanted.get(k, (None,))[0] != (w.calibration, w.ring_name)}
            for key in gone:
                del self._watches[key]
        for (machine, of), watch in gone.items():
            _end(watch)
            for kind in ALARMS[of]:
                self.alarms.report(machine, kind, "", "info", False)
        for (machine, of), ((calibration, ring_name), model) in wanted.items():
            with self._lock:
                current = self._watches.get((machine, of))
                if current is not None and (current.ended is None or time.monotonic() - current.ended < PAUSE_S):
                    continue
                watch = _Watch(calibration, ring_name, of, since=self.now())
                self._watches[machine, of] = watch
            row = self.machines.get(machine)
            order = Order(
                of=of,
                model=model,
                machine=self.files.machine_file(machine, row.version),
                ring_name=ring_name,
                memory=self._directory / f"{calibration}.json",
                rules=self.rules,
            )
            watch.thread = threading.Thread(
                target=self._watch, args=(machine, watch, order), name=f"monitor-{machine}-{of}", daemon=True
            )
            watch.thread.start()

    def _wanted(self, machine: str, of: Of) -> tuple[tuple[str, str], Path] | None:
        """Return (calibration, ring) and the model behind them; None if there is nothing to watch."""
        calibration = self.calibrations.active(machine, of)
        if calibration is None:
            return None
        try:
            _, feed = self.acquisition.feed(machine)
        except HilfitError:
            return None
        return (calibration.id, feed.ring_name), self.models[of](calibration.source)

    def _watch(self, machine: str, watch: _Watch, order: Order) -> None:
        path = self._directory / f"{watch.calibration}.order"
        try:
            write_whole(path, order.to_json().encode())
            result = run_child(
                [sys.executable, "-P", "-m", "server.monitor.monitor_child", str(path)],
                log=self._directory / f"{watch.calibration}.log",
                timeout_s=float("inf"),
                progress=lambda _, text: self._received(machine, watch, json.loads(text)),
                should_stop=watch.stop.is_set,
            )
            reason = (result.error or Sentence("server.acquisition_ended")).replace(f"{self.files.root}/", "")
        except Exception as error:
            _log.error("monitor_failed", machine=machine, exc_info=error)
            reason = Sentence("server.monitor_failed_unexpectedly")
        with self._lock:
            watch.reason, watch.ended = reason, time.monotonic()
        if not watch.stop.is_set():
            for kind in ALARMS[watch.of][1:]:
                self.alarms.report(machine, kind, "", "info", False)  # nobody looks any more
            _log.warning("monitor_ended", machine=machine, reason=reason)

    def _received(self, machine: str, watch: _Watch, found: dict[str, Any]) -> None:
        """Keep what a monitor reported; report a drift or an overload that begins or ends."""
        if "overload" in found:
            self._received_overload(machine, watch, found["overload"])
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
                watch.since = self.now()
        if watch.stop.is_set():
            return
        worst = [joint for joint in found["joints"] if joint["joint"] in drifting]
        moved = [named(joint["joint"], words) for joint in worst for words in changed(watch.of, joint)]
        text = Sentence(DRIFTS[watch.of], moved=moved)
        self.alarms.report(machine, ALARMS[watch.of][0], text, "warning", bool(drifting))
        if watch.of == "valves":
            return
        if found["state"] == "watching":
            self._asked.pop(machine, None)
        if found["state"] == "drift" and self._asked.get(machine) != watch.calibration and self.recalibrate is not None:
            self._asked[machine] = watch.calibration
            try:
                self.recalibrate(machine, text)
            except HilfitError as error:
                self.alarms.report(machine, "recalibration_failed", str(error), "warning", True)

    def _received_overload(self, machine: str, watch: _Watch, hit: dict[str, Any]) -> None:
        with self._lock:
            watch.found["overload"] = hit if hit["on"] else None
        if not watch.stop.is_set():
            self.alarms.report(machine, "overload", _as_text(hit) if hit["on"] else "", "critical", hit["on"])


def _because(reason: str | None) -> dict[str, Any]:
    return {"reason": reason, "reason_message": message_of(reason)}


#: What a monitor says once, or of its own accord, beside what it says of each block.
_LASTING = ("overload", "overload_joints", "overload_delay_s")
#: Alarms of a monitor, by what its calibration is of; the first is that of a drift.
ALARMS: Mapping[Of, tuple[str, ...]] = {"identification": ("residual_drift", "overload"), "valves": ("valve_drift",)}
#: Codes of the text of a drift.
DRIFTS: Mapping[Of, str] = {"identification": "server.effort_drifts", "valves": "server.speeds_drift"}
#: What a change of each statistic looks like to a person.
WORDS = {
    "offset": "a constant force more or less",
    "direction": "more or less force against the motion (friction)",
    "level": "a force that grows with the load (a gain, or another load)",
    **{
        f"{name}.{way}": f"the {name} of {way}ing"
        for way in ("extend", "retract")
        for name in ("edge", "gain", "delay")
    },
}


def _as_text(hit: Mapping[str, Any]) -> str:
    """Describe an overload to an operator."""
    values = {name: hit[name] for name in ("joint", "residual", "unit", "threshold")}
    return Sentence("server.collision_or_overload", **values, times=abs(hit["score"]))


def changed(of: Of, joint: Mapping[str, Any]) -> list[str]:
    """Describe a drift at a joint; of a valve, which of its numbers moved, as far as blocks show."""
    words = WORDS[joint["statistic"]]
    if of == "identification":
        return [words]
    return [
        Sentence("server.number_has_moved", what=WORDS[own["name"]], by=own["value"], unit=own["unit"], std=own["std"])
        for own in joint.get("moved", ())
    ] or [Sentence("server.seems_to_have_moved", what=words)]


def _end(watch: _Watch) -> None:
    watch.stop.set()
    if watch.thread is not None:
        watch.thread.join()
