"""Every way to the base parameters beside plain least squares, on measured machines: same rows, same filter.

The first motion is fitted, another one is predicted. Errors are ``100 |measured - predicted| / |measured|`` of joint
efforts in the identification band; *plain least squares* is one ordinary regression of everything on the ``train``
recordings, as a user would write it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from fitting.loop.session import Session
from fitting.pipeline.results.stage_results import Refitted, StageResults
from fitting.pipeline.stage_names import quiet
from fitting.pipeline.stages import STEPS

#: Names of the ways in the order of the table; ``one_shot`` is plain least squares.
WAYS = ("whitened", "equal", "least_squares", "possible", "one_shot", "two_stage")
#: Share by which the base may be worse than plain least squares.
MOST_WORSE = 0.02


@dataclass(frozen=True)
class Ways:
    """The ways to one machine's base parameters.

    Attributes
    ----------
    machine : its name
    chosen : which one is handed out
    ratio : training error of the whitened fit over that of least squares
    training, held_out : relative error of each of :data:`WAYS` that there is, percent
    base, after : relative error on the held-out motion of the base that is handed out, and with what the loop added;
        the latter None where no loop was run
    impossible : violations of physics that the report names
    """

    machine: str
    chosen: str
    ratio: float
    training: dict[str, float]
    held_out: dict[str, float]
    base: float
    after: float | None
    impossible: tuple[Mapping[str, Any], ...]

    @property
    def worse(self) -> float:
        """Error of the base that is handed out over that of plain least squares, less one."""
        return self.base / self.held_out["one_shot"] - 1.0


def ways(name: str, session: Session) -> Ways:
    """Run both stages, and the loop where the session's options ask for it, and read off what every way leaves.

    Parameters
    ----------
    name : of the machine, for the table
    session : with a ``validate`` recording
    """
    results = StageResults()
    for compute in STEPS.values():
        results = results.having(compute(session, results, quiet))
    refitted = results[Refitted]
    estimation, relative = refitted.estimation, refitted.overall["relative"]
    tried = {way["name"]: way for way in estimation["tried"]}
    return Ways(
        name,
        str(estimation["chosen"]),
        float(estimation["ratio"]),
        {way: 100.0 * own["training_error"] for way, own in tried.items()},
        {way: 100.0 * own["held_out_error"] for way, own in tried.items()},
        100.0 * relative["before"],
        100.0 * relative["after"] if session.options.loop else None,
        refitted.plausibility.violations,
    )


def named(violation: Mapping[str, Any]) -> str:
    """Name an impossible parameter with its value."""
    place = f"{violation['joint']}." if violation["joint"] else ""
    return f"`{place}{violation['parameter']}` = {violation['value']:.3g} {violation['unit']}"
