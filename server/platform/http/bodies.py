"""Building blocks of the bodies of requests and of answers."""

from __future__ import annotations

import math
from collections.abc import Callable, Collection, Mapping
from typing import Annotated, Any, Generic, Self, TypeVar

from pydantic import BaseModel, ConfigDict, Field, model_validator

from daq.messages import message_of, with_messages
from server.platform.database.engine import Page

#: ``true`` or ``false``, not 0, "no" or what else Python takes for one.
Flag = Annotated[bool, Field(strict=True)]
#: Words of a person: no control characters, and none of those that make text read otherwise than it is written.
PLAIN = r"^[^\u0000-\u001f\u007f-\u009f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]*$"
Label = Annotated[str, Field(max_length=200, pattern=PLAIN)]


def finite(value: float | None) -> float | None:
    """Return what JSON can hold of a number: None where it is infinite or none."""
    return None if value is None or not math.isfinite(value) else float(value)


class Body(BaseModel):
    """A body that refuses what it does not know."""

    model_config = ConfigDict(extra="forbid")


class Message(BaseModel):
    """What a sentence was made of, for another language: ``code`` of its text, and ``values`` by their names in it."""

    model_config = ConfigDict(frozen=True)
    code: str
    values: dict[str, Any]


def with_messages_of(values: Mapping[str, Any], names: Collection[str]) -> dict[str, Any]:
    """Add what the texts among ``values`` were made of, where ``names`` has a ``<text>_message``; null of others."""
    made = ((f"{name}_message", value) for name, value in values.items())
    return {name: message_of(value) for name, value in made if name in names} | dict(values)


class Shown(BaseModel):
    """Body that shows an object of the service: the attributes named like its fields.

    A field ``<text>_message`` is filled in with what the sentence in ``text`` was made of.
    """

    model_config = ConfigDict(from_attributes=True, frozen=True)

    @model_validator(mode="before")
    @classmethod
    def _messages(cls, content: Any) -> Any:
        return with_messages_of(content, cls.model_fields) if isinstance(content, Mapping) else content

    def sentence(self, name: str) -> str:
        """Return a text as the sentence that it was made as."""
        text, made_of = str(getattr(self, name)), getattr(self, f"{name}_message")
        return text if made_of is None else str(with_messages(text, {text: made_of.model_dump()}))

    @classmethod
    def of(cls, value: object, /, **beside: object) -> Self:
        """Build it from a thing's attributes, whatever else it has; ``beside`` are other fields."""
        own = {name: getattr(value, name) for name in cls.model_fields if name not in beside and hasattr(value, name)}
        return cls.model_validate(own | beside)


Item = TypeVar("Item", bound=BaseModel)


class Listed(BaseModel, Generic[Item]):
    """Some of a longer list; ``next`` is the cursor of the next page."""

    items: list[Item]
    next: int | None

    @classmethod
    def of(cls, page: Page[Any], show: Callable[[Any], object] = lambda value: value) -> Self:
        """Build it from the store; ``show`` makes an item of what does not show itself."""
        return cls.model_validate({"items": [show(value) for value in page.items], "next": page.next})
