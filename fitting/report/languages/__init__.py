"""Languages of `report.html`: texts, numbers, dates. A further one is a file like `german.json` and a line here.

Sentences of the report are messages, worded by their codes (:mod:`daq.messages`). Names of codes are in
`english.json`; `german.json` translates that and all other texts of the page, by the English one, with ``{}`` where a
value goes and ``$1``, ``$2``, ... in the translation.
"""

from __future__ import annotations

import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib.resources import files
from typing import Any

from daq.errors import InputError
from daq.messages import Sentence, numerals, texts, word
from fitting.report import text

#: Files of the languages beside this module; English is what the report is written in.
_FILES = {"de": "german.json"}


@dataclass(frozen=True, eq=False)
class Language:
    """Language of a report. Texts are given in English, which is their key; one that is not known is left English.

    Attributes
    ----------
    code : as in ``<html lang>``
    decimal : sign between whole and parts of a number
    quotes : marks around a name within a sentence; empty where there are none
    date : of ``day``, ``month`` (its name) and ``year``
    months : their names
    own : texts of the page itself, English to this language; None: it is English
    """

    code: str
    decimal: str = "."
    quotes: tuple[str, str] = ("", "")
    date: str = "{day} {month} {year}"
    months: Sequence[str] = text.MONTHS
    own: Mapping[str, str] | None = None

    # --- texts ----------------------------------------------------------------------------------------------------

    def phrase(self, english: str, *values: str) -> str:
        """Return a text of the page itself, with ``values`` (in this language) where it has ``{}``."""
        if self.own is None:
            parts = english.split("{}")
            return parts[0] + "".join(value + part for value, part in zip(values, parts[1:], strict=True))
        other = self.own.get(english) or texts(_PACKAGE, self.code)["words"].get(english)
        if other is None:
            return ENGLISH.phrase(english, *values)
        return re.sub(r"\$(\d)", lambda at: values[int(at[1]) - 1], other)

    def translated(self, english: str) -> str:
        """Word a message of the report, or one of its words; another text is left as it is."""
        if self.own is None:
            return english
        return english.worded(self.code) if isinstance(english, Sentence) else word(english, self.code, _PACKAGE)

    def words(self, name: str) -> str:
        """Return a signal's or key's name in words: ``piston_position``, ``joint2.piston_speed``."""
        spaced = name.replace("_", " ")
        if self.own is None:
            return spaced
        known_words = texts(_PACKAGE, self.code)["words"]
        known = self.own.get(spaced) or known_words.get(spaced)
        joint, _, signal = name.rpartition(".")
        if known is None and joint:
            known = known_words.get(signal.replace("_", " "))
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
        if len(items) < 2:
            return "".join(items)
        return f"{', '.join(items[:-1])} {self.phrase(last)} {items[-1]}"

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
        return formula if self.own is None else numerals(self.translated(formula), self.code)

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


#: Whose words a report has.
_PACKAGE = "fitting"
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
        raise InputError("fitting.report_no_language", code=code, codes=codes())
    content = content_of(code)
    return Language(
        code=code,
        decimal=content["decimal"],
        quotes=tuple(content["quotes"]),
        date=content["date"],
        months=tuple(content["months"]),
        own={english: other for group in content["page"].values() for english, other in group.items()},
    )


def content_of(code: str) -> dict[str, Any]:
    """Read a language's file: ``page`` maps groups of English texts to it."""
    return _read(_FILES[code])


def _read(name: str) -> dict[str, Any]:
    return dict(json.loads(files(__package__).joinpath(name).read_text("utf-8")))


#: What codes are called in English, by groups: ``verdicts``, ``statuses``, ...; ``drives`` are the words of joints that
#: no cylinder drives.
NAMES = _read("english.json")
