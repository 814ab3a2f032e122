"""The inverse of a valve's model for a controller: C99, Python, Structured Text, and a table.

The formula is written once, as a graph (:mod:`fitting.model.export.tracing.graph`), and printed by the dialects of
the model's own export. Beside it each file has what a graph cannot say: numbers that are none give the neutral
command, missing pressures the reference, and whether the axis stood decides where it starts. The text of every file
says what else a controller owes the machine.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Mapping
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from fitting.model.export.formats.c import dialect_of as c_words
from fitting.model.export.formats.st import dialect_of as st_words
from fitting.model.export.functions import rendered, written
from fitting.model.export.printing import PYTHON, Dialect, statements
from fitting.model.export.tracing.graph import Curve, Graph, Node
from fitting.model.export.words import Written, require_folder
from fitting.valve.inverse import CLIPPED, LEAST_SHARE, NO_NUMBER, NO_PRESSURE, REST_SHARE, Direction, ValveModel
from fitting.valve.laws import LAWS
from fitting.valve.model import WAYS

#: What is given, in this order: m/s, Pa (of whatever is not known any number, with ``known`` 0), 1 and 0.
GIVEN = ("speed", "head", "rod", "supply", "tank", "known", "moving")
#: Rows of the self-test, largest difference that passes as share of full command, and points of a table.
_ROWS, TOLERANCE, _POINTS = 48, 1e-9, 21
SAFETY = (
    "hilfit writes no command; what calls this owes the machine: a rate limit and a limit of |command|, a dead-man",
    "switch, a watchdog (neutral when an input is older than 100 ms), and a first run at 25 % of the speed.",
    "It is no part of an emergency stop.",
)


def formats() -> dict[str, Callable[[ValveModel], dict[str, str]]]:
    """What writes each format: files by name."""
    return {"c": _c, "csv": _csv, "python": _python, "st": _st}


def export_valve(model: ValveModel, to: str, folder: Path) -> Written:
    """Write the inverse of a valve's model in one of :func:`formats`.

    Raises
    ------
    InputError
        If there is no such format, the folder is a file, or the model moves in no direction.
    """
    if to not in formats():
        raise InputError(f"--to {to}: there is no such format; use one of {', '.join(formats())}")
    require_folder(folder)
    if not model.moves:
        raise InputError(f"{model.joint}: its valve was never seen to move it; there is nothing to export")
    return written(folder, formats()[to](model), model.left_out)


def inverse_graph(model: ValveModel) -> dict[str, Node]:
    """Nodes ``command`` (as it is sent), ``flags`` and ``going`` (whether it moves) of variables :data:`GIVEN`."""
    graph = Graph()
    given = {name: graph.variable(name) for name in GIVEN}
    speed, moving = given["speed"], given["moving"]
    zero = graph.number(0.0)
    share, flags, going = zero, zero, zero
    for way, own in enumerate(model.directions):
        if own.fastest <= 0.0:
            continue
        sign = 1.0 if way == 0 else -1.0
        wanted = graph.binary("max", speed * sign, 0.0)
        low = REST_SHARE * own.fastest
        here = graph.binary("at_least", wanted, low * (3.0 - 2.0 * moving))
        factor, missing = _factor(graph, own, way, given)
        reduced = wanted / factor
        asked = own.edge + _opening(graph, own, reduced)
        beyond = graph.binary(
            "max",
            graph.binary("above", asked, own.largest),
            graph.binary("above", reduced, own.fastest * (1.0 + 1e-9)),
        )
        clipped = beyond * own.largest + (1.0 - beyond) * graph.binary("min", asked, own.largest)
        share = share + here * clipped * sign
        flags = flags + here * (CLIPPED * beyond + NO_PRESSURE * missing)
        going = going + here
    raw = model.neutral + model.extends * model.full * share
    command = graph.binary("min", graph.binary("max", raw, model.least), model.most)
    outside = graph.binary("above", graph.unary("abs", raw - command), 0.0)
    return {"command": command, "flags": graph.binary("max", flags, CLIPPED * outside), "going": going}


def _factor(graph: Graph, own: Direction, way: int, given: Mapping[str, Node]) -> tuple[Node, Node]:
    """What the pressures make of the gain, and 1 where the reference is taken for them."""
    needs = LAWS[own.law].needs
    if needs == "nothing":
        return graph.number(1.0), graph.number(0.0)
    filled, emptied = (given["head"], given["rod"]) if way == 0 else (given["rod"], given["head"])
    drop = given["supply"] - filled if needs == "supply" else emptied - given["tank"]
    reference = own.drop_in if needs == "supply" else own.drop_out
    believed = graph.binary("at_least", drop, LEAST_SHARE * reference) * given["known"]
    ratio = graph.binary("max", drop, LEAST_SHARE * reference) / reference
    if own.law == "free_exponent":
        factor = graph.binary("power", ratio, own.law_shape["exponent"])
    elif own.law == "compensated":
        order, whole = own.law_shape["order"], (reference / own.law_shape["margin"]) ** own.law_shape["order"]
        share = graph.binary("power", ratio, order) * whole
        factor = graph.binary("power", share / (1.0 + share) * ((1.0 + whole) / whole), 0.5 / order)
    else:
        factor = graph.unary("sqrt", ratio)
    return believed * factor + (1.0 - believed), 1.0 - believed


def _opening(graph: Graph, own: Direction, speed: Node) -> Node:
    """What has to be beyond the edge for a speed at the reference drops."""
    if not own.openings:
        line = speed / own.gain
        return line if own.power == 1.0 else graph.binary("power", graph.binary("max", line, 1e-12), 1.0 / own.power)
    speeds, openings = np.array(own.speeds), np.array(own.openings)
    rising = np.append(True, np.diff(speeds) > 0.0)  # a flat piece has no inverse; what is before it is enough
    speeds, openings = speeds[rising], openings[rising]
    slopes = np.diff(openings) / np.diff(speeds)
    nothing = np.zeros_like(slopes)
    return graph.curve(speed, Curve(speeds, np.column_stack([nothing, nothing, slopes, openings[:-1]])))


def said_of(model: ValveModel) -> list[str]:
    """The model's card in lines."""
    lines = [
        f"Command of the valve of {model.joint} for a speed of its rod, made {datetime.now(UTC):%Y-%m-%d} by hilfit.",
        f"speed in m/s, positive extends; pressures in Pa; command in {model.unit}, neutral {model.neutral:g}.",
        f"A reference that is known is taken {model.delay:.3g} s ahead: so late the axis answers.",
    ]
    for way, own in zip(WAYS, model.directions, strict=True):
        lines.append(
            f"{way}: edge {own.edge:.4g}, largest recorded command {own.largest:.4g} of full, {own.fastest:.4g} m/s "
            f"there; {LAWS[own.law].title}."
        )
    if model.error is not None:
        lines.append(f"Error of the speed on another motion: {model.error:.3g} of its RMS.")
    if model.pump_limit is not None:
        lines.append(f"The pump gives {model.pump_limit:.4g} m^3/s: scale all speeds by min(1, that / sum A |v|).")
    lines += [f"Not in this file: {own}." for own in model.left_out]
    lines += [
        f"Flags: {CLIPPED} clipped at what was recorded, {NO_NUMBER} an input was no number, {NO_PRESSURE} no "
        "pressure: the reference was taken.",
        *SAFETY,
    ]
    return lines


