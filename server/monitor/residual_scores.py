"""A block of residual as three numbers per joint, each aimed at one kind of change.

A residual's mean alone misses the commonest change of all: more friction pushes one way while the drive goes forth and
the other way while it comes back, and the mean over a stroke is zero. So the residual ``e`` of a block is projected on
a direction ``w``: ``z = sum(w e) / sqrt(sum(w^2))``, which has the variance of one sample whatever ``w`` is, where
``e`` is white. Directions:

- ``offset``: 1, a bias of a sensor or a load that is always there;
- ``direction``: the sign of the speed, friction;
- ``level``: the predicted effort about its mean, a gain, or a load that moves with the arm.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from server.identifications.live_model import JointBlock

STATISTICS = ("offset", "direction", "level")
#: Share of a block during which a drive has to move for the block to count.
MOVING_SHARE = 0.5


def scores(block: JointBlock) -> Mapping[str, float] | None:
    """Project a joint's block, in the joint's effort unit; None while it mostly rests.

    A direction that the motion does not have (always forth: ``direction`` is ``offset``) is left out.
    """
    moving = block.moving
    if np.count_nonzero(moving) < max(3, MOVING_SHARE * len(moving)):
        return None
    e = block.residual[moving]
    weights = {
        "offset": np.ones(len(e)),
        "direction": block.direction[moving],
        "level": block.predicted[moving] - block.predicted[moving].mean(),
    }
    scale = max(float(np.abs(block.predicted[moving]).max()), 1e-12)
    found = {}
    for name in STATISTICS:
        w = weights[name] / scale if name == "level" else weights[name]
        norm = float(np.linalg.norm(w))
        if norm > 0.05 * np.sqrt(len(e)):
            found[name] = float(w @ e) / norm
    return found


def effective(block: JointBlock) -> float:
    """Compute the RMS of a joint's residual while it moves, in its effort unit; NaN while it rests."""
    e = block.residual[block.moving]
    return float(np.sqrt(np.mean(e**2))) if len(e) else float("nan")
