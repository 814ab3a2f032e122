"""Gravity and friction as tables over their variables, for controllers that interpolate (a PLC).

Which variables a value has is tried out on the model; a grid is as fine as linear interpolation needs. How far that
is off is measured on points between those of the grid, and listed in ``tables.csv`` beside units and ranges. What needs
more than two variables is no table, and is listed as left out.

Gravity along parallel axes needs no table of several positions: the part of each link is a function of its own angle to
the first of these axes (the sum of the joint positions), and a joint bears the parts of its own link and of all behind
it along these axes. What else acts at rest (stiffness, offsets) is a table beside it: both together are the effort at
rest.
"""

from __future__ import annotations

import csv
import io
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np
import scipy

from fitting.arm.geometry import geometry_of
from fitting.arrays import FloatArray
from fitting.effects.base import Effect
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.evaluation import without
from fitting.model.export.functions import written
from fitting.model.export.words import Written, model_card, refitted, require_folder

#: Error of linear interpolation that grids are refined to, as a share of the table's largest value.
TOLERANCE = 1e-3
#: Most points along a variable of a table of one, and of two.
_MOST = {1: 513, 2: 65}
_TRIALS, _BETWEEN = 40, 2000
#: Share of the largest value below which a change is rounding.
ROUNDING = 1e-9


@dataclass(frozen=True)
class _Quantity:
    """Something to be tabled.

    Attributes
    ----------
    name : of the file
    description : what it is, and how it is used
    unit : of the value
    variables : name, unit, lowest, highest of everything that it may depend on
    value : (N, variables) to (N,)
    """

    name: str
    description: str
    unit: str
    variables: tuple[tuple[str, str, float, float], ...]
    value: Callable[[FloatArray], FloatArray]


@dataclass(frozen=True)
class _Table:
    """A quantity on a grid: its chosen variables by number, the rising values of each, and its own.

    ``error`` is the largest of linear interpolation between, in the unit of the value.
    """

    quantity: _Quantity
    chosen: tuple[int, ...]
    axes: tuple[FloatArray, ...]
    values: FloatArray
    error: float


def _tabled(quantity: _Quantity, rng: np.random.Generator) -> _Table | str | None:
    """Tabulate a quantity over its variables; return a line on why not, None of nothing."""
    low, high = np.array([ends for _, _, *ends in quantity.variables]).T
    points = rng.uniform(low, high, (_TRIALS, len(low)))
    first = quantity.value(points)
    scale = float(np.max(np.abs(first)))
    if scale == 0.0:
        return None
    chosen = []
    for k in range(len(low)):
        moved = points.copy()
        moved[:, k] = rng.uniform(low[k], high[k], _TRIALS)
        if np.max(np.abs(quantity.value(moved) - first)) > ROUNDING * scale:
            chosen.append(k)
    if len(chosen) > max(_MOST):
        names = ", ".join(quantity.variables[k][0] for k in chosen)
        return f"{quantity.name}: it depends on {names}, which is more than a table of two variables has"
    chosen = chosen or [0]
    middle = 0.5 * (low + high)

    def at(rows: FloatArray) -> FloatArray:
        whole = np.tile(middle, (len(rows), 1))
        whole[:, chosen] = rows
        return quantity.value(whole)

    axes = _refined(at, low[chosen], high[chosen], TOLERANCE * scale)
    values = _ongrid_points(at, axes)
    between = rng.uniform(low[chosen], high[chosen], (_BETWEEN, len(chosen)))
    # Middles of the cells as well, where linear interpolation of something smooth is worst.
    middles = [0.5 * (axis[1:] + axis[:-1]) for axis in axes]
    between = np.vstack([between, _grid_points(middles)])
    error = float(np.max(np.abs(scipy.interpolate.RegularGridInterpolator(axes, values)(between) - at(between))))
    return _Table(quantity, tuple(chosen), axes, values, error)


def _grid_points(axes: Sequence[FloatArray]) -> FloatArray:
    return np.stack([own.ravel() for own in np.meshgrid(*axes, indexing="ij")], axis=1)


def _ongrid_points(value: Callable[[FloatArray], FloatArray], axes: Sequence[FloatArray]) -> FloatArray:
    return value(_grid_points(axes)).reshape([len(axis) for axis in axes])


def _refined(
    value: Callable[[FloatArray], FloatArray], low: FloatArray, high: FloatArray, tolerance: float
) -> tuple[FloatArray, ...]:
    """Refine axes until linear interpolation errs by at most ``tolerance``, as far as points suffice."""
    most = _MOST[len(low)]
    axes = [np.linspace(a, b, 17) for a, b in zip(low, high, strict=True)]
    busy = True
    while busy:
        busy, values = False, _ongrid_points(value, axes)
        for k, axis in enumerate(list(axes)):
            middles = 0.5 * (axis[1:] + axis[:-1])
            between = _ongrid_points(value, [*axes[:k], middles, *axes[k + 1 :]])
            ends = np.moveaxis(values, k, 0)
            wrong = np.abs(np.moveaxis(between, k, 0) - 0.5 * (ends[1:] + ends[:-1])).reshape(len(middles), -1)
            worst = wrong.max(axis=1)
            worse = np.argsort(-worst)[: max(most - len(axis), 0)]
            added = middles[worse[worst[worse] > tolerance]]
            if len(added):
                axes[k], busy = np.sort(np.concatenate([axis, added])), True
                break  # the values of the other axis are on the old grid
    return tuple(axes)


