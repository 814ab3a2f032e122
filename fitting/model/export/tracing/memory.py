"""What a term remembers, found in the expressions of some moments that follow each other.

An effect with a history is traced at a few moments at once, by its own code. What the expression of one moment takes
from before it, and that of the next moment takes from the same place, is one number of a memory; the expression of
that number is how it goes on. So a recurrence is read off the formula, and no formula exists twice.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

from fitting.model.export.tracing.graph import BINARY, UNARY, Graph, Node

#: Moments that are traced: a chain of numbers, each of which begins with the one before, may be this long less three.
MOMENTS = 6


@dataclass(frozen=True)
class Memory:
    """A number that is kept from moment to moment.

    Attributes
    ----------
    name : of its variable
    start : at the first moment
    after : at every later one, of its variable and of that moment
    """

    name: str
    start: Node
    after: Node


@dataclass(frozen=True)
class Remembered:
    """Columns of a term with a history: at the first moment, and at every later one; and what they remember."""

    first: tuple[Node, ...]
    later: tuple[Node, ...]
    memory: tuple[Memory, ...]


def remembered(
    graph: Graph, columns: Sequence[Sequence[Node]], moments: Sequence[Mapping[str, Node]], taken: int
) -> Remembered:
    """Find the recurrence in a term's columns.

    Parameters
    ----------
    columns : nodes of each of :data:`MOMENTS` moments
    moments : variables of each by the name of the one that they become
    taken : how many numbers other terms remember

    Raises
    ------
    TypeError
        If the moments are not made alike, or take more and more from before.
    """
    chains = _chains(graph, [list(own) for own in zip(*columns, strict=True)], moments)
    names = {chain[0].number: graph.variable(f"m{taken + k}") for k, chain in enumerate(chains)}

    def now(node: Node, moment: int) -> Node:
        known = {variable.number: graph.variable(name) for name, variable in moments[moment].items()}
        return _rewritten(graph, node, known if moment == 0 else known | names)

    return Remembered(
        tuple(now(node, 0) for node in columns[0]),
        tuple(now(node, 1) for node in columns[1]),
        tuple(Memory(f"m{taken + k}", now(chain[0], 0), now(chain[1], 1)) for k, chain in enumerate(chains)),
    )


def _chains(graph: Graph, columns: list[list[Node]], moments: Sequence[Mapping[str, Node]]) -> list[list[Node]]:
    """List the nodes of each remembered number, moment by moment."""
    place = {own.number: (name, k) for k, variables in enumerate(moments) for name, own in variables.items()}
    latest: dict[int, int] = {}
    for node in graph.nodes:
        own = place[node.number][1] if node.number in place else -1
        latest[node.number] = max([own, *(latest[argument.number] for argument in node.arguments)])

    def cut(a: Node, b: Node, moment: int, found: list[tuple[Node, Node]]) -> bool:
        """Return whether ``b`` is the next moment's ``a``; what both take from before is noted."""
        if latest[a.number] < 0:
            return a is b
        if latest[a.number] < moment:
            found += [] if (a, b) in found else [(a, b)]
            return latest[b.number] <= moment
        if (a.operation, len(a.arguments)) != (b.operation, len(b.arguments)):
            return False
        if a.operation == "variable":
            return place[b.number] == (place[a.number][0], moment + 1)
        if a.value != b.value:
            return False
        orders = [b.arguments, b.arguments[::-1]] if a.operation in ("add", "mul") else [b.arguments]
        for order in orders:  # which of two stands first is chance
            trial = list(found)
            if all(cut(x, y, moment, trial) for x, y in zip(a.arguments, order, strict=True)):
                found[:] = trial
                return True
        return False

    known: dict[int, list[Node]] = {}
    todo = [*columns]
    while todo:
        chain = todo.pop(0)
        before: list[list[tuple[Node, Node]]] = []
        for moment in range(1, len(chain) - 1):
            before.append([])
            if not cut(chain[moment], chain[moment + 1], moment, before[-1]):
                raise TypeError("moments that follow each other are not made alike")
        if not before or len({len(own) for own in before}) > 1:
            raise TypeError("every moment takes more from before")
        for links in zip(*before, strict=True):
            found = [links[0][0], *(after for _, after in links)]
            if known.setdefault(found[0].number, found) is found:
                todo.append(found)
    return list(known.values())


def _rewritten(graph: Graph, node: Node, known: Mapping[int, Node]) -> Node:
    """Replace some of the nodes that a node is made of."""
    made = dict(known)
    todo = [node]
    while todo:
        own = todo[-1]
        missing = [argument for argument in own.arguments if argument.number not in made]
        if own.number in made or not missing:
            todo.pop()
            if own.number not in made:
                arguments = [made[argument.number] for argument in own.arguments]
                if own.operation in BINARY:
                    made[own.number] = graph.binary(own.operation, *arguments)
                elif own.operation in UNARY:
                    made[own.number] = graph.unary(own.operation, *arguments)
                else:
                    made[own.number] = graph.node(own.operation, tuple(arguments), own.value)
        todo += missing if own.number not in made else []
    return made[node.number]
