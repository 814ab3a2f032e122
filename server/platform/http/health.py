"""What the routes of health give."""

from __future__ import annotations

from typing import Literal

from pydantic import BaseModel


class Health(BaseModel):
    """Answered when all is well."""

    status: Literal["ok"]
