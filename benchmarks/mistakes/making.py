"""Mistakes that people make with machine files, wiring and recordings, one function each.

A mistake takes a sound rig and gives what a person would have on disk: a machine file, columns, and what they should be
called. ``None`` where it cannot be made on that rig (no such channel), or where nobody could see it.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from benchmarks.mistakes.rigs import Rig, make_rig
from daq.errors import MachineFileError
from daq.machine.machine_file import Machine, machine_to_yaml, parse_machine
from fitting.arrays import FloatArray

Rng = np.random.Generator


@dataclass(frozen=True)
class Made:
    """Files on disk, and what they should be called.

    Attributes
    ----------
    rig : columns
    machine : the machine file that is given
    codes : any of these names it rightly
    words : so does one of these in the line that is printed (with what explains the data as well)
    joints : one of these has to be named too; empty: any
    roles : role that a stem is given in, where it is another than its own
    """

    rig: Rig
    machine: Machine
    codes: frozenset[str]
    joints: frozenset[str]
    words: tuple[str, ...]
    roles: Mapping[str, str]


#: Share of the arm's largest effort (per head area) below which a wrong size of a cylinder or of its pins changes less
#: than a wrist's cables and noise do.
CARRIES = 0.05
#: How a mistake is made.
Make = Callable[[Rig, Rng], Made | None]
#: By name; what is drawn for a mistake depends on its place, so that later ones are at the end.
MISTAKES: dict[str, Make] = {}
PRESSURES = ("head_pressure", "rod_pressure")


def _mistake(name: str) -> Callable[[Make], Make]:
    def add(make: Make) -> Make:
        MISTAKES[name] = make
        return make

    return add


def _made(
    rig: Rig, codes: str, *joints: str, machine: Machine | None = None, roles: Mapping[str, str] | None = None,
    words: tuple[str, ...] = (),
) -> Made:  # fmt: skip
    return Made(rig, machine or rig.machine, frozenset(codes.split()), frozenset(joints), words, roles or {})


def _joint(rig: Rig, rng: Rng) -> str:
    return rig.names[int(rng.integers(len(rig.names)))]


def _heavy_joint(rig: Rig, rng: Rng, *, last: bool = True) -> str:
    """Choose a joint that carries enough to show its sizes in the efforts: :data:`CARRIES` of the largest."""
    sizes = {}
    for joint in rig.machine.joints if last else rig.machine.joints[:-1]:
        assert joint.cylinder is not None
        head, rod = _chambers(rig, joint.name)
        table = rig.tables["train-1"]
        ratio = joint.cylinder.rod_area / joint.cylinder.head_area
        sizes[joint.name] = float(np.std(np.asarray(table[head]) - ratio * np.asarray(table[rod])))
    most = max(sizes.values())
    enough = [name for name, size in sizes.items() if size >= CARRIES * most]
    return enough[int(rng.integers(len(enough)))]


def _channel(rig: Rig, quantity: str, joint: str) -> str | None:
    found = rig.machine.channel(quantity, joint)
    return None if found is None else found.name


def _chambers(rig: Rig, joint: str) -> tuple[str, str]:
    """Return the channels of a joint's head and rod pressure."""
    head, rod = (_channel(rig, quantity, joint) for quantity in PRESSURES)
    assert head is not None and rod is not None
    return head, rod


#: How a sensor is chosen of a joint; None where the rig has none of them.
Pick = Callable[[Rig, str, Rng], str | None]


def _position(rig: Rig, joint: str, rng: Rng) -> str:
    options = [n for q in ("joint_position", "piston_position") if (n := _channel(rig, q, joint))]
    return options[int(rng.integers(len(options)))]


def _any(rig: Rig, joint: str, rng: Rng) -> str:
    options = [c.name for c in rig.machine.channels if c.joint == joint]
    return options[int(rng.integers(len(options)))]


def _chamber(rig: Rig, joint: str, rng: Rng) -> str:
    return _chambers(rig, joint)[int(rng.integers(2))]


def _of(quantity: str) -> Pick:
    return lambda rig, joint, rng: _channel(rig, quantity, joint)


