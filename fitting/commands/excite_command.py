"""The command ``hilfit excite``: design a motion and write its motion file."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from pathlib import Path
from typing import Annotated, Any, TypeVar

import numpy as np
import typer

from daq.console import print_json, progress_bar, reported
from daq.errors import InputError
from daq.machine.machine_file import Machine, load_machine
from daq.motion_files import LONGEST_S, SCHEMA, Motion, read_motion, write_motion
from daq.recordings.recording import Recording, read_recording
from daq.recordings.recording_files import read_table
from fitting.arm.base_parameters import BaseParameters, reduce_parameters
from fitting.arm.geometry import geometry_of
from fitting.excitation.cylinders import CylinderOptions, design_cylinder_motion
from fitting.excitation.design import design_sequence, information_of, information_of_recording
from fitting.excitation.experiments import KINDS, Arm, experiment
from fitting.excitation.limits import (
    HydraulicLimits,
    LimitUse,
    holding_efforts,
    joint_numbers,
    limits_of_machine,
    limits_used,
)
from fitting.excitation.objective import Criterion
from fitting.excitation.problem import ExcitationOptions
from fitting.planning.excite_text import show
from fitting.planning.guess import USUAL_SUPPLY, Guess, default_guess, guess_from_file, worst_friction

_Options = TypeVar("_Options", ExcitationOptions, CylinderOptions)

_LITRES_PER_MINUTE = 1e-3 / 60  # m^3/s
_BAR = 1e5  # Pa

Gathered = Annotated[
    list[Path] | None,
    typer.Option(
        "--after",
        "--gathered",
        help="Motion file or recording that is there already, to be complemented; may be given again.",
    ),
]
MostFlow = Annotated[
    float | None, typer.Option(help="Supply flow in l/min; hydraulics.pump_flow of the machine file.", min=1e-6)
]
MostPressure = Annotated[
    float | None,
    typer.Option(help="Chamber pressure in bar; hydraulics.supply_pressure of the machine file.", min=1e-6),
]
MostFrequency = Annotated[float | None, typer.Option(help="Highest frequency in Hz; 0.6.", min=1e-3, max=10.0)]
Parameters = Annotated[
    Path | None,
    typer.Option(help="report.json of an earlier identification, or a drawing, for pressures; guessed without."),
]
Forecast = Annotated[
    bool, typer.Option("--effects", help="Also forecast how well each effect and each parameter will show.")
]


def register(app: typer.Typer) -> None:
    """Add the command to ``app``."""
    app.command("excite")(reported(_excite))


@dataclass(frozen=True)
class _Plan:
    """Options that every kind of motion needs."""

    machine: Machine
    base: BaseParameters
    joints: tuple[str, ...]
    seconds: float | None
    use: float | None
    limits: HydraulicLimits
    starts: int | None
    seed: int
    progress: Callable[[float, float], None]


def _excite(
    machine: Annotated[Path, typer.Argument(help="The machine file.", metavar="MACHINE")],
    output: Annotated[
        Path, typer.Option("-o", "--output", help="Motion file to write (CSV); with --count NAME-1.csv and so on.")
    ],
    joint: Annotated[list[str] | None, typer.Option(help="Move only this joint; may be given again.")] = None,
    seconds: Annotated[
        float | None, typer.Option(help="Length; 30 pinned, 60 unpinned or an experiment.", min=1.0, max=LONGEST_S)
    ] = None,
    unpinned: Annotated[bool, typer.Option("--unpinned", help="Free cylinders, for stage 1.")] = False,
    kind: Annotated[
        str | None, typer.Option("--experiment", help=f"Instead, an experiment of one --joint: {', '.join(KINDS)}.")
    ] = None,
    count: Annotated[
        int, typer.Option(help="So many motions in sequence that complement each other.", min=1, max=100)
    ] = 1,
    after: Gathered = None,
    max_flow: MostFlow = None,
    max_pressure: MostPressure = None,
    parameters: Parameters = None,
    use: Annotated[float | None, typer.Option(help="Share of every limit to use; 0.95 pinned, 0.92 otherwise.")] = None,
    criterion: Annotated[
        str, typer.Option(help="condition (number of W) or determinant (D-optimality).")
    ] = "condition",
    max_frequency: MostFrequency = None,
    starts: Annotated[int | None, typer.Option(help="Random starts; 6 pinned, 3 unpinned.", min=1, max=100)] = None,
    seed: Annotated[int, typer.Option(help="Random seed of the starts.", min=0)] = 0,
    effects: Forecast = False,
    json: Annotated[bool, typer.Option("--json", help="Print the result as JSON.")] = False,
) -> None:
    """Design a motion that determines the parameters: all joints, one joint's experiment, or free pistons (stage 1)."""
    described = load_machine(machine)
    base = reduce_parameters(geometry_of(described).uncoupled())
    options = _options(criterion, max_frequency)
    if kind is not None and (unpinned or count > 1 or not joint or len(joint) != 1):
        raise InputError("fitting.experiment_of_one_joint")
    if unpinned and (count > 1 or max_pressure is not None or (after and not effects)):
        raise InputError("fitting.unpinned_without_load")
    guess = _guess(described, base, parameters)
    limits, notes = _limits(described, guess, max_flow, max_pressure)
    there = [_read(path, described) for path in after or ()]
    with progress_bar("designing the motion", show=not json) as bar:

        def progress(share: float, _condition: float) -> None:
            bar(share, 1.0)

        plan = _Plan(described, base, tuple(joint or ()), seconds, use, limits, starts, seed, progress)
        if kind is not None:
            found = [_experiment(plan, kind, guess)]
        elif unpinned:
            found, notes = [_free_cylinders(plan)], [*notes, *_unseen(described)]
        else:
            found = _whole_arm(plan, options, count, there, effects)
    result = _written(output, described, found, notes)
    if effects:
        result["forecast"] = _forecast(described, base, [motion for motion, _ in found], guess, there)
    if json:
        print_json(result)
    else:
        show(result)


