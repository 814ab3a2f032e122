"""Open the buses of many machine files, and see where they lead: ``python tests/daq/fuzz_places.py [FILES]``.

A process of its own, because what traces it (``sys.addaudithook``) cannot be taken off again. Nothing is opened or
connected to in truth: the trace notes the attempt and refuses it, as a computer without that device or host does. The
last line is JSON: files, those that were taken, drivers that tried to open something, and every trespass.
"""

from __future__ import annotations

import ctypes.util
import json
import logging
import platform
import re
import sys
import warnings
from collections import Counter
from contextlib import closing, suppress
from typing import Any

from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st
from pydantic import TypeAdapter, ValidationError

import daq.without_mdf4  # noqa: F401
from daq.drivers.can.port import open_bus
from daq.drivers.modbus.client import ModbusConnection
from daq.machine.buses import Bus

#: Every scheme of pyserial (``serial/urlhandler``), and words that python-can or a shell would understand.
SCHEMES = ("alt", "cp2110", "hwgrep", "loop", "rfc2217", "socket", "spy", "file", "unix", "http", "ws")
TARGET = "/tmp/hilfit-fuzz-target"
#: Devices of a serial grammar that is written here once more, and what libraries ask the system for.
DEVICES = re.compile(r"/dev/tty[\w.\-]*|/dev/pts/\d+|/dev/serial/by-(id|path)/[^/\s]+|COM\d+")
HOSTS = ("192.0.2.10", "gateway.example", "::1")

urls = st.sampled_from([f"{scheme}://{rest}" for scheme in SCHEMES for rest in (
    f"/dev/ptmx?file={TARGET}", f"{TARGET}", "127.0.0.1:8350", f"?logging=debug&file={TARGET}")])  # fmt: skip
paths = st.sampled_from([TARGET, "/dev/ptmx", "/dev/sda", "/dev/../etc/passwd", "/dev/tty/../../etc/passwd",
    "/dev/serial/by-id/../../../tmp/x", "COM1\n", "/dev/ttyUSB0@115200", "/dev/ttyUSB0?file=/tmp/x", ""])  # fmt: skip
honest = st.sampled_from(["can0", "PCAN_USBBUS1", "/dev/ttyUSB0", "/dev/serial/by-id/usb-x", "COM3", *HOSTS])
words = st.one_of(honest, honest, honest, urls, paths, st.text(max_size=20))
keys = st.sampled_from(["host", "port", "tty_baudrate", "app_name", "unique_hardware_id", "logfile", "file", "url",
    "channel", "interface", "config_context", "ignore_config", "serial", "timing", "bus", "context"])  # fmt: skip
interfaces = st.sampled_from(["socketcan", "socketcand", "pcan", "kvaser", "vector", "ixxat", "gs_usb", "slcan",
    "serial", "virtual", "udp_multicast", "robotell", "seeedstudio", "canalystii", "nican", "neovi", "usb2can",
    "socketcan_native", "remote", "etas", "neousys", "systec", "spy://x"])  # fmt: skip
options = st.dictionaries(keys, st.one_of(words, st.integers(-1, 70000), st.booleans()), max_size=3)
HONEST = {
    "socketcan": ("can0", {"receive_own_messages": True}),
    "socketcand": ("can0", {"host": "192.0.2.10", "port": 29536}),
    "pcan": ("PCAN_USBBUS1", {}), "kvaser": ("0", {"driver_mode": False}), "vector": ("0", {"app_name": "x"}),
    "ixxat": ("0", {}), "gs_usb": ("x", {"index": 0}), "slcan": ("/dev/ttyACM0", {"sleep_after_open": 0.0}),
    "serial": ("/dev/serial/by-id/usb-x", {"baudrate": 115200}), "virtual": ("x", {}),
}  # fmt: skip


@st.composite
def can_buses(draw: st.DrawFn) -> dict[str, Any]:
    """A bus that fits, with up to two of its texts replaced by what somebody might try."""
    interface = draw(st.sampled_from(sorted(HONEST)))
    channel, own = HONEST[interface]
    bus = {"name": "b", "type": draw(st.sampled_from(["canopen", "can_signals"])), "interface": interface,
           "channel": channel, "options": dict(own), "listen_only": draw(st.booleans())}  # fmt: skip
    if bus["type"] == "can_signals":
        bus = {**{key: value for key, value in bus.items() if key != "listen_only"}, "dbc": ["x.dbc"]}
    for what in draw(st.lists(st.sampled_from(["channel", "interface", "options", "option", "bitrate"]), max_size=2)):
        if what == "option":
            bus["options"] = {**bus["options"], draw(st.sampled_from(sorted(own) or ["host"])): draw(words)}
        else:
            bus[what] = draw({"channel": words, "interface": interfaces, "options": options,
                              "bitrate": st.integers(0, 10**6)}[what])  # fmt: skip
    return bus


