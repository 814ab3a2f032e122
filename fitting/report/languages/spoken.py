"""A language that `report.html` can be in: its texts, its numbers, its dates.

English sentences with values in them are found in a table. The page does the same with the same table
(`server/web/src/texts/sentences.ts`): a key has ``{}`` where a value stands, its translation ``$1``, ``$2``, ... What
stands there is looked up as well, unless it stands in quotes: that is a name.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any, NamedTuple

from daq.errors import InputError
from fitting.report import text

#: A number with a point, by itself.
_DECIMAL = re.compile(r"(?<![\w.])([+-]?\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w.])", re.ASCII)
#: A name, or a file and its line, in front of what is said of it.
_NAMED = re.compile(r"([^\s:]+(?::\d+)?): (.+)")
_VALUE = re.compile(r"\$(\d)")
#: What a key begins with that may stand behind any sentence.
_BEHIND = (" ", ";")
#: What joins several to one: ``; or {}``.
_JOINT = re.compile(r"; \w+ \{\}")
#: Letters that a sentence with values needs to be known by itself; one with fewer is known inside of others only.
_DISTINCT = 9


class _Sentence(NamedTuple):
    pattern: re.Pattern[str]
    other: str
    names: frozenset[int]
    """Numbers of the values that are names."""
    needed: str
    """The longest of its own parts: a text without it need not be held against the pattern."""


def _sentence(english: str, other: str) -> _Sentence:
    """Make a key's pattern and translation; a sentence before another text is its first value."""
    if english.startswith(_BEHIND):
        rest = _sentence("{}" + english, "$1" + _VALUE.sub(lambda found: f"${int(found[1]) + 1}", other))
        # As much as there is in front: the same words may stand within it.
        return rest._replace(pattern=re.compile(rest.pattern.pattern.replace("(.*?)", "(.*)", 1)))
    parts = english.split("{}")
    names = {at for at in range(1, len(parts)) if parts[at].startswith("'") and parts[at - 1].endswith("'")}
    pattern = re.compile("(.*?)".join(map(re.escape, parts)))
    return _Sentence(pattern, other, frozenset(names), max(parts, key=len))


@dataclass(frozen=True)
class Sentences:
    """A table, ready to be looked into.

    Attributes
    ----------
    fixed : texts without values
    sentences : those with values, the more telling before the others
    inner : those that are known only where they stand in others
    joints : what stands between sentences of a list: ``; or ``
    decimal : sign between whole and parts of a number
    """

    fixed: Mapping[str, str]
    sentences: tuple[_Sentence, ...]
    inner: tuple[_Sentence, ...]
    joints: Mapping[str, str]
    decimal: str

    @classmethod
    def of(cls, table: Mapping[str, str], decimal: str) -> Sentences:
        """Read ``table``: English to the other language; keys that begin with a space or ``;`` follow any sentence."""
        fixed = {key: other for key, other in table.items() if "{}" not in key and not key.startswith(_BEHIND)}
        opened = sorted((key for key in table if key not in fixed), key=_letters, reverse=True)
        inner = [key for key in opened if _letters(key) < _DISTINCT]
        return cls(
            fixed,
            tuple(_sentence(key, table[key]) for key in opened if key not in inner),
            tuple(_sentence(key, table[key]) for key in inner),
            {key[:-2]: table[key].replace("$1", "") for key in opened if _JOINT.fullmatch(key)},
            decimal,
        )

    def translated(self, text: str) -> str:
        """Translate ``text``; unchanged where no table has it, or has one of its parts only."""
        known = self._whole(text)
        return text if known is None else known

    def numerals(self, text: str) -> str:
        """Set this language's decimal sign in the numbers of ``text``; not in versions and names with points."""
        return _DECIMAL.sub(rf"\1{self.decimal}\2", text)

    def _found(self, text: str, among: Iterable[_Sentence]) -> str | None:
        for sentence in among:
            values = sentence.pattern.fullmatch(text) if sentence.needed in text else None
            if values is not None:
                return self._filled(sentence, values)
        return None

    def _filled(self, sentence: _Sentence, values: re.Match[str]) -> str:
        """Fill the translation with its values."""

        def value(found: re.Match[str]) -> str:
            at = int(found[1])
            return values[at] if at in sentence.names else self._part(values[at])

        return _VALUE.sub(value, sentence.other)

    def _whole(self, text: str) -> str | None:
        """Translate a sentence, or what is composed of known ones only."""
        known = self.fixed.get(text) or self._list(text) or self._found(text, self.sentences)
        if known is not None:
            return known
        named = _NAMED.fullmatch(text)
        rest = None if named is None else self._whole(named[2])
        if named is not None and rest is not None:
            return f"{named[1]}: {rest}"
        if "; " not in text:
            return None
        pieces = [piece for piece in map(self._whole, text.split("; ")) if piece is not None]
        return "; ".join(pieces) if len(pieces) == len(text.split("; ")) else None

    def _list(self, text: str) -> str | None:
        """Translate what consists of several, all of them known."""
        for joint, other in self.joints.items():
            pieces = [self._whole(piece) for piece in text.split(joint)] if joint in text else []
            known = [piece for piece in pieces if piece is not None]
            if pieces and len(known) == len(pieces):
                return other.join(known)
        return None

    def _part(self, text: str) -> str:
        """Translate a value within a sentence."""
        known = self.fixed.get(text) or self.fixed.get(text.replace("_", " ")) or self._whole(text)
        known = known or self._found(text, self.inner)
        if known is not None:
            return known
        if "; " in text:
            return "; ".join(map(self._part, text.split("; ")))
        named = _NAMED.fullmatch(text)
        if named is not None:
            return f"{named[1]}: {self._part(named[2])}"
        return self.numerals(text)


