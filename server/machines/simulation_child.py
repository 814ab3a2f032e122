"""The process that the simulated buses are started from: ``python -m server.machines.simulation_child PARENT_PID``.

Loading the plant's libraries takes as long as loading the service's; in a process of its own it is done meanwhile. It
reads one order ``{"directory": ..., "speed": ..., "faults": ...}`` from standard input, answers ``{"machine": ...}`` or
``{"error": ...}``, then answers orders, one line of JSON each way (:class:`FaultOrders`), and ends everything when
standard input does. Faults that are ordered run in this process beside those of ``--faults``.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.errors import BadValueError
from daq.messages import listed, named, with_their_messages
from server.platform.processes.child_guard import die_with

if TYPE_CHECKING:
    from sim_backends import SimulatedMachine
    from sim_backends.faults.fault_file import Fault

MOST = 20  # faults at once


class FaultOrders:
    """Answers orders; lives in the simulated machine's process.

    Parameters
    ----------
    simulated : the running machine
    log : where what began and ended is written, a line of JSON each
    """

    def __init__(self, simulated: SimulatedMachine, machine: Any, log: Path) -> None:
        self._simulated, self._machine, self._log = simulated, machine, log
        self._running: list[tuple[float, dict[str, Any]]] = []

    def answer(self, line: str) -> dict[str, Any]:
        """Answer an order: ``{"result": ...}``, or ``{"error": line}`` for one that makes no sense."""
        order = json.loads(line)
        handlers: Mapping[str, Callable[[dict[str, Any]], Any]] = {
            "offers": lambda order: self._offers(),
            "running": lambda order: self._left(),
            "begin": lambda order: self._begin(order["faults"]),
        }
        try:
            return {"result": handlers[order["order"]](order)}
        except ValueError as error:
            return with_their_messages({"error": str(error)})

    def _offers(self) -> list[dict[str, Any]]:
        from sim_backends.faults.fault_offers import fault_offers

        return fault_offers(self._machine)

    def _left(self) -> list[dict[str, Any]]:
        now = time.monotonic()
        self._running = [(end, content) for end, content in self._running if end > now]
        return [{**content, "left_s": round(end - now, 2)} for end, content in self._running]

    def _begin(self, faults: list[dict[str, Any]]) -> list[dict[str, Any]]:
        import yaml

        from sim_backends.faults.fault_file import SCHEMA, fault_problems
        from sim_backends.faults.fault_runner import FaultRunner

        script, problems = fault_problems(yaml.safe_dump({"schema": SCHEMA, "faults": faults}), self._machine)
        if script is None:
            raise ValueError(listed([named(problem.key, problem.text) for problem in problems]))
        if len(self._left()) + len(script.faults) > MOST:
            raise BadValueError("server.faults_most", most=MOST)
        if any(fault.every is not None for fault in script.faults):
            raise BadValueError("server.faults_every")
        FaultRunner(self._simulated, self._machine, script.faults, self._log).start()
        self._running += [
            (time.monotonic() + fault.at + fault.seconds_long, _content(fault)) for fault in script.faults
        ]
        return self._left()


def _content(fault: Fault) -> dict[str, Any]:
    content: dict[str, Any] = fault.model_dump(mode="json", by_alias=True, exclude_none=True)
    return content


def main(parent: int) -> int:
    """Load, take the order, run until the parent ends; return the exit code."""
    die_with(parent)
    from daq.errors import HilfitError
    from sim_backends import SimulatedMachine, default_machine
    from sim_backends.faults.fault_file import load_faults

    machine, truth = default_machine()
    line = sys.stdin.readline()
    if not line:
        return 0
    order = json.loads(line)
    try:
        faults = None if order["faults"] is None else load_faults(order["faults"], machine)
        with SimulatedMachine(
            machine,
            truth,
            undeclared="demo",
            speed=float(order["speed"]),
            workdir=Path(order["directory"]),
            faults=faults,
        ) as simulated:
            print(json.dumps({"machine": str(simulated.machine_path)}), flush=True)
            orders = FaultOrders(simulated, machine, Path(order["directory"]) / "faults.jsonl")
            for line in sys.stdin:
                print(json.dumps(orders.answer(line)), flush=True)
    except HilfitError as error:
        print(json.dumps(with_their_messages({"error": str(error)})), flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