def _changed(rig: Rig, channel: str, of: Callable[[FloatArray], FloatArray], stems: tuple[str, ...] = ()) -> Rig:
    """Change one column in all (or some) recordings."""
    for stem in stems or tuple(rig.tables):
        rig = rig.with_column(stem, channel, of(np.asarray(rig.tables[stem][channel])))
    return rig


def _all(
    rig: Rig, quantities: tuple[str, ...], of: Callable[[FloatArray], FloatArray], stems: tuple[str, ...] = ()
) -> Rig:
    for channel in rig.machine.channels:
        if channel.quantity in quantities:
            rig = _changed(rig, channel.name, of, stems)
    return rig


def _edited_machine(machine: Machine, change: Callable[[dict[str, Any]], None]) -> Machine | None:
    """Edit the machine file, if it can be read at all (else the reader names it, and that is another check)."""
    import yaml

    content = yaml.safe_load(machine_to_yaml(machine))
    change(content)
    try:
        return parse_machine(yaml.safe_dump(content, sort_keys=False))
    except MachineFileError:
        return None


def _edited(
    rig: Rig, codes: str, *joints: str, change: Callable[[dict[str, Any]], None], words: tuple[str, ...] = ()
) -> Made | None:
    """Edit the rig's machine file; None where that cannot be read."""
    machine = _edited_machine(rig.machine, change)
    return None if machine is None else _made(rig, codes, *joints, machine=machine, words=words)


def _spoilt(
    name: str, pick: Pick, codes: str, of: Callable[[Rig, str, str, FloatArray, Rng], FloatArray],
    stems: tuple[str, ...] = (),
) -> None:  # fmt: skip
    """Spoil one sensor of one joint by ``of`` its values (rig, joint, channel, a copy of the values, chance)."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        joint = _joint(rig, rng)
        channel = pick(rig, joint, rng)
        if channel is None:
            return None
        return _made(_changed(rig, channel, lambda v: of(rig, joint, channel, v.copy(), rng), stems), codes, joint)

    MISTAKES[name] = make


def _all_scaled(quantities: tuple[str, ...], of: Callable[[FloatArray], FloatArray]) -> Make:
    def make(rig: Rig, rng: Rng) -> Made | None:
        there = _channel(rig, quantities[0], rig.names[0]) is not None
        return _made(_all(rig, quantities, of), "unit", *rig.names) if there else None

    return make


def _times(gain: float) -> Callable[[FloatArray], FloatArray]:
    return lambda values: values * gain


for _unit, _gain in (("bar", 1e-5), ("kPa", 1e-3), ("psi", 1 / 6894.757), ("MPa", 1e-6)):
    _mistake(f"all pressures in {_unit}")(_all_scaled(PRESSURES, _times(_gain)))


def _one_scaled(quantity: str, gain: float, codes: str = "unit", *, heavy: bool = False, alone: bool = True) -> Make:
    def make(rig: Rig, rng: Rng) -> Made | None:
        if rig.kind == "one" and not alone:
            return None  # its masses and its friction take up nearly all of it
        joint = _heavy_joint(rig, rng) if heavy else _joint(rig, rng)
        channel = _channel(rig, quantity, joint)
        return None if channel is None else _made(_changed(rig, channel, lambda v: v * gain), codes, joint)

    return make


for _unit, _gain in (("bar", 1e-5), ("psi", 1 / 6894.757), ("kPa", 1e-3)):
    _mistake(f"one head pressure in {_unit}")(_one_scaled("head_pressure", _gain))
_mistake("one rod pressure in bar")(_one_scaled("rod_pressure", 1e-5))
_mistake("one angle in degrees")(_one_scaled("joint_position", 180 / np.pi))
_mistake("one piston in mm")(_one_scaled("piston_position", 1e3))


@_mistake("one angle declared in degrees")
def _(rig: Rig, rng: Rng) -> Made | None:
    joint = _joint(rig, rng)
    channel = _channel(rig, "joint_position", joint)
    if channel is None:
        return None

    def change(content: dict[str, Any]) -> None:
        next(c for c in content["channels"] if c["name"] == channel)["unit"] = "deg"

    return _edited(rig, "unit", joint, change=change)


def _stroke(rig: Rig, joint: str) -> float:
    cylinder = rig.machine.joint(joint).cylinder
    assert cylinder is not None
    return cylinder.stroke


_mistake("all angles in degrees")(_all_scaled(("joint_position",), np.rad2deg))
_mistake("all pistons in mm")(_all_scaled(("piston_position",), _times(1e3)))
_spoilt("sign of an angle", _of("joint_position"), "sign", lambda rig, joint, channel, v, rng: -v)
_spoilt("piston counted from the other end", _of("piston_position"), "sign",
        lambda rig, joint, channel, v, rng: _stroke(rig, joint) - v)  # fmt: skip


def _chambers_swapped(codes: str, *stems: str, every: bool = False) -> Make:
    """Swap the chambers of one joint, or of ``every``; in some recordings no joint has to be named."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        joints = rig.names if every else [_joint(rig, rng)]
        for joint in joints:
            rig = _swapped(rig, *_chambers(rig, joint), *stems)
        return _made(rig, codes, *(() if stems else joints))

    return make


