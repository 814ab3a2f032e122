"""``hilfit doctor``: is this computer ready? A line each, with what to do.

Every probe only reads; none changes anything.
"""

from __future__ import annotations

import ctypes
import os
import platform
import shutil
import sys
import threading
from collections.abc import Callable, Collection, Iterator, Mapping
from dataclasses import asdict, dataclass
from importlib.metadata import PackageNotFoundError, distribution, version
from pathlib import Path
from typing import Annotated, Literal

import typer

from daq.confinement import landlock_version
from daq.console import Json, print_json, reported

Level = Literal["ok", "note", "problem"]

#: Extras of the distribution that a user installs, and what they are for.
EXTRAS = {
    "sim": "the simulated machine: demo, simulate, serve --simulate",
    "export": "MDF4, MCAP and ROS 2 bags: export, import",
    "xacro": "machine import of xacro files",
    "dbc": "CAN buses that a DBC file describes",
    "postgresql": "a service with several hosts",
    "s3": "an object store that hosts share",
}
#: Bytes: below the first recordings are in danger, below the second a day of recordings may not fit.
_LEAST_FREE, _GOOD_FREE = 100 * 2**20, 2 * 2**30
#: Bytes that the ring buffers of a few machines take.
_LEAST_SHARED = 64 * 2**20
_ARPHRD_CAN = "280"  # linux/if_arp.h
_TIME_ERROR = 5  # adjtimex(2): the clock is not synchronised
_RESIDENT_CLOCKS = ("tsc", "arch_sys_counter", "kvm-clock", "hyperv_clocksource_tsc_page")


@dataclass(frozen=True)
class Line:
    """One thing that was looked at.

    Attributes
    ----------
    topic : what was looked at
    level : ``problem``: something will fail; ``note``: something may be wanted
    text : what is there
    do : what to do; empty where nothing is
    """

    topic: str
    level: Level
    text: str
    do: str = ""


def program() -> Line:
    """Report versions and the computer."""
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    text = f"hilfit {version('hilfit')}, Python {platform.python_version()}, {platform.system()} "
    text += f"{platform.release()}, {cores} core{'s' if cores != 1 else ''}"
    if sys.platform != "linux":
        return Line("program", "note", text, "acquisition is tried on Linux only; use Linux at a machine")
    if cores < 2:
        return Line("program", "note", text, "acquire and identify on two cores or more: one process acquires")
    return Line("program", "ok", text)


def libraries() -> Iterator[Line]:
    """Check that what hilfit needs is there in a version that it was made for; then the extras."""
    from packaging.requirements import Requirement

    own = [Requirement(text) for text in distribution("hilfit").requires or ()]
    base = [need for need in own if need.marker is None or need.marker.evaluate({"extra": ""})]
    wrong = [need for need in base if _missing(need)]
    for need in wrong:
        text = f"{need.name}: {_missing(need)}"
        yield Line("libraries", "problem", text, f"pip install '{need.name}{need.specifier}'")
    if not wrong:
        yield Line("libraries", "ok", f"all {len(base)} that are needed, in versions that fit")
    for extra, use in EXTRAS.items():
        needs = [n for n in own if n not in base and n.marker is not None and n.marker.evaluate({"extra": extra})]
        if any(_missing(need) for need in needs):
            yield Line(f"extra {extra}", "note", f"not installed; for {use}", f"pip install 'hilfit[{extra}]'")
        else:
            yield Line(f"extra {extra}", "ok", f"installed: {use}")


def _missing(need: object) -> str:
    """Explain why a requirement is not met; empty if it is."""
    name, specifier = need.name, need.specifier  # type: ignore[attr-defined]
    try:
        found = version(name)
    except PackageNotFoundError:
        return "is not installed"
    return "" if specifier.contains(found, prereleases=True) else f"is {found}, needed is {specifier}"


def environment(variables: Mapping[str, str], known: Mapping[str, str]) -> Iterator[Line]:
    """Report variables that begin with ``HILFIT_``, and whether anything reads them.

    Parameters
    ----------
    variables : the environment
    known : what reads a name, by name
    """
    own = sorted(name for name in variables if name.startswith("HILFIT_"))
    if not own:
        yield Line("environment", "ok", "no variable HILFIT_... is set")
    for name in own:
        if name in known:
            yield Line("environment", "ok", f"{name} is set, for {known[name]}")
            continue
        like = sorted(other for other in known if other.endswith(name.removeprefix("HILFIT")))
        do = f"write {' or '.join(like[:3])}" if like else "unset it; 'hilfit COMMAND --help' lists the names"
        yield Line("environment", "problem", f"{name} is set and read by nothing", do)


