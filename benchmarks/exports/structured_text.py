"""An interpreter of Structured Text, written from the grammar of IEC 61131-3 (second edition, annex B).

It knows functions, function blocks, LREAL, INT, BOOL and arrays of them; assignments, IF, WHILE and EXIT; and it is
strict: every word is declared before it is used and none is a keyword (upper and lower case are one), types are never
mixed, inputs and constants are never written, indices stay in their arrays. Arithmetic is IEC 60559's.
"""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

_TOKEN = re.compile(
    r"\s+|\(\*(?:(?!\(\*).)*?\*\)|(?P<real>\d+\.\d+(?:[eE][+-]?\d+)?)|(?P<integer>\d+)(?!\.\d|\w)"
    r"|(?P<word>[A-Za-z_]\w*)|(?P<sign>:=|\.\.|<=|>=|<>|[-+*/<>=(),;:\[\]])",
    re.DOTALL,
)
_KEYWORDS = """
    and array at bool by case constant date dint do dt else elsif end_case end_for end_function end_function_block
    end_if end_repeat end_var end_while exit false for function function_block if int lreal mod not of or real repeat
    retain return step string struct then time time_of_day to tod true type until var var_external var_global
    var_in_out var_input var_output var_temp while word xor ld st le lt ge gt eq ne add sub mul div cal ret jmp
"""
#: Levels of binary signs, the weakest first.
_LEVELS = (("or",), ("xor",), ("and",), ("=", "<>"), ("<", ">", "<=", ">="), ("+", "-"), ("*", "/"))
_PYTHON = {"elsif": "elif", "xor": "!=", "=": "==", "<>": "!="}
_TYPES = {"lreal": 0.0, "int": 0, "bool": False}
_SECTIONS = ("var_input", "var_in_out", "var_output", "var")


def _exp(x: float) -> float:
    return math.exp(x) if not x > 709.7 else math.inf


def _div(a: float, b: float) -> float:
    if b != 0.0:
        return a / b
    return math.nan if a == 0.0 or a != a else math.copysign(math.inf, a) * math.copysign(1.0, b)


def _at(index: int, low: int, high: int) -> int:
    if not low <= index <= high:
        raise IndexError(f"{index} is not within {low}..{high}")
    return index - low


def _int(value: int) -> int:
    return _at(value, -32768, 32767) - 32768


#: Standard functions: types of arguments, of the result, and what they do.
_STANDARD: dict[str, tuple[tuple[str, ...], str, Callable[..., Any]]] = {
    **{name: (("lreal",), "lreal", own) for name, own in (("sin", math.sin), ("cos", math.cos), ("sqrt", math.sqrt))},
    "exp": (("lreal",), "lreal", _exp),
    "abs": (("lreal",), "lreal", abs),
    "max": (("lreal", "lreal"), "lreal", max),
    "min": (("lreal", "lreal"), "lreal", min),
    "expt": (("lreal", "lreal"), "lreal", lambda a, b: a**b),
    "sel": (("bool", "lreal", "lreal"), "lreal", lambda which, first, second: second if which else first),
}


@dataclass
class Block:
    """An instance of a function block: called with its inputs by name, it gives its outputs; variables stay."""

    run: Callable[[dict[str, Any]], None]
    kinds: dict[str, tuple[str, Any]]
    values: dict[str, Any] = field(default_factory=dict)

    def __call__(self, **given: Any) -> dict[str, Any]:
        """Run once; arrays that are taken as VAR_IN_OUT are the caller's own."""
        wanted = {name for name, (section, _) in self.kinds.items() if section in ("var_input", "var_in_out")}
        if set(given) != wanted:
            raise TypeError(f"wants {sorted(wanted)}, not {sorted(given)}")
        self.values |= {name: own if self.kinds[name][0] == "var_in_out" else _copy(own) for name, own in given.items()}
        self.run(self.values)
        return {name: _copy(self.values[name]) for name, (section, _) in self.kinds.items() if section == "var_output"}


def _copy(value: Any) -> Any:
    return list(value) if isinstance(value, list) else value


