"""A live table of a machine's channels and devices."""

from __future__ import annotations

import contextlib
import json as json_text
import math
import sys
import time
from collections import deque
from typing import Any

import numpy as np
from rich.console import Console, Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from daq.acquisition.acquisition import AcquisitionProcess
from daq.acquisition.cycles import AcquisitionStatistics
from daq.acquisition.ring import RingReader
from daq.arrays import RowArray
from daq.machine.machine_file import Machine
from daq.quality import MEASURED, Quality

WINDOW_S = 2.0  # that rate and spread are of
_STYLES = {Quality.FRESH: "green", Quality.HELD: "green", Quality.OUT_OF_RANGE: "yellow", Quality.LATE: "yellow"}


class _Picture:
    """The table on the screen, fed with rows of the ring."""

    def __init__(self, machine: Machine) -> None:
        self._machine = machine
        self._conversions = [machine.conversion(channel) for channel in machine.channels]
        self._rows: deque[np.void] = deque(maxlen=max(2, round(WINDOW_S * machine.rate_hz)))

    def add(self, rows: RowArray) -> None:
        """Add rows that came."""
        self._rows.extend(rows)

    def table(self, statistics: AcquisitionStatistics) -> Group:
        """Return the table now."""
        table = Table("channel", "value", "unit", "quality", "age, ms", "values/s", "spread", "device", box=None)
        for column in (1, 4, 5, 6):
            table.columns[column].justify = "right"
        shown = self.content(statistics)["channels"]
        for channel in self._machine.channels:
            source = "" if channel.source is None else channel.source.bus
            one = shown.get(channel.name)
            if one is None:
                table.add_row(channel.name, "", channel.unit, "nothing yet", "", "", "", source)
                continue
            style = _STYLES.get(Quality[one["quality"].upper()], "red")
            table.add_row(
                channel.name, _number(one["value"], 6), channel.unit, Text(one["quality"], style=style),
                _number(one["age_ms"], 3), f"{one['values_per_s']:.1f}", _number(one["spread"], 2), source,
            )  # fmt: skip
        return Group(_head(statistics), table, *_troubles(statistics))

    def _window(self, index: int) -> tuple[float, float]:
        """Compute values a second, and their standard deviation."""
        good = [row for row in self._rows if int(row["quality"][index]) in (*MEASURED, Quality.LATE)]
        lasted = float(self._rows[-1]["time"] - self._rows[0]["time"]) + 1 / self._machine.rate_hz
        values = self._conversions[index].from_si([row["values"][index] for row in good])
        return len(good) / lasted, float(np.std(values)) if len(good) > 1 else math.nan

    def content(self, statistics: AcquisitionStatistics) -> dict[str, Any]:
        """Return :meth:`table` for programs: values in the channels' units, None where there is none."""
        newest = self._rows[-1] if self._rows else None
        channels = {}
        for index, channel in enumerate(self._machine.channels if newest is not None else ()):
            assert newest is not None
            rate, spread = self._window(index)
            channels[channel.name] = {
                "value": _known(float(self._conversions[index].from_si(newest["values"][index]))),
                "unit": channel.unit,
                "quality": Quality(int(newest["quality"][index])).name.lower(),
                "age_ms": _known(1e3 * float(newest["ages"][index])),
                "values_per_s": rate,
                "spread": _known(spread),
            }
        time_s = None if newest is None else float(newest["time"])
        return {"time": time_s, "state": statistics.state, "channels": channels, "buses": statistics.buses}


def _known(value: float) -> float | None:
    return None if math.isnan(value) else value


def _number(value: float | None, digits: int) -> str:
    return "" if value is None else f"{value:.{digits}g}"


def _head(statistics: AcquisitionStatistics) -> Text:
    buses = ", ".join(f"{bus['bus']} {bus['state']}" for bus in statistics.buses)
    return Text(
        f"{statistics.state}: {statistics.cycles} cycles, {statistics.skipped} skipped, {statistics.late} late; {buses}"
    )


def _troubles(statistics: AcquisitionStatistics) -> list[Text]:
    """List a line for every device that does not run, and every other trouble."""
    lines = [
        f"{bus['bus']} {device['name']}: {device['state']}: {device['detail']}"
        for bus in statistics.buses
        for device in bus["devices"]
        if device["state"] != "running"
    ]
    return [Text(line, style="red") for line in (*lines, *statistics.warnings)]


def watch(machine: Machine, seconds: float | None, rate: float, *, plain: bool = False, json: bool = False) -> None:
    """Show a machine until ``seconds`` are over or Ctrl-C; ``rate`` pictures a second, with ``json`` a line each.

    Raises
    ------
    AcquisitionError
        If a bus cannot be opened, or another master leads one that is not ``listen_only``.
    """
    console = Console()
    picture = _Picture(machine)
    plain = plain or json or not sys.stdout.isatty()
    with (
        AcquisitionProcess(machine, strict=False) as acquisition,
        RingReader(acquisition.ring_name) as ring,
        contextlib.suppress(KeyboardInterrupt),
        contextlib.ExitStack() as screen,
    ):
        ends = math.inf if seconds is None else time.monotonic() + seconds
        live = None if plain else screen.enter_context(Live(console=console, auto_refresh=False, screen=False))
        while time.monotonic() < ends:
            time.sleep(min(1.0 / rate, max(0.0, ends - time.monotonic())))
            acquisition.check()
            picture.add(ring.read().rows)
            if json:
                print(json_text.dumps(picture.content(acquisition.statistics())), flush=True)
                continue
            shown = picture.table(acquisition.statistics())
            if live is None:
                console.print(shown)
            else:
                live.update(shown, refresh=True)