def data_directory(path: Path) -> Line:
    """Check that the service can write there, who else can read it, and how much room is left."""
    topic = "data directory"
    place = path
    while not place.exists() and place != place.parent:
        place = place.parent
    place = place.resolve()
    if not place.is_dir():
        return Line(topic, "problem", f"{place} is no directory", "give another one with --data-dir")
    if not os.access(place, os.W_OK | os.X_OK):
        return Line(topic, "problem", f"{place} cannot be written", f"sudo chown $USER {place}, or another --data-dir")
    free = shutil.disk_usage(place).free
    text = f"{path.resolve()}: {free / 2**30:.1f} GiB free"
    text += "" if path.exists() else "; is made when the service starts"
    if free < _LEAST_FREE:
        return Line(topic, "problem", text, "make room: recordings stop when a disk is full")
    if path.exists() and path.stat().st_mode & 0o077:
        return Line(topic, "note", f"{text}; others on this computer can read it", f"chmod 700 {path.resolve()}")
    if free < _GOOD_FREE:
        return Line(topic, "note", text, "make room before long recordings")
    return Line(topic, "ok", text)


def _shared_memory(place: Path = Path("/dev/shm")) -> Line:
    """Check the room for the ring buffers."""
    topic = "shared memory"
    if not place.is_dir():
        return Line(topic, "problem", f"{place} is not there", "mount a tmpfs at /dev/shm; the ring buffer lives there")
    free = shutil.disk_usage(place).free
    text = f"{place}: {free / 2**20:.0f} MiB free"
    if free < _LEAST_SHARED or not os.access(place, os.W_OK):
        return Line(topic, "problem", text, "give it 64 MiB and write access (in a container: --shm-size 128m)")
    return Line(topic, "ok", text)


def scheduling() -> Line:
    """Check that acquisition may have the real-time class; tried in a thread that ends at once."""
    from daq.acquisition.acquisition_child import FIFO_PRIORITY, request_fifo

    if _in_a_thread(lambda: request_fifo()[0]):
        return Line("scheduling", "ok", f"SCHED_FIFO with priority {FIFO_PRIORITY} is granted")
    return Line(
        "scheduling",
        "note",
        "SCHED_FIFO is refused: cycles may be late on a busy computer",
        "add '@hilfit - rtprio 20' to /etc/security/limits.d/hilfit.conf and join that group, or "
        "AmbientCapabilities=CAP_SYS_NICE in the unit; in a container --ulimit rtprio=20",
    )


def precedence() -> Line:
    """Check that the service may precede ordinary work; tried as :func:`scheduling` is."""
    from server.platform.processes.precedence import NICENESS, take_niceness

    if _in_a_thread(take_niceness):
        return Line("precedence", "ok", f"the service answers before ordinary work (niceness {NICENESS})")
    text = "the service is no more than other programs: answers wait while they keep the processor busy"
    do = f"LimitNICE={NICENESS} in the unit, or '@hilfit - nice {NICENESS}' in /etc/security/limits.d/hilfit.conf; "
    return Line("precedence", "note", text, do + "in a container --ulimit nice=30, and --cpu-shares 4096")


def can_interfaces(root: Path = Path("/sys/class/net"), wanted: Mapping[str, str] | None = None) -> Iterator[Line]:
    """Report CAN interfaces of this computer.

    Parameters
    ----------
    root : where the kernel lists interfaces
    wanted : bus by interface, of a machine file; None where none was given
    """
    found: dict[str, bool] = {}
    for path in sorted(root.glob("*")):
        if _read(path / "type") == _ARPHRD_CAN:
            # A CAN controller says 'up', a virtual one 'unknown'; IFF_UP is the lowest bit of the flags.
            found[path.name] = bool(int(_read(path / "flags") or "0", 16) & 1)
    for name, bus in sorted((wanted or {}).items()):
        if name not in found:
            do = "plug the adapter in and load its driver; 'ip -details link show type can' lists what is there"
            yield Line("CAN", "problem", f"{name}, of bus '{bus}', is not there", do)
    for name, up in found.items():
        level: Level = "ok" if up else "problem" if name in (wanted or {}) else "note"
        do = "" if up else f"sudo ip link set {name} up type can bitrate 250000 (the bitrate of the bus)"
        yield Line("CAN", level, f"{name} is {'up' if up else 'down'}", do)
    if not found and not wanted:
        yield Line(
            "CAN", "note", "no CAN interface", "none is needed for Modbus and for files; else plug an adapter in"
        )


def _serial_ports(root: Path = Path("/dev")) -> Iterator[Line]:
    """Report serial adapters, for Modbus RTU."""
    for path in sorted([*root.glob("ttyUSB*"), *root.glob("ttyACM*")]):
        if os.access(path, os.R_OK | os.W_OK):
            yield Line("serial", "ok", f"{path} can be used")
        else:
            yield Line("serial", "problem", f"{path} is refused", "sudo usermod -aG dialout $USER, then log in again")


def confinement() -> Line:
    """Check that the kernel keeps children of the service away from its store."""
    if landlock_version() > 0:
        return Line("confinement", "ok", "acquisition and numerical children cannot write to the store (Landlock)")
    do = "use a kernel from 5.13 on with Landlock; without it run children as another user, or let nobody upload files"
    return Line("confinement", "note", "the kernel has no Landlock: children could write to the store", do)


