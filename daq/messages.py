"""Messages: a code and values inside, a sentence at the edge.

A message is an English sentence that knows what it was made of, so that no program reads it again: a page in another
language words the same code and values. ``fitting.no_unloaded`` is ``no_unloaded`` in the texts of the package
``fitting``: ``fitting/texts/en.json`` and ``de.json`` beside it, with equal keys. Placeholders are those of
``str.format``, with these additions: a value that is a list is joined with its format (``{names:; }``; a comma without
one), one that is given as it is (``{name!s}``) is no word of the language, and a whole number has no point without a
format (``1.0`` is ``1``), which JSON does not keep.

A package of one's own has its texts in the same place.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Callable, Mapping, Sequence
from dataclasses import fields, is_dataclass
from functools import cache
from importlib.util import find_spec
from pathlib import Path, PurePath
from string import Formatter
from types import MappingProxyType
from typing import Any, SupportsIndex, TypeAlias

#: Name of a value for people, if it has one.
Naming: TypeAlias = Callable[[str], str | None]
#: Language that messages are made in, and those that they can be worded in.
ENGLISH = "en"
LANGUAGES = (ENGLISH, "de")
#: Packages whose texts every page of this product has.
_OWN = frozenset({"daq", "fitting", "server", "sim_backends"})
_DECIMAL_SIGNS = {ENGLISH: ".", "de": ","}
#: A number with a point, by itself: no version, no part of a name.
_DECIMAL = re.compile(r"(?<![\w.])([+-]?\d+)\.(\d+(?:e[+-]?\d+)?)(?![\w.])", re.ASCII)


class Sentence(str):
    """An English sentence with its code and values.

    Parameters
    ----------
    code : ``<package>.<key>`` of its text
    values : what stands in it: texts, numbers, messages, lists of them; others as ``str`` has them

    Raises
    ------
    KeyError
        If there is no such text, or it names a value that is not given.
    """

    code: str
    values: Mapping[str, Any]

    def __new__(cls, code: str, /, **values: Any) -> Sentence:
        plain = {name: _plain(value) for name, value in values.items()}
        message = super().__new__(cls, _worded(code, plain, ENGLISH))
        message.code = code
        message.values = MappingProxyType(plain)
        return message

    def __str__(self) -> str:
        return self

    def __add__(self, other: str) -> Sentence:
        return Sentence("daq.together", first=self, second=other) if other else self

    def __radd__(self, other: str) -> Sentence:
        return Sentence("daq.together", first=other, second=self) if other else self

    def __reduce__(self) -> tuple[Any, ...]:
        return _known, (str.__str__(self), {str.__str__(self): self.to_json()})

    def mapped(self, change: Callable[[Any], Any]) -> Sentence:
        """Return it with changed values."""
        return Sentence(self.code, **{name: change(value) for name, value in self.values.items()})

    def to_json(self) -> dict[str, Any]:
        """Return code and values as JSON content."""
        return {"code": self.code, "values": {name: _to_json(value) for name, value in self.values.items()}}

    def replace(self, old: str, new: str, /, count: SupportsIndex = -1) -> Sentence:
        """Replace ``old`` in its values, as in the name of a file."""
        return self.mapped(lambda value: _replaced(value, old, new))

    def worded(self, language: str, named: Naming | None = None) -> str:
        """Word it in one of :data:`LANGUAGES`; in English where that has no text for it.

        ``named`` gives the name of a value for people, None where it is as good as it is.
        """
        try:
            return _worded(self.code, self.values, language, named)
        except KeyError:
            return str.__str__(self)


def message_of(text: str | None) -> dict[str, Any] | None:
    """Return code and values of a sentence as JSON content; None for another text."""
    return text.to_json() if isinstance(text, Sentence) else None


def one_line(text: str) -> str:
    """Return a text without line breaks; a sentence that has none as it is."""
    line = " ".join(text.split())
    return text if line == text else line


def message_from_json(content: Mapping[str, Any]) -> Sentence:
    """Read what :meth:`Sentence.to_json` wrote.

    Raises
    ------
    KeyError
        If this version has no such text, or it names other values.
    """
    return Sentence(content["code"], **{name: _from_json(value) for name, value in content["values"].items()})


def numerals(text: str, language: str) -> str:
    """Set a language's decimal sign in the numbers of ``text``; not in versions and names with points."""
    return text if language == ENGLISH else _DECIMAL.sub(rf"\1{_DECIMAL_SIGNS[language]}\2", text)