def _name(model: ValveModel) -> str:
    return "valve_" + re.sub(r"\W", "_", model.joint)


def _body(model: ValveModel, dialect: Dialect, indent: str) -> dict[str, Any]:
    """Statements and results of the formula in a language, and the curves that it uses."""
    nodes = inverse_graph(model)
    lines, words = statements(nodes, dialect, {name: name for name in GIVEN}, indent)
    curves = [
        {"number": number, "breaks": own.breaks.tolist(), "pieces": own.pieces.tolist()}
        for number, own in enumerate(nodes["command"].graph.curves)
    ]
    return {
        "lines": lines,
        "words": words,
        "curves": curves,
        "name": _name(model),
        "asks": list(model.asks),
        "given": ["head", "rod", "supply", "tank"],
        "said": said_of(model),
        "neutral": dialect.number(model.neutral),
        "no_number": NO_NUMBER,
    }


def self_test_rows(model: ValveModel) -> list[tuple[float, ...]]:
    """Speed, head, rod, supply, tank, moving before, and what :meth:`ValveModel.command` says: command and flags."""
    rng = np.random.default_rng(0)
    fastest = max(own.fastest for own in model.directions)
    rows = list[tuple[float, ...]]()
    for number in range(_ROWS):
        speed = float(rng.uniform(-1.3, 1.3) * fastest * (0.02 if number % 4 == 0 else 1.0))
        head, rod, supply, tank = (float(rng.uniform(*own)) for own in ((0, 2e7), (0, 2e7), (1e7, 2.2e7), (0, 5e5)))
        head = np.nan if number % 12 == 5 else head
        speed = np.nan if number % 16 == 7 else speed
        moving = bool(rng.integers(0, 2))
        found = model.command(speed, moving=moving, head=head, rod=rod, supply=supply, tank=tank)
        rows.append((speed, head, rod, supply, tank, float(moving), found.command, float(found.flags)))
    return rows


