"""The processes of a storm: hosts that are started again whenever they die, and their children, found and killed.

Nothing is killed but what these hosts started: a process is looked up among the descendants of a host that is ours,
held by a file descriptor (pidfd), looked up once more, and only then killed. A number that was given to another
process meanwhile cannot be hit."""

from __future__ import annotations

import contextlib
import json
import os
import random
import signal
import subprocess
import sys
import threading
import time
from collections import Counter
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path

from benchmarks.service.hosts import end, polled
from benchmarks.service.start import descendants
from benchmarks.storm import stages
from benchmarks.storm.faults import Weather
from benchmarks.targets import Show

#: Kind of a process by a part of its command line.
CHILDREN: Mapping[str, str] = {
    "daq.acquisition.acquisition_child": "acquisition",
    "storm/stages.py": "stage",
    "benchmarks.storm.real_stages": "real stage",
}
START_S = 240.0
OnHost = Callable[[list[str]], list[str]]


@dataclass
class Host:
    """A server or a worker that is started again whenever it was killed."""

    name: str
    command: list[str]
    log: Path
    process: subprocess.Popen[str] | None = None
    line: str | None = None
    starts: int = 0
    up: threading.Event = field(default_factory=threading.Event)
    began: float = 0.0
    since: float = 0.0
    took: float = 0.0
    doom_s: float | None = None
    life_s: float = 0.0
    killed: bool = False

    def start(self) -> None:
        """Start it; ``up`` is set once it reports that it works."""
        self.up.clear()
        self.killed = False
        self.began = time.monotonic()
        with self.log.open("ab") as errors:
            process = subprocess.Popen(
                self.command, stdin=subprocess.DEVNULL, stdout=subprocess.PIPE, stderr=errors, text=True
            )
        self.process, self.starts = process, self.starts + 1
        threading.Thread(target=self._read_first_line, args=(process,), daemon=True).start()

    def _read_first_line(self, process: subprocess.Popen[str]) -> None:
        assert process.stdout is not None
        line = process.stdout.readline().strip()
        if line and process is self.process:
            self.line, self.since = line, time.monotonic()
            self.took = self.since - self.began
            self.up.set()

    @property
    def due(self) -> bool:
        """True if its time has come: it has worked for its life, or was doomed from the start."""
        now = time.monotonic()
        if self.doom_s is not None and now - self.began > self.doom_s:
            return True
        return self.up.is_set() and now - self.since > self.life_s

    @property
    def pid(self) -> int | None:
        """Number of its process; None where it does not run."""
        return None if self.process is None or self.process.poll() is not None else self.process.pid

    def kill(self) -> None:
        """Kill -9 it, if it runs."""
        if self.process is not None:
            self.process.kill()
            self.process.wait()


class Herd:
    """All hosts of a storm.

    Parameters
    ----------
    order : file that every host reads its order in (:class:`benchmarks.storm.host.HostOrder`)
    workers : names of the workers beside the server, and what starts a command on the host of each

    Attributes
    ----------
    died : hosts that worked and ended although nobody had killed them
    refused : exit codes of those that ended by themselves before they worked
    """

    def __init__(self, order: Path, workers: Mapping[str, OnHost], logs: Path) -> None:
        command = [sys.executable, "-m", "benchmarks.storm.clock", str(order)]
        self.server = Host("server", command, logs / "server.log")
        self.workers = [Host("worker", on([*command, name]), logs / f"{name}.log") for name, on in workers.items()]
        self.starting = 0
        self.died: list[str] = []
        self.refused: Counter[int] = Counter()
        self.spared: dict[int, bool] = {}
        self.hits: Counter[str] = Counter()
        self._seen: dict[int, float] = {}
        self.killed: dict[str, int] = dict.fromkeys(("server", "worker", *CHILDREN.values()), 0)

    @property
    def hosts(self) -> list[Host]:
        """Server and workers."""
        return [self.server, *self.workers]

    @property
    def total(self) -> int:
        """Number of processes killed."""
        return sum(self.killed.values())

    def revive(self) -> list[Host]:
        """Start every host that is not there; these."""
        started = []
        for host in self.hosts:
            if host.pid is None:
                self._note_end(host)
                host.start()
                started.append(host)
        return started

    def _note_end(self, host: Host) -> None:
        """Note a host that ended by itself."""
        if host.process is None:
            return
        if host.process.stdout is not None:
            host.process.stdout.close()
        if host.killed:
            return
        if host.up.is_set():
            self.died.append(f"{host.log.stem}, exit code {host.process.returncode}")
        else:
            self.refused[host.process.returncode] += 1

    def children(self) -> dict[str, list[int]]:
        """Group descendants of the hosts by kind; leave out those that are no target."""
        found: dict[str, list[int]] = {kind: [] for kind in CHILDREN.values()}
        for host in self.hosts:
            for pid in () if host.pid is None else descendants(host.pid):
                command = _command(pid)
                for text, kind in CHILDREN.items():
                    if text in command:
                        found[kind].append(pid)
        return found

    def ages(self, pids: list[int]) -> dict[int, float]:
        """Return seconds since each of these processes was first seen here."""
        now = time.monotonic()
        self._seen = {pid: self._seen.get(pid, now) for pid in pids}
        return {pid: now - seen for pid, seen in self._seen.items()}

    def kill_child(self, kind: str, pid: int) -> bool:
        """Kill -9 a descendant of ours; False if it was gone."""
        try:
            held = os.pidfd_open(pid)
        except ProcessLookupError:
            return False
        try:
            if pid not in self.children()[kind]:
                return False
            subject = _real_identification(pid)
            signal.pidfd_send_signal(held, signal.SIGKILL)
        except ProcessLookupError:
            return False
        finally:
            os.close(held)
        self.killed[kind] += 1
        self.hits[subject] += subject != ""
        return True

    def kill_host(self, host: Host) -> bool:
        """Kill -9 a host; False if it was gone."""
        if host.pid is None:
            return False
        self.starting += not host.up.is_set()
        host.up.clear()
        host.killed = True
        host.kill()
        self.killed[host.name] += 1
        return True

    def wait_up(self) -> bool:
        """Start what is missing until every host works."""

        def up() -> bool:
            self.revive()
            return all(host.up.wait(0.2) for host in self.hosts)

        return bool(polled(up, START_S, 0.0))

    def stop(self) -> list[int]:
        """Stop every host that runs; exit codes."""
        return [end(host.process, START_S) for host in reversed(self.hosts) if host.process is not None]

    def log_events(self) -> dict[str, int]:
        """Count each event of level error in the hosts' logs, and tracebacks outside of them."""
        counts = Counter[str]()
        for host in self.hosts:
            for line in host.log.read_text(errors="replace").splitlines() if host.log.is_file() else ():
                with contextlib.suppress(ValueError, AttributeError):
                    content = json.loads(line)
                    if content.get("level") in ("error", "critical"):
                        counts[" ".join(str(content.get("event")).split())[:80]] += 1
                    continue
                if line.startswith("Traceback"):
                    counts["traceback"] += 1
        return counts


