"""Requirements that every effect meets; call them from a test of your own effect::

    from fitting.effects.conformance import check_effect

    def test_conforms() -> None:
        check_effect(MyEffect())

The effect is tried on small arms that have every kind of joint: revolute and prismatic, with a cylinder (three pins,
rack, polynomial, direct) and without, with pressures and with a force sensor, with one position sensor and with two.
"""

from __future__ import annotations

import re
from collections.abc import Iterator
from dataclasses import dataclass, fields, replace
from functools import lru_cache, partial
from typing import Any

import numpy as np
import yaml

from daq.machine.machine_file import Machine, parse_machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, Parameter, Parity, Ranges, Shape, has_both_positions
from fitting.effects.variables import NEIGHBOUR, OWN
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import PositionNoise, Segment, motion_segment

_RATE = 50.0
_SECONDS = 24.0
_TEXTS = ("id", "title", "level", "variable", "equation", "dependence", "experiment", "source")


@dataclass(frozen=True)
class _Bench:
    """One arm with an unloaded and a loaded recording; ``views[segment][joint]``."""

    machine: Machine
    views: tuple[tuple[DriveView, ...], ...]


def check_effect(effect: Effect) -> None:
    """Raise ``AssertionError``, with a text that names what is wrong, if the effect breaks the contract.

    Checked: texts are there; parameters are named once; on every joint that it applies to, every shape gives finite
    columns of the right form, beyond the fitted ranges as well, that add something in a loaded recording; a joint's
    effect is gone when the arm is unloaded; the parity is the declared one; columns of an effect with
    ``uses_model = False`` do not move with the model, and no column holds a hidden force of its own (doubled model
    forces give a multiple of the column); gap columns have the same form; plausibility follows the intervals; the same
    view gives the same columns and is left unchanged.

    Parameters
    ----------
    effect : an object of the class, as its entry point names it
    """
    _check_texts(effect)
    _check_plausibility(effect)
    used = False
    for bench in _benches():
        for joint in _joints(effect, bench.machine):
            used = True
            _check_columns(effect, bench, joint)
        used = _check_gap(effect, bench) or used
    _require(effect, used, "it applies to no joint of any arm, and no position sensor sees it")


def _require(effect: Effect, condition: bool, text: str) -> None:
    if not condition:
        raise AssertionError(f"effect '{getattr(effect, 'id', type(effect).__name__)}' does not conform: {text}")


def _check_texts(effect: Effect) -> None:
    require = partial(_require, effect)
    require(isinstance(effect, Effect), "it is no subclass of fitting.effects.Effect")
    for name in _TEXTS:
        text = getattr(effect, name, None)
        require(isinstance(text, str) and bool(text.strip()), f"its text '{name}' is missing or empty")
        require("\n" not in str(text), f"its text '{name}' is more than one line")
    require(bool(re.fullmatch(r"[a-z][a-z0-9_]*", effect.id)), "its id is not in lower case with underscores")
    require(effect.level in ("cylinder", "joint", "measurement"), f"there is no level '{effect.level}'")
    require(
        effect.variable.removeprefix("other.")
        in (NEIGHBOUR if effect.variable.startswith("other.") else OWN | NEIGHBOUR),
        f"there is no variable '{effect.variable}' to draw it against: see fitting/effects/variables.py",
    )
    parameters = getattr(effect, "parameters", None)
    require(
        isinstance(parameters, tuple) and all(isinstance(p, Parameter) for p in parameters),
        "its 'parameters' are missing, or are no tuple of fitting.effects.Parameter",
    )
    names = [p.name for p in effect.parameters]
    require(bool(names) and len(set(names)) == len(names), "its parameters need names, each its own")
    for parameter in effect.parameters:
        require(bool(parameter.unit), f"parameter '{parameter.name}' has no unit; '1' where it has none")
        require(parameter.low < parameter.high, f"the interval of '{parameter.name}' is empty")
    require(effect.id not in effect.confounders, "it is named as its own confounder")


def _check_plausibility(effect: Effect) -> None:
    inside, stds = [], [1e-9] * len(effect.parameters)
    for p in effect.parameters:
        low, high = max(p.low, -1e3), min(p.high, 1e3)
        # A parameter without bounds may have to be there at all for the effect to be what it states.
        inside.append(0.5 * (low + high) if np.isfinite(p.low) or np.isfinite(p.high) else 1.0)
    _require(effect, effect.plausible(inside, stds), "the middles of its own intervals are not plausible")


