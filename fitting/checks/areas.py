"""Bore and rod, from the one thing that a single cylinder tells of them: what its rod side weighs against its head.

The effort is ``A1 (p1 - (A2/A1) p2)``. A scale common to both areas is absorbed by the masses; their ratio is not,
because back-pressure changes for reasons of its own. It is estimated with everything else of the joint free::

    A1 p1 - known = rho A2 p2 + (body, friction, constant, spring, delay)

and nominal is ``rho = 1``. Gains of single transducers (an effect) reach ten per cent each. Back pressure of valves in
one direction of motion (another effect) moves the ratio too; where that alone explains more, it is only a remark.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from fitting.checks.physical import Trial, without

#: A ratio this far from the declared one (its logarithm) is no gain of a transducer; so many of its standard errors;
#: and what is left of the effort has to fall by this factor.
_FAR, _SIGMAS, _FALLS = 0.17, 6.0, 1.5
#: Cylinders are built with rod sides of a fifth to nearly all of the head's area, so no true ratio is beyond these of a
#: declared one; and the joint has to be explained well with it: else the ratio stands in for something that is missing.
_POSSIBLE, _EXPLAINED = (0.15, 6.0), 0.1
#: Standard errors are of coloured residuals: a third as many samples as rows in each direction count.
_COLOURED = 3.0


@dataclass(frozen=True)
class AreaRatio:
    """Estimated ``rho`` of a joint, its standard error, misfits before and after, and whether valves explain more."""

    joint: int
    rho: float
    std: float
    before: float
    after: float
    valves: bool

    @property
    def wrong(self) -> bool:
        """Whether bore or rod cannot be right."""
        far = self.rho <= 0 or abs(float(np.log(self.rho))) > _FAR
        possible = _POSSIBLE[0] < self.rho < _POSSIBLE[1] and self.after < _EXPLAINED
        return far and possible and abs(self.rho - 1) > _SIGMAS * self.std and self.before > _FALLS * self.after


def area_ratios(trial: Trial) -> list[AreaRatio]:
    """Estimates of all joints with both pressures."""
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
        valves = np.column_stack([without(columns, own) for own in block.valves.T])
        rival = y - back - valves @ np.linalg.lstsq(valves, y - back, rcond=None)[0]
        std = _COLOURED * float(np.linalg.norm(left)) / np.sqrt(power * freedom)
        weights = {names[0]: joint.cylinder.head_area, names[1]: -joint.cylinder.rod_area, "known": -1.0}
        target = block.target(weights)
        size = max(float(target @ block.centred @ target), 1e-300) ** 0.5
        before, after, other = (float(np.linalg.norm(e)) / size for e in (y - back, left, rival))
        # The valves have more parameters; by Schwarz's criterion they are worth so much of the misfit.
        samples = block.rows / _COLOURED**2
        least = np.sqrt(max(1 - (valves.shape[1] - 1) * np.log(samples) / samples, 0.0))
        result.append(AreaRatio(number, rho, std, before, after, bool(other < least * after)))
    return result