def _swapped(rig: Rig, a: str, b: str, *stems: str) -> Rig:
    """Exchange two channels in some recordings, or in all."""
    for stem in stems or tuple(rig.tables):
        table = rig.tables[stem]
        rig = rig.with_column(stem, a, table[b]).with_column(stem, b, table[a])
    return rig


_mistake("chambers swapped")(_chambers_swapped("swapped_chambers"))
_mistake("all chambers swapped")(_chambers_swapped("swapped_chambers", every=True))


def _two(rig: Rig, rng: Rng) -> tuple[str, str] | None:
    if len(rig.names) < 2:
        return None
    first, second = rng.choice(len(rig.names), 2, replace=False)
    return rig.names[int(first)], rig.names[int(second)]


@_mistake("positions of two joints exchanged")
def _(rig: Rig, rng: Rng) -> Made | None:
    pair = _two(rig, rng)
    for quantity in ("joint_position", "piston_position") if pair else ():
        first, second = (_channel(rig, quantity, joint) for joint in pair or ())
        if first is not None and second is not None:
            return _made(_swapped(rig, first, second), "exchanged_channels", *(pair or ()))
    return None


@_mistake("pressures of two joints exchanged")
def _(rig: Rig, rng: Rng) -> Made | None:
    pair = _two(rig, rng)
    if pair is None:
        return None
    for first, second in zip(*(_chambers(rig, joint) for joint in pair), strict=True):
        rig = _swapped(rig, first, second)
    return _made(rig, "exchanged_channels", *pair)


def _chamber_exchanged(codes: str, *stems: str, crossed: bool = False) -> Make:
    """Exchange a chamber of a joint with another joint's same one, or other one where ``crossed``."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        pair = _two(rig, rng)
        if pair is None:
            return None
        chamber = int(rng.integers(2))
        first, second = _chambers(rig, pair[0])[chamber], _chambers(rig, pair[1])[chamber ^ crossed]
        return _made(_swapped(rig, first, second, *stems), codes, *pair)

    return make


_mistake("one chamber of two joints exchanged")(_chamber_exchanged("exchanged_channels"))


@_mistake("a channel recorded twice")
def _(rig: Rig, rng: Rng) -> Made | None:
    joint = _joint(rig, rng)
    head, rod = _chambers(rig, joint)
    tables = {stem: {**table, rod: table[head]} for stem, table in rig.tables.items()}
    return _made(replace(rig, tables=tables), "same_channel", joint)


def _edit_joint(
    key: str, of: Callable[[float], float], code: str, linkage: bool = False, *, last: bool = True,
    words: tuple[str, ...] = (),
) -> Make:  # fmt: skip
    def make(rig: Rig, rng: Rng) -> Made | None:
        if linkage and rig.kind == "one":
            return None  # one joint with one sensor: its masses take up any lever arm
        # A last link that is mirrored moves like one whose masses are.
        joint = _heavy_joint(rig, rng, last=last or len(rig.names) == 1)
        number = rig.names.index(joint)

        def change(content: dict[str, Any]) -> None:
            cylinder = content["joints"][number]["cylinder"]
            place = cylinder["linkage"] if linkage else cylinder
            place[key] = of(float(place[key]))

        return _edited(
            rig, code, joint, change=change, words=(f"{joint}: linkage.{key} ", *words) if linkage else words
        )

    return make


_mistake("wrong bore")(_edit_joint("bore", lambda v: 1.6 * v, "bore rod cylinder_areas"))
_mistake("wrong rod")(_edit_joint("rod", lambda v: 1.5 * v, "rod bore cylinder_areas"))
_mistake("bore with a decimal slip")(_edit_joint("bore", lambda v: 10 * v, "bore rod cylinder_areas"))
_mistake("wrong pin offset")(_edit_joint("offset", lambda v: v - 0.5, "linkage effort_scale", True))
_mistake("wrong pin distance")(_edit_joint("b", lambda v: 1.35 * v, "linkage effort_scale", True))


def _edit_dh(key: str, of: Callable[[float], float], codes: str, leave: int = 2, named: bool = False) -> Make:
    """Edit a number of a link: not of the last ones, which carry too little; ``named``: its joint has to be."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        inner = [k for k, joint in enumerate(rig.machine.joints[:-leave]) if abs(getattr(joint.dh, key)) > 0.3]
        if not inner:
            return None
        number = inner[int(rng.integers(len(inner)))]

        def change(content: dict[str, Any]) -> None:
            content["joints"][number]["dh"][key] = of(float(content["joints"][number]["dh"][key]))

        name = rig.names[number]
        words = () if named else (f"{name}: dh.{key} ",)
        return _edited(rig, codes, *((name,) if named else ()), change=change, words=words)

    return make


