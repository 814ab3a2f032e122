"""The most that a pump gives: what all cylinders take together while its pressure gives way.

A pump holds a pressure ``c - r Q``, a load-sensing one above the highest load of an open axis. That it follows late, as
its valve is a spool of its own; taken at once, each jump of the load looks like noise of what is held. Transducers have
zeros of their own, so ``c`` is another one over each chamber. Where a pump gives all that it has, the pressure falls
from there, and the flow ``Q`` remains, or the power ``p Q``. No axis shows that by itself: its speed is what is left of
the pressure. So rows are of three kinds, in unknown shares: on the line and below the limit; at the limit and anywhere
below the line; transients, anywhere at all. A row is of the same kind as the last one, or drawn anew: transients are
short, a limit lasts. Against a line without a limit it has to be worth its numbers (Schwarz), in rows that count for as
many as hang together.

Sources: A. Dempster, N. Laird and D. Rubin, J. R. Stat. Soc. B 39, 1977 (mixtures); L. Baum and T. Petrie, Ann. Math.
Stat. 37, 1966 (kinds that last); G. Schwarz, Ann. Stat. 6, 1978.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import scipy

from fitting.arrays import BoolArray, FloatArray
from fitting.estimators.effort_fit import long_run
from fitting.selection import priors
from fitting.selection.evidence import log_sum
from fitting.signals.filters import delayed, followed
from fitting.valve.effects import EFFECTS
from fitting.valve.fit import Fit
from fitting.valve.inverse import direction_of
from fitting.valve.model import SIGNS
from fitting.valve.rows import Axis

#: Of the largest flow: rows below it determine nothing of a pump.
STILL = 0.02
#: Shares of rows below a limit at which the search begins; how widely, as a share of it, flows at a limit may spread.
_BEGIN, _SPREAD = (0.5, 0.8, 0.9, 0.95, 0.98, 0.99, 0.995), 0.05
#: Of what an axis can open: up to there a flow is asked for in proportion, whatever the pump gives.
_SMALL = 0.25
#: s by which a load-sensing pump follows its load late.
_LAGS = (0.0, 0.02, 0.035, 0.05, 0.07, 0.1, 0.14, 0.2)
#: Of the search, and of what is held noise at the least.
_ROUNDS, _LEAST = 60, 1e-4


@dataclass(frozen=True)
class PumpLimit:
    """``value`` in m^3/s or, of a limited power, in W, its standard deviation, ``unit``, and the log odds for it."""

    value: float
    std: float
    unit: str
    odds: float


def pump_limits_of(fits: Sequence[Fit], kind: str) -> tuple[PumpLimit, ...]:
    """Find the limit of these axes' pump, of its flow or its power, or either where inseparable.

    Nothing where none is seen, or the axes' stretches are not the same. ``kind`` is the machine file's:
    ``load_sensing``, ``constant_pressure``, or ``unknown``.
    """
    axes, signals = [fit.axis for fit in fits], fits[0].axis.signals
    if not all(np.array_equal(own.signals.first, signals.first) for own in axes):
        return ()
    loads, asked, flow = [np.zeros(len(signals))], np.zeros(len(signals)), np.zeros(len(axes[0].speed))
    for fit, axis in zip(fits, axes, strict=True):
        command = delayed(axis.signals.parts, axis.signals.u, fit.shape["delay"] * axis.bank.rate_hz)
        for number, (sign, inlet, area) in enumerate(zip(SIGNS, axis.signals.inlet, axis.areas, strict=True)):
            own = direction_of(fit, number)
            opening, part = np.maximum(sign * command - own.edge, 0.0), _SMALL * (own.largest - own.edge)
            loads.append(np.where(opening > 0.0, inlet, 0.0))
            asked += area * opening * own.speed(part) / max(part, 1e-9)
        flow += np.where(axis.speed > 0.0, axis.areas[0], -axis.areas[1]) * axis.speed
    supply, asked = axes[0].reduced(np.column_stack([signals.supply, asked])).T
    seen = (flow > STILL * flow.max()) & (asked > 0.0)
    if np.count_nonzero(seen) < len(_BEGIN):
        return ()
    flow, supply, one = flow[seen], supply[seen], np.ones(np.count_nonzero(seen))
    units, ways = {"m^3/s": one}, list[tuple[FloatArray, FloatArray]]()
    if all(own.sees_supply for own in axes):
        units["W"] = supply
        if kind != "load_sensing":
            ways.append((supply, one[:, None]))
        if kind != "constant_pressure":
            above = [_above(axes[0], np.stack(loads), supply, seen, lag) for lag in _LAGS]
            ways.append(max(above, key=lambda own: float(_mixture(flow, own[0], own[1], one, None)[0].sum())))
    else:
        ways.append((-asked[seen], one[:, None]))
    found = max(
        ([_limit(flow, held, sides, per, unit) for unit, per in units.items()] for held, sides in ways),
        key=lambda own: max(limit.odds for limit in own),
    )
    odds = np.array([own.odds for own in found])
    prior = float(np.log(priors.CATALOGUE / len(EFFECTS) / len(found) / priors.NOTHING))
    clear = float(log_sum(odds)) + prior > priors.CREDIBLE_ODDS
    return tuple(own for own in found if clear and own.odds > odds.max() - priors.CREDIBLE_ODDS)


def _above(
    axis: Axis, loads: FloatArray, supply: FloatArray, seen: BoolArray, lag: float
) -> tuple[FloatArray, FloatArray]:
    """Compute supply over the highest of ``loads`` (k, N) as a spool follows it, and each one's share (M, k)."""
    shares = (np.arange(len(loads))[:, None] == loads.argmax(axis=0)).astype(float)
    samples = lag * axis.bank.rate_hz
    late = [followed(axis.signals.parts, own, samples, 1.0).mean(axis=0) for own in (loads.max(axis=0), *shares)]
    load, *sides = axis.reduced(np.column_stack(late))[seen].T
    return supply - load, np.column_stack(sides)


