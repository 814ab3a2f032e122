"""An identified valve on newer motion: what it leaves of the speed, and which of its numbers has moved by how much.

The model is that of the fit that was handed out, with the fit's own filters, laws and effects; nothing is fitted again.
To first order a valve that has changed leaves ``e = W d`` of the speed: ``d`` are changes of edge, gain and delay of
both directions, ``W`` the slopes of the prediction over them. Blocks of motion are kept as ``W'W`` and ``W'e``. Each
statistic of a block is ``e`` projected on one of these slopes, which has the variance of one sample whatever the motion
was. Sums over blocks give ``d``, by least squares; its interval is that of a sandwich over blocks.

Source: K. Liang and S. Zeger, Biometrika 73, 1986 (sandwich over clusters).
"""

from __future__ import annotations

import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.signals.filters import FilterBank, filter_bank
from fitting.valve.checks import STILL_SPEED
from fitting.valve.fit import Fit
from fitting.valve.model import WAYS, Structure, columns
from fitting.valve.rows import Axis, axis_of

#: What may move, and its unit; a gain by a share of itself.
NUMBERS = {"edge": "of full command", "gain": "of itself", "delay": "s"}
STATISTICS = tuple(f"{name}.{way}" for way in WAYS for name in NUMBERS)
#: s before a block that a model remembers beside its delay: the spool's lag, and its hysteresis.
PAST = 3.0
#: Share of a block in which a direction has to move for it to count.
MOVING_SHARE = 0.2
#: Of slopes: share of full command, and s.
EDGE_STEP, DELAY_STEP = 1e-3, 5e-3
#: Standard deviations from which on a number is reported to have moved.
SURE = 3.0


@dataclass(frozen=True)
class Kept:
    """The part of a fit that is kept, so that it can be tested again.

    Attributes
    ----------
    structure, shape, gains : of the fit
    drops, largest : of its axis, what gains and curves are counted to
    bandwidth_hz : of its filters
    """

    structure: Structure
    shape: Mapping[str, float]
    gains: Mapping[str, float]
    drops: FloatArray
    largest: tuple[float, float]
    bandwidth_hz: float

    @classmethod
    def of(cls, fit: Fit) -> Kept:
        """Keep a fit."""
        axis = fit.axis
        return cls(fit.structure, fit.shape, fit.gains, axis.drops, axis.largest, axis.bank.bandwidth_hz)

    def to_json(self) -> dict[str, Any]:
        """Return plain content; :meth:`from_json` reads it back."""
        content = {**vars(self), "structure": asdict(self.structure), "drops": self.drops.tolist()}
        return dict(json.loads(json.dumps(content)))

    @classmethod
    def from_json(cls, content: Mapping[str, Any]) -> Kept:
        """Read :meth:`to_json`'s content."""
        own = content["structure"]
        structure = Structure(tuple(own["laws"]), own["curve"], own["stiffness"], tuple(own["effects"]))
        own = {"structure": structure, "drops": np.array(content["drops"]), "largest": tuple(content["largest"])}
        return cls(**{**content, **own})

    def bank(self, rate_hz: float) -> FilterBank:
        """Return its filters."""
        return filter_bank(rate_hz, self.bandwidth_hz)


@dataclass(frozen=True)
class Block:
    """A block of motion of one axis.

    Attributes
    ----------
    residual : m/s, RMS of measured minus predicted speed while it moves; NaN at rest
    normal, score : (6, 6) ``W'W`` and (6,) ``W'e``, in the order of :data:`STATISTICS`; 0 of a direction at rest
    """

    residual: float
    normal: FloatArray
    score: FloatArray

    @property
    def statistics(self) -> dict[str, float] | None:
        """The projections, m/s; None at rest."""
        size = np.sqrt(np.diag(self.normal))
        found = {name: float(s / w) for name, s, w in zip(STATISTICS, self.score, size, strict=True) if w > 0.0}
        return found or None

    def slack(self, error: float) -> dict[str, float]:
        """Compute each statistic's slack, m/s, for a model that is off by share ``error`` of speed."""
        sizes = {name: float(size) for name, size in zip(STATISTICS, np.sqrt(np.diag(self.normal)), strict=True)}
        return {name: error * sizes[f"gain.{name.partition('.')[2]}"] for name in STATISTICS}


