"""A language that `report.html` can be in: its texts, its numbers, its dates."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib.resources import files
from typing import Any

from daq.errors import InputError
from fitting.report import text
from fitting.report.languages.sentences import Sentences

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

    def say(self, english: str, *values: str) -> str:
        """A text of the page itself, with ``values`` (already in this language) where it has ``{}``."""
        if self.own is None:
            parts = english.split("{}")
            return parts[0] + "".join(value + part for value, part in zip(values, parts[1:], strict=True))
        other = self.own.get(english) or self.table.fixed.get(english)
        if other is None:
            return ENGLISH.say(english, *values)
        return re.sub(r"\$(\d)", lambda at: values[int(at[1]) - 1], other)

    def said(self, english: str) -> str:
        """A text that the report holds; it may have values in it, and be put together of several."""
        return english if self.own is None else self.table.said(english)

    def said_each(self, english: str) -> str:
        """Several sentences that the report holds as one text, each for itself."""
        if self.own is None:
            return english
        return " ".join(map(self.said, re.split(r"(?<=\.) (?=[A-Z])", english)))

    def words(self, name: str) -> str:
        """The name of a signal or of a key in words: ``piston_position``, ``joint2.piston_speed``."""
        spaced = text.words(name)
        if self.own is None:
            return spaced
        known = self.own.get(spaced) or self.table.fixed.get(spaced)
        joint, _, signal = name.rpartition(".")
        if known is None and joint:
            known = self.table.fixed.get(text.words(signal))
            return spaced if known is None else self.say("{} of {}", known, joint)
        return spaced if known is None else known

    def lower(self, said: str) -> str:
        """A text for the middle of a sentence: English begins with a small letter there, ``IDIM`` and ``K x`` stay."""
        return said[:1].lower() + said[1:] if self.own is None and said[1:2].islower() else said

    def quoted(self, name: str) -> str:
        """A name that is made of several words, within a sentence."""
        return f"{self.quotes[0]}{name}{self.quotes[1]}"

    def listed(self, items: Sequence[str], last: str = "and") -> str:
        """``a, b and c``."""
        return text.listed(items, self.say(last))

    def unit(self, unit: Any) -> str:
        """A unit as people write it; some are words."""
        return self.say(text.unit(unit))

    def effort(self, unit: str, name: str = "effort") -> str:
        """What an effort of a unit is called; English has one word for forces and torques."""
        return self.say(name) if self.own is None or "N m" not in unit else self.say(f"{name}, N m")

    def size(self, value: float, unit: str) -> str:
        """A value for a sentence, two digits in the unit that people use: ``120 mm``, ``35°``, ``12 MPa``."""
        scale, known = text.USUAL.get(unit, (1.0, f" {self.unit(unit)}".rstrip()))
        return f"{self.number(scale * value, 2)}{known}"

    def formula(self, formula: str) -> str:
        """An equation, or a combination of parameters: names stay, numbers are this language's."""
        return formula if self.own is None else self.table.numerals(self.said(formula))

    # --- numbers --------------------------------------------------------------------------------------------------

    def numeral(self, english: str) -> str:
        """A number that was written the English way; a thin space between thousands is right everywhere."""
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
    """Codes of all languages, English first."""
    return (ENGLISH.code, *_FILES)


@cache
def language(code: str) -> Language:
    """The language of a code, ``en`` or ``de``.

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
    """A language's file: ``page`` and ``report`` are groups of texts, English to that language."""
    return _read(_FILES[code])


def _read(name: str) -> dict[str, Any]:
    return dict(json.loads(files(__package__).joinpath(name).read_text("utf-8")))


#: What codes are called in English, by groups: ``verdicts``, ``statuses``, ...; ``drives`` are the words of joints that
#: no cylinder drives.
NAMES = _read("english.json")
