"""
Excavator front with pins
=========================

Boom and stick are described by the pins that were measured on the machine, the bucket by its four-bar linkage. The
simulator stands in for the machine; its stick cylinder rubs harder toward the end of its stroke, and nobody says so to
the fit.
"""

# %%
# The machine file is beside this script, and so is what the plant really weighs, which only the plant reads.

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import hilfit
from daq.machine.machine_file import load_machine
from sim_backends.plant.cases import make_case
from sim_backends.plant.truth import load_truth

here = Path.cwd()  # where this script and the machine file are
machine = hilfit.Machine.load(here / "excavator.yaml")
print(machine.name, machine.joints)

# %%
# Where the pistons are, and their lever arms, over the joints' travel: look at this before anything else.

fig, axes = plt.subplots(1, 2, figsize=(9, 3.4), layout="constrained")
for joint in machine.content.joints:
    q = np.linspace(*joint.limits.position, 100)
    x = joint.cylinder.linkage.piston_position(q)
    axes[0].plot(np.degrees(q), 1e3 * x, label=joint.name)
    axes[1].plot(np.degrees(q), 1e3 * np.gradient(x, q))
axes[0].set(xlabel="joint position [deg]", ylabel="piston position [mm]")
axes[1].set(xlabel="joint position [deg]", ylabel="lever arm [mm]")
axes[0].legend()

# %%
# Five recordings of 60 s: rods unpinned, two training motions, one of them again, and another motion to judge by. With
# a machine of your own these are the files of ``hilfit record``.

folder = Path(mkdtemp())
plant = load_machine(here / "excavator.yaml"), load_truth(here / "excavator.truth.yaml")
make_case(folder, plant, seed=3, undeclared=[("position_dependent_friction", "stick", 250.0)])
files = {
    "unloaded": [folder / "unloaded.parquet"],
    "train": [folder / "train-1.parquet", folder / "train-2.parquet"],
    "repeat": [folder / "repeat.parquet"],
    "validate": [folder / "validate.parquet"],
}

# %%
# Identify, and let the loop look for what is missing.

result = hilfit.identify(machine, **files)
report = result.report
print(report["reduction"])
print(report["loop"]["verdict"])
for effect in report["loop"]["effects"]:
    print(effect["id"], "at", effect["joint"], "with probability", round(effect["probability"], 3))

# %%
# Errors on the motion that no fit has seen.

for joint, errors in report["errors"].items():
    floor, before, after = errors["noise_floor"], errors["before"]["validate"], errors["after"]["validate"]
    print(f"{joint:7s} noise floor {floor:6.2f}  before {before:6.2f}  after {after:6.2f} {errors['unit']}")

# %%
# What the model says of a motion, and how sure it is.

recording = hilfit.Recording.load(files["validate"][0], machine, "validate")
predicted = result.model.predict(recording)
fig, ax = plt.subplots(figsize=(9, 3.2), layout="constrained")
stick, rows = machine.joints.index("stick"), slice(500, 1000)
t = predicted.t[rows]
ax.plot(t, predicted.measured[rows, stick], color="#333333", linewidth=0.8, label="measured")
ax.plot(t, predicted.predicted[rows, stick], color="#1f6f8b", linewidth=0.8, label="predicted")
ax.set(xlabel="time [s]", ylabel="stick effort [N m]")
ax.legend()

# %%
# Take it along: one file, or a URDF with links that can exist.

result.model.save(folder / "model.json")
for line in result.model.export("urdf", folder / "excavator.urdf"):
    print("not in a URDF:", line)