def bus_places(places: Collection[str]) -> Line:
    """Report where uploaded machines may be acquired from."""
    if places:
        return Line("bus places", "ok", f"uploaded machines may be acquired from {', '.join(places)}")
    do = "list places in the file of --config to acquire them: bus_places: [can:socketcan:can0]"
    return Line("bus places", "ok", "uploaded machines may be acquired from nowhere", do)


def webhook_places(places: Collection[str]) -> Line:
    """Report where webhooks may be delivered to."""
    return Line("webhook places", "ok", f"webhooks may be delivered to {', '.join(places) or 'nowhere'}")


def _time_is_synchronised() -> Line:
    """Check the kernel's clock state (adjtimex(2)): recordings and audit carry UTC."""
    if sys.platform != "linux":
        return Line("time", "note", "cannot be told on this system", "")
    asked = ctypes.create_string_buffer(512)  # struct timex, modes 0: only reads
    state = ctypes.CDLL(None, use_errno=True).adjtimex(asked)
    if state < 0 or state == _TIME_ERROR:
        do = "sudo timedatectl set-ntp true, or install chrony; schedules and the order of recordings hang on UTC"
        return Line("time", "note", "the clock is not synchronised", do)
    return Line("time", "ok", "the clock is synchronised")


def _clock_source(path: Path = Path("/sys/devices/system/clocksource/clocksource0/current_clocksource")) -> Line:
    """Report how the kernel reads time: a slow way makes every cycle dearer."""
    found = _read(path)
    if not found or found in _RESIDENT_CLOCKS:
        return Line("clock", "ok", found or "not said by the kernel")
    return Line("clock", "note", f"{found} is slow to read", "look in the kernel's log why it left the processor's own")


def _in_a_thread(probe: Callable[[], bool]) -> bool:
    """Return what ``probe`` finds in a thread that ends at once, which alone is changed by it; False if it fails."""
    got: list[bool] = []
    thread = threading.Thread(target=lambda: got.append(probe()))
    thread.start()
    thread.join()
    return got == [True]


def _read(path: Path) -> str:
    try:
        return path.read_text(encoding="utf-8").strip()
    except OSError:
        return ""


_MARKS = {"ok": "ok     ", "note": "note   ", "problem": "PROBLEM"}


def register(app: typer.Typer) -> None:
    """Add the command."""
    app.command("doctor")(reported(doctor))


def doctor(
    machine: Annotated[
        Path | None, typer.Argument(help="Machine file whose CAN interfaces have to be there.", show_default=False)
    ] = None,
    data_dir: Annotated[Path, typer.Option(help="Data directory of the service.")] = Path("hilfit-data"),
    config: Annotated[
        Path | None, typer.Option(help="Settings of the service (YAML).", dir_okay=False, show_default=False)
    ] = None,
    json: Json = False,
) -> None:
    """Check that this computer is ready: libraries, permissions, scheduling, CAN, time. Exit code 1 on a problem."""
    found = list(_look(machine, data_dir, config))
    problems = sum(line.level == "problem" for line in found)
    if json:
        print_json({"ready": not problems, "lines": [asdict(line) for line in found]})
    else:
        for line in found:
            print(f"{_MARKS[line.level]} {line.topic:17s} {line.text}")
            if line.do:
                print(f"{'':25s} -> {line.do}")
        print(f"{problems} problem{'s' if problems != 1 else ''}" if problems else "ready")
    if problems:
        raise typer.Exit(1)


def _look(machine: Path | None, data_dir: Path, config: Path | None) -> Iterator[Line]:
    from server.platform.settings import load_settings

    wanted = None if machine is None else _interfaces(machine)
    yield program()
    yield from libraries()
    yield from environment(os.environ, _known_variables())
    yield data_directory(data_dir)
    yield _shared_memory()
    yield scheduling()
    yield precedence()
    yield from can_interfaces(wanted=wanted)
    yield from _serial_ports()
    yield confinement()
    settings = load_settings(config)
    yield bus_places(settings.bus_places)
    yield webhook_places(settings.webhook_places)
    yield _time_is_synchronised()
    yield _clock_source()


def _interfaces(machine: Path) -> dict[str, str]:
    """Map network interface to name of the bus, for buses that are one."""
    from daq.machine.buses import CanopenBus, CanSignalsBus
    from daq.machine.machine_file import load_machine

    buses = [bus for bus in load_machine(machine).buses if isinstance(bus, (CanopenBus, CanSignalsBus))]
    return {str(bus.channel): bus.name for bus in buses if bus.interface == "socketcan"}


def _known_variables() -> dict[str, str]:
    """Return what reads a variable of the environment, by its name."""
    from server.commands.command_line import every_command
    from server.commands.conventions import Parameter
    from server.platform.settings import Settings

    known = {f"HILFIT_{name.upper()}": "the service" for name in Settings.model_fields}
    for words, command in every_command():
        for parameter in (Parameter(words, own) for own in command.params):
            if parameter.option is not None and parameter.own.envvar is not None:
                known.setdefault(str(parameter.own.envvar), f"{parameter.option} of 'hilfit {words}'")
    return known