def _limit(flow: FloatArray, held: FloatArray, sides: FloatArray, per: FloatArray, unit: str) -> PumpLimit:
    """Find the best limit of ``flow * per`` and its log odds, whatever they are."""
    given = flow * per
    tried = (_mixture(flow, held, sides, per, float(own)) for own in np.quantile(given, _BEGIN))
    logs, limit, spread, share = max(tried, key=lambda own: float(own[0].sum()))
    gained = logs - _mixture(flow, held, sides, per, None)[0]
    rows = len(gained) / long_run(gained - gained.mean())
    there = max(share * rows, 1.0)  # rows that determine where the limit is
    odds = rows * float(gained.mean()) - 0.5 * float(np.log(rows)) - float(np.log(there))
    return PumpLimit(limit, spread / float(np.sqrt(there)), unit, odds)


def _mixture(
    flow: FloatArray, held: FloatArray, sides: FloatArray, per: FloatArray, begin: float | None
) -> tuple[FloatArray, float, float, float]:
    """Compute log densities (N,), the limit searched from (None: there is none), its spread and share of rows.

    The level of ``held`` is another one for each of ``sides`` (N, k), by their shares in each row.
    """
    limit = 1e3 * float((flow * per).max()) if begin is None else begin
    middle, droop, least = float(np.median(held)), 0.0, _LEAST * float(np.ptp(held))
    level, lowest = np.full_like(held, middle), float(held[held * middle > 0.0].min())
    noise, spread = least + 1.48 * float(np.median(np.abs(held - level))), 0.6 * _SPREAD * limit
    span = max(middle - lowest, noise)
    shares, most, area = np.array([0.7, 0.2 * (begin is not None), 0.1]), flow.max(), flow.max() * np.ptp(held)
    for _ in range(_ROUNDS):
        top, off = limit / per, held - level + droop * flow
        below = level - droop * top - held
        line = _density(off, noise) / most * scipy.special.ndtr((limit - flow * per) / spread)
        there = _density(flow * per - limit, spread) * per
        there *= (scipy.special.ndtr(below / noise) - scipy.special.ndtr((below - span) / noise)) / span
        kinds = np.stack([line, there, np.full_like(flow, 1.0 / area)])
        parts = shares[:, None] * kinds
        on, at, _ = parts / parts.sum(axis=0)
        shares = np.array([on.mean(), at.mean(), 1.0 - on.mean() - at.mean()])
        weight = np.sqrt(on)
        for lines in (np.column_stack([sides, -flow]), sides):
            levels = np.linalg.lstsq(weight[:, None] * lines, weight * held, rcond=None)[0]
            droop = float(levels[sides.shape[1] :].sum())
            if droop >= 0.0:
                break
        level = sides @ levels[: sides.shape[1]]
        noise = least + float(np.sqrt(on @ (held - level + droop * flow) ** 2 / on.sum()))
        if begin is not None and at.sum() > 1.0:
            limit = float(at @ (flow * per) / at.sum())
            wide = float(np.sqrt(at @ (flow * per - limit) ** 2 / at.sum()))
            spread = min(max(wide, 1e-3 * limit), _SPREAD * limit)
    return _lasting(kinds, shares), limit, spread, float(shares[1])


def _density(off: FloatArray, std: float) -> FloatArray:
    """Compute the normal density ``off`` its mean, in a third of the time of :data:`scipy.stats.norm`."""
    return np.asarray(np.exp(-((off / std) ** 2) / 2.0) / np.sqrt(2.0 * np.pi) / std)


def _lasting(kinds: FloatArray, shares: FloatArray) -> FloatArray:
    """Compute log densities (N,) of rows given those before: a row is of the last one's kind, or drawn anew."""
    persistence = np.array([[0.0], [0.5], [0.7], [0.8], [0.9], [0.95]])
    state, out = np.tile(shares, (len(persistence), 1)), np.empty((kinds.shape[1], len(persistence)))
    for row, own in zip(out, kinds.T, strict=True):
        state = (persistence * state + (1.0 - persistence) * shares) * own
        row[:] = state.sum(axis=1)
        state /= row[:, None]
    logs = np.log(out)
    return np.asarray(logs[:, logs.sum(axis=0).argmax()])
