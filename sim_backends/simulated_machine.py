"""A simulated machine on real bus protocols: its processes, from power-on to power-off.

::

    acquisition --socketcand--> hub --STEP--> plant + controller <--- inbox/*.csv
         |                       |  \\--SYNC--> CANopen nodes
         \\-Modbus TCP, RTU--> Modbus devices --BARRIER--> hub

All ports are ephemeral and on the loopback interface, serial lines are pseudo-terminals. ``<workdir>/machine.yaml`` is
the machine file with the addresses that hold for this run.
"""

from __future__ import annotations

import contextlib
import json
import os
import selectors
import socket
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import asdict, astuple
from pathlib import Path
from typing import Any, Literal

from daq.errors import HilfitError, InputError
from daq.machine.machine_file import CanopenBus, Machine, ModbusRtuBus, ModbusTcpBus, Simulation, machine_to_yaml
from daq.messages import Sentence
from daq.whole_files import write_whole
from sim_backends import backplane
from sim_backends.devices.wiring import wire
from sim_backends.faults.fault_file import FaultScript
from sim_backends.faults.fault_runner import FaultRunner
from sim_backends.plant.truth import SensorQuality, Truth, load_truth
from sim_backends.undeclared import EffectSpec, check_spec
from sim_backends.valve.effects import ValveEffectSpec, with_effect
from sim_backends.valve.truth import ValvePlantTruth, load_valve_truth

START_PATIENCE = 120.0  # s for all processes to be ready: a first start compiles and loads everything from disk
ORDER_PATIENCE = 10.0  # s for an answer to an order, not counting time that the processes wait for a processor
STOP_PATIENCE = 5.0  # s for a process to end by itself
HIGHEST_SPEED = 4.0

Reached = Callable[[Mapping[str, Any]], bool]

_MODULES = {
    "plant": "sim_backends.plant.plant_process",
    "valves": "sim_backends.valve.valve_process",
    "hub": "sim_backends.devices.can_hub",
    "nodes": "sim_backends.devices.canopen_nodes",
    "modbus": "sim_backends.devices.modbus_devices",
}

#: Which process is to blame where several have failed: each one takes those after it along.
_BLAMED = ("plant", "hub", "nodes", "modbus")


class SimulationError(HilfitError):
    """A process of the simulated machine did not start, failed, or does not answer."""


def waited_s(pids: Iterable[int]) -> float:
    """Sum seconds for which these processes were ready but had no processor; 0 where the system has no count.

    Source: ``/proc/PID/schedstat``, time spent waiting on a run queue (Documentation/scheduler/sched-stats.rst).
    """
    total = 0
    for pid in pids:
        with contextlib.suppress(OSError, IndexError, ValueError):
            total += int(Path(f"/proc/{pid}/schedstat").read_text(encoding="ascii").split()[1])
    return total / 1e9