def write(model: ArmModel, path: Path, possible: bool = False) -> Written:
    """Write a folder of tables, and ``tables.csv`` that lists what each is.

    Raises
    ------
    InputError
        If the folder is a file.
    """
    require_folder(path)
    reasons = {
        "belongs to the sensors": motion.left_out(model),
        "needs the motion before a moment": motion.histories(model),
        "needs the oil's temperature": motion.heated(model),
    }
    left_out = [f"{model.terms[k].id}: it {why}" for why, numbers in reasons.items() for k in sorted(numbers)]
    lost = motion.histories(model) | motion.heated(model)
    rest = model.rest(lost) if lost else None
    left_out += [] if rest is None else refitted(model, rest)
    whole, model = model, motion.at_rest(rest or model, cold=True)
    rng = np.random.default_rng(0)
    tables = []
    links = _links(model)

    def beside(q: FloatArray) -> FloatArray:
        return motion.gravity(model, q) - motion.gravity(links, q)

    what = "at rest beside the links' gravity: stiffness, offset, springs"
    held = [_at_rest(model, joint, "held", what, beside) for joint in range(len(model.joints))]
    for quantity in (*_link_quantities(links), *held, *_friction_quantities(model)):
        found = _tabled(quantity, rng)
        if found is None:
            continue
        if isinstance(found, _Table):
            tables.append(found)
        else:
            left_out.append(found)
    files = {f"{own.quantity.name}.csv": _text(own) for own in tables} | {"tables.csv": _index(tables)}
    files["card.txt"] = "\n".join([*model_card(whole, left_out), ""])
    return written(path, files, left_out)


def _text(table: _Table) -> str:
    variables = [table.quantity.variables[k] for k in table.chosen]
    header = [*(f"{name} [{unit}]" for name, unit, _, _ in variables), f"{table.quantity.name} [{table.quantity.unit}]"]
    rows = np.column_stack([_grid_points(table.axes), table.values.ravel()])
    return _csv([header, *([repr(value) for value in row] for row in rows.tolist())])


def _index(tables: Sequence[_Table]) -> str:
    header = ["file", "value", "unit", "variables", "points", "largest", "interpolation_error", "says"]
    rows = []
    for own in tables:
        names = ["{} [{}] {!r} to {!r}".format(*own.quantity.variables[k]) for k in own.chosen]
        points = " x ".join(str(len(axis)) for axis in own.axes)
        largest = repr(float(np.max(np.abs(own.values))))
        name, unit = own.quantity.name, own.quantity.unit
        error = f"{own.error:.3g}"
        rows.append([f"{name}.csv", name, unit, "; ".join(names), points, largest, error, own.quantity.description])
    return _csv([header, *rows])


def _csv(rows: Sequence[Sequence[str]]) -> str:
    text = io.StringIO()
    csv.writer(text, lineterminator="\n").writerows(rows)
    return text.getvalue()


def _links(model: ArmModel) -> ArmModel:
    """Return the links alone, with what effects change about them."""
    changes = {
        number
        for number, term in enumerate(model.terms)
        if not isinstance(term.content, Effect) or term.content.body_columns(model.arm, term.shape) is None
    }
    own = without(model, changes)
    drives = np.arange(len(own.theta)) < own.parameters.drive_count
    return replace(
        own, passes=tuple(replace(p, theta=np.where(drives[: len(p.theta)], 0.0, p.theta)) for p in own.passes)
    )


def _at_rest(
    model: ArmModel, joint: int, name: str, what: str, efforts: Callable[[FloatArray], FloatArray]
) -> _Quantity:
    """Return a joint's effort over all joint positions: its own of ``efforts``, (N, n) at positions (N, n)."""
    positions = tuple(_position(model, k) for k in range(len(model.joints)))
    own, unit = model.joints[joint], model.joint_units[joint]
    return _Quantity(f"{name}_{own}", f"effort of {own} {what}", unit, positions, lambda q: efforts(q)[:, joint])