def block_of(machine: Machine, joint: str, kept: Kept, recording: Recording, samples: int) -> Block | None:
    """Cut the last so many ``samples`` of a gapless recording; None with gaps."""
    try:
        axis = axis_of(machine, machine.joint(joint), [recording], bandwidth_hz=kept.bandwidth_hz, like=kept)
    except InputError:
        return None
    if len(axis.signals) < len(recording):
        return None
    rows = slice(-(samples // axis.bank.decimation), None)
    speeds, beside = _of_ways(axis, kept, kept.shape)
    edges = {name: kept.shape[name] + EDGE_STEP for name in ("edge.extend", "edge.retract")}
    farther = replace(axis, largest=(axis.largest[0] + EDGE_STEP, axis.largest[1] + EDGE_STEP))
    by_edge = _of_ways(farther, kept, {**kept.shape, **edges})[0]  # the whole curve moves, and keeps its form
    by_delay = _of_ways(axis, kept, {**kept.shape, "delay": kept.shape["delay"] + DELAY_STEP})[0]
    bent = [(by_edge - speeds) / EDGE_STEP, speeds, (by_delay - speeds) / DELAY_STEP]
    slopes = np.stack(bent, axis=2)[rows]  # (rows, ways, numbers), as NUMBERS has them
    keep = axis.keep[rows]
    moving = np.abs(speeds[rows]) > STILL_SPEED
    counts = np.count_nonzero(moving & keep[:, None], axis=0) >= MOVING_SHARE * len(keep)
    W = np.where(counts[None, :, None] & keep[:, None, None], slopes, 0.0).reshape(len(keep), -1)
    e = np.where(keep, (axis.speed - speeds.sum(axis=1) - beside)[rows], 0.0)
    seen = e[keep & moving.any(axis=1)]
    return Block(float(np.sqrt(np.mean(seen**2))) if len(seen) else float("nan"), W.T @ W, W.T @ e)


def _of_ways(axis: Axis, kept: Kept, shape: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Return filtered speeds by direction's opening, (M, 2), and what stiffness and leaks add, (M,)."""
    names, matrix = columns(axis, kept.structure, shape)
    shares = matrix * np.array([kept.gains[name] for name in names])
    of = np.array([[name.startswith(f"gain.{way}") for name in names] for way in WAYS])
    return shares @ of.T, shares @ ~of.any(axis=0)


@dataclass(frozen=True)
class Moved:
    """A number that has moved: its name as in :data:`STATISTICS`, by how much, with a standard deviation."""

    name: str
    value: float
    std: float
    unit: str


def moved_numbers(blocks: Sequence[Block], usual: FloatArray, error: FloatArray) -> list[Moved]:
    """List numbers that moved over some blocks, the surest first; empty where undecided.

    Parameters
    ----------
    usual, error : (6,) what statistics were before, m/s, with standard errors: a model that is off a little everywhere
        has moved nowhere
    """
    G = np.array([own.normal for own in blocks])
    sizes = np.sqrt(np.diagonal(G, axis1=1, axis2=2))
    b = np.array([own.score for own in blocks]) - usual * sizes
    live = np.flatnonzero(np.diag(G.sum(axis=0)) > 0.0)
    G, b = G[:, live][:, :, live], b[:, live]
    if len(blocks) <= 2 * len(live):
        return []
    inverse = np.linalg.pinv(G.sum(axis=0), hermitian=True)
    d = inverse @ b.sum(axis=0)
    left = b - G @ d
    spread = left.T @ left * len(blocks) / (len(blocks) - len(live)) + np.diag((error * sizes.sum(axis=0))[live] ** 2)
    std = np.sqrt(np.diag(inverse @ spread @ inverse))
    sure = sorted((own for own in range(len(live)) if abs(d[own]) > SURE * std[own]), key=lambda k: -abs(d[k]) / std[k])
    names = [(k, STATISTICS[live[k]]) for k in sure]
    return [Moved(name, float(d[k]), float(std[k]), NUMBERS[name.partition(".")[0]]) for k, name in names]
