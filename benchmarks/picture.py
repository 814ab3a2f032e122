"""The picture on the first screen of README and site: what one joint's model leaves, before and after the loop.

``python -m benchmarks.picture docs/_static/before-after.png`` (``make picture``): the arm of the demonstration,
offline, with friction that depends on the piston position at joint 2, which no file declares.
"""

from __future__ import annotations

import sys
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

import hilfit
from benchmarks.samples import identified
from fitting.arrays import FloatArray
from sim_backends.machines import default_machine
from sim_backends.plant.cases import make_case

JOINT, SIZE = "joint2", 850.0  # N/m
_BEFORE, _AFTER, _MEAN = "#b3541e", "#1f6f8b", "#222222"
_BINS = 24
_SEED = 4


def main(target: Path) -> None:
    """Simulate, identify without and with the loop, and draw."""
    with TemporaryDirectory(prefix="hilfit-picture-") as scratch:
        folder = Path(scratch)
        make_case(folder, default_machine(), _SEED, [("position_dependent_friction", JOINT, SIZE)])
        machine = hilfit.Machine.load(folder / "machine.yaml")
        results = [identified(folder, loop=loop) for loop in (False, True)]
        recording = hilfit.Recording.load(folder / "validate.parquet", machine, "validate")
        panels = [_panel(result, recording) for result in results]
    named = ", ".join(f"{e['id']} at {e['joint']}" for e in results[1].report["loop"]["effects"])
    print(f"the loop named: {named or 'nothing'}")
    target.parent.mkdir(parents=True, exist_ok=True)
    _draw(panels, target)
    print(f"{target}: {target.stat().st_size / 1000:.0f} kB")


def _panel(result: hilfit.Result, recording: hilfit.Recording) -> tuple[FloatArray, FloatArray, float]:
    """Collect piston position in mm and residual in N m of ``validate``'s moving rows; the error as reported."""
    found = result.model.predict(recording)
    joint = found.joints.index(JOINT)
    piston = np.interp(found.t, recording.time, recording.values[f"{JOINT}.piston_position"])
    moving = found.moving[:, joint]
    sign = np.sign(np.gradient(piston, found.t))[moving]
    error = result.report["errors"][JOINT]["after"]["validate"]
    return 1e3 * piston[moving], sign * found.residual[moving, joint], float(error)


def _draw(panels: list[tuple[FloatArray, FloatArray, float]], target: Path) -> None:
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure

    figure = Figure(figsize=(9.0, 3.3), layout="constrained", dpi=110, facecolor="white")
    FigureCanvasAgg(figure)
    axes: Any = figure.subplots(1, 2, sharex=True, sharey=True)
    titles = ("before: cylinders and rigid body", "after: friction named and added")
    for ax, (x, y, error), colour, title in zip(axes, panels, (_BEFORE, _AFTER), titles, strict=True):
        ax.plot(x, y, ".", color=colour, markersize=2.5, alpha=0.5)
        parts = np.array_split(np.argsort(x, kind="stable"), _BINS)
        ax.plot([x[p].mean() for p in parts], [y[p].mean() for p in parts], color=_MEAN, linewidth=1.6)
        ax.set_title(f"{title}\nerror on an unseen motion {error:.2g} N m", fontsize=10)
        ax.set_xlabel("piston position of joint 2 [mm]")
        ax.grid(color="#dddddd", linewidth=0.6)
        ax.set_axisbelow(True)
        ax.spines[["top", "right"]].set_visible(False)
    axes[0].set_ylabel("measured − predicted,\nagainst the motion [N m]")
    reach = float(np.quantile(np.abs(panels[0][1]), 0.995))
    axes[0].set_ylim(-1.15 * reach, 1.15 * reach)
    figure.savefig(target, metadata={"Software": None})


if __name__ == "__main__":
    if len(sys.argv) != 2:
        sys.exit("benchmarks.picture: give the file to write, as in: python -m benchmarks.picture before-after.png")
    main(Path(sys.argv[1]))
