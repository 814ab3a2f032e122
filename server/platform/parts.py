"""The parts of a process, each made when it is first asked for, and one only.

::

    parts[Recordings].get(id)      # a part is asked for by its class
    parts[RECORDER].record(order)  # or, where it is a function or whatever fits a protocol, by its name

What makes a part stands in the declaration of its resource (:mod:`server.platform.resource`); it asks for the parts
that it needs, so nothing depends on the order of declarations.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from contextlib import AbstractContextManager, ExitStack
from typing import Any, Generic, TypeVar, cast, overload

Made = TypeVar("Made")


class PartName(Generic[Made]):
    """Names a part that has no class of its own; tests put fakes in its place."""

    def __init__(self, text: str) -> None:
        self._text = text

    def __repr__(self) -> str:
        return f"PartName({self._text!r})"


#: What is wrong with the service itself, by the kind of alarm: whoever finds it writes it, alarms are made of it.
TROUBLES: PartName[dict[str, str]] = PartName("troubles of the service")

Key = type[Any] | PartName[Any]
Provider = Callable[["Parts"], Any]


class Parts:
    """Parts by class or name.

    Parameters
    ----------
    providers : what makes each
    """

    def __init__(self, providers: Mapping[Key, Provider]) -> None:
        self._providers = dict(providers)
        self._made: dict[Key, Any] = {}
        self._making: list[Key] = []
        self._closing = ExitStack()

    @overload
    def __getitem__(self, key: type[Made]) -> Made: ...

    @overload
    def __getitem__(self, key: PartName[Made]) -> Made: ...

    def __getitem__(self, key: type[Made] | PartName[Made]) -> Made:
        """Return the part.

        Raises
        ------
        LookupError
            If no declaration provides it, or it needs itself.
        """
        if key not in self._made:
            if key in self._making:
                raise LookupError(f"{' needs '.join(map(_text, [*self._making, key]))}; ask for one of them later")
            if key not in self._providers:
                raise LookupError(f"no resource provides {_text(key)}; add it to `provides` of its declaration")
            self._making.append(key)
            try:
                self._made[key] = self._providers[key](self)
            finally:
                self._making.pop()
        return cast(Made, self._made[key])

    def put(self, given: Mapping[Key, Any]) -> None:
        """Put parts that exist in the place of what their providers would make."""
        self._made |= given

    def make_all(self) -> None:
        """Make every part that was not asked for yet."""
        for key in self._providers:
            self[key]

    def at_close(self, callback: Callable[[], object]) -> None:
        """Call something when the parts are closed; what was added last comes first."""
        self._closing.callback(callback)

    def entered(self, context: AbstractContextManager[Made]) -> Made:
        """Enter a context; it is left when the parts are closed."""
        return self._closing.enter_context(context)

    def close(self) -> None:
        """Close what is to be closed."""
        self._closing.close()


def _text(key: Key) -> str:
    return key.__name__ if isinstance(key, type) else repr(key)
