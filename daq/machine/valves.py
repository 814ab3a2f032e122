"""Proportional valves in a machine file, and the supply in front of them.

A valve's ``command`` is recorded as it is **sent** to the amplifier, in the amplifier's own unit: nothing converts it.
``extends`` is the sign of ``command - neutral`` that lets oil into the head chamber. hilfit reads commands, it never
writes one.
"""

from __future__ import annotations

from typing import Annotated, Any, Literal

from pydantic import Field, field_validator, model_validator

from daq.errors import BadValueError
from daq.machine.buses import FileModel
from daq.units import AS_SENT

#: What is known of something that may be there: YAML's ``true`` and ``false``, or ``unknown``.
Known = bool | Literal["unknown"]
#: ``constant_pressure``: a pump that holds its pressure; ``load_sensing``: the highest load and a margin;
#: ``constant_flow``: an open centre, whose pressure is what the load makes of it.
SupplyKind = Literal["unknown", "constant_pressure", "load_sensing", "constant_flow"]


class Valve(FileModel):
    """The proportional valve of a cylinder."""

    unit: str = "1"  # of `range`, `neutral` and the command channel
    range: tuple[float, float] = (-1.0, 1.0)  # least and largest command the amplifier takes
    neutral: float = 0.0  # command at which the spool is centred
    extends: Literal[1, -1] = 1  # sign of command - neutral that extends the rod
    compensated: Known = "unknown"  # a pressure compensator in front of the spool
    counterbalance: Known = "unknown"  # a counterbalance (load-holding) valve between the ports and the chambers

    @field_validator("extends", mode="before")
    @classmethod
    def _is_a_sign(cls, value: Any) -> Any:
        if isinstance(value, bool) or value not in (1, -1):
            raise BadValueError("daq.must_sign_command_neutral")
        return int(value)

    @field_validator("unit")
    @classmethod
    def _is_sent(cls, value: str) -> str:
        if value not in AS_SENT:
            raise BadValueError("daq.no_unit_command", value=value[:40], as_sent=", ".join(AS_SENT))
        return value

    @model_validator(mode="after")
    def _neutral_within(self) -> Valve:
        low, high = self.range
        if low >= high:
            raise BadValueError("daq.range_must_go_low", at=("range",), low=low, high=high)
        if not low < self.neutral < high:
            raise BadValueError(
                "daq.neutral_not_inside_range", at=("neutral",), neutral=self.neutral, low=low, high=high
            )
        return self

    @property
    def full(self) -> float:
        """The farthest command from neutral: what commands are measured by."""
        return max(self.range[1] - self.neutral, self.neutral - self.range[0])


class Supply(FileModel):
    """The pump that all valves are fed by."""

    pressure: Annotated[float, Field(gt=0)] | None = None  # Pa, where no channel measures it
    kind: SupplyKind = "unknown"
    flow_limit: Annotated[float, Field(gt=0)] | None = None  # m^3/s, all cylinders together
