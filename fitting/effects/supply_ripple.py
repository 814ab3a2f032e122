from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from fitting.arrays import FloatArray
from fitting.effects.base import DriveView, Effect, FoundBy, Parameter, Parity, Shape


class SupplyRipple(Effect):
    """A pump's pulsation: one spectral line that no motion explains.

    The phase is the pump's own and starts anywhere in every recording, so a shape carries, beside the frequency, the
    phase of each recording (``phase_<number>``, rad, 0 if absent), as `fitting.residual.lines` finds them. Amplitude
    and a common correction of the phases are the linear parameters.
    """

    id = "supply_ripple"
    title = "a ripple of the supply pressure"
    level = "measurement"
    variable = "time"
    uses_model = False
    needs_cylinder = True
    equation = "a sin(2 pi f t + phase) + b cos(2 pi f t + phase), a phase per recording"
    found_by = FoundBy.LINES
    parity = Parity.OTHER
    dependence = "a spectral line unrelated to motion"
    parameters = (Parameter("a", "N"), Parameter("b", "N"))
    shape_units = {"frequency": "Hz"}
    experiment = "change the pump's speed: the line moves with it"
    by_motion = False
    look_at = "the pump and its accumulator: worn elements, lost gas charge"
    source = "flow ripple of positive-displacement pumps: shaft speed times number of pistons or teeth, and aliases"

    def shapes(self, view: DriveView) -> Sequence[Shape]:
        """Return one frequency amid the band, for detection limits; actual frequencies come from the residual."""
        return ({"frequency": 0.5 * view.bank.bandwidth_hz},)

    def columns(self, view: DriveView, shape: Shape) -> FloatArray:
        phase = shape.get(f"phase_{view.segment.recording}", 0.0)
        angle = 2 * np.pi * shape["frequency"] * view.clock + phase
        return np.column_stack([np.sin(angle), np.cos(angle)])
