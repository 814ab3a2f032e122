"""English sentences with values in them, found in a table and said in another language.

The page does the same with the same table (`server/web/src/texts/sentences.ts`): a key has ``{}`` where a value stands,
its translation ``$1``, ``$2``, ... What stands there is looked up as well, unless it stands in quotes: that is a name.
"""

from __future__ import annotations

import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from typing import NamedTuple

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
_TELLING = 9


class _Sentence(NamedTuple):
    pattern: re.Pattern[str]
    other: str
    names: frozenset[int]
    """Numbers of the values that are names."""
    needed: str
    """The longest of its own parts: a text without it need not be held against the pattern."""


def _sentence(english: str, other: str) -> _Sentence:
    """A key as a pattern, and what it becomes; the sentence that something stands behind is its first value."""
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
        """``table``: English to the other language; a key that begins with a space or ``;`` may follow any sentence."""
        fixed = {key: other for key, other in table.items() if "{}" not in key and not key.startswith(_BEHIND)}
        opened = sorted((key for key in table if key not in fixed), key=_letters, reverse=True)
        inner = [key for key in opened if _letters(key) < _TELLING]
        return cls(
            fixed,
            tuple(_sentence(key, table[key]) for key in opened if key not in inner),
            tuple(_sentence(key, table[key]) for key in inner),
            {key[:-2]: table[key].replace("$1", "") for key in opened if _JOINT.fullmatch(key)},
            decimal,
        )

    def said(self, text: str) -> str:
        """``text`` in the other language; as it is where no table has it, or has one of its parts only."""
        known = self._whole(text)
        return text if known is None else known

    def numerals(self, text: str) -> str:
        """``text`` with this language's decimal sign in its numbers; versions and names with points stay."""
        return _DECIMAL.sub(rf"\1{self.decimal}\2", text)

    def _found(self, text: str, among: Iterable[_Sentence]) -> str | None:
        for sentence in among:
            values = sentence.pattern.fullmatch(text) if sentence.needed in text else None
            if values is not None:
                return self._filled(sentence, values)
        return None

    def _filled(self, sentence: _Sentence, values: re.Match[str]) -> str:
        """The translation with its values."""

        def value(found: re.Match[str]) -> str:
            at = int(found[1])
            return values[at] if at in sentence.names else self._part(values[at])

        return _VALUE.sub(value, sentence.other)

    def _whole(self, text: str) -> str | None:
        """A sentence, or what is put together of nothing but known ones."""
        known = self.fixed.get(text) or self._list(text) or self._found(text, self.sentences)
        if known is not None:
            return known
        named = _NAMED.fullmatch(text)
        said = None if named is None else self._whole(named[2])
        if named is not None and said is not None:
            return f"{named[1]}: {said}"
        if "; " not in text:
            return None
        pieces = [piece for piece in map(self._whole, text.split("; ")) if piece is not None]
        return "; ".join(pieces) if len(pieces) == len(text.split("; ")) else None

    def _list(self, text: str) -> str | None:
        """What consists of several, all of them known."""
        for joint, other in self.joints.items():
            pieces = [self._whole(piece) for piece in text.split(joint)] if joint in text else []
            known = [piece for piece in pieces if piece is not None]
            if pieces and len(known) == len(pieces):
                return other.join(known)
        return None

    def _part(self, text: str) -> str:
        """What stands in a sentence as a value."""
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
