"""Mistakes in what was recorded of a valve: another axis' command, its sign, before the dead band's compensation.

And what recorded commands determine by themselves: the dead band that the controller in front of the valve compensates.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np

from daq.machine.machine_file import Machine
from daq.messages import Sentence
from fitting.arrays import FloatArray, IntArray
from fitting.valve.fit import Fit, fitted
from fitting.valve.model import DELAY, WAYS, Structure
from fitting.valve.rows import Axis

#: m/s, and share of full command: below that an axis is at rest.
STILL_SPEED, STILL_COMMAND = 1e-3, 0.02
#: Of an error turned round or left as it is: nobody's command explains less.
_TURNED, _NOTHING = 0.5, 0.8
#: Share of full command: a dead band below it was taken off before the command was recorded.
_NO_EDGE = 0.01
#: Largest command that leaves much of a valve unseen.
_FAR = 0.6
#: Share of full command: less is no dead band, and an axis that is never commanded more remains where it is.
_REST = 0.01
#: Natural logarithm of the odds of 95 %.
_SURE = float(np.log(19.0))


def moves(axis: Axis) -> bool:
    """Return whether the axis is commanded to move, and does."""
    if not axis.keep.any() or float(np.ptp(axis.signals.u)) < STILL_COMMAND:
        return False
    return float(np.sqrt(np.mean(axis.speed[axis.keep] ** 2))) > STILL_SPEED


#: Code, text and cure.
Check = tuple[str, str, str]


def axis_checks(machine: Machine, axis: Axis, fit: Fit) -> list[dict[str, str]]:
    """List possible mistakes, each with its cure."""
    channel = machine.channel("command", axis.joint.name)
    name = "command" if channel is None else channel.name
    found = [*_of_the_command(name, axis, fit), *_of_the_motion(axis, fit), *_of_the_pressures(axis)]
    return [{"code": code, "joint": axis.joint.name, "text": text, "cure": cure} for code, text, cure in found]


def _of_the_command(name: str, axis: Axis, fit: Fit) -> Iterator[Check]:
    misfit = fitted(axis, Structure()).misfit if fit.misfit > _TURNED else fit.misfit
    if misfit > _TURNED:
        signals = replace(axis.signals, u=-axis.signals.u)
        turned = fitted(replace(axis, signals=signals), Structure()).misfit
        if turned < _TURNED * misfit:
            yield (
                "command_sign",
                Sentence("fitting.looks_if_had_wrong", name=name, turned=turned, misfit=misfit),
                Sentence("fitting.write_extends_valve_look", extends=-axis.valve.extends),
            )
        elif misfit > _NOTHING:
            yield (
                "command_axis",
                Sentence("fitting.explains_next_nothing_speed", name=name, misfit=misfit),
                Sentence("fitting.look_whether_command_axis"),
            )
    edges = [fit.shape[f"edge.{way}"] for way in WAYS if _moves(fit, way)]
    if edges and max(edges) < _NO_EDGE and fit.misfit < _TURNED:
        yield (
            "before_compensation",
            Sentence("fitting.shows_no_dead_band", name=name),
            Sentence("fitting.record_value_sent_amplifier"),
        )
    if fit.shape["delay"] > 0.98 * DELAY[2]:
        yield (
            "late",
            Sentence("fitting.ahead_speed_all_searched", name=name, shape=fit.shape["delay"]),
            Sentence("fitting.look_clocks_both_buses"),
        )


def _of_the_motion(axis: Axis, fit: Fit) -> Iterator[Check]:
    for way, most in zip(WAYS, axis.largest, strict=True):
        if not _moves(fit, way):
            text = Sentence("fitting.never_seen_valve", joint=axis.joint.name, way=way)
            yield "one_way", text, Sentence("fitting.record_motion_both_directions")
        elif most < _FAR:
            yield (
                "unvisited",
                Sentence("fitting.commands_beyond_full_never", way=way, most=100 * most),
                Sentence("fitting.record_higher_levels"),
            )


def _of_the_pressures(axis: Axis) -> Iterator[Check]:
    if not axis.has_pressures:
        yield (
            "no_pressures",
            Sentence("fitting.no_chamber_pressures_curve"),
            Sentence("fitting.add_head_pressure_rod_pressure"),
        )
    elif not axis.has_supply:
        yield (
            "no_supply",
            Sentence("fitting.nobody_knows_supply_pressure"),
            "add a supply_pressure channel, or supply: {pressure: ...}",
        )


def _moves(fit: Fit, way: str) -> bool:
    if fit.axis.largest[WAYS.index(way)] <= fit.shape[f"edge.{way}"]:
        return False  # a spool that swings beyond its middle is no command
    return any(gain > 0 for name, gain in fit.gains.items() if name.startswith(f"gain.{way}"))


def compensated_edge(u: FloatArray, first: IntArray) -> float | None:
    """Find the edge a controller jumps to, as share of full command; None without one, or if unknown.

    One that compensates a dead band sends nothing between rest and its own edge. One that does not, and an operator's
    lever, pass through these commands whenever the axis sets off. So of each run of commands to one side the smallest
    one counts, runs being independent: where ``n`` of them lie between an edge and twice the edge and none below it,
    an even spread between both is ``2^n`` times less likely.

    Parameters
    ----------
    u : (N,) commands, positive to the side that is asked for, as share of full
    first : (N,) place of the first sample of the stretch that each sample is in
    """
    positive = u > 0.0
    starts = np.flatnonzero(positive & ~(np.r_[False, positive[:-1]] & (first == np.r_[-1, first[:-1]])))
    if not len(starts):
        return None
    runs = np.minimum.reduceat(np.where(positive, u, np.inf), starts)
    least = np.sort(runs[np.maximum.reduceat(u, starts) > _REST])
    if not len(least):
        return None
    below = np.searchsorted(least, least, side="left")
    above = np.searchsorted(least, 2.0 * least, side="right") - below
    both = np.maximum(below + above, 1)
    with np.errstate(divide="ignore", invalid="ignore"):
        odds = np.where(below > 0, below * np.log(2.0 * below / both), 0.0) + above * np.log(2.0 * above / both)
    odds = np.where((above > below) & (least > _REST), odds, 0.0)
    best = int(np.argmax(odds))
    return float(least[best]) if odds[best] > _SURE else None