class Library:
    """Functions and function blocks of a source text.

    Raises
    ------
    SyntaxError
        With the line where the text is none of the language.
    """

    def __init__(self, text: str) -> None:
        self._tokens: list[tuple[str, str, int]] = []
        place = 0
        while place < len(text):
            found = _TOKEN.match(text, place)
            if found is None:
                raise SyntaxError(f"line {text.count(chr(10), 0, place) + 1}: {text[place : place + 20]!r}")
            if found.lastgroup is not None:
                self._tokens.append((found.lastgroup, found.group().lower(), text.count("\n", 0, place) + 1))
            place = found.end()
        self._tokens.append(("end", "", 0))
        self._place = 0
        self._functions: dict[str, tuple[tuple[str, ...], str]] = {k: own[:2] for k, own in _STANDARD.items()}
        self._space: dict[str, Any] = {f"f_{k}": own[2] for k, own in _STANDARD.items()}
        self._space |= {"_div": _div, "_at": _at, "_int": _int}
        self._blocks: dict[str, tuple[Callable[..., None], dict[str, tuple[str, Any]], dict[str, Any]]] = {}
        while self._tokens[self._place][0] != "end":
            self._unit()

    def block(self, name: str) -> Block:
        """Make a new instance of a function block."""
        run, kinds, start = self._blocks[name.lower()]
        return Block(run, kinds, {own: _copy(value) for own, value in start.items()})

    def function(self, name: str) -> Callable[..., Any]:
        """Return a function, of its inputs in their order."""
        own: Callable[..., Any] = self._space[f"f_{name.lower()}"]
        return own

    # Reading.

    def _fail(self, what: str) -> SyntaxError:
        return SyntaxError(f"line {self._tokens[self._place][2]}: {what} at '{self._tokens[self._place][1]}'")

    def _take(self, *wanted: str) -> str:
        if self._tokens[self._place][1] not in wanted:
            raise self._fail(f"wants {' or '.join(wanted)}")
        self._place += 1
        return self._tokens[self._place - 1][1]

    def _seen(self, *wanted: str) -> bool:
        if self._tokens[self._place][1] in wanted:
            self._place += 1
            return True
        return False

    def _name(self) -> str:
        kind, word, _ = self._tokens[self._place]
        if kind != "word" or word in _KEYWORDS.split() or "__" in word or word.endswith("_"):
            raise self._fail("wants a name")
        self._place += 1
        return word

    # Units.

    def _unit(self) -> None:
        whole = self._take("function", "function_block")
        name = self._name()
        if name in self._functions or name in self._blocks:
            raise self._fail("is there twice")
        self._kinds: dict[str, tuple[str, Any]] = {}
        self._start: dict[str, Any] = {}
        if whole == "function":
            self._take(":")
            self._kinds[name] = "result", self._take(*_TYPES)
            self._start[name] = _TYPES[self._kinds[name][1]]
        while self._tokens[self._place][1] in _SECTIONS:
            self._declarations()
        lines = self._statements(f"end_{whole}", indent=1)
        self._take(f"end_{whole}")
        exec("\n".join(["def run(v):", *lines, "    return None"]), self._space)
        run, start, kinds = self._space.pop("run"), self._start, self._kinds
        if whole == "function_block":
            self._blocks[name] = run, kinds, start
            return
        inputs = [own for own, (section, _) in kinds.items() if section == "var_input"]

        def called(*given: Any) -> Any:
            values = start | dict(zip(inputs, given, strict=True))
            run(values)
            return values[name]

        self._functions[name] = tuple(kinds[own][1] for own in inputs), kinds[name][1]
        self._space[f"f_{name}"] = called

    def _declarations(self) -> None:
        section = self._take(*_SECTIONS)
        section = "constant" if self._seen("constant") else section
        while not self._seen("end_var"):
            names = [self._name()]
            while self._seen(","):
                names.append(self._name())
            self._take(":")
            kind: Any
            if self._seen("array"):
                self._take("[")
                low, _, high = self._integer(), self._take(".."), self._integer()
                self._take("]")
                self._take("of")
                kind = self._take(*_TYPES), low, high
                value: Any = [_TYPES[kind[0]]] * (high - low + 1)
            else:
                kind = self._take(*_TYPES)
                value = _TYPES[kind]
            if self._seen(":="):
                value = self._initial(kind)
            self._take(";")
            for name in names:
                if name in self._kinds or name in self._functions or name in self._blocks:
                    raise self._fail(f"{name} is there twice")
                self._kinds[name], self._start[name] = (section, kind), _copy(value)

    def _integer(self) -> int:
        if self._tokens[self._place][0] != "integer":
            raise self._fail("wants an integer")
        self._place += 1
        return int(self._tokens[self._place - 1][1])

    def _initial(self, kind: Any) -> Any:
        values = []
        self._take("[")
        while True:
            minus = -1.0 if self._seen("-") else 1.0
            if self._tokens[self._place][0] != "real":
                raise self._fail("wants a real number")
            values.append(minus * float(self._tokens[self._place][1]))
            self._place += 1
            if self._take(",", "]") == "]":
                break
        if kind[0] != "lreal" or len(values) != kind[2] - kind[1] + 1:
            raise self._fail("has another number of values")
        return values

    # Statements and expressions, as Python's.

    def _statements(self, *ends: str, indent: int, loop: bool = False) -> list[str]:
        lines, tab = list[str](), "    " * indent
        while self._tokens[self._place][1] not in ends:
            if self._seen("if"):
                word = "if"
                while word != "end_if":
                    condition = "" if word == "else" else f" {self._of('bool')}"
                    if word != "else":
                        self._take("then")
                    lines.append(f"{tab}{_PYTHON.get(word, word)}{condition}:")
                    stops = ("end_if",) if word == "else" else ("elsif", "else", "end_if")
                    lines += self._statements(*stops, indent=indent + 1, loop=loop) or [f"{tab}    pass"]
                    word = self._take(*stops)
            elif self._seen("while"):
                lines.append(f"{tab}while {self._of('bool')}:")
                self._take("do")
                lines += self._statements("end_while", indent=indent + 1, loop=True)
                self._take("end_while")
            elif loop and self._seen("exit"):
                lines.append(f"{tab}break")
            else:
                name = self._name()
                section, _ = self._kinds.get(name, ("", ""))
                target, kind = self._variable(name)
                if section in ("var_input", "constant"):
                    raise self._fail(f"{name} is not to be written")
                self._take(":=")
                value = self._of(kind)
                lines.append(f"{tab}{target} = {f'_int({value})' if kind == 'int' else value}")
            self._take(";")
        return lines

    def _variable(self, name: str) -> tuple[str, str]:
        if name not in self._kinds:
            raise self._fail(f"{name} is not declared")
        kind = self._kinds[name][1]
        if isinstance(kind, str):
            return f"v['{name}']", kind
        self._take("[")
        index = self._of("int")
        self._take("]")
        return f"v['{name}'][_at({index}, {kind[1]}, {kind[2]})]", kind[0]

    def _of(self, kind: str) -> str:
        text, found = self._binary(0)
        if found != kind:
            raise self._fail(f"is {found}, wants {kind}")
        return text

    def _binary(self, level: int) -> tuple[str, str]:
        if level == len(_LEVELS):
            return self._unary()
        text, kind = self._binary(level + 1)
        while self._tokens[self._place][1] in _LEVELS[level]:
            sign = self._take(*_LEVELS[level])
            other, second = self._binary(level + 1)
            if kind != second or (kind == "bool") != (level < 3) or (sign == "/" and kind != "lreal"):
                raise self._fail(f"{kind} {sign} {second}")
            text = f"_div({text}, {other})" if sign == "/" else f"({text} {_PYTHON.get(sign, sign)} {other})"
            kind = "bool" if level < 5 else kind
        return text, kind

    def _unary(self) -> tuple[str, str]:
        if self._seen("-"):
            text, kind = self._unary()
            if kind == "bool":
                raise self._fail("minus of a BOOL")
            return f"(-{text})", kind
        if self._seen("not"):
            text, kind = self._unary()
            if kind != "bool":
                raise self._fail("NOT of a number")
            return f"(not {text})", kind
        if self._tokens[self._place][1] in ("true", "false"):
            return self._take("true", "false").capitalize(), "bool"
        kind, word, _ = self._tokens[self._place]
        if kind in ("real", "integer"):
            self._place += 1
            return word, "lreal" if kind == "real" else "int"
        if self._seen("("):
            text, inner = self._binary(0)
            self._take(")")
            return text, inner
        name = self._name()
        if name in self._functions and name not in self._kinds:
            return self._call(name, *self._functions[name])
        return self._variable(name)

    def _call(self, name: str, wanted: Sequence[str], kind: str) -> tuple[str, str]:
        self._take("(")
        given = []
        for number, own in enumerate(wanted):
            given.append(self._of(own))
            self._take("," if number < len(wanted) - 1 else ")")
        return f"f_{name}({', '.join(given)})", kind