def named(name: str, what: str) -> Sentence:
    """Put a name, or a place, in front of what is wrong with it."""
    return Sentence("daq.named", name=name, what=what)


def listed(texts: Sequence[str]) -> str:
    """Put several texts into one line."""
    return texts[0] if len(texts) == 1 else Sentence("daq.listed", items=list(texts))


def in_a_row(texts: Sequence[str]) -> str:
    """Put several texts behind each other, with commas."""
    return texts[0] if len(texts) == 1 else Sentence("daq.in_a_row", items=list(texts))


def first_of(texts: Sequence[str]) -> str:
    """Return the first of several texts, with the number of the others."""
    return texts[0] if len(texts) == 1 else Sentence("daq.first_of", first=texts[0], count=len(texts) - 1)


def with_their_messages(content: Mapping[str, Any]) -> dict[str, Any]:
    """Add ``messages`` to JSON content that has sentences; see :func:`messages_in`."""
    found = messages_in(content)
    return {**content, "messages": found} if found else dict(content)


def put_together(content: Mapping[str, Any]) -> dict[str, Any]:
    """Undo :func:`with_their_messages`."""
    plain = {key: value for key, value in content.items() if key != "messages"}
    return dict(with_messages(plain, content.get("messages") or {}))


def messages_in(content: Any) -> dict[str, Any]:
    """Collect all messages of JSON content or of dataclasses: each English sentence with its code and values.

    One with a text of another distribution in it is ``worded`` in every language as well.
    """
    found: dict[str, Any] = {}
    _collect(content, found)
    return found


def with_messages(content: Any, messages: Mapping[str, Any]) -> Any:
    """Put messages back into JSON content in which they are their sentences; see :func:`messages_in`.

    A value that is the sentence of another message is that message.
    """
    if isinstance(content, Sentence):
        return content.mapped(lambda value: with_messages(value, messages))
    if isinstance(content, Mapping):
        return {_known(key, messages): with_messages(value, messages) for key, value in content.items()}
    if isinstance(content, (list, tuple)):
        return [with_messages(value, messages) for value in content]
    return _known(content, messages) if isinstance(content, str) else content


def _of_others(value: Any) -> bool:
    """Return whether a message, or one in it, has its text in another distribution, which a page does not have."""
    if isinstance(value, list):
        return any(map(_of_others, value))
    if not isinstance(value, Sentence):
        return False
    return value.code.partition(".")[0] not in _OWN or any(map(_of_others, value.values.values()))


def _known(text: str, messages: Mapping[str, Any]) -> str:
    if text not in messages:
        return text
    try:
        message = message_from_json(messages[text])
    except KeyError:  # of another version
        return text
    others = {english: own for english, own in messages.items() if english != text}  # a list of one is its item
    return str(with_messages(message, others))


def _collect(content: Any, found: dict[str, Any]) -> None:
    if isinstance(content, Sentence):
        others = {code: content.worded(code) for code in LANGUAGES if code != ENGLISH} if _of_others(content) else None
        found[str.__str__(content)] = content.to_json() | ({"worded": others} if others else {})
    elif isinstance(content, (Mapping, list, tuple)):
        for value in (*content, *content.values()) if isinstance(content, Mapping) else content:
            _collect(value, found)
    elif is_dataclass(content):
        for own in fields(content):
            _collect(getattr(content, own.name), found)