def _real_identification(pid: int) -> str:
    """Return the id of the real identification that a stage works on; empty if it is a light one, or gone."""
    for text in _command(pid).split("\0"):
        if text.endswith("/request.json"):
            with contextlib.suppress(OSError, ValueError):
                content = json.loads(Path(text).read_text(encoding="utf-8"))
                return Path(text).parents[1].name if stages.is_real(content) else ""
    return ""


def _command(pid: int) -> str:
    try:
        return Path(f"/proc/{pid}/cmdline").read_bytes().decode(errors="replace")
    except OSError:
        return ""


#: Least seconds between two kills.
BREATH_S = 0.15
#: How often each kind is chosen, where one is there.
WEIGHTS = {"server": 8, "worker": 6, "acquisition": 6, "stage": 2, "real stage": 2}
#: Seconds that a host works at least before it is killed, drawn at its start, and that an acquisition is there; longer
#: on a computer so busy that a host takes longer than usual to start, or nothing would ever get to work.
LIFE_S = (2.0, 12.0)
ACQUISITION_S = 2.0
USUAL_START_S = 2.5
#: Share of the stages that are spared: three kills fail a job.
SPARED = 0.4
#: Most kills of stages of a real identification: it has to get done.
REAL_KILLS = 2
#: Share of starts that are killed within so many seconds, up or not.
DOOMED, DOOM_S = 0.4, 4.0


class Killing:
    """Kills at random, so many a second.

    Attributes
    ----------
    past : seconds since it began
    weather : what else happens meanwhile
    """

    def __init__(self, herd: Herd, chance: random.Random, rate: float, show: Show, weather: Weather | None) -> None:
        self.weather = weather
        self._herd, self._chance, self._rate, self._show = herd, chance, rate, show
        self._began = self._due = self._shown = time.monotonic()

    @property
    def past(self) -> float:
        """Seconds since the first call."""
        return time.monotonic() - self._began

    def go_on(self, wanted: Callable[[float], bool], longest: float) -> None:
        """Kill while it is ``wanted`` (given the seconds since the beginning), for ``longest`` s at most."""
        start, chance = time.monotonic(), self._chance
        while wanted(self.past) and (now := time.monotonic()) - start < longest:
            if self.weather is not None:
                self.weather.go_on()
            for host in self._herd.revive():
                host.doom_s = chance.uniform(0.0, DOOM_S) if chance.random() < DOOMED else None
                host.life_s = chance.uniform(*LIFE_S) * _slowness(self._herd)
            if now >= self._due and _kill_one(self._herd, chance):
                # From when it was due: a storm that falls behind catches up.
                self._due = max(self._due + chance.expovariate(self._rate), now + BREATH_S)
            if now - self._shown > 10.0:
                self._shown = now
                seen = "" if self.weather is None else self.weather.shown
                self._show(f"{self.past:3.0f} s: {self._herd.total} killed{seen}")
            time.sleep(0.02)


def _kill_one(herd: Herd, chance: random.Random) -> bool:
    """Kill one process of a kind that is there; False if there is none, or it was gone."""
    children = herd.children()
    ages = herd.ages(children["acquisition"])
    children["acquisition"] = [pid for pid, age in ages.items() if age > ACQUISITION_S * _slowness(herd)]
    herd.spared = {pid: herd.spared.get(pid, chance.random() < SPARED) for pid in children["stage"]}
    children["stage"] = [pid for pid, spared in herd.spared.items() if not spared]
    for kind in ("stage", "real stage"):
        children[kind] = [pid for pid in children[kind] if herd.hits[_real_identification(pid)] < REAL_KILLS]
    # Not all at their start: a host that never works does nothing that could go wrong.
    hosts: dict[str, list[Host]] = {"server": [herd.server], "worker": herd.workers}
    up = {kind: [host for host in found if host.due] for kind, found in hosts.items()}
    there = [kind for kind in WEIGHTS if children.get(kind) or up.get(kind)]
    if not there:
        return False
    kind = chance.choices(there, [WEIGHTS[kind] for kind in there])[0]
    if kind in up:
        return herd.kill_host(chance.choice(up[kind]))
    return herd.kill_child(kind, chance.choice(children[kind]))


def _slowness(herd: Herd) -> float:
    """Compute how many times longer than usual the server started, 1 to 10: beyond, it waited for disk or database."""
    return min(max(1.0, herd.server.took / USUAL_START_S), 10.0)
