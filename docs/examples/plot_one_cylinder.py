"""
One cylinder on a bench
=======================

A single cylinder that carries a mass up and down: one prismatic joint. Its pressures say what it does; ``hilfit`` says
how it rubs.
"""

# %%
# The machine file, as text. ``direct`` is the linkage of a piston that is the joint.

from pathlib import Path
from tempfile import mkdtemp

import matplotlib.pyplot as plt
import numpy as np

import hilfit
from daq.machine.machine_file import load_machine
from sim_backends.plant.cases import make_case
from sim_backends.plant.truth import CylinderTruth, LinkTruth, Truth

folder = Path(mkdtemp())
path = folder / "bench.yaml"
path.write_text("""\
schema: hilfit/machine/1
name: bench
rate_hz: 50
gravity: [0.0, 0.0, -9.81]
joints:
  - name: slide
    type: prismatic
    dh: {a: 0.0, alpha: 0.0, d: 0.0, theta: 0.0}
    limits: {position: [0.02, 0.28], velocity: 0.2, acceleration: 0.8}
    cylinder: {bore: 0.05, rod: 0.028, stroke: 0.30, linkage: {type: direct}}
channels:
  - {name: slide.position, quantity: joint_position, joint: slide, unit: mm, noise_std: 0.003, resolution: 0.005}
  - {name: slide.head, quantity: head_pressure, joint: slide, unit: bar}
  - {name: slide.rod, quantity: rod_pressure, joint: slide, unit: bar}
""")
machine = hilfit.Machine.load(path)

# %%
# The simulator in place of the bench: 180 kg, and friction that the fit has to find.

truth = Truth(
    links=(LinkTruth(180.0, (0.0, 0.0, 0.0), (2.0, 0.0, 0.0, 2.0, 0.0, 2.0)),),
    cylinders={"slide": CylinderTruth(m=4.0, K=0.0, f_c=95.0, f_v=520.0, f_s=70.0)},
)
make_case(folder, (load_machine(path), truth), seed=1)
files = {
    "unloaded": [folder / "unloaded.parquet"],
    "train": [folder / "train-1.parquet", folder / "train-2.parquet"],
    "repeat": [folder / "repeat.parquet"],
    "validate": [folder / "validate.parquet"],
}
result = hilfit.identify(machine, **files)
print(result.report["loop"]["verdict"])
for name, (value, std, unit) in result.model.parameters.items():
    print(f"{name:12s} {value:9.2f} ± {std:6.2f} {unit}")

# %%
# Its friction curve beside the truth. Single parameters may trade with each other (viscous and cube root are alike at
# such speeds); the curve does not.

v = np.linspace(-0.2, 0.2, 400)
found = result.model.friction(np.full((400, 1), 0.15), v[:, None])[:, 0]
real = 95.0 * np.sign(v) + 520.0 * v + 70.0 * np.cbrt(v)
fig, ax = plt.subplots(figsize=(6.4, 3.6), layout="constrained")
ax.plot(1e3 * v, found, color="#1f6f8b", label="identified")
ax.plot(1e3 * v, real, "--", color="#333333", label="truth")
ax.set(xlabel="speed [mm/s]", ylabel="friction [N]")
ax.legend()
print(f"largest difference {np.abs(found - real).max():.1f} N")
