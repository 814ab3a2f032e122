"""Stage 2's ordinary least squares over more rows than fit in memory.

Rows of each joint are folded into a triangle (:func:`fitting.regression.streamed.triangle`), from which parameters and
their conditioning follow as from all rows. A second walk through the rows gives residuals, and with ``Q = A root`` the
scores that the covariance is made of. Each segment of each joint is a series of its own there: what neighbouring
segments have in common at their seam, one correlation time of some minutes, is left out.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from fitting.arrays import FloatArray, IntArray
from fitting.estimators.base import Estimate
from fitting.estimators.covariance import Colour, check_colour, series_scores
from fitting.estimators.least_squares import solve
from fitting.regression.design import Design
from fitting.regression.streamed import triangle


class LongRows:
    """Rows of joint efforts of a stored design, as :class:`fitting.pipeline.rigid_body_stage.EffortRows` has them in
    memory.

    Attributes
    ----------
    columns, target, groups : the triangles of all joints, which stand for all rows in any least squares with one
        weight per joint
    """

    def __init__(self, design: Design, roles: Sequence[str]) -> None:
        self._design, self._roles = design, tuple(roles)
        triangles = []
        for joint in range(len(design.machine.joints)):
            triangles.append(triangle(np.column_stack(part) for part in self._parts(joint)))
        self.columns = np.vstack([R[:, :-1] for R in triangles])
        self.target = np.concatenate([R[:, -1] for R in triangles])
        self.groups = np.concatenate([np.full(len(R), joint) for joint, R in enumerate(triangles)])

    def _parts(self, joint: int) -> Iterator[tuple[FloatArray, FloatArray]]:
        """Columns and target of one joint, segment by segment."""
        for index in self._design.indices(*self._roles):
            block = self._design.blocks[joint][index]
            target, columns = block.effort(self._design.bank, self._design.segments[index].r[:, joint])
            yield columns[block.keep], target[block.keep]

    def fit(self, wanted: IntArray, frozen: FloatArray, colour: Colour) -> Estimate:
        """Fit the columns ``wanted``, all others frozen at the values (p,) that ``frozen`` has for them."""
        check_colour(colour)
        known = frozen.copy()
        known[wanted] = 0.0
        solution = solve(self.columns[:, wanted], self.target - self.columns @ known)
        theta = known.copy()
        theta[wanted] = solution.theta
        rng = np.random.default_rng(20)  # the same residual gives the same deviation
        joints = len(self._design.machine.joints)
        squares, freedom, S = np.zeros(joints), np.zeros(joints), np.zeros((solution.rank, solution.rank))
        for joint in range(joints):
            for columns, target in self._parts(joint):
                Q, e = columns[:, wanted] @ solution.root, target - columns @ theta
                squares[joint] += float(e @ e)
                freedom[joint] += len(e) - float(np.sum(Q**2))
                if colour != "white" and len(e):
                    S += series_scores(Q, e, colour, rng)
        # Freedom of all joints: rows less rank; a leverage sums to the rank.
        free = float(freedom.sum())
        middle = float(squares.sum()) / free if colour == "white" else S * ((free + solution.rank) / free)
        moving = freedom > 1e-6
        return Estimate(
            theta=solution.theta,
            covariance=solution.covariance(middle),
            residual_std=np.sqrt(squares / np.where(moving, freedom, np.nan)),
            groups=np.arange(joints),
            condition_number=solution.condition_number,
            told=solution.told,
        )
