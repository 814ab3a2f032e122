"""The most that a pump gives: what all cylinders take together while its pressure gives way.

A pump holds a pressure ``c - r Q``, a load-sensing one above the highest load of an open axis. Where it gives all that
it has, the pressure falls from there, and the flow ``Q`` stays, or the power ``p Q``. No axis shows that by itself: its
speed is what is left of the pressure. So rows are of three kinds, in unknown shares: on the line and below the limit;
at the limit and below the line, by a fall that is exponential; transients, anywhere. Against the same without rows at
the limit it has to be worth its numbers (Schwarz), in rows that count for as many as hang together.

Sources: A. Dempster, N. Laird and D. Rubin, J. R. Stat. Soc. B 39, 1977 (mixtures); G. Schwarz, Ann. Stat. 6, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy import stats

from fitting.arrays import FloatArray
from fitting.estimators.effort_fit import long_run
from fitting.selection import priors
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit
from fitting.valve.inverse import direction_of
from fitting.valve.model import SIGNS, delayed

#: Of the largest flow: rows below it tell nothing of a pump.
STILL = 0.02
#: Shares of rows below a limit at which the search begins; how widely, as a share of it, flows at a limit may spread.
_BEGIN, _SPREAD = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995), 0.05
#: Of what an axis can open: up to there a flow is asked for in proportion, whatever the pump gives.
_SMALL = 0.25
#: Of the search, and of what is held noise at the least.
_ROUNDS, _LEAST = 60, 1e-4


@dataclass(frozen=True)
class PumpLimit:
    """``value`` in m^3/s or, of a limited power, in W, its standard deviation, ``unit``, and the log odds for it."""

    value: float
    std: float
    unit: str
    odds: float


def pump_limit_of(fits: Sequence[Fit], kind: str) -> PumpLimit | None:
    """The limit of the pump that feeds these axes; None where none is seen, or their stretches are not the same.

    ``kind`` is the machine file's: ``load_sensing``, ``constant_pressure``, or ``unknown``.
    """
    axes, signals = [fit.axis for fit in fits], fits[0].axis.signals
    if not all(np.array_equal(own.signals.first, signals.first) for own in axes):
        return None
    load, asked, flow = np.zeros(len(signals)), np.zeros(len(signals)), np.zeros(len(axes[0].speed))
    for fit, axis in zip(fits, axes, strict=True):
        told = delayed(axis.signals, axis.signals.u, fit.shape["delay"] * axis.bank.rate_hz)
        for number, (sign, inlet, area) in enumerate(zip(SIGNS, axis.signals.inlet, axis.areas, strict=True)):
            own = direction_of(fit, number)
            opening, part = np.maximum(sign * told - own.edge, 0.0), _SMALL * (own.largest - own.edge)
            load = np.maximum(load, np.where(opening > 0.0, inlet, 0.0))
            asked += area * opening * own.speed(part) / max(part, 1e-9)
        flow += np.where(axis.speed > 0.0, axis.areas[0], -axis.areas[1]) * axis.speed
    supply, load, asked = axes[0].reduced(np.column_stack([signals.supply, load, asked])).T
    ways = {"load_sensing": [supply - load], "constant_pressure": [supply]}.get(kind, [supply, supply - load])
    watched = all(own.sees_supply for own in axes)
    seen = (flow > STILL * flow.max()) & (asked > 0.0)
    if np.count_nonzero(seen) < len(_BEGIN):
        return None
    units = {"m^3/s": np.ones_like(flow)} | ({"W": supply} if watched else {})
    best = max(
        (
            _limit(flow[seen], held[seen], per[seen], unit)
            for held in (ways if watched else [-asked])
            for unit, per in units.items()
        ),
        key=lambda own: own.odds,
    )
    prior = float(np.log(priors.CATALOGUE / len(EFFECTS) / priors.NOTHING))
    return best if best.odds + prior > priors.SAID_ODDS else None


def _limit(flow: FloatArray, held: FloatArray, per: FloatArray, unit: str) -> PumpLimit:
    """The best limit of ``flow * per`` and the log odds for it, whatever they are."""
    given = flow * per
    tried = (_mixture(flow, held, per, float(own), None) for own in np.quantile(given, _BEGIN))
    logs, limit, spread, share = max(tried, key=lambda own: float(own[0].sum()))
    gained = logs - _mixture(flow, held, per, limit, spread)[0]
    rows = len(gained) / long_run(gained - gained.mean())
    there = max(share * rows, 1.0)  # rows that tell where the limit is, and how far they fall
    odds = rows * float(gained.mean()) - 0.5 * float(np.log(rows)) - float(np.log(there))
    return PumpLimit(limit, spread / float(np.sqrt(there)), unit, odds)


def _mixture(
    flow: FloatArray, held: FloatArray, per: FloatArray, limit: float, fixed: float | None
) -> tuple[FloatArray, float, float, float]:
    """Log densities (N,), the limit, its spread and its share of rows; none is there where the spread is ``fixed``."""
    level, droop, fall = float(np.median(held)), 0.0, 0.1 * abs(float(np.median(held)))
    least = _LEAST * float(np.ptp(held))
    noise, spread = least + 1.48 * float(np.median(np.abs(held - level))), fixed or 0.6 * _SPREAD * limit
    shares, most, area = np.array([0.7, 0.2 * (fixed is None), 0.1]), flow.max(), flow.max() * np.ptp(held)
    for _ in range(_ROUNDS):
        top, off = limit / per, held - level + droop * flow
        below = level - droop * top - held
        line = stats.norm.pdf(off, scale=noise) / most * stats.norm.cdf((limit - flow * per) / spread)
        there = stats.norm.pdf(flow * per, limit, spread) * per * stats.norm.cdf(below / noise)
        there *= np.exp(-np.maximum(below, 0.0) / fall) / fall
        parts = shares[:, None] * np.stack([line, there, np.full_like(flow, 1.0 / area)])
        whole = parts.sum(axis=0)
        on, at, _ = parts / whole
        shares = np.array([on.mean(), at.mean(), 1.0 - on.mean() - at.mean()])
        middle = float(on @ flow / on.sum()), float(on @ held / on.sum())
        droop = max(-float(on @ ((flow - middle[0]) * held)) / float(on @ (flow - middle[0]) ** 2), 0.0)
        level = middle[1] + droop * middle[0]
        noise = least + float(np.sqrt(on @ (held - level + droop * flow) ** 2 / on.sum()))
        if fixed is None and at.sum() > 1.0:
            limit = float(at @ (flow * per) / at.sum())
            wide = float(np.sqrt(at @ (flow * per - limit) ** 2 / at.sum()))
            spread = min(max(wide, 1e-3 * limit), _SPREAD * limit)
            fall = noise + float(at @ np.maximum(below, 0.0) / at.sum())
    return np.log(whole), limit, spread, float(shares[1])