def _joints(effect: Effect, machine: Machine) -> list[int]:
    if effect.machine_wide:
        return [0]
    return [j for j in range(len(machine.joints)) if effect.applies(machine, j)]


def _shapes(effect: Effect, view: DriveView) -> Iterator[Shape]:
    variants = ((),) if effect.machine_wide else effect.variants(view.machine, view.joint)
    for others in variants:
        _require(effect, all(k != view.joint for k in others), "a variant names the joint itself as the other one")
        for shape in effect.shapes(view):
            yield {**shape, **({"other": float(others[0])} if others else {})}


def _check_columns(effect: Effect, bench: _Bench, joint: int) -> None:
    require = partial(_require, effect)
    place = f"on {bench.machine.name}, {bench.machine.joints[joint].name}"
    unloaded, loaded = bench.views[0][joint], bench.views[1][joint]
    shapes = list(_shapes(effect, loaded))
    require(bool(shapes), f"{place} it has no shape; give one empty one")
    alive = False
    for shape in shapes:
        require(
            all(isinstance(k, str) and np.isfinite(float(v)) for k, v in shape.items()),
            f"{place} shape {dict(shape)} is not made of finite numbers",
        )
        before = _fingerprint(loaded)
        columns = _columns(effect, loaded, shape, place)
        require(_fingerprint(loaded) == before, f"{place} it changes the view that it looks at")
        require(np.array_equal(columns, effect.columns(loaded, shape)), f"{place} it is not deterministic")
        alive = alive or bool(np.any(columns))
        _columns(effect, _beyond(loaded), shape, f"{place}, in a recording that goes beyond what was fitted,")
        still = _columns(effect, unloaded, shape, place)
        if effect.level == "joint":
            require(not np.any(still), f"{place} a joint's effect must be zero in an unloaded recording")
        if effect.parity is Parity.ODD:
            # A lagged or averaged column is odd too: every speed of the recording is turned round.
            require(_like(effect.columns(_turned(loaded), shape), -columns), f"{place} it is not odd in v")
        elif effect.parity is Parity.EVEN:
            require(_like(effect.columns(_turned(loaded), shape), columns), f"{place} it is not even in v")
        elif effect.parity is Parity.NEITHER:
            other = effect.columns(_turned(loaded), shape)
            require(not _like(other, columns) and not _like(other, -columns), f"{place} it is even or odd in v")
        stronger = effect.columns(_stronger(loaded), shape)
        if not effect.uses_model:
            require(np.array_equal(stronger, columns), f"{place} uses_model is False, but it moves with the model")
        require(
            _proportional(stronger, columns),
            f"{place} its columns hold a force that is neither the model's nor the parameter's: "
            "with doubled model forces each has to be a multiple of what it was",
        )
    require(alive, f"{place} every shape is zero in a recording that moves all joints under load")


def _columns(effect: Effect, view: DriveView, shape: Shape, place: str) -> FloatArray:
    columns = effect.columns(view, shape)
    wide = effect.machine_wide or effect.spreads
    k = len(effect.parameters)
    wanted = (len(view), len(view.machine.joints), k) if wide else (len(view), k)
    _require(effect, np.shape(columns) == wanted, f"{place} columns have shape {np.shape(columns)}, not {wanted}")
    _require(effect, bool(np.all(np.isfinite(columns))), f"{place} columns of shape {dict(shape)} are not finite")
    return columns


def _check_gap(effect: Effect, bench: _Bench) -> bool:
    """Check gap columns, and return whether two position sensors of the bench see the effect."""
    seen = False
    for joint in range(len(bench.machine.joints)):
        if not has_both_positions(bench.machine, joint):
            continue
        view = bench.views[1][joint]
        view = replace(view, segment=replace(view.segment, effort=view.forces), cache={})
        for shape in effect.gap_shapes(view):
            columns = effect.gap_columns(view, shape)
            if columns is not None:
                seen = True
                wanted = (len(view), len(effect.parameters))
                _require(effect, columns.shape == wanted, f"gap columns have shape {columns.shape}, not {wanted}")
                _require(effect, bool(np.all(np.isfinite(columns))), "gap columns are not finite")
                _require(effect, bool(np.any(columns)), "gap columns are zero; give None where there is no gap")
    return seen