def _gravity(of: Callable[[Sequence[float]], list[float]], alone: bool = False) -> Make:
    """Change gravity; of one link only if ``alone``: hanging, it equals one with its mass opposite."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        if rig.kind == "one" and not alone:
            return None
        return _edited(rig, "gravity", change=lambda c: c.update(gravity=of(rig.machine.gravity)))

    return make


# The length of the last link, or of the only one, enters nothing.
_mistake("link with a decimal slip")(_edit_dh("a", lambda v: 10 * v, "length", 1, True))
_mistake("base upside down")(_gravity(lambda g: [-v for v in g]))
_mistake("gravity along another axis")(_gravity(lambda g: [g[1], g[2], g[0]]))


@_mistake("pressures 0.6 s late")
def _(rig: Rig, rng: Rng) -> Made | None:
    if rig.kind == "one":
        return None  # at one joint a delay is a friction that grows with speed
    late = 30
    tables = {}
    for stem, table in rig.tables.items():
        pressures = {c.name for c in rig.machine.channels if c.quantity in PRESSURES}
        tables[stem] = {name: v[: len(v) - late] if name in pressures else v[late:] for name, v in table.items()}
    return _made(replace(rig, tables=tables), "clock_offset late_channels")


@_mistake("clock of the pressures 1 % fast")
def _(rig: Rig, rng: Rng) -> Made | None:
    if rig.kind == "one":
        return None

    def stretch(values: FloatArray) -> FloatArray:
        rows = np.arange(len(values))
        return np.asarray(np.interp(0.99 * rows, rows, values))

    return _made(_all(rig, PRESSURES, stretch), "clock_rate clock_offset")


def _clocked(of: Callable[[FloatArray], FloatArray], code: str) -> Make:
    return lambda rig, rng: _made(_changed(rig, "time", of), code)


_mistake("time in ms")(_clocked(_times(1e3), "time_unit"))
_mistake("time at another rate")(_clocked(_times(0.5), "wrong_rate"))
_mistake("a jump of the clock")(_clocked(lambda t: t + 30.0 * (t > 15.0), "time_jump"))


@_mistake("rows lost")
def _(rig: Rig, rng: Rng) -> Made | None:
    kept = {}
    for stem, table in rig.tables.items():
        rows = np.ones(len(table["time"]), dtype=bool)
        for start in rng.integers(100, len(rows) - 100, 20):
            rows[start : start + 12] = False
        kept[stem] = {name: np.asarray(column)[rows] for name, column in table.items()}
    return _made(replace(rig, tables=kept), "lost_rows")


@_mistake("pressure clipped inside its range")
def _(rig: Rig, rng: Rng) -> Made | None:
    joint = _joint(rig, rng)
    channel = _chambers(rig, joint)[0]
    level = float(np.percentile(np.concatenate([table[channel] for table in rig.tables.values()]), 85))
    return _made(_changed(rig, channel, lambda v: np.minimum(v, level)), "clipped saturated", joint)


def _freeze(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    values[600:900] = values[600]
    return values


def _repeat(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    return values[(np.arange(len(values)) // 10) * 10]


def _wrap(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    turn = 2 * np.pi if channel.endswith("angle") else 0.131072
    return np.where(values > float(np.median(values)), values - turn, values)


def _outliers(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    span, places = np.ptp(values), rng.choice(len(values), 12, replace=False)
    values[places] += rng.choice([-1, 1], 12) * 0.5 * span
    return values


def _step(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    return values + np.where(np.arange(len(values)) > 1100, 0.3 * np.ptp(values), 0.0)


def _drop(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    for start in rng.integers(100, len(values) - 100, 6):
        values[start : start + int(rng.integers(5, 40))] = 0.0
    return values


def _rounded(rig: Rig, joint: str, channel: str, values: FloatArray, rng: Rng) -> FloatArray:
    step = np.deg2rad(1.0) if channel.endswith("angle") else 0.01
    return np.asarray(step * np.round(values / step))


_spoilt("a sensor freezes", _any, "frozen", _freeze, ("train-1",))
_spoilt("a sensor repeats its values", _chamber, "held", _repeat)
_spoilt("an encoder wraps", _position, "wrap", _wrap)
_spoilt("outliers", _any, "outliers", _outliers)
_spoilt("a step in a sensor's zero", _position, "jump", _step, ("train-1",))


def _given_as(stem: str, role: str) -> Make:
    return lambda rig, rng: _made(rig, "wrong_role", roles={stem: role}) if stem in rig.tables else None


def _in_place_of(stem: str, other: str, code: str) -> Make:
    """Put the recording ``stem`` in the place of another one."""

    def make(rig: Rig, rng: Rng) -> Made | None:
        tables = {name: table for name, table in rig.tables.items() if name not in (stem, other)}
        return _made(replace(rig, tables={**tables, other: rig.tables[stem]}), code)

    return make


_mistake("unloaded given as train")(_given_as("unloaded", "train"))
_mistake("train given as unloaded")(_given_as("train-2", "unloaded"))
_mistake("repeat of another motion")(_in_place_of("train-2", "repeat", "no_repeat"))
_mistake("validated on the training motion")(_in_place_of("repeat", "validate", "same_motion"))


@_mistake("a recording of another machine")
def _(rig: Rig, rng: Rng) -> Made | None:
    own, other = rig.tables["train-2"], make_rig(rig.kind, int(rng.integers(10_000, 2**30))).tables["train-2"]
    columns = {name: column for name, column in other.items() if name in own}
    if set(columns) != set(own):
        return None
    return _made(replace(rig, tables={**rig.tables, "train-2": columns}), "other_machine")


_mistake("range of a transducer")(
    _one_scaled("head_pressure", 1.6, "unit cylinder_areas effort_scale bore rod", heavy=True)
)
_mistake("angle counted twice")(_one_scaled("joint_position", 2.0, "scale unit out_of_range", heavy=True, alone=False))
_mistake("bore in place of its radius")(_edit_joint("bore", lambda v: 2 * v, "bore cylinder_areas effort_scale"))
_mistake("rod with a decimal slip")(_edit_joint("rod", lambda v: v / 10, "rod bore cylinder_areas"))
_mistake("sign of a pin offset")(
    _edit_joint("offset", lambda v: -v, "linkage effort_scale", True, last=False, words=("linkage offset", "offset"))
)
_mistake("sign of a twist")(_edit_dh("alpha", lambda v: -v, "axis gravity sign"))
_mistake("twist in degrees")(_edit_dh("alpha", lambda v: float(np.rad2deg(v)), "axis unit dh_angle"))
_mistake("length in mm")(_edit_dh("a", lambda v: 1e3 * v, "length"))
_mistake("gravity in g")(_gravity(lambda g: [v / 9.81 for v in g], alone=True))


@_mistake("all pressures in bar in one recording")
def _(rig: Rig, rng: Rng) -> Made | None:
    return _made(_all(rig, PRESSURES, _times(1e-5), ("validate",)), "unit other_machine", *rig.names)


_mistake("chambers swapped in one recording")(_chambers_swapped("swapped_chambers other_machine", "train-2"))
_spoilt("a loose cable", _any, "dropouts outliers jump", _drop)
_spoilt("rounded to whole units", _position, "coarse held", _rounded)


@_mistake("zero of a piston a third of its stroke off")
def _(rig: Rig, rng: Rng) -> Made | None:
    if rig.kind == "one":
        return None
    joint = _joint(rig, rng)
    channel = _channel(rig, "piston_position", joint)
    if channel is None:
        return None
    off = _changed(rig, channel, lambda v: v + _stroke(rig, joint) / 3)
    return _made(off, "offset linkage out_of_range positions_disagree", joint)


@_mistake("two recordings in one file")
def _(rig: Rig, rng: Rng) -> Made | None:
    tables = dict(rig.tables)
    second = tables.pop("train-2")
    tables["train-1"] = {name: np.concatenate([column, second[name]]) for name, column in tables["train-1"].items()}
    return _made(replace(rig, tables=tables), "time_jump")


@_mistake("rows in the wrong order")
def _(rig: Rig, rng: Rng) -> Made | None:
    order = np.arange(len(rig.tables["train-1"]["time"]))
    order[500:520] = order[500:520][::-1]
    table = {k: np.asarray(v)[order] for k, v in rig.tables["train-1"].items()}
    return _made(replace(rig, tables={**rig.tables, "train-1": table}), "time_jump")


# What the last three links are long bends little but their own wrists' efforts.
_mistake("link a tenth as long")(_edit_dh("a", lambda v: v / 10, "length", 3, True))


def _slow(rig: Rig, factor: float) -> Rig:
    """Declare rows ``factor`` times further apart than they are, in file and machine file."""
    machine = rig.machine.model_copy(update={"rate_hz": rig.machine.rate_hz / factor})
    tables = {stem: {**table, "time": factor * np.asarray(table["time"])} for stem, table in rig.tables.items()}
    return replace(rig, machine=machine, tables=tables)


@_mistake("rows twenty times closer in time")
def _(rig: Rig, rng: Rng) -> Made | None:
    return _made(_slow(rig, 20.0), "wrong_rate")


@_mistake("the same with recorded speeds")
def _(rig: Rig, rng: Rng) -> Made | None:
    if _channel(rig, "joint_position", rig.names[0]) is None:
        return None
    content = [{"name": f"{n}.speed", "quantity": "joint_velocity", "joint": n, "unit": "rad/s"} for n in rig.names]
    machine = _edited_machine(rig.machine, lambda c: c["channels"].extend(content))
    assert machine is not None
    tables = {}
    for stem, table in rig.tables.items():
        angles = {n: np.asarray(table[_channel(rig, "joint_position", n) or ""]) for n in rig.names}
        speeds = {f"{n}.speed": np.gradient(q, np.asarray(table["time"])) for n, q in angles.items()}
        tables[stem] = {**table, **speeds}
    return _made(_slow(replace(rig, machine=machine, tables=tables), 20.0), "wrong_rate")


@_mistake("a noisy position sensor")
def _(rig: Rig, rng: Rng) -> Made | None:
    joint = _joint(rig, rng)
    channel, own = _position(rig, joint, rng), rig.machine.joint(joint)
    reach = own.cylinder.stroke if own.cylinder and not channel.endswith("angle") else np.ptp(own.limits.position)
    some = ("train-1",) if rng.random() < 0.5 or rig.kind == "one" else ()
    noisy = _changed(rig, channel, lambda v: v + 2e-3 * float(reach) * rng.standard_normal(len(v)), some)
    return _made(noisy, "noisy", joint)


_mistake("link with the wrong sign")(_edit_dh("a", lambda v: -v, "length", 3, True))

_mistake("one pressure of two joints exchanged in one recording")(
    _chamber_exchanged("exchanged_channels other_machine", "train-2")
)
_mistake("a head and a rod pressure of two joints exchanged")(_chamber_exchanged("exchanged_channels", crossed=True))


@_mistake("both pressures of a joint in bar")
def _(rig: Rig, rng: Rng) -> Made | None:
    joint = _joint(rig, rng)
    for channel in _chambers(rig, joint):
        rig = _changed(rig, channel, _times(1e-5))
    return _made(rig, "unit", joint)


_mistake("one angle in counts of an encoder")(
    _one_scaled("joint_position", 4096 / (2 * np.pi), "unit scale out_of_range")
)