def _options(criterion: str, max_frequency: float | None) -> ExcitationOptions:
    chosen: dict[str, Criterion] = {"condition": "condition", "determinant": "determinant"}
    if criterion not in chosen:
        raise InputError("fitting.criterion_unknown", criterion=criterion)
    options = replace(ExcitationOptions(), criterion=chosen[criterion])
    return options if max_frequency is None else replace(options, max_frequency=max_frequency)


def _written(
    output: Path, machine: Machine, found: Sequence[tuple[Motion, dict[str, Any]]], notes: Sequence[str]
) -> dict[str, Any]:
    """Write the motions, and report which file holds which; the last one's figures are those of all together."""
    several = len(found) > 1
    files = [output.with_stem(f"{output.stem}-{k + 1}") if several else output for k in range(len(found))]
    for path, (motion, _) in zip(files, found, strict=True):
        write_motion(path, motion)
    return {
        "file": str(files[0]),
        "machine": machine.name,
        "rods": found[0][0].rods,
        **found[-1][1],
        "notes": notes,
        "motions": [{"file": str(path), **content} for path, (_, content) in zip(files, found, strict=True)],
    }


def _guess(machine: Machine, base: BaseParameters, parameters: Path | None) -> Guess:
    if parameters is not None:
        return guess_from_file(parameters, machine, base)
    hydraulics = machine.hydraulics
    supply = None if hydraulics is None else hydraulics.supply_pressure
    return default_guess(machine, base, supply or USUAL_SUPPLY)


def _limits(
    machine: Machine, guess: Guess, max_flow: float | None, max_pressure: float | None
) -> tuple[HydraulicLimits, list[str]]:
    """Take hydraulic limits of the command line, or of the machine file; with remarks on them."""
    notes: list[str] = []
    limits = limits_of_machine(
        machine,
        guess.base,
        worst_friction(machine, guess),
        flow=None if max_flow is None else max_flow * _LITRES_PER_MINUTE,
        pressure=None if max_pressure is None else max_pressure * _BAR,
    )
    if all(joint.cylinder is None for joint in machine.joints):
        if max_flow is not None or max_pressure is not None:
            raise InputError("fitting.limits_without_cylinder", machine=machine.name)
        return limits, notes
    if limits.flow is None:
        notes.append("no limit on the supply flow: give --max-flow, or hydraulics.pump_flow in the machine file")
    if limits.pressure is None:
        notes.append(
            "no limit on chamber pressures: give --max-pressure, or hydraulics.supply_pressure in the machine file"
        )
    else:
        notes.append(f"chamber pressures are computed with {guess.statement}")
    return limits, notes


def _unseen(machine: Machine) -> list[str]:
    """List what no channel shows once the rods are off their pins."""
    hidden = machine.unseen_pistons()
    if not hidden:
        return []
    return [
        f"{', '.join(hidden)}: no piston_position channel, so nothing measures these pistons with the rods off: a "
        "recording of this motion will say nothing of them, and their friction is estimated with the arm attached"
    ]


