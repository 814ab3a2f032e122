"""Acquire from many whole machine files, and see where they lead: ``python tests/daq/fuzz_machine_files.py [FILES]``.

A file is an honest one with up to three of its places changed. Places are drawn from the published JSON schema, all of
it, whether the honest file has them or not; what is put there is what the schema says, with texts that somebody might
try. Each file goes the way of an upload (:mod:`server.machines.inspect_machine`) and then that of an acquisition: every
driver of every bus is made, started, triggered once, and stopped. What traces it is that of :mod:`fuzz_places`; the
last line is JSON: files, those that were taken, those that made a driver try to open or connect, the places of the
schema that were changed and that there are, threads that are left, and every trespass.
"""

from __future__ import annotations

import copy
import ctypes.util
import json
import logging
import platform
import sys
import tempfile
import threading
import time
import warnings
from collections import Counter
from collections.abc import Iterator
from contextlib import suppress
from itertools import pairwise
from pathlib import Path
from typing import Any

from fuzz_places import DEVICES, HONEST, Trace, words
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from daq import parse_machine
from daq.drivers.base import DriverContext, make_driver
from daq.drivers.found_setups import FoundSetups
from daq.errors import HilfitError
from daq.frames.channels import channels_by_bus
from daq.machine.buses import BUSES
from daq.machine.device_files import refuse_files_elsewhere
from daq.machine.machine_file import Machine

SCHEMA = Machine.model_json_schema(by_alias=True)
#: Where a value stands in a file: keys, and numbers of list entries.
Place = tuple[str | int, ...]
DBC = 'VERSION ""\nBU_: X\nBO_ 291 Boom: 8 X\n SG_ Angle : 0|16@1+ (0.01,0) [0|655.35] "rad" X\n'
#: What may be tried for a text, and what a file itself says.
TEXTS = words | st.sampled_from(["b", "j1", "rad", "Pa", "arm.dbc", "other.dbc", "Angle", "0x6131:1 uint32"])
#: Keys of buses that say how long is waited, and how long it is here.
WAITS = {"timeout_s": 0.01, "listen_s": 0}
#: How deep a value that the schema describes is made.
DEPTH = 3

JOINT = {
    "name": "j1",
    "dh": {"a": 1.0, "alpha": 0.0, "d": 0.0, "theta": 0.0},
    "limits": {"position": [-1.0, 1.0], "velocity": 1.0, "acceleration": 1.0},
    "cylinder": {"bore": 0.08, "rod": 0.04, "stroke": 0.3, "linkage": {"type": "rack", "radius": 0.1, "zero": -1.2}},
}


def _file(bus: dict[str, Any], source: dict[str, Any]) -> dict[str, Any]:
    effort = {"name": "j1.torque", "quantity": "joint_effort", "joint": "j1", "unit": "N m"}
    return {
        "schema": "hilfit/machine/1", "name": "bench", "rate_hz": 50, "gravity": [0.0, -9.81, 0.0],
        "joints": [copy.deepcopy(JOINT)],
        "channels": [
            {"name": "j1.angle", "quantity": "joint_position", "joint": "j1", "unit": "rad",
             "source": {"bus": "b", **source}},
            {**effort, "source": {"bus": "b", **source}},
        ],
        "buses": [{"name": "b", **bus}],
    }  # fmt: skip


def honest_files() -> list[dict[str, Any]]:
    """A file for each kind of bus, and for each interface of a CAN bus."""
    found = []
    for kind in BUSES:
        waits = {key: wait for key, wait in WAITS.items() if key in kind.bus.model_fields}
        bus = {"type": kind.tag, **copy.deepcopy(dict(kind.example)), **waits}
        ways = [{"interface": name, "channel": own, "options": options} for name, (own, options) in HONEST.items()]
        found += [_file({**bus, **way}, {**kind.source}) for way in (ways if "interface" in bus else [{}])]
    return found


def places(schema: dict[str, Any], place: Place = (), depth: int = 6) -> Iterator[tuple[Place, dict[str, Any]]]:
    """Every place that the schema describes, with what it says of it; entries of lists stand for all (``0``)."""
    for option in _options(schema) if depth else ():
        for name, own in option.get("properties", {}).items():
            yield (*place, name), own
            yield from places(own, (*place, name), depth - 1)
        if "items" in option:
            yield (*place, 0), option["items"]
            yield from places(option["items"], (*place, 0), depth - 1)
        if isinstance(option.get("additionalProperties"), dict):
            yield (*place, "port"), option["additionalProperties"]


def _options(schema: dict[str, Any]) -> list[dict[str, Any]]:
    """What a schema lets a value be, references followed."""
    if "$ref" in schema:
        return _options(SCHEMA["$defs"][schema["$ref"].rpartition("/")[2]])
    several = schema.get("anyOf") or schema.get("oneOf")
    return [schema] if several is None else [own for one in several for own in _options(one)]


def values(schema: dict[str, Any], depth: int = DEPTH) -> st.SearchStrategy[Any]:
    """What fits a schema, but for texts, which somebody may try."""
    return st.one_of([_value(option, depth) for option in _options(schema)])


