"""Common parts of the report's objects."""

from __future__ import annotations

from pydantic import BaseModel, ConfigDict


class Part(BaseModel):
    """An object of the report; keys of later versions are taken as they are."""

    model_config = ConfigDict(extra="allow", allow_inf_nan=False)


class Value(Part):
    """A number with its standard deviation and unit.

    ``told_by_data`` is the share of what is known of it that came from the recordings; below a half, ``std`` is None.
    """

    value: float | None = None
    std: float | None = None
    unit: str | None = None
    told_by_data: float | None = None