serial_buses = st.fixed_dictionaries({"name": st.just("b"), "type": st.just("modbus_rtu"), "port": words})
tcp_buses = st.fixed_dictionaries({"name": st.just("b"), "type": st.just("modbus_tcp"), "host": words})
BUS: TypeAdapter[Any] = TypeAdapter(Bus)


class Trace:
    """Notes what the process tries to open for writing, and to whom it wants to talk; refuses both."""

    def __init__(self) -> None:
        sys.dont_write_bytecode = True  # where Python keeps what it compiled is no place that a bus leads to
        self.on = False
        self.seen: list[tuple[str, str]] = []

    def __call__(self, event: str, arguments: tuple[Any, ...]) -> None:
        """One event of the interpreter."""
        if not self.on:
            return
        if event == "open":
            path, mode, flags = arguments
            writes = any(letter in mode for letter in "wax+") if isinstance(mode, str) else bool(flags & 0o3)
            if writes and path != "/dev/null":
                self.seen.append(("open", str(path)))
                raise PermissionError(f"{path} is not there")
        elif event in ("socket.connect", "socket.sendto"):
            self.seen.append(("connect", str(arguments[1][0] if isinstance(arguments[1], tuple) else arguments[1])))
            raise ConnectionRefusedError("nobody is there")
        elif event in ("socket.getaddrinfo", "socket.gethostbyname"):
            self.seen.append(("connect", str(arguments[0])))
            raise ConnectionRefusedError("nobody is there")
        elif event in ("subprocess.Popen", "os.system", "os.exec", "os.remove", "os.rename"):
            self.seen.append((event, str(arguments[0])))


def trespasses(bus: Any, seen: list[tuple[str, str]]) -> list[str]:
    """What was tried beyond the device or host that the bus names."""
    port = getattr(bus, "port", None) if bus.type == "modbus_rtu" else getattr(bus, "channel", None)
    host = getattr(bus, "host", None) or getattr(bus, "options", {}).get("host")
    found = []
    for what, where in seen:
        if what == "open" and where == str(port).partition("@")[0] and DEVICES.fullmatch(where):
            continue
        if what == "connect" and where == str(host) and "://" not in where and "/" not in where:
            continue
        found.append(f"{bus!r}: {what} {where}"[:300])
    return found


def main(files: int) -> dict[str, Any]:
    """Try so many files."""
    trace, counts, found = Trace(), Counter[str](), []
    sys.addaudithook(trace)
    # Libraries of adapters are not there; looking for them, and for the kind of computer, starts programs.
    ctypes.util.find_library = lambda name: None
    platform.architecture = lambda *_: ("64bit", "ELF")

    @settings(max_examples=files, deadline=None, database=None, phases=[Phase.generate], derandomize=True,
              suppress_health_check=list(HealthCheck))  # fmt: skip
    @given(st.one_of(can_buses(), serial_buses, tcp_buses))
    def one(content: dict[str, Any]) -> None:
        counts["files"] += 1
        try:
            bus = BUS.validate_python(content)
        except ValidationError:
            return
        counts["taken"] += 1
        trace.seen = []
        trace.on = True
        try:
            with suppress(Exception):  # whatever a library makes of it: where it went is what counts
                if bus.type in ("canopen", "can_signals"):
                    open_bus(bus).shutdown()
                elif bus.type in ("modbus_rtu", "modbus_tcp"):
                    with closing(ModbusConnection(bus, 0.01)) as connection:
                        connection.open()
        finally:
            trace.on = False
        counts["reached"] += bool(trace.seen)
        found.extend(trespasses(bus, trace.seen))

    one()
    return {**counts, "trespasses": sorted(set(found))}


if __name__ == "__main__":
    logging.disable(logging.CRITICAL)
    warnings.simplefilter("ignore")
    print(json.dumps(main(int(sys.argv[1]) if len(sys.argv) > 1 else 10_000)))