def _c(model: ValveModel) -> dict[str, str]:
    name = _name(model)
    words = _body(model, c_words(name, "double", ""), "        ") | {"upper": name.upper()}
    rows = [["NAN" if np.isnan(own) else repr(own) for own in row] for row in self_test_rows(model)]
    words |= {"rows": rows, "tolerance": TOLERANCE * model.full}
    return {f"{name}{end}": rendered(f"valve{own}.j2", **words) for end, own in _C_FILES.items()}


_C_FILES = {".h": ".h", ".c": ".c", "_selftest.c": "_selftest.c"}


def _python(model: ValveModel) -> dict[str, str]:
    return {f"{_name(model)}.py": rendered("valve.py.j2", **_body(model, PYTHON, "    "))}


def _st(model: ValveModel) -> dict[str, str]:
    name = _name(model)
    words = _body(model, st_words(name), "    ")
    local = [line.split(" :=")[0].strip() for line in words["lines"]]
    words["said"] = [line.replace("*)", "* )").replace("(*", "( *") for line in words["said"]]
    return {f"{name}.st": rendered("valve.st.j2", **words, local=local)}


def _csv(model: ValveModel) -> dict[str, str]:
    """Commands over speeds and over the drop that the direction's law asks for, in rows."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    for line in said_of(model):
        text.write(f"# {line}\n")
    table.writerow(["direction", "speed [m/s]", "pressure drop [Pa]", f"command [{model.unit}]", "flags"])
    for way, (name, own) in enumerate(zip(WAYS, model.directions, strict=True)):
        needs, sign = LAWS[own.law].needs, 1.0 if way == 0 else -1.0
        reference = own.drop_in if needs == "supply" else own.drop_out
        drops = [reference] if needs == "nothing" else (reference * np.linspace(0.2, 2.0, 10)).tolist()
        for drop in drops:
            for speed in np.linspace(0.0, own.fastest, _POINTS).tolist():
                side, supply = (drop, 2.0 * drop) if needs == "supply" else (drop, drop)
                found = model.command(sign * speed, head=side, rod=side, supply=supply)
                shown = "" if needs == "nothing" else repr(drop)
                table.writerow([name, repr(sign * speed), shown, repr(found.command), found.flags])
    return {f"{_name(model)}.csv": text.getvalue()}
