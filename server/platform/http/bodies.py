"""What bodies of requests are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

#: ``true`` or ``false``, not 0, "no" or what else Python takes for one.
Flag = Annotated[bool, Field(strict=True)]
#: Words of a person: no control characters, and none of those that make text read otherwise than it is written.
PLAIN = r"^[^\u0000-\u001f\u007f-\u009f\u061c\u200b-\u200f\u2028-\u202e\u2060-\u206f\ufeff]*$"
Label = Annotated[str, Field(max_length=200, pattern=PLAIN)]


class Body(BaseModel):
    """A body that refuses what it does not know."""

    model_config = ConfigDict(extra="forbid")
