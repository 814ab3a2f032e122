"""
An effect of one's own
======================

An effect is one class: texts for people, and regressor columns. Here a wiper seal that drags more the faster the rod
comes *out* than it goes in; it is checked like every effect of the catalogue, and evaluated on a motion.
"""

# %%
# The class. ``columns`` says what one unit of each parameter adds to the force of the cylinder, from the motion and the
# model's own force, never from the measured one.

import matplotlib.pyplot as plt
import numpy as np

from fitting.effects.base import DriveView, Effect, Parameter, Parity
from fitting.effects.conformance import check_effect


class WiperDrag(Effect):
    """A wiper seal that drags in proportion to the speed, on the way out only."""

    id = "wiper_drag"
    title = "a wiper seal that drags on the way out only"
    level = "cylinder"
    variable = "piston_speed"
    uses_model = False
    equation = "f_w max(v, 0)"
    parity = Parity.NEITHER
    dependence = "nothing on the way in"
    parameters = (Parameter("f_w", "N s/m", low=0.0),)
    confounders = ("asymmetric_friction",)
    experiment = "the same stroke slowly and fast, in both directions"
    source = "an example"

    def columns(self, view: DriveView, shape):
        """Compute columns (N, 1)."""
        return np.maximum(view.v, 0.0)[:, None]


# %%
# The check that every effect has to pass: shapes of the columns, no dependence on the measured force, units, texts.

check_effect(WiperDrag())
print("conforms")

# %%
# In a package of yours one line of ``pyproject.toml`` makes it a candidate of the loop and of its reports::
#
#     [project.entry-points."hilfit.effects"]
#     wiper_drag = "my_package.wiper_drag:WiperDrag"
#
# Its shape beside the two that it may be mistaken for:

v = np.linspace(-0.3, 0.3, 300)
fig, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
ax.plot(v, np.maximum(v, 0.0), label="wiper_drag")
ax.plot(v, 0.5 * v, "--", label="viscous friction takes half of it")
ax.plot(v, np.maximum(v, 0.0) - 0.5 * v, ":", label="what is left to tell it by: even in the speed")
ax.set(xlabel="piston speed [m/s]", ylabel="force per unit [N]")
ax.legend()
