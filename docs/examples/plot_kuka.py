"""
KUKA LWR: seven joints with torque sensors
==========================================

Recordings of FloBaRoID (LGPL-3.0): one motion twice, and another one. The torque sensors sit on the link side of the
gears. This example runs where ``../shared/data/kuka_lwr4`` is there.
"""

# %%
# No cylinder, no pressures: the same machine file describes an arm with motors and torque sensors.

from pathlib import Path

import hilfit

data = Path.cwd().parents[2] / "shared" / "data" / "kuka_lwr4"
if data.is_dir():
    machine = hilfit.Machine.load(data / "machine.yaml")
    result = hilfit.identify(
        machine,
        train=[data / "train.parquet"],
        repeat=[data / "repeat.parquet"],
        validate=[data / "validate.parquet"],
        loop=False,
    )
    print(result.report["reduction"])
    for joint, errors in result.report["errors"].items():
        print(f"{joint}  fitted {errors['before']['train']:.2f}  another motion {errors['before']['validate']:.2f} N m")
else:
    result = None
    print("skipped: the measured data of the KUKA LWR is not beside the repository (../shared/data/kuka_lwr4)")

# %%
# The motion does not tell all parameters: those have little of their own, and are from the prior.

if result is not None:
    for entry in result.report["rigid_body"]["parameters"]:
        if entry["told_by_data"] < 0.5:
            print(entry["name"], f"= {entry['value']:.3g} {entry['unit']}, {100 * entry['told_by_data']:.0f} % told")

# %%
# What the fit leaves of another motion beside the size of the efforts, joint by joint.

if result is not None:
    import matplotlib.pyplot as plt
    import numpy as np

    joints = list(result.report["errors"])
    fitted, unseen = (
        [result.report["errors"][joint]["before"][role] for joint in joints] for role in ("train", "validate")
    )
    place = np.arange(len(joints))
    fig, ax = plt.subplots(figsize=(6.4, 3.2), layout="constrained")
    ax.bar(place - 0.2, fitted, 0.4, color="#1f6f8b", label="fitted motion")
    ax.bar(place + 0.2, unseen, 0.4, color="#b3541e", label="another motion")
    ax.set(xticks=place, xticklabels=joints, ylabel="error [N m]")
    ax.legend()
