"""Bore and rod, from the one thing that a single cylinder tells of them: what its rod side weighs against its head.

The effort is ``A1 (p1 - (A2/A1) p2)``. A scale common to both areas is absorbed by the masses; their ratio is not,
because back-pressure changes for reasons of its own. It is estimated with everything else of the joint free::

    A1 p1 - known = rho A2 p2 + (body, friction, constant, spring, delay)

and nominal is ``rho = 1``. Gains of single transducers (an effect) reach ten per cent each. Back pressure of valves in
one direction of motion and friction that grows with the pressures (other effects) move the ratio too; where one of them
alone explains more, the ratio is only a remark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.arrays import FloatArray
from fitting.checks.mistakes.hypothesis import CLEAR
from fitting.checks.mistakes.physical import RIVALS, Trial, without

#: A ratio this far from the declared one (its logarithm) is no gain of a transducer.
_FAR = 0.17
#: Standard errors that it is away, and factor by which what is left of the effort falls; the same for a remark.
_SIGMAS, _FALLS = 6.0, 1.5
_NOTED_SIGMAS, _NOTED_FALLS = 3.5, 1.1
#: Cylinders are built with rod sides of a fifth to nearly all of the head's area, so no true ratio is beyond these of a
#: declared one; and the joint has to be explained well with it, or far better: else it stands in for what is missing.
_POSSIBLE, _EXPLAINED = (0.15, 6.0), 0.1
#: An effect has more parameters: it has to leave less by this share, but beside areas that no cylinder has (a rod takes
#: some of the head's).
_AS_MUCH = 0.02
#: Standard errors are of coloured residuals: a third as many samples as rows in each direction count.
_COLOURED = 3.0


@dataclass(frozen=True)
class AreaRatio:
    """Estimated ``rho`` of a joint, its standard error, the misfits, and whether an effect explains more."""

    joint: int
    rho: float
    std: float
    before: float
    after: float
    effect: bool

    @property
    def wrong(self) -> bool:
        """Whether bore or rod look wrong, be it only worth a remark."""
        far = self.rho <= 0 or abs(float(np.log(self.rho))) > _FAR
        explained = self.after < _EXPLAINED or self.before > CLEAR * self.after
        possible = _POSSIBLE[0] < self.rho < _POSSIBLE[1] and explained
        return far and possible and self._is(_NOTED_SIGMAS, _NOTED_FALLS)

    @property
    def sure(self) -> bool:
        """Whether bore or rod cannot be right, because nothing else explains as much."""
        return self._is(_SIGMAS, _FALLS) and not self.effect

    def _is(self, sigmas: float, falls: float) -> bool:
        return abs(self.rho - 1) > sigmas * self.std and self.before > falls * self.after


def area_ratios(trial: Trial) -> list[AreaRatio]:
    """Estimate the ratios of areas of all joints with both pressures."""
    result = []
    for number, joint in enumerate(trial.machine.joints):
        block = trial.blocks[number]
        names = (f"head_pressure{number}", f"rod_pressure{number}")
        if (
            block is None
            or joint.cylinder is None
            or not set(names) <= set(block.names)
            or joint.cylinder.rod_area <= 0
        ):
            continue
        head, rod, known = (block.signals[:, block.names.index(name)] for name in (*names, "known"))
        columns = np.hstack([block.body, block.drive])
        y = without(columns, joint.cylinder.head_area * head - known)
        back = without(columns, joint.cylinder.rod_area * rod)
        power = float(back @ back)
        freedom = block.rows - columns.shape[1]
        if power <= 0 or freedom < 50:
            continue
        rho = float(y @ back) / power
        left = y - rho * back
        rivals = np.column_stack([without(columns, own) for own in block.rivals.T])
        std = _COLOURED * float(np.linalg.norm(left)) / np.sqrt(power * freedom)
        weights = {names[0]: joint.cylinder.head_area, names[1]: -joint.cylinder.rod_area, "known": -1.0}
        target = block.target(weights)
        size = max(float(target @ block.centred @ target), 1e-300) ** 0.5
        before, after = (float(np.linalg.norm(e)) / size for e in (y - back, left))
        asked = 1.0 - _AS_MUCH if rho * joint.cylinder.rod_area < joint.cylinder.head_area else 1.0
        effect = any(_explains_as_much(rivals[:, own], y - back, asked * left) for own in RIVALS)
        result.append(AreaRatio(number, rho, std, before, after, effect))
    return result


def _explains_as_much(columns: FloatArray, before: FloatArray, left: FloatArray) -> bool:
    """Return whether an effect's columns leave less than the ratio of the areas with its one parameter."""
    rest = before - columns @ np.linalg.lstsq(columns, before, rcond=None)[0]
    return bool(np.linalg.norm(rest) < np.linalg.norm(left))
