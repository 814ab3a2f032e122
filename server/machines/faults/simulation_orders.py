"""What the process of the simulated machine is asked for while it runs: which faults there are, and to let them begin.

One line of JSON each way. Faults run in that process beside those of ``--faults``; the plant's libraries stay there.
"""

from __future__ import annotations

import json
import time
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any

from daq.messages import Sentence

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
            return {"error": str(error)}

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
            raise ValueError("; ".join(f"{problem.key}: {problem.text}" for problem in problems))
        if len(self._left()) + len(script.faults) > MOST:
            raise ValueError(Sentence("server.faults_most", most=MOST))
        if any(fault.every is not None for fault in script.faults):
            raise ValueError(Sentence("server.faults_every"))
        FaultRunner(self._simulated, self._machine, script.faults, self._log).start()
        self._running += [
            (time.monotonic() + fault.at + fault.seconds_long, _content(fault)) for fault in script.faults
        ]
        return self._left()


def _content(fault: Fault) -> dict[str, Any]:
    content: dict[str, Any] = fault.model_dump(mode="json", by_alias=True, exclude_none=True)
    return content