def _letters(key: str) -> int:
    return len(key.replace("{}", ""))


#: Files of the languages beside this module; English is what the report is written in.
_FILES = {"de": "german.json"}


@dataclass(frozen=True, eq=False)
class Language:
    """How a report speaks. Texts are given in English, which is their key; one that is not known stays English.

    Attributes
    ----------
    code : as in ``<html lang>``
    decimal : sign between whole and parts of a number
    quotes : what stands around a name within a sentence; empty where nothing does
    date : of ``day``, ``month`` (its name) and ``year``
    months : their names
    own : texts of the page itself, English to this language; None: it is English
    table : texts of `report.json`
    """

    code: str
    decimal: str = "."
    quotes: tuple[str, str] = ("", "")
    date: str = "{day} {month} {year}"
    months: Sequence[str] = text.MONTHS
    own: Mapping[str, str] | None = None
    table: Sentences = field(default_factory=lambda: Sentences({}, (), (), {}, "."))

    # --- texts ----------------------------------------------------------------------------------------------------

    def phrase(self, english: str, *values: str) -> str:
        """Return a text of the page itself, with ``values`` (in this language) where it has ``{}``."""
        if self.own is None:
            parts = english.split("{}")
            return parts[0] + "".join(value + part for value, part in zip(values, parts[1:], strict=True))
        other = self.own.get(english) or self.table.fixed.get(english)
        if other is None:
            return ENGLISH.phrase(english, *values)
        return re.sub(r"\$(\d)", lambda at: values[int(at[1]) - 1], other)

    def translated(self, english: str) -> str:
        """Translate a text of the report, with values in it or composed of several."""
        return english if self.own is None else self.table.translated(english)

    def translated_each(self, english: str) -> str:
        """Translate several sentences of one text of the report, each for itself."""
        if self.own is None:
            return english
        return " ".join(map(self.translated, re.split(r"(?<=\.) (?=[A-Z])", english)))

    def words(self, name: str) -> str:
        """Return a signal's or key's name in words: ``piston_position``, ``joint2.piston_speed``."""
        spaced = text.words(name)
        if self.own is None:
            return spaced
        known = self.own.get(spaced) or self.table.fixed.get(spaced)
        joint, _, signal = name.rpartition(".")
        if known is None and joint:
            known = self.table.fixed.get(text.words(signal))
            return spaced if known is None else self.phrase("{} of {}", known, joint)
        return spaced if known is None else known

    def lower(self, word: str) -> str:
        """Adapt a text to the middle of a sentence: English has a small letter there, not in ``IDIM``, ``K x``."""
        return word[:1].lower() + word[1:] if self.own is None and word[1:2].islower() else word

    def quoted(self, name: str) -> str:
        """Quote a name of several words within a sentence."""
        return f"{self.quotes[0]}{name}{self.quotes[1]}"

    def listed(self, items: Sequence[str], last: str = "and") -> str:
        """Join as ``a, b and c``."""
        return text.listed(items, self.phrase(last))

    def unit(self, unit: Any) -> str:
        """Write a unit as people do; some are words."""
        return self.phrase(text.unit(unit))

    def effort(self, unit: str, name: str = "effort") -> str:
        """Name an effort of a unit; English has one word for forces and torques."""
        return self.phrase(name) if self.own is None or "N m" not in unit else self.phrase(f"{name}, N m")

    def size(self, value: float, unit: str) -> str:
        """Write a value in a sentence, two digits in people's unit: ``120 mm``, ``35°``, ``12 MPa``."""
        scale, known = text.USUAL.get(unit, (1.0, f" {self.unit(unit)}".rstrip()))
        return f"{self.number(scale * value, 2)}{known}"

    def formula(self, formula: str) -> str:
        """Write an equation or combination of parameters: names as they are, this language's numbers."""
        return formula if self.own is None else self.table.numerals(self.translated(formula))

    # --- numbers --------------------------------------------------------------------------------------------------

    def numeral(self, english: str) -> str:
        """Rewrite an English number; a thin space between thousands is right everywhere."""
        return english.replace(".", self.decimal)

    def number(self, value: float | None, digits: int = 3) -> str:
        """See :func:`fitting.report.text.number`."""
        return self.numeral(text.number(value, digits))

    def with_std(self, value: float | None, std: float | None) -> str:
        """See :func:`fitting.report.text.with_std`."""
        return self.numeral(text.with_std(value, std))

    def percent(self, value: float | None) -> str:
        """See :func:`fitting.report.text.percent`."""
        return self.numeral(text.percent(value))

    def share(self, value: float | None) -> str:
        """See :func:`fitting.report.text.share`."""
        return self.numeral(text.share(value))

    def moment(self, stamp: str) -> str:
        """See :func:`fitting.report.text.moment`."""
        return text.moment(stamp, self.months, self.date)


