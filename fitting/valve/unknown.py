"""Laws of an unknown effect: what is said of a valve where no name fits.

A speed that is wrong by a share that follows one variable ``z`` is, to first order, ``(1 + h(z))`` times what the
valve lets through. ``h`` is any smooth curve, as the loop's laws are. It stands beside names under one criterion.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from daq.messages import Sentence
from fitting.arrays import FloatArray
from fitting.residual.confirmation.local import Local
from fitting.residual.laws import OTHER_FUNCTIONS
from fitting.selection.evidence import with_curve
from fitting.signals.splines import evaluate, spline_knots
from fitting.valve.fit import Fit
from fitting.valve.rows import Axis


def _filled(axis: Axis) -> FloatArray:
    """Compute the drop in Pa (N,) that feeds the cylinder, or without known supply the fed pressure."""
    filled = np.where(axis.signals.last_way < 0.0, axis.signals.inlet[1], axis.signals.inlet[0])
    return np.asarray(axis.signals.supply - filled if axis.has_supply else filled)


#: Name of a variable, its unit, and the variable (N,) itself; what is not measured is not finite.
VARIABLES: dict[str, tuple[str, Callable[[Axis], FloatArray]]] = {
    "inlet_pressure": ("Pa", _filled),
    "piston_position": ("m", lambda axis: axis.signals.x),
    "oil_temperature": ("K", lambda axis: axis.signals.temperature),
    "time": ("s", lambda axis: axis.signals.clock),
    "neighbours_flow": ("m^3/s", lambda axis: axis.signals.taken),
}


@dataclass(frozen=True)
class Unknown:
    """A law beside a fit.

    Attributes
    ----------
    variable : what it follows
    local : the fit's columns with the curve's behind them
    values : (p,) what all of them are moved by
    knots : of the curve
    """

    variable: str
    local: Local
    values: FloatArray
    knots: FloatArray

    def on(self, there: Fit, moved: Local) -> Local:
        """Refit on another motion: what is left, and its columns there, from those of the fit (:meth:`Fit.on`)."""
        whole = np.hstack([moved.columns, _columns(there, self.variable, self.knots)])
        return replace(self.local, columns=whole, residual=there.residual - whole @ self.values, rows=moved.rows)

    def to_json(self, points: int = 21) -> dict[str, Any]:
        """Return its report: the curve as shares of the speed, with standard deviations, over the variable."""
        first = len(self.values) - (len(self.knots) - 4)
        grid = np.linspace(self.knots[0], self.knots[-1], points)
        basis = evaluate(self.knots, grid)
        std = np.sqrt(np.einsum("ij,jk,ik->i", basis, self.local.covariance[first:, first:], basis))
        value = basis @ self.values[first:]
        law = {"grid": grid.tolist(), "value": value.tolist(), "std": std.tolist(), "unit": VARIABLES[self.variable][0]}
        return {
            "variable": self.variable,
            "law": law,
            "experiment": Sentence("fitting.same_commands_different_values"),
        }


def _columns(fit: Fit, variable: str, knots: FloatArray) -> FloatArray:
    """Compute each coefficient's unit speed (M, functions); 0 in rows left out."""
    axis, basis = fit.axis, evaluate(knots, VARIABLES[variable][1](fit.axis))
    return np.where(axis.keep[:, None], axis.reduced(fit.openings[:, None] * basis), 0.0)


def unknown_laws(fit: Fit) -> Iterator[Unknown]:
    """Fit the most probable curve of every measured variable that changed in motion."""
    base, moving = fit.local, fit.openings != 0.0
    for variable, (_, of) in VARIABLES.items():
        z = of(fit.axis)[moving]
        if len(z) and np.isfinite(z).all() and np.ptp(z) > 1e-9 * float(np.abs(z).max()):
            knots = spline_knots(z, OTHER_FUNCTIONS)
            local, values = with_curve(base, _columns(fit, variable, knots))
            rows = replace(fit, residual=local.residual).rows
            yield Unknown(variable, replace(local, rows=rows), values, knots)
