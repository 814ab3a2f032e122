"""Findings, and intervals of parameters, beside the truth."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from benchmarks.attribution.judging import Findings, Place
from benchmarks.attribution.making import TrueEffect
from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import reduce_parameters
from fitting.arrays import FloatArray
from fitting.regression.design import Design
from sim_backends.plant.truth import Truth

#: Results of a case, in the order of the table.
RESULTS = ("right", "in set", "unexplained", "silent", "elsewhere", "partly", "wrong", "wrong set", "accused", "error")


@dataclass(frozen=True)
class Verdict:
    """Result of a case.

    Attributes
    ----------
    result : one of :data:`RESULTS`
    wrong_alone : effects named without an alternative that the plant does not have
    surplus : findings (sets or laws) beyond the true effects, where those were found
    widest : members of the largest set
    located : a law, or a set, is at the joint of every true effect
    """

    result: str
    wrong_alone: tuple[Place, ...]
    surplus: int
    widest: int
    located: bool


def verdict(kind: str, effects: tuple[TrueEffect, ...], findings: Findings) -> Verdict:
    """Compare one case.

    ``right``: named, alone, at its joint (of pairs: both). ``in set``: it is in a set with others, which may be
    an effect of no catalogue (a law with the names that it may be). ``unexplained``: a law, no such name.
    ``silent``: nothing. ``wrong``: a name alone that is not there; ``wrong set``: a set without it. Of pairs,
    ``partly`` is one of two. Nothing missing: ``right`` if nothing was found, else ``accused``. Outside the
    catalogue: ``right`` if only laws were found, all at the right joint and one of them in a variable that shows the
    effect, or an effect of no catalogue is at least as probable there as not; ``elsewhere`` if joint or variable
    differ; any name is ``wrong``.
    """
    true = {(e.id, e.reported) for e in effects}
    sets = [set(members) for members in findings.sets]
    perhaps = [members for members in _beside_laws(findings) if members & true]
    false_sets = [members for members in sets if not members & true]
    wrong_alone = tuple(next(iter(members)) for members in false_sets if len(members) == 1)
    widest = max((len(members) for members in sets), default=0)
    places = {joint for _, joint in findings.laws} | {joint for members in sets for _, joint in members}
    located = bool(effects) and all(e.reported in places for e in effects)
    found = {one for one in true if any(one in members for members in (*sets, *perhaps))}
    surplus = 0

    if kind == "null":
        result = "accused" if sets or findings.laws else "right"
    elif kind == "outside":
        joints, variables = {e.joint for e in effects}, {v for e in effects for v in e.variables}
        if sets:
            result = "wrong"
        elif not findings.laws:
            result = "silent"
        else:
            seen = any(v in variables for v, _ in findings.laws)
            seen = seen or any(findings.unknown.get(j, 0.0) >= 0.5 for j in joints if j)
            fits = all(joint in joints for _, joint in findings.laws) and seen
            result = "right" if fits else "elsewhere"
    elif found:
        surplus = len(false_sets) + len(findings.laws) - len(perhaps)
        surplus += sum(1 for one in true if sum(one in members for members in sets) > 1)
        alone = all({one} in sets for one in found)
        result = "partly" if found != true else "right" if alone else "in set"
    elif false_sets:
        result = "wrong" if wrong_alone else "wrong set"
    else:
        result = "unexplained" if findings.laws else "silent"
    return Verdict(result, wrong_alone, surplus, widest, located)


def _beside_laws(findings: Findings) -> list[set[Place]]:
    """Return the names found beside each law: what it may be, if it is no unknown effect."""
    laws = set(findings.laws)
    return [{(name, joint) for name, joint, _ in own[1:]} for own in findings.stated if own and own[0][:2] in laws]


DRIVE = ("m", "K", "f_c", "f_v", "f_s")


def true_values(machine: Machine, truth: Truth) -> dict[str, float]:
    """Return the plant's parameters by the names that an identification gives them."""
    values = {
        f"{name}.{symbol}": float(getattr(law, symbol)) for name, law in truth.cylinders.items() for symbol in DRIVE
    }
    base = reduce_parameters(machine)
    pi = np.array([link.as_list() for link in truth.links])
    if base.regrouping.shape[1] != pi.size:  # friction and drive inertia of each joint are standard parameters, too
        pi = np.hstack([pi, np.zeros((len(pi), base.regrouping.shape[1] // len(pi) - pi.shape[1]))])
    return values | dict(zip(base.names, base.from_standard(pi).tolist(), strict=True))


def truth_vector(machine: Machine, truth: Truth, design: Design) -> FloatArray:
    """Return true drive and base parameters (p,), in the design's order."""
    values, base = true_values(machine, truth), design.parameters.base
    names = dict(zip(base.expressions, base.names, strict=True))
    return np.array([values[names.get(name, name)] for name in design.parameters.names])


def kind_of(name: str) -> str:
    """Name kinds: ``joint1.f_c`` an ``f_c``; ``ZZ2`` an ``inertia``, ``MX3`` a ``first moment``, ``m4`` a ``mass``."""
    if "." in name:
        return name.rpartition(".")[2]
    symbol = name.rstrip("0123456789")
    return {"M": "first moment", "m": "link mass"}.get(symbol[:1], "inertia")