ENGLISH = Language("en")


def codes() -> tuple[str, ...]:
    """List the codes of all languages, English first."""
    return (ENGLISH.code, *_FILES)


@cache
def language(code: str) -> Language:
    """Return the language of a code, ``en`` or ``de``.

    Raises
    ------
    InputError
        One line, if there is none.
    """
    if code == ENGLISH.code:
        return ENGLISH
    if code not in _FILES:
        raise InputError(f"there is no report in the language '{code}'; use one of {', '.join(codes())}")
    content = content_of(code)
    table = {english: other for group in content["report"].values() for english, other in group.items()}
    return Language(
        code=code,
        decimal=content["decimal"],
        quotes=tuple(content["quotes"]),
        date=content["date"],
        months=tuple(content["months"]),
        own={english: other for group in content["page"].values() for english, other in group.items()},
        table=Sentences.of(table, content["decimal"]),
    )


def content_of(code: str) -> dict[str, Any]:
    """Read a language's file: ``page`` and ``report`` map groups of English texts to it."""
    return _read(_FILES[code])


def _read(name: str) -> dict[str, Any]:
    return dict(json.loads(files(__package__).joinpath(name).read_text("utf-8")))


#: What codes are called in English, by groups: ``verdicts``, ``statuses``, ...; ``drives`` are the words of joints that
#: no cylinder drives.
NAMES = _read("english.json")
