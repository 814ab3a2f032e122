"""Laws of a valve's opening by its pressures: one per direction.

A land lets through ``sqrt(d / d_0)`` of what it does at the reference drop ``d_0``. Which drop decides is not known
from outside: that of the oil that goes in (``meter_in``), of the oil that leaves (``meter_out``), or none where a
compensator holds it (``compensated``), as long as supply and load leave it its margin. A compensator's spring gives way
over its stroke, so it takes over softly, and how softly is searched: a corner there bends the edges.

Source: H. Merritt, Hydraulic Control Systems, 1967, chapters 5 and 7.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field

import numpy as np

from fitting.arrays import FloatArray

#: A number of a shape: where it starts, and where it ends.
Bounds = tuple[float, float, float]


@dataclass(frozen=True)
class Law:
    """A law of the pressure.

    Attributes
    ----------
    id, title : for files, and for people
    needs : what has to be known: ``nothing``, ``outlet`` (both chambers) or ``supply``
    factor : of the opening, from the drops at inlet and outlet over their references (N,), the reference drops in Pa
        and the shape; 1 at the references
    shape : numbers of it that are searched: start, least, largest
    """

    id: str
    title: str
    needs: str
    factor: Callable[[FloatArray, FloatArray, FloatArray, Mapping[str, float]], FloatArray]
    shape: Mapping[str, Bounds] = field(default_factory=dict)


def root(drop: FloatArray) -> FloatArray:
    """Compute ``sqrt(d)`` of what is above zero: no land lets oil back."""
    return np.sqrt(np.maximum(drop, 0.0))


def _compensated(inlet: FloatArray, _: FloatArray, reference: FloatArray, shape: Mapping[str, float]) -> FloatArray:
    shares = (np.maximum(own, 0.0) * reference[0] / shape["margin"] for own in (inlet, np.ones(1)))
    here, there = (own ** shape["order"] / (1.0 + own ** shape["order"]) for own in shares)
    return np.asarray((here / there) ** (0.5 / shape["order"]))


LAWS: dict[str, Law] = {
    law.id: law
    for law in (
        Law("none", "no law of the pressure", "nothing", lambda i, _o, _r, _s: np.ones_like(i)),
        Law("meter_in", "an orifice that feeds the cylinder", "supply", lambda i, _o, _r, _s: root(i)),
        Law("meter_out", "an orifice that the cylinder empties through", "outlet", lambda _i, o, _r, _s: root(o)),
        Law(
            "compensated",
            "a compensator that needs its margin",
            "supply",
            _compensated,
            {"margin": (8e5, 2e5, 4e6), "order": (4.0, 1.0, 12.0)},
        ),
        Law(
            "free_exponent",
            "a power of the drop that feeds the cylinder",
            "supply",
            lambda i, _o, _r, s: np.maximum(i, 1e-6) ** s["exponent"],
            {"exponent": (0.3, 0.0, 1.0)},
        ),
    )
}


def laws_for(*, pressures: bool, supply: bool, compensated: bool | str) -> tuple[str, ...]:
    """List laws open to what is measured and declared, by id, the simplest first.

    Of a valve that is declared compensated an orifice is no law but an effect, as is an outlet that decides where the
    supply is known: both edges are alike there, but where the load outruns the oil (:mod:`fitting.valve.effects`).
    """
    known = {"nothing": True, "outlet": pressures, "supply": supply}
    ids = [law.id for law in LAWS.values() if known[law.needs] and not (supply and law.needs == "outlet")]
    if compensated is True:
        ids = [own for own in ids if own in ("none", "compensated")]
    elif compensated is False:
        ids = [own for own in ids if own != "compensated"]
    return tuple(ids)