def _link_quantities(model: ArmModel) -> list[_Quantity]:
    """Return links' gravity over the link's angle along parallel axes, else over joint positions."""
    limits = model.limits.T
    result: list[_Quantity] = []
    for chain in _parallel_axes(model):
        last = chain[-1]
        if not _alone(model, chain):
            gravity = partial(motion.gravity, model)
            result += [_at_rest(model, joint, "gravity", "that holds the links still", gravity) for joint in chain]
            continue
        for joint in chain:
            # Of the others one pose is as good as another: what differs between two joints is this link's own part.
            low, high = limits[chain[0] : joint + 1].sum(axis=0)

            def part(rows: FloatArray, joint: int = joint, first: int = chain[0], last: int = last) -> FloatArray:
                q = np.tile(limits.mean(axis=1), (len(rows), 1))
                q[:, first : joint + 1] = 0.0
                q[:, first] = rows[:, 0]
                efforts = motion.gravity(model, q)
                behind = efforts[:, joint + 1] if joint < last else 0.0
                return np.asarray(efforts[:, joint] - behind)

            names = " + ".join(model.joints[chain[0] : joint + 1])
            about = f"part of link {model.joints[joint]} in the gravity of itself and of the joints before it from "
            about += f"{model.joints[chain[0]]} on, over {names}: a joint bears its own link's part and those behind"
            variable = (f"{model.joints[joint]}.link_angle", "rad", float(low), float(high))
            result.append(_Quantity(f"gravity_{model.joints[joint]}", about, "N m", (variable,), part))
    return result


def _parallel_axes(model: ArmModel) -> list[tuple[int, ...]]:
    """Group joints in runs of parallel turning axes; a sliding joint is a run of its own."""
    geometry = geometry_of(model.arm)
    runs: list[tuple[int, ...]] = []
    for joint in range(geometry.joints):
        twist = joint - 1 if not geometry.modified else joint  # between the axes of the joint before and of this one
        parallel = joint > 0 and abs(geometry.sin_alpha[twist]) < 1e-12 and geometry.cos_alpha[twist] > 0
        if runs and parallel and geometry.revolute[joint] and geometry.revolute[joint - 1]:
            runs[-1] = (*runs[-1], joint)
        else:
            runs.append((joint,))
    return runs


def _alone(model: ArmModel, chain: Sequence[int]) -> bool:
    """Return whether gravity along parallel axes is a sum over the links' angles."""
    rng, n = np.random.default_rng(1), len(model.joints)
    if not geometry_of(model.arm).revolute[chain[0]]:
        return False
    low, high = model.limits
    q, other = (rng.uniform(low, high, (_TRIALS, n)) for _ in range(2))
    efforts = motion.gravity(model, q)
    scale = float(np.max(np.abs(efforts))) or 1.0
    for place, joint in enumerate(chain):
        moved = other.copy()  # another pose with the same angle of this link
        moved[:, chain[0]] += q[:, chain[: place + 1]].sum(axis=1) - other[:, chain[: place + 1]].sum(axis=1)
        again = motion.gravity(model, moved)
        parts = [e[:, joint] - (e[:, joint + 1] if joint < chain[-1] else 0.0) for e in (efforts, again)]
        if np.max(np.abs(parts[0] - parts[1])) > ROUNDING * scale:
            return False
    return True


def _position(model: ArmModel, joint: int) -> tuple[str, str, float, float]:
    described = model.machine.joints[joint]
    unit = "rad" if described.type == "revolute" else "m"
    return (f"{described.name}.position", unit, *described.limits.position)


def _friction_quantities(model: ArmModel) -> list[_Quantity]:
    """Return every drive's friction over its own speed, and whatever else it depends on."""
    n, result = len(model.joints), []
    levers = motion.levers(model, model.limits.mean(axis=0, keepdims=True))[0]
    for joint, described in enumerate(model.arm.joints):
        fastest = model.passes[-1].ranges[joint].v or abs(levers[joint]) * described.limits.velocity
        turns = described.cylinder is None and described.type == "revolute"
        own = (f"{described.name}.{'speed' if described.cylinder is None else 'piston_speed'}",)
        speed = (*own, "rad/s" if turns else "m/s", -float(fastest), float(fastest))
        others = [k for k in range(n) if k != joint]

        def value(rows: FloatArray, joint: int = joint, others: list[int] = others) -> FloatArray:
            q, qd = rows[:, 1 : 1 + n], np.zeros((len(rows), n))
            qd[:, others] = rows[:, 1 + n :]
            qd[:, joint] = rows[:, 0] / motion.levers(model, q)[:, joint]
            both = motion.on_motion(model, np.vstack([q, q]), np.vstack([qd, -qd]), np.zeros((2 * len(q), n)))
            efforts = both.drive_effort(0)[:, joint]
            return np.asarray((efforts[: len(q)] - efforts[len(q) :]) / 2)

        positions = [_position(model, k) for k in range(n)]
        limits = [model.machine.joints[k].limits.velocity for k in others]
        speeds = [
            (f"{model.joints[k]}.speed", f"{_position(model, k)[1]}/s", -fast, fast)
            for k, fast in zip(others, limits, strict=True)
        ]
        unit = model.effort_units[joint]
        about = f"friction of the drive of {described.name}: what changes its sign with its speed"
        result.append(_Quantity(f"friction_{described.name}", about, unit, (speed, *positions, *speeds), value))
    return result
