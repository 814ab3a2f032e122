"""The fit's side of the benchmark: machine file and recordings in, what it says out. It sees nothing else."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine_file import Machine
from daq.recording import Recording
from fitting.loop.closing import Examined
from fitting.loop.session import Options, Session
from fitting.residual.laws import Law

FloatArray = npt.NDArray[np.float64]
Place = tuple[str, str | None]


@dataclass(frozen=True)
class Said:
    """What an identification says.

    Attributes
    ----------
    sets : per finding the effects that it may be, as (effect id, joint; None: the whole machine), the best first
    laws : (variable, joint) of each law of an unknown effect
    stated : per finding of the efforts what stands first (effect id, or variable of a law; joint), and its probability
    values : parameter name to (value, standard deviation); ``joint1.f_c`` and base-parameter names
    """

    sets: tuple[tuple[Place, ...], ...]
    laws: tuple[tuple[str, str | None], ...]
    values: Mapping[str, tuple[float, float]]
    stated: tuple[tuple[str, str | None, float], ...] = ()


def recordings_of(machine: Machine, tables: Mapping[str, Mapping[str, FloatArray]]) -> list[Recording]:
    """Recordings from tables in SI by file stem; the role is what stands before the hyphen."""
    result = []
    for stem, table in tables.items():
        values = {name: np.asarray(column) for name, column in table.items() if name != "time"}
        role = stem.partition("-")[0]
        result.append(Recording(machine.name, role, stem, stem, machine.rate_hz, np.asarray(table["time"]), values))
    return result


def judge(machine: Machine, recordings: Sequence[Recording], bootstrap: int) -> Said:
    """Run the loop on recordings, with at most so many replicas, and put what it found into plain names."""
    return said_of(Examined.of(Session(machine, recordings, Options(bootstrap=bootstrap))))


def said_of(examined: Examined) -> Said:
    """What the loop found, in plain names."""
    findings, found = examined.kinematics, examined.attribution
    names = tuple(joint.name for joint in examined.session.machine.joints)

    def place(joint: int | None) -> str | None:
        return None if joint is None else names[joint]

    sets: list[tuple[Place, ...]] = [
        tuple((effect, names[f.joint]) for effect in (f.effect.id, *f.rivals)) for f in findings
    ]
    laws: list[tuple[str, str | None]] = []
    for item in found.accepted:
        term = item.score.term
        if isinstance(term.content, Law):
            laws.append((term.content.variable(names), place(term.joint)))
        else:
            rivals = ((r.term.id, place(r.term.joint)) for r in item.rivals)
            sets.append(tuple(dict.fromkeys([(term.id, place(term.joint)), *rivals])))
    added = {item.score.term.family for item in found.accepted}
    sets += [
        (("supply_ripple", names[line.joint]),)
        for line in {line.joint: line for line in found.lines}.values()
        if ("supply_ripple", line.joint) not in added
    ]
    laws += [
        (item.score.term.content.variable(names), place(item.score.term.joint))
        for item in found.unconfirmed
        if isinstance(item.score.term.content, Law)
    ]
    parameters, fit = found.model.design.parameters, found.model.fit
    base = dict(zip(parameters.base.expressions, parameters.base.names, strict=True))
    values = {
        base.get(name, name): (float(value), float(std))
        for name, value, std, told in zip(parameters.names, fit.theta, fit.std, fit.told, strict=False)
        if told
    }
    stated = tuple(
        (t.content.variable(names) if isinstance(t.content, Law) else t.id, place(t.joint), item.probability)
        for item in found.accepted
        if (t := item.score.term).id != "supply_ripple"
    )
    return Said(tuple(sets), tuple(laws), values, stated)