class _Process:
    """A child process with its orders and answers.

    Parameters
    ----------
    waited : seconds for which the machine's processes have waited for a processor: a silence that long is no fault
    module : which of the modules it runs, if not the one of its name
    """

    def __init__(
        self,
        name: str,
        configuration: Mapping[str, Any],
        ends: Sequence[socket.socket],
        log: Path,
        waited: Callable[[], float] = lambda: 0.0,
        module: str | None = None,
    ) -> None:
        self.name, self.log, self._waited = name, log, waited
        environment = {k: v for k, v in os.environ.items() if k != "PYTHONSTARTUP"}
        # One thread each: numerical libraries would start one per core.
        environment |= dict.fromkeys(("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS"), "1")
        with log.open("wb") as errors:
            self.popen = subprocess.Popen(
                [sys.executable, "-m", _MODULES[module or name]],
                stdin=subprocess.PIPE, stdout=subprocess.PIPE, stderr=errors,
                pass_fds=[end.fileno() for end in ends], env=environment,
            )  # fmt: skip
        self._received = b""
        self._send(configuration)

    def _send(self, content: Mapping[str, Any]) -> None:
        assert self.popen.stdin is not None
        try:
            self.popen.stdin.write(json.dumps(content).encode() + b"\n")
            self.popen.stdin.flush()
        except (BrokenPipeError, ValueError):
            raise SimulationError(self.ended()) from None

    def answer(self, patience: float) -> dict[str, Any]:
        """Return its next line, within ``patience`` s that it was able to run in."""
        assert self.popen.stdout is not None
        descriptor = self.popen.stdout.fileno()
        deadline, waited = time.monotonic() + patience, self._waited()
        with selectors.DefaultSelector() as selector:
            selector.register(descriptor, selectors.EVENT_READ)
            while b"\n" not in self._received:
                left = deadline - time.monotonic()
                if left <= 0:
                    left = deadline + self._waited() - waited - time.monotonic()
                    if left <= 0:
                        raise SimulationError(
                            "sim_backends.process_no_answer", process=self.name, patience=patience, log=self.log
                        )
                if not selector.select(left):
                    continue
                data = os.read(descriptor, 1 << 16)
                if not data:
                    raise SimulationError(self.ended())
                self._received += data
        line, _, self._received = self._received.partition(b"\n")
        content: dict[str, Any] = json.loads(line)
        return content

    def order(self, content: Mapping[str, Any]) -> Any:
        """Order it and wait for its result."""
        self._send(content)
        answer = self.answer(ORDER_PATIENCE)
        if "error" in answer:
            raise SimulationError(
                "sim_backends.process_order_failed", process=self.name, order=content["order"], error=answer["error"]
            )
        return answer["result"]

    def gone(self, patience: float = 0.0) -> bool:
        """Test whether it has ended, or does so within that many seconds."""
        try:
            self.popen.wait(timeout=patience)
        except subprocess.TimeoutExpired:
            return False
        return True

    def ended(self) -> Sentence:
        """Return one line about a process that is gone."""
        which = {"process": self.name, "pid": self.popen.pid, "log": self.log}
        try:
            return Sentence("sim_backends.process_ended", **which, code=self.popen.wait(timeout=1.0))
        except subprocess.TimeoutExpired:
            return Sentence("sim_backends.process_ending", **which)

    def stop(self) -> None:
        """Close its stdin, which ends it; terminate it by its pid if that does not help."""
        for stream in (self.popen.stdin, self.popen.stdout):
            if stream is not None:
                with contextlib.suppress(BrokenPipeError):
                    stream.close()
        for give_up in (self.popen.terminate, self.popen.kill, None):
            try:
                self.popen.wait(timeout=STOP_PATIENCE)
                return
            except subprocess.TimeoutExpired:
                if give_up is not None:
                    give_up()


