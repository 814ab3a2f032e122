"""The inverse of a valve's model for a controller: C99, Python, Structured Text, functional mock-up units, and a table.

The formula (:func:`fitting.valve.inverse.inverse_graph`) is printed by the dialects of the model's own export. Each
file has beside it what a graph cannot express: numbers that are none give the neutral command, missing pressures the
reference, and whether the axis moved decides where it starts. The text of every file states what else a controller owes
the machine.
"""

from __future__ import annotations

import csv
import io
import re
from collections.abc import Callable, Iterable
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from fitting.model.export.formats.c import dialect_of as c_words
from fitting.model.export.formats.fmu import Unit, Variable, write_units
from fitting.model.export.formats.st import dialect_of as st_words
from fitting.model.export.functions import rendered, written
from fitting.model.export.printing import PYTHON, Dialect, statements
from fitting.model.export.words import Written, require_folder
from fitting.valve.inverse import CLIPPED, GIVEN, NO_NUMBER, NO_PRESSURE, ValveModel, inverse_graph
from fitting.valve.laws import LAWS
from fitting.valve.model import WAYS

#: Rows of the self-test, largest difference that passes as share of full command, and points of a table.
_ROWS, TOLERANCE, _POINTS = 48, 1e-9, 21
SAFETY = (
    "hilfit writes no command; what calls this owes the machine: a rate limit and a limit of |command|, a dead-man",
    "switch, a watchdog (neutral when an input is older than 100 ms), and a first run at 25 % of the speed.",
    "It is no part of an emergency stop.",
)


def formats() -> dict[str, Callable[[ValveModel, Path], Written]]:
    """Return the writer of each format in a folder."""
    texts = {"c": _c, "csv": _csv, "python": _python, "st": _st}

    def writing(of: Callable[[ValveModel], dict[str, str]]) -> Callable[[ValveModel, Path], Written]:
        return lambda model, folder: written(folder, of(model), model.left_out)

    return {name: writing(of) for name, of in texts.items()} | {"fmu": _fmu}


def require_formats(names: Iterable[str]) -> None:
    """Refuse what is none of :func:`formats` (InputError)."""
    for name in set(names) - set(formats()):
        raise InputError("fitting.valve_no_format", name=name, names=sorted(formats()))


def export_valve(model: ValveModel, to: str, folder: Path) -> Written:
    """Write the inverse of a valve's model in one of :func:`formats`.

    Raises
    ------
    InputError
        If there is no such format, the folder is a file, or the model moves in no direction.
    """
    require_formats([to])
    require_folder(folder)
    if not model.moves:
        raise InputError("fitting.valve_never_seen_move", joint=model.joint)
    return formats()[to](model, folder)


def _model_card(model: ValveModel) -> list[str]:
    """Write the model's card in lines."""
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
    """Write statements and results of the formula in a language, and the curves used."""
    nodes = inverse_graph(model)
    del nodes["share"]
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
        "card": _model_card(model),
        "neutral": dialect.number(model.neutral),
        "no_number": NO_NUMBER,
    }


def self_test_rows(model: ValveModel, *, chained: bool = False) -> list[tuple[float, ...]]:
    """Make rows: speed, head, rod, supply, tank, moving before, and :meth:`ValveModel.command`'s command, flags.

    ``chained``: an axis moves before a row if it did in the row before, and at first it does not.
    """
    rng = np.random.default_rng(0)
    fastest = max(own.fastest for own in model.directions)
    rows, went = list[tuple[float, ...]](), False
    for number in range(_ROWS):
        speed = float(rng.uniform(-1.3, 1.3) * fastest * (0.02 if number % 4 == 0 else 1.0))
        head, rod, supply, tank = (float(rng.uniform(*own)) for own in ((0, 2e7), (0, 2e7), (1e7, 2.2e7), (0, 5e5)))
        head = np.nan if number % 12 == 5 else head
        speed = np.nan if number % 16 == 7 else speed
        moving = went if chained else bool(rng.integers(0, 2))
        found = model.command(speed, moving=moving, head=head, rod=rod, supply=supply, tank=tank)
        rows.append((speed, head, rod, supply, tank, float(moving), found.command, float(found.flags)))
        went = found.share != 0.0
    return rows


def _c(model: ValveModel) -> dict[str, str]:
    name = _name(model)
    words = _body(model, c_words(name, "double", ""), "        ") | {"upper": name.upper()}
    rows = [["NAN" if np.isnan(own) else repr(own) for own in row] for row in self_test_rows(model)]
    words |= {"rows": rows, "tolerance": TOLERANCE * model.full}
    return {f"{name}{end}": rendered(f"valve{end}.j2", **words) for end in (".h", ".c", "_selftest.c")}


#: Inputs and outputs of a unit.
_INPUTS = (
    ("speed", "m/s", "wanted speed of the rod, positive extends"),
    *((name, "Pa", f"{name} pressure; what is no number is not known") for name in GIVEN[1:5]),
)
_ROW = (*(name for name, _, _ in _INPUTS), "moving before", "command", "flags")


def _fmu(model: ValveModel, folder: Path) -> Written:
    """Build units of the C; whether the axis moved is kept between communication points, or accepted steps."""
    name, sources, held = _name(model), _c(model), io.StringIO()
    del sources[f"{name}_selftest.c"]
    csv.writer(held, lineterminator="\n").writerows([_ROW, *self_test_rows(model, chained=True)])
    variables = [Variable(own, unit, description, "input") for own, unit, description in _INPUTS]
    variables.append(Variable("command", model.unit, "command as it is sent", "output"))
    variables.append(Variable("flags", "1", "flags, bits", "output"))
    given = ", ".join(f"in[{place}]" for place in range(len(_INPUTS)))
    call = f"int moving = arm->memory[0] > 0.5, flags; out[0] = {name}_command({given}, &moving, &flags);"
    call += " out[1] = flags; arm->memory[0] = moving;"
    calls = {"init": f"arm->memory[0] = 0; {{ {call} }}", "step": f"{{ {call} }}"}
    words = {"calls": calls, "memory": 1, "moving": 0}
    kinds = ("ModelExchange", "CoSimulation")
    resources = {f"{name}_selftest.csv": held.getvalue()}
    unit = Unit(name, model.joint, repr(model.to_json()), kinds, tuple(variables), sources, words, None, resources)
    return write_units(folder, [unit], model.left_out, lambda lines: _model_card(replace(model, left_out=tuple(lines))))


def _python(model: ValveModel) -> dict[str, str]:
    return {f"{_name(model)}.py": rendered("valve.py.j2", **_body(model, PYTHON, "    "))}


def _st(model: ValveModel) -> dict[str, str]:
    name = _name(model)
    words = _body(model, st_words(name), "    ")
    local = [line.split(" :=")[0].strip() for line in words["lines"]]
    words["card"] = [line.replace("*)", "* )").replace("(*", "( *") for line in words["card"]]
    return {f"{name}.st": rendered("valve.st.j2", **words, local=local)}


def _csv(model: ValveModel) -> dict[str, str]:
    """Tabulate commands over speeds and over the drop of the direction's law, in rows."""
    text = io.StringIO()
    table = csv.writer(text, lineterminator="\n")
    for line in _model_card(model):
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
