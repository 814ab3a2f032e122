"""The fit's side of the benchmark: machine file and recordings in, answers out. It sees nothing else."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from time import process_time
from typing import Any

from daq.errors import InputError
from daq.machine.machine_file import load_machine

WAYS = ("extend", "retract")
#: A value and its 95 % interval (None: it has none).
Bar = tuple[float, tuple[float, float] | None]
#: Speed in m/s, head, rod, supply and tank pressure in Pa, whether it moves, to a fraction of full command.
CommandOf = Callable[[float, float, float, float, float, bool], float]


@dataclass(frozen=True)
class AxisAnswer:
    """Findings of one axis.

    Attributes
    ----------
    error : on the validation motion, over the speed's root mean square
    delay : s
    edges : per direction the command, fraction of full, that gives 2 % of the speed at the largest recorded one
    largest : per direction the largest recorded command, fraction of full
    effects : per finding the ids that it may be, the best first
    laws : variables of laws without a name
    flow_limit : m^3/s, or None
    command : the inverse, or None
    """

    error: float
    delay: Bar
    edges: Mapping[str, Bar]
    largest: Mapping[str, float]
    effects: tuple[tuple[str, ...], ...] = ()
    laws: tuple[str, ...] = ()
    flow_limit: float | None = None
    command: CommandOf | None = field(default=None, compare=False)


@dataclass(frozen=True)
class Answer:
    """Findings of a machine, by name of joint, and the processor time in s that it took."""

    axes: Mapping[str, AxisAnswer]
    seconds: float = 0.0


def identified(folder: Path) -> Answer:
    """Run ``hilfit.identify_valve`` on the recordings of a case, ``validate`` apart.

    Raises
    ------
    InputError
        If this version of hilfit has no such function.
    """
    import hilfit

    identify: Any = getattr(hilfit, "identify_valve", None)
    if identify is None:
        raise InputError(
            "hilfit.identify_valve is not there: this version identifies no valves; --only-make makes cases"
        )
    train = sorted(folder.glob("train-*.parquet"))
    started = process_time()
    found = identify(folder / "machine.yaml", train, [folder / "validate.parquet"])
    took = process_time() - started
    joints = [joint.name for joint in load_machine(folder / "machine.yaml").joints]
    return Answer({name: _axis(found.report["axes"][name], found.models[name]) for name in joints}, took)


def _axis(own: Mapping[str, Any], model: Any) -> AxisAnswer:
    def bar(value: Mapping[str, Any]) -> Bar:
        interval = value["ci95"]
        return float(value["value"]), None if interval is None else (float(interval[0]), float(interval[1]))

    def command(speed: float, head: float, rod: float, supply: float, tank: float, moving: bool) -> float:
        wanted = model.command(speed, moving=moving, head=head, rod=rod, supply=supply, tank=tank)
        return float(wanted.share)

    limit, pump = own["pump_limit"], {"pump_flow_limit"} if own["pump_limit"] or own["pump_power"] else set()
    effects, ways = [(e["id"], *e["indistinguishable_from"]) for e in own["effects"]], own["directions"]
    return AxisAnswer(
        error=float(own["errors"]["handed_out"]),
        delay=bar(own["delay"]),
        edges={way: bar(ways[way]["edge_at_2_percent"]) for way in WAYS if ways[way]["moves"]},
        largest=own["largest_recorded"],
        effects=(*effects, *((name,) for name in pump - {found[0] for found in effects})),
        laws=tuple(law["variable"] for law in own["unexplained"]),
        flow_limit=None if limit is None else float(limit["value"]),
        command=command,
    )