def _plain(value: Any) -> Any:
    if isinstance(value, PurePath):
        return str(value)
    if isinstance(value, (str, int, float)) or value is None:
        return value
    if hasattr(value, "item"):  # a number of numpy
        return value.item()
    if isinstance(value, Sequence):
        return [_plain(one) for one in value]
    return str(value)


def _to_json(value: Any) -> Any:
    if isinstance(value, Sentence):
        return value.to_json()
    if isinstance(value, float) and not math.isfinite(value):
        return str(value)
    return [_to_json(one) for one in value] if isinstance(value, list) else value


def _replaced(value: Any, old: str, new: str) -> Any:
    if isinstance(value, list):
        return [_replaced(one, old, new) for one in value]
    return value.replace(old, new) if isinstance(value, str) else value


def _from_json(value: Any) -> Any:
    if isinstance(value, Mapping):
        return message_from_json(value)
    return [_from_json(one) for one in value] if isinstance(value, list) else value


@cache
def texts(package: str, language: str) -> dict[str, dict[str, str]]:
    """Read a package's texts: ``messages`` by key and ``words`` by the English one.

    Raises
    ------
    KeyError
        If there is no such package, or it has none. It is not imported: a code may come from a file of somebody.
    """
    spec = find_spec(package) if package.isidentifier() else None
    for place in (spec.submodule_search_locations or ()) if spec is not None else ():
        file = Path(place, "texts", f"{language}.json")
        if file.is_file():
            return dict(json.loads(file.read_text("utf-8")))
    raise KeyError(package)


@cache
def placeholders(code: str) -> tuple[str, ...]:
    """Return the names of the values that a message's text needs."""
    package, _, key = code.partition(".")
    fields = Formatter().parse(texts(package, ENGLISH)["messages"][key])
    return tuple(dict.fromkeys(name for _, name, _, _ in fields if name))


def is_code(text: str) -> bool:
    """Return whether ``text`` is the code of a message, and no sentence."""
    package, _, key = text.partition(".")
    try:
        return key.isidentifier() and key in texts(package, ENGLISH)["messages"]
    except KeyError:
        return False


class _Wording(Formatter):
    """``str.format`` with the numbers, words and messages of a language."""

    def __init__(self, language: str, package: str, named: Naming | None) -> None:
        self._language, self._package, self._named = language, package, named

    def convert_field(self, value: Any, conversion: str | None) -> Any:
        if conversion != "s":
            return super().convert_field(value, conversion)
        return [_as_it_is(one) for one in value] if isinstance(value, list) else _as_it_is(value)

    def format_field(self, value: Any, format_spec: str) -> Any:
        if isinstance(value, _AsItIs):
            return str.__str__(value)
        if isinstance(value, list):
            return (format_spec or ", ").join(self.format_field(one, "") for one in value)
        if isinstance(value, (int, float)) and not isinstance(value, bool):
            number = format(value, format_spec) if format_spec else str(value).removesuffix(".0")
            return number.replace(".", _DECIMAL_SIGNS[self._language])
        if isinstance(value, Sentence):
            return value.worded(self._language, self._named)
        if not isinstance(value, str):
            return str(value)
        name = None if self._named is None else self._named(value)
        return word(value, self._language, self._package) if name is None else name


class _AsItIs(str):
    """A name: no word of any language."""


def _as_it_is(value: Any) -> Any:
    if isinstance(value, Sentence):
        return value
    return _AsItIs(str(value).removesuffix(".0") if isinstance(value, float) else value)


def _worded(code: str, values: Mapping[str, Any], language: str, named: Naming | None = None) -> str:
    package, _, key = code.partition(".")
    return _Wording(language, package, named).vformat(texts(package, language)["messages"][key], (), values)


def word(text: str, language: str, package: str) -> str:
    """Translate a word of a package, or of this one; another text stays, but for the sign in its numbers."""
    if language == ENGLISH:
        return text
    for owner in dict.fromkeys((package, __package__)):
        known = texts(owner, language)["words"]
        if text in known or text.replace("_", " ") in known:
            return known.get(text) or known[text.replace("_", " ")]
    return numerals(text, language)
