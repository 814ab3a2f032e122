"""Which process is killed next, and when."""

from __future__ import annotations

import random
import time
from collections.abc import Callable

from benchmarks.storm.faults import Weather
from benchmarks.storm.processes import Herd, Host, real_identification
from benchmarks.targets import Show

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

    def __init__(self, herd: Herd, chance: random.Random, rate: float, say: Show, weather: Weather | None) -> None:
        self.weather = weather
        self._herd, self._chance, self._rate, self._say = herd, chance, rate, say
        self._began = self._due = self._told = time.monotonic()

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
            if now - self._told > 10.0:
                self._told = now
                seen = "" if self.weather is None else self.weather.said
                self._say(f"{self.past:3.0f} s: {self._herd.total} killed{seen}")
            time.sleep(0.02)


def _kill_one(herd: Herd, chance: random.Random) -> bool:
    """Kill one process of a kind that is there; False if there is none, or it was gone."""
    children = herd.children()
    ages = herd.ages(children["acquisition"])
    children["acquisition"] = [pid for pid, age in ages.items() if age > ACQUISITION_S * _slowness(herd)]
    herd.spared = {pid: herd.spared.get(pid, chance.random() < SPARED) for pid in children["stage"]}
    children["stage"] = [pid for pid, spared in herd.spared.items() if not spared]
    for kind in ("stage", "real stage"):
        children[kind] = [pid for pid in children[kind] if herd.hits[real_identification(pid)] < REAL_KILLS]
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
