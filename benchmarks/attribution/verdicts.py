"""What was said, beside what is true."""

from __future__ import annotations

from dataclasses import dataclass

from benchmarks.attribution.judging import Place, Said
from benchmarks.attribution.making import TrueEffect

#: Results of a case, as they stand in the table.
RESULTS = ("right", "in set", "unexplained", "silent", "elsewhere", "partly", "wrong", "wrong set", "accused", "error")


@dataclass(frozen=True)
class Verdict:
    """How a case came out.

    Attributes
    ----------
    result : one of :data:`RESULTS`
    wrong_alone : effects named without an alternative that the plant does not have
    surplus : findings (sets or laws) beyond the true effects, where those were found
    widest : members of the largest set
    located : a law, or a set, stands at the joint of every true effect
    """

    result: str
    wrong_alone: tuple[Place, ...]
    surplus: int
    widest: int
    located: bool


def verdict(kind: str, effects: tuple[TrueEffect, ...], said: Said) -> Verdict:
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
    sets = [set(members) for members in said.sets]
    perhaps = [members for members in _beside_laws(said) if members & true]
    false_sets = [members for members in sets if not members & true]
    wrong_alone = tuple(next(iter(members)) for members in false_sets if len(members) == 1)
    widest = max((len(members) for members in sets), default=0)
    places = {joint for _, joint in said.laws} | {joint for members in sets for _, joint in members}
    located = bool(effects) and all(e.reported in places for e in effects)
    found = {one for one in true if any(one in members for members in (*sets, *perhaps))}
    surplus = 0

    if kind == "null":
        result = "accused" if sets or said.laws else "right"
    elif kind == "outside":
        joints, variables = {e.joint for e in effects}, {v for e in effects for v in e.variables}
        if sets:
            result = "wrong"
        elif not said.laws:
            result = "silent"
        else:
            seen = any(v in variables for v, _ in said.laws) or any(
                said.unknown.get(j, 0.0) >= 0.5 for j in joints if j
            )
            fits = all(joint in joints for _, joint in said.laws) and seen
            result = "right" if fits else "elsewhere"
    elif found:
        surplus = len(false_sets) + len(said.laws) - len(perhaps)
        surplus += sum(1 for one in true if sum(one in members for members in sets) > 1)
        alone = all({one} in sets for one in found)
        result = "partly" if found != true else "right" if alone else "in set"
    elif false_sets:
        result = "wrong" if wrong_alone else "wrong set"
    else:
        result = "unexplained" if said.laws else "silent"
    return Verdict(result, wrong_alone, surplus, widest, located)


def _beside_laws(said: Said) -> list[set[Place]]:
    """Return the names found beside each law: what it may be, if it is no unknown effect."""
    laws = set(said.laws)
    return [{(name, joint) for name, joint, _ in own[1:]} for own in said.stated if own and own[0][:2] in laws]
