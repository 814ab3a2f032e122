"""The process that the simulated buses are started from: ``python -m server.machines.simulation_child PARENT_PID``.

Loading the plant's libraries takes as long as loading the service's; in a process of its own it is done meanwhile. It
reads one order ``{"directory": ..., "speed": ..., "faults": ...}`` from standard input, answers ``{"machine": ...}`` or
``{"error": ...}``, then answers orders (:mod:`server.machines.faults.simulation_orders`), and ends everything when
standard input does.
"""

from __future__ import annotations

import json
import sys
from pathlib import Path

from server.machines.faults.simulation_orders import FaultOrders
from server.platform.processes.child_guard import die_with


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
        print(json.dumps({"error": str(error)}), flush=True)
        return 1
    return 0


if __name__ == "__main__":
    sys.exit(main(int(sys.argv[1])))