def _proportional(first: FloatArray, second: FloatArray) -> bool:
    """Return whether each column of the first (N, k) or (N, n, k) is one multiple of that of the second."""
    one, two = (own.reshape(-1, own.shape[-1]) for own in (first, second))
    return _like(one, two * (np.sum(one * two, axis=0) / np.maximum(np.sum(two * two, axis=0), 1e-300)))


def _like(first: FloatArray, second: FloatArray) -> bool:
    size = max(float(np.max(np.abs(second))), 1e-300)
    return bool(np.all(np.abs(first - second) <= 1e-6 * size))


def _beyond(view: DriveView) -> DriveView:
    """Return the view of a recording that goes three times as far, three times as fast, as the fitted ones."""
    ranges = tuple(
        replace(own, x=(own.middle - own.span / 6, own.middle + own.span / 6), v=own.v / 3, force=own.force / 3)
        for own in view.ranges
    )
    return replace(view, ranges=ranges, cache={}, shared={})


def _turned(view: DriveView) -> DriveView:
    """Return the view with all speeds reversed; positions, accelerations and forces as they are."""
    segment = replace(view.segment, v=-view.segment.v, qd=-view.segment.qd)
    return replace(view, segment=segment, cache={}, shared={})


def _stronger(view: DriveView) -> DriveView:
    """Return the view of a model with twice the forces."""
    return replace(
        view,
        forces=2 * view.forces,
        loads=2 * view.loads,
        ranges=tuple(replace(r, force=2 * r.force) for r in view.ranges),
        rod_pressures=lambda: 2 * view.rod_pressures(),
        base_values=2 * view.base_values,
        cache={},
        shared={},
    )


def _fingerprint(view: DriveView) -> bytes:
    arrays = [view.forces, view.loads, view.rod_pressures(), view.clock, view.base_values]
    arrays += [v for f in fields(view.segment) if isinstance(v := getattr(view.segment, f.name), np.ndarray)]
    return b"".join(np.ascontiguousarray(a).tobytes() for a in arrays)


# The benches: machine files in short, and motions that are sums of sines, so that derivatives are exact.
_LINKAGES: dict[str, dict[str, Any]] = {
    "three_pin": {"type": "three_pin", "a": 0.45, "b": 0.16, "offset": 1.7, "retracted": 0.37},
    "rack": {"type": "rack", "radius": 0.1, "zero": -1.5},
    "polynomial": {"type": "polynomial", "coefficients": [0.15, 0.14, 0.02, -0.01]},
    "direct": {"type": "direct"},
}
#: name, then per joint: type, linkage or None, twist, sensors
_ARMS: tuple[tuple[str, tuple[tuple[str, str | None, float, tuple[str, ...]], ...]], ...] = (
    (
        "planar",
        (
            ("revolute", "three_pin", 0.0, ("joint_position", "piston_position", "head_pressure", "rod_pressure")),
            ("revolute", "polynomial", 0.0, ("joint_position", "piston_position", "head_pressure", "rod_pressure")),
        ),
    ),
    (
        "slewing",
        (
            ("revolute", "rack", np.pi / 2, ("joint_position", "head_pressure", "rod_pressure")),
            ("revolute", "three_pin", 0.0, ("joint_position", "cylinder_force")),
            ("prismatic", "direct", 0.0, ("piston_position", "head_pressure", "rod_pressure")),
        ),
    ),
    (
        "direct-drives",
        (
            ("revolute", None, np.pi / 2, ("joint_position", "joint_effort")),
            ("prismatic", None, np.pi / 2, ("joint_position", "joint_effort")),
            ("revolute", None, 0.0, ("joint_position", "joint_effort")),
        ),
    ),
)


@lru_cache(maxsize=1)
def _benches() -> tuple[_Bench, ...]:
    return tuple(_bench(name, joints) for name, joints in _ARMS)


