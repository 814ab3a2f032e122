"""
EMPS: a measured positioning system
===================================

A carriage on a ball screw, recorded at 1 kHz (A. Janot, M. Gautier, M. Brunot, *Data set and reference models of EMPS*,
2019). The data may not be passed on; this example runs where ``../shared/data/emps`` is there.
"""

# %%
# The published base model has an inertia, viscous and Coulomb friction and an offset. What it lacks is friction that
# differs with the direction.

from pathlib import Path
from tempfile import mkdtemp

import hilfit

data = Path.cwd().parents[2] / "shared" / "data" / "emps"
if data.is_dir():
    from benchmarks.measured.emps import MACHINE, files

    folder = Path(mkdtemp())
    recordings = files(data, folder)
    machine = hilfit.Machine.load(MACHINE)
    result = hilfit.identify(machine, **{role: [recordings[role]] for role in ("train", "repeat", "validate")})
    print(result.report["loop"]["verdict"])
    for effect in result.report["loop"]["effects"]:
        print(effect["id"], [round(float(p["value"]), 3) for p in effect["parameters"].values()])
    errors = result.report["errors"]["carriage"]
    print(
        f"error on the pulses: {errors['before']['validate']:.2f} N before, {errors['after']['validate']:.2f} N after"
    )
else:
    result = None
    print("skipped: the measured data of EMPS is not beside the repository (../shared/data/emps)")

# %%
# Friction of the corrected model beside the published base model: Coulomb and viscous friction and an offset.

if result is not None:
    import matplotlib.pyplot as plt
    import numpy as np

    from benchmarks.measured.emps import PUBLISHED

    v = np.linspace(-0.2, 0.2, 400)
    still = np.zeros((400, 1))
    found = result.model.effort(np.full((400, 1), 0.1), v[:, None], still)[:, 0]
    published = PUBLISHED["Fv"] * v + PUBLISHED["Fc"] * np.sign(v) + PUBLISHED["offset"]
    fig, ax = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
    ax.plot(v, published, color="#b3541e", label="published base model")
    ax.plot(v, found, color="#1f6f8b", label="after the loop")
    ax.set(xlabel="speed [m/s]", ylabel="force at constant speed [N]")
    ax.legend()