def _read(path: Path, machine: Machine) -> Motion | Recording:
    """Read a motion file, or a recording in any role; an undeclared one may have parked joints."""
    try:
        with path.open("rb") as file:
            is_motion = file.read(64).decode("utf-8-sig", "replace").startswith(f"# {SCHEMA}")
    except OSError as error:
        raise InputError("fitting.cannot_read_motion_recording", path=path, reason=error.strerror) from None
    if is_motion:
        return read_motion(path, machine)
    role = read_table(path).metadata.get("hilfit.role", "operation")
    return read_recording(path, machine, "unloaded" if role == "unloaded" else "operation")


def _whole_arm(
    plan: _Plan, options: ExcitationOptions, count: int, there: Sequence[Motion | Recording], forecast: bool
) -> list[tuple[Motion, dict[str, Any]]]:
    options = _asked(options, plan)
    gathered = np.zeros((len(plan.base), len(plan.base)))
    for item in there:
        unpinned = item.rods == "unpinned" if isinstance(item, Motion) else item.role == "unloaded"
        if forecast and unpinned:  # determines nothing of the links, but shows effects of the cylinders
            continue
        if isinstance(item, Recording):
            gathered += information_of_recording(plan.machine, plan.base, item)
        else:
            gathered += information_of(plan.machine, plan.base, item)
    found = design_sequence(
        plan.machine,
        plan.base,
        count,
        seed=plan.seed,
        options=options,
        joints=plan.joints or None,
        gathered=gathered if gathered.any() else None,
        hydraulic=plan.limits,
        progress=plan.progress,
    )
    return [
        (
            each.motion,
            {
                "seconds": each.motion.seconds,
                "condition_number": _finite(each.condition_number),
                "own_condition_number": _finite(each.own_condition_number),
                "base_parameters": len(plan.base),
                "not_told": list(each.undetermined),
                "limits": [asdict(limit) for limit in each.limits],
            },
        )
        for each in found
    ]


def _asked(options: _Options, plan: _Plan) -> _Options:
    """Apply what was asked for to the usual options."""
    asked: dict[str, Any] = {"seconds": plan.seconds, "use": plan.use, "starts": plan.starts}
    return replace(options, **{name: value for name, value in asked.items() if value is not None})


def _free_cylinders(plan: _Plan) -> tuple[Motion, dict[str, Any]]:
    found = design_cylinder_motion(
        plan.machine,
        seed=plan.seed,
        options=_asked(CylinderOptions(), plan),
        joints=plan.joints or None,
        flow=plan.limits.flow,
        progress=plan.progress,
    )
    return found.motion, {
        "seconds": found.motion.seconds,
        "condition_number": max(found.condition_numbers.values()),
        "condition_numbers": found.condition_numbers,
        "limits": [asdict(limit) for limit in found.limits],
    }


def _experiment(plan: _Plan, kind: str, guess: Guess) -> tuple[Motion, dict[str, Any]]:
    arm = Arm(
        plan.machine,
        joint_numbers(plan.machine, plan.joints)[0],
        seconds=plan.seconds or 60.0,
        use=plan.use or 0.92,
        holding=partial(holding_efforts, plan.machine, plan.base, guess.base),
        hydraulic=plan.limits,
        base=plan.base,
    )
    made = experiment(arm, kind)
    plan.progress(1.0, 0.0)
    limits: tuple[LimitUse, ...] = ()
    if made.motion.rods == "pinned":
        q = made.motion.joint_positions(plan.machine)
        qd = np.gradient(q, made.motion.time, axis=0)
        qdd = np.gradient(qd, made.motion.time, axis=0)
        limits = limits_used(plan.machine, plan.limits, q, qd, qdd, plan.base)
    return made.motion, {
        "seconds": made.motion.seconds,
        "experiment": kind,
        "does": made.text,
        "limits": [asdict(limit) for limit in limits],
    }


def _forecast(
    machine: Machine,
    base: BaseParameters,
    motions: Sequence[Motion],
    guess: Guess,
    there: Sequence[Motion | Recording],
) -> dict[str, Any]:
    """Forecast what the plan will show, with what is there already."""
    from fitting.effects import effects as catalogue  # loads every effect: only where it is asked for
    from fitting.planning.forecast import forecast, forecast_to_json

    planned = [*motions, *(item for item in there if isinstance(item, Motion))]
    recorded = [item for item in there if isinstance(item, Recording)]
    return forecast_to_json(forecast(machine, base, planned, guess, catalogue(), recorded), guess)


def _finite(value: float) -> float | None:
    return value if np.isfinite(value) else None