def _bench(name: str, joints: tuple[tuple[str, str | None, float, tuple[str, ...]], ...]) -> _Bench:
    machine = _machine(name, joints)
    n = len(joints)
    base = reduce_parameters(machine)
    # Loads of both signs, friction of a like size: every branch of an effect is entered.
    rng = np.random.default_rng(3)
    values, friction = rng.normal(size=len(base)) * 20.0, rng.normal(size=(2, n)) * 20.0
    segments = [_segment(machine, loaded, number) for number, loaded in enumerate((False, True))]
    loads = [own.loaded * (base_regressor(machine, base, own.q, own.qd, own.qdd) @ values) / own.r for own in segments]
    forces = [load + friction[0] * own.x + friction[1] * own.v for own, load in zip(segments, loads, strict=True)]
    ranges = tuple(
        Ranges(
            x=(min(own.x[:, j].min() for own in segments), max(own.x[:, j].max() for own in segments)),
            v=max(np.abs(own.v[:, j]).max() for own in segments),
            force=max(np.abs(own[:, j]).max() for own in forces),
            time=(0.0, float(segments[0].t[-1])),
        )
        for j in range(n)
    )

    def views_of(own: Segment, force: FloatArray, load: FloatArray) -> tuple[DriveView, ...]:
        shared: dict[str, FloatArray] = {}
        return tuple(
            DriveView(
                machine=machine,
                joint=joint,
                segment=own,
                bank=filter_bank(_RATE, 3.0),
                noise=(PositionNoise(1e-5, 1e-4, 1e-3),) * n,
                forces=force,
                loads=load,
                rod_pressures=lambda: own.p2,
                ranges=ranges,
                clock=own.t,
                base=base,
                base_values=values,
                loaded_recordings=(1,),
                shared=shared,
            )
            for joint in range(n)
        )

    return _Bench(machine, tuple(map(views_of, segments, forces, loads)))


def _machine(name: str, joints: tuple[tuple[str, str | None, float, tuple[str, ...]], ...]) -> Machine:
    units = {"head_pressure": "Pa", "rod_pressure": "Pa", "piston_position": "m", "cylinder_force": "N"}
    table: list[dict[str, Any]] = []
    channels: list[dict[str, str]] = []
    for number, (kind, linkage, alpha, sensors) in enumerate(joints, start=1):
        revolute = kind == "revolute"
        joint: dict[str, Any] = {
            "name": f"joint{number}",
            "type": kind,
            "dh": {"a": 0.7, "alpha": alpha, "d": 0.1, "theta": 0.2},
            "limits": {"position": [-0.6, 0.6] if revolute else [0.05, 0.35], "velocity": 1.0, "acceleration": 4.0},
        }
        if linkage is not None:
            joint["cylinder"] = {"bore": 0.08, "rod": 0.045, "stroke": 0.4, "linkage": _LINKAGES[linkage]}
        table.append(joint)
        own = {"joint_position": "rad" if revolute else "m", "joint_effort": "N m" if revolute else "N"}
        channels += [
            {"name": f"joint{number}.{s}", "quantity": s, "joint": f"joint{number}", "unit": {**units, **own}[s]}
            for s in sensors
        ]
    content = {"schema": "hilfit/machine/1", "name": name, "gravity": [0.0, -6.0, -7.0], "rate_hz": _RATE}
    return parse_machine(yaml.safe_dump({**content, "joints": table, "channels": channels}))


def _segment(machine: Machine, loaded: bool, number: int) -> Segment:
    n = len(machine.joints)
    rng = np.random.default_rng([5, number])
    t = np.arange(round(_SECONDS * _RATE)) / _RATE
    w = 2 * np.pi * rng.uniform(0.08, 0.4, (n, 3))
    angle = t[:, None, None] * w + rng.uniform(0, 2 * np.pi, (n, 3))
    parts = (np.sin(angle), w * np.cos(angle), -(w**2) * np.sin(angle))
    wave = [0.3 * part.sum(axis=2) for part in parts]
    middle = np.array([0.5 * sum(j.limits.position) for j in machine.joints])
    half = np.array([0.5 * (j.limits.position[1] - j.limits.position[0]) for j in machine.joints])
    q, qd, qdd = (half * part for part in wave)
    q += middle
    found = motion_segment(machine, t, (q, qd, qdd), recording=number, role="train" if loaded else "unloaded")
    p1, p2 = found.p1.copy(), found.p2.copy()
    for j, joint in enumerate(machine.joints):
        if joint.cylinder is not None and machine.channel("rod_pressure", joint.name) is not None:
            p2[:, j] = 8e5 + 1e6 * found.v[:, j]
            p1[:, j] = 1.5 * p2[:, j]
    found = replace(found, p1=p1, p2=p2, gap=np.zeros_like(q), loaded=loaded)
    if loaded:
        return found
    return replace(found, q=np.tile(middle, (len(t), 1)), qd=np.zeros_like(q), qdd=np.zeros_like(q))