def _value(schema: dict[str, Any], depth: int) -> st.SearchStrategy[Any]:
    if "const" in schema:
        return st.just(schema["const"]) | TEXTS
    if "enum" in schema:
        return st.sampled_from(schema["enum"]) | TEXTS
    kind = schema.get("type")
    if kind == "integer":
        return st.integers(int(schema.get("minimum", 0)), int(schema.get("maximum", 2**16)))
    if kind == "number":
        return st.floats(schema.get("minimum", -100), schema.get("maximum", 100), allow_nan=False)
    if kind == "boolean":
        return st.booleans()
    if kind == "null":
        return st.none()
    if kind == "array":
        if "prefixItems" in schema:
            return st.tuples(*(values(part, depth) for part in schema["prefixItems"])).map(list)
        return st.lists(values(schema.get("items", {}), depth - 1), max_size=2) if depth else st.just([])
    if kind == "object" and "properties" in schema and depth:
        own = {name: values(part, depth - 1) for name, part in schema["properties"].items()}
        needed = {name: own.pop(name) for name in schema.get("required", ()) if name in own}
        return st.fixed_dictionaries(needed, optional=own)
    if kind == "object":
        return st.dictionaries(TEXTS, TEXTS | st.integers(0, 70000) | st.booleans(), max_size=2)
    return TEXTS


def changed(content: dict[str, Any], place: Place, value: Any) -> None:
    """Put a value at a place of a file; where there is no way to it, nowhere."""
    here: Any = content
    for key, following in pairwise(place):
        if isinstance(here, dict):
            if not isinstance(here.get(str(key)), dict | list):
                here[str(key)] = [] if isinstance(following, int) else {}
            here = here[str(key)]
        elif here:
            here = here[0]
        else:
            return
    if isinstance(here, dict):
        here[str(place[-1])] = value
    elif isinstance(here, list):
        here[:1] = [value]


def acquire(machine: Machine, data: Path) -> None:
    """Make, start, trigger and stop the drivers of all buses, as the process of an acquisition does."""
    context = DriverContext(
        period_s=0.02, patience_s=0.0, monotonic_ns=time.monotonic_ns, start_s=0.0, rate_hz=machine.rate_hz,
        found=FoundSetups(data, machine.name),
    )  # fmt: skip
    grouped = channels_by_bus(machine)
    drivers = [make_driver(bus, grouped[bus.name], context) for bus in machine.buses if bus.name in grouped]
    try:
        for driver in drivers:
            driver.start()
            driver.trigger(0)
            driver.collect(time.monotonic_ns())
    finally:
        for driver in drivers:
            driver.stop()


def trespasses(machine: Machine, folders: tuple[Path, ...], seen: list[tuple[str, str]]) -> list[str]:
    """What was tried beyond the devices and hosts that the buses name, and written beyond the data directory."""
    ports = {str(getattr(bus, name, "")).partition("@")[0] for bus in machine.buses for name in ("port", "channel")}
    hosts = {str(getattr(bus, "host", "")) for bus in machine.buses}
    hosts |= {str(getattr(bus, "options", {}).get("host", "")) for bus in machine.buses}
    found = []
    for what, where in seen:
        device = what == "open" and where in ports and DEVICES.fullmatch(where)
        inside = what != "connect" and any(Path(where).resolve().is_relative_to(folder) for folder in folders)
        host = what == "connect" and where in hosts and "/" not in where
        if not (device or inside or host):
            found.append(f"{[bus.place for bus in machine.buses]}: {what} {where}"[:300])
    return found


def main(files: int) -> dict[str, Any]:
    """Try so many files."""
    trace, counts, found, reached = Trace(), Counter[str](), list[str](), set[Place]()
    sys.addaudithook(trace)
    # Libraries of adapters are not there; looking for them, and for the kind of computer, starts programs.
    ctypes.util.find_library = lambda name: None
    platform.architecture = lambda *_: ("64bit", "ELF")
    honest = honest_files()
    every = dict(places(SCHEMA))
    put = {place: values(schema) for place, schema in every.items()}
    quiet = threading.active_count()
    with tempfile.TemporaryDirectory() as scratch:
        folder, data = Path(scratch, "machine").resolve(), Path(scratch, "data").resolve()
        for made in (folder, data):
            made.mkdir()
        (folder / "arm.dbc").write_text(DBC)

        @settings(max_examples=files, deadline=None, database=None, phases=[Phase.generate], derandomize=True,
                  suppress_health_check=list(HealthCheck))  # fmt: skip
        @given(st.sampled_from(honest), st.lists(st.sampled_from(sorted(every, key=str)), max_size=3), st.data())
        def one(content: dict[str, Any], chosen: list[Place], data_of: st.DataObject) -> None:
            counts["files"] += 1
            content = copy.deepcopy(content)
            for place in chosen:
                reached.add(place)
                changed(content, place, data_of.draw(put[place]))
            trace.seen, trace.on = [], True
            machine = None
            try:
                with suppress(HilfitError, RecursionError):  # what an upload is refused by
                    text = json.dumps(content)
                    machine = parse_machine(text, folder=None)
                    refuse_files_elsewhere(machine, "machine.yaml")
                    machine = parse_machine(text, folder=folder)
                    counts["taken"] += 1
                    with suppress(Exception):  # whatever a driver makes of it: where it went is what counts
                        acquire(machine, data)
            finally:
                trace.on = False
            counts["reached"] += bool(trace.seen)
            if machine is not None:
                found.extend(trespasses(machine, (data,), trace.seen))
            elif trace.seen:
                found.append(f"refused, and yet: {trace.seen}"[:300])

        one()
    left = threading.active_count() - quiet
    return {**counts, "places": len(reached), "of": len(every), "threads_left": left, "trespasses": sorted(set(found))}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    print(json.dumps(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)))
