"""What bodies of requests are made of."""

from __future__ import annotations

from typing import Annotated

from pydantic import BaseModel, ConfigDict, Field

#: ``true`` or ``false``, not 0, "no" or what else Python takes for one.
Flag = Annotated[bool, Field(strict=True)]
Label = Annotated[str, Field(max_length=200)]


class Body(BaseModel):
    """A body that refuses what it does not know."""

    model_config = ConfigDict(extra="forbid")