class SimulatedMachine:
    """Simulated buses of a machine, as a context manager.

    Parameters
    ----------
    machine : Machine
        With ``buses`` and ``source`` entries; addresses in it are replaced.
    truth : Truth or ValvePlantTruth, optional
        The plant's own parameters; default: those of a committed machine, if ``machine`` is one. With valves, motion
        follows from what the controller sends (:mod:`sim_backends.valve.valve_process`).
    undeclared : sequence of EffectSpec (with valves of ValveEffectSpec), or "demo"
        Effects that only the plant's process gets to know. ``"demo"``: the demonstration's, chosen by the plant
        itself, so that not even the caller handles its name.
    seed : int
        Of everything random in the plant.
    speed : float
        Machine seconds per second that acquisition is asked to run at (it leads with SYNC); up to 4.
    workdir : path
        Gets ``machine.yaml``, ``inbox/``, ``accepted/``, ``rejected/``, ``controller.json`` and logs.
    faults : FaultScript, optional
        Begun and ended at their times, from the first SYNC on; ``workdir/faults.jsonl`` records when.
    show : callable
        Takes a line for each of them.

    Raises
    ------
    InputError
        If the machine cannot be simulated, or an effect or the speed is wrong.
    SimulationError
        If a process does not start.
    """

    def __init__(
        self,
        machine: Machine,
        truth: Truth | ValvePlantTruth | None = None,
        undeclared: Sequence[EffectSpec | ValveEffectSpec] | Literal["demo"] = (),
        seed: int = 0,
        speed: float = 1.0,
        workdir: str | Path = ".",
        faults: FaultScript | None = None,
        show: Callable[[str], None] = lambda line: None,
    ) -> None:
        if not 0 < speed <= HIGHEST_SPEED:
            raise InputError("sim_backends.speed_beyond", speed=speed, highest=HIGHEST_SPEED)
        self._wiring = wire(machine)
        self._machine = machine
        self._truth = truth if truth is not None else truth_of(machine)
        self._undeclared = undeclared if undeclared == "demo" else self._checked(undeclared)
        self._seed, self._speed = seed, speed
        self.workdir = Path(workdir).resolve()
        self.inbox = self.workdir / "inbox"
        self.machine_path = self.workdir / "machine.yaml"
        self.status_path = self.workdir / "controller.json"
        self._processes: dict[str, _Process] = {}
        self._ordering = threading.Lock()  # an answer belongs to the order before it
        self._faults = None
        if faults is not None:
            log = self.workdir / "faults.jsonl"
            self._faults = FaultRunner(self, machine, faults.faults, log, show)

    def _checked(self, undeclared: Sequence[EffectSpec | ValveEffectSpec]) -> list[list[Any]]:
        """Check effects as the plant's process gets them (InputError if it cannot have them)."""
        for spec in undeclared:
            if isinstance(self._truth, ValvePlantTruth) != isinstance(spec, ValveEffectSpec):
                raise InputError("sim_backends.undeclared_other_kind", effect=spec.id)
            if isinstance(spec, EffectSpec):
                check_spec(spec, self._machine)
            elif isinstance(self._truth, ValvePlantTruth):
                with_effect(self._machine, self._truth, spec)
        return [list(astuple(spec)) for spec in undeclared]

    def __enter__(self) -> SimulatedMachine:
        for folder in (self.inbox, self.workdir / "accepted", self.workdir / "rejected", self.workdir / "log"):
            folder.mkdir(parents=True, exist_ok=True)
        try:
            self._start()
        except BaseException:
            self.stop()
            raise
        if self._faults is not None:
            self._faults.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.stop()

    def _start(self) -> None:
        plant_hub, hub_plant = backplane.pair()
        nodes_hub, hub_nodes = backplane.pair()
        modbus_hub, hub_modbus = backplane.pair()
        wiring = self._wiring
        plant = {
            "machine": machine_to_yaml(self._machine), "truth": self._truth.to_dict(), "undeclared": self._undeclared,
            "quality": asdict(SensorQuality()), "seed": self._seed, "hub": plant_hub.fileno(),
            "inbox": str(self.inbox), "status": str(self.status_path),
        }  # fmt: skip
        nodes = {
            "hub": nodes_hub.fileno(), "nodes": [asdict(plan) for plan in wiring.nodes],
            "rate_hz": self._machine.rate_hz,
        }  # fmt: skip
        modbus = {
            "hub": modbus_hub.fileno(),
            "buses": {
                bus.name: {
                    "baudrate": bus.baudrate if isinstance(bus, ModbusRtuBus) else None,
                    "units": [asdict(plan) for plan in wiring.modbus[bus.name]],
                }
                for bus in self._machine.buses
                if wiring.modbus.get(bus.name)
            },
        }  # fmt: skip
        hub = {
            "channel": wiring.can_channel, "plant": hub_plant.fileno(), "nodes": hub_nodes.fileno(),
            "modbus": hub_modbus.fileno(),
        }  # fmt: skip
        ends = (plant_hub, hub_plant, nodes_hub, hub_nodes, modbus_hub, hub_modbus)
        try:
            for name, configuration, mine in (
                ("plant", plant, (plant_hub,)),
                ("nodes", nodes, (nodes_hub,)),
                ("modbus", modbus, (modbus_hub,)),
                ("hub", hub, (hub_plant, hub_nodes, hub_modbus)),
            ):
                log = self.workdir / "log" / f"{name}.log"
                module = "valves" if name == "plant" and isinstance(self._truth, ValvePlantTruth) else name
                self._processes[name] = _Process(name, configuration, mine, log, self._waited, module)
        finally:
            for end in ends:
                end.close()
        ready = self._ready()
        self.can_port = int(ready["hub"]["port"])
        ports: dict[str, Any] = ready["modbus"]["ports"]
        self.modbus_ports: dict[str, int] = {bus: port for bus, port in ports.items() if isinstance(port, int)}
        self.serial_ports: dict[str, str] = {bus: port for bus, port in ports.items() if isinstance(port, str)}
        write_whole(self.machine_path, machine_to_yaml(self._addressed()).encode())

    def _ready(self) -> dict[str, Any]:
        """Read what each process reports once it is ready, in the order of their reports."""
        deadline = time.monotonic() + START_PATIENCE
        ready: dict[str, Any] = {}
        with selectors.DefaultSelector() as selector:
            for process in self._processes.values():
                assert process.popen.stdout is not None
                selector.register(process.popen.stdout, selectors.EVENT_READ, process)
            while selector.get_map():
                events = selector.select(max(0.0, deadline - time.monotonic()))
                if not events:
                    late = next(process for name, process in self._processes.items() if name not in ready)
                    raise SimulationError(
                        "sim_backends.process_not_ready", process=late.name, patience=START_PATIENCE, log=late.log
                    )
                for key, _ in events:
                    try:
                        ready[key.data.name] = key.data.answer(ORDER_PATIENCE)["ready"]
                    except SimulationError:
                        self.check()
                        raise
                    selector.unregister(key.fileobj)
        return ready

    def _addressed(self) -> Machine:
        """Return the machine file as it holds for this run."""
        buses: list[Any] = []
        for bus in self._machine.buses:
            if isinstance(bus, CanopenBus):
                options = {"host": "127.0.0.1", "port": self.can_port}
                buses.append(bus.model_copy(update={"interface": "socketcand", "options": options, "bitrate": None}))
            elif isinstance(bus, ModbusTcpBus):
                port = self.modbus_ports.get(bus.name, bus.port)
                buses.append(bus.model_copy(update={"host": "127.0.0.1", "port": port}))
            elif isinstance(bus, ModbusRtuBus):
                port_path = self.serial_ports.get(bus.name, bus.port)
                buses.append(bus.model_copy(update={"port": port_path, "parity": "N"}))  # a pty refuses parity
        simulation = Simulation(speed=self._speed, lockstep=True)
        return self._machine.model_copy(update={"buses": tuple(buses), "simulation": simulation})

    def stop(self) -> None:
        """Switch off: all processes end; what they wrote remains."""
        if self._faults is not None:
            self._faults.stop()
        for name in ("hub", "plant", "nodes", "modbus"):  # without the hub the others end by themselves
            process = self._processes.pop(name, None)
            if process is not None:
                process.stop()

    def check(self) -> None:
        """Raise :class:`SimulationError` if a process has died; it names the one that failed first.

        Without the hub all others end, and without the plant the hub does. Those that follow the hub exit with 0, so an
        exit code of 0 means that the hub is the one to look at, although it may take longer to end than they do.
        """
        ended = [self._processes[name] for name in _BLAMED if name in self._processes and self._processes[name].gone()]
        if not ended:
            return
        failed = [process for process in ended if process.popen.returncode != 0]
        hub = self._processes.get("hub")
        if not failed and hub is not None and hub.gone(STOP_PATIENCE):
            failed = [hub]
        raise SimulationError((failed or ended)[0].ended())

    def _waited(self) -> float:
        return waited_s(self.pids.values())

    @property
    def pids(self) -> dict[str, int]:
        """Process ids by process name."""
        return {name: process.popen.pid for name, process in self._processes.items()}

    def order(self, process: str, order: str, **details: Any) -> Any:
        """Order something of one process and wait for its answer (:mod:`sim_backends.faults.fault_runner`)."""
        with self._ordering:
            return self._processes[process].order({"order": order, **details})

    def controller_status(self) -> dict[str, Any]:
        """Return the state of the arm's controller (see :mod:`sim_backends.plant.plant_process`)."""
        self.check()
        content: dict[str, Any] = json.loads(self.status_path.read_text(encoding="utf-8"))
        return content

    def wait_following(self, name: str, timeout: float = 60.0) -> dict[str, Any]:
        """Wait until the controller follows the motion file ``name``; its status then.

        Machine time only advances while acquisition sends SYNC.
        """
        name = name.removesuffix(".csv")
        return self._wait(name, timeout, lambda status: name in status["followed"], "sim_backends.motion_not_followed")

    def wait_done(self, name: str, timeout: float = 300.0) -> dict[str, Any]:
        """Wait until the motion file ``name`` has been followed to its end; the status then."""
        name = name.removesuffix(".csv")

        def over(status: Mapping[str, Any]) -> bool:
            cycles = status["followed"].get(name)
            return cycles is not None and cycles[1] is not None

        return self._wait(name, timeout, over, "sim_backends.motion_not_finished")

    def _wait(self, name: str, timeout: float, reached: Reached, code: str) -> dict[str, Any]:
        deadline = time.monotonic() + timeout
        while True:
            status = self.controller_status()
            if name in status["rejected"]:
                raise InputError(status["rejected"][name])
            if reached(status):
                return status
            if time.monotonic() > deadline:
                raise SimulationError(code, name=name, timeout=timeout, state=status["state"], cycle=status["cycle"])
            time.sleep(0.02)


def truth_of(machine: Machine, path: Path | None = None) -> Truth | ValvePlantTruth:
    """Load the plant's own parameters: of a YAML file (with ``valves`` for valves), or of a known machine.

    Raises
    ------
    InputError
        If the file is not there or holds none, or nothing is known of the machine.
    """
    from sim_backends.machines import default_machine
    from sim_backends.valve.machines import default_crane

    if path is not None:
        with contextlib.suppress(OSError):
            if any(line.startswith(b"valves:") for line in path.read_bytes().splitlines()):
                return load_valve_truth(path)
        return load_truth(path)
    for known, truth in (default_machine(), default_crane()):
        if machine.joints == known.joints:
            return truth
    raise InputError("sim_backends.no_truth_known", machine=machine.name)
