"""Pictures of linkages: piston position and lever arm over the joint's range, as SVG."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.machine.travel import Travel, travel_of

_INCHES = (7.0, 2.6)  # of one joint: x(q) and r(q) side by side
_STROKE, _CURVE, _LEVER = "#9aa5b1", "#1f5fa8", "#b3541e"


def draw_linkages(machine: Machine, target: Path) -> list[Path]:
    """Draw every joint that has a cylinder.

    Parameters
    ----------
    target : a file ``.svg`` for all of them, or a folder, which then gets one file per joint

    Returns
    -------
    list
        What was written.

    Raises
    ------
    InputError
        If no joint has a cylinder, or the file has another ending.
    """
    travels = [travel_of(joint) for joint in machine.joints if joint.cylinder is not None]
    if not travels:
        raise InputError("daq.draw_without_cylinder", machine=machine.name)
    if target.suffix.lower() == ".svg":
        _save(_figure(travels), target)
        return [target]
    if target.suffix and not target.is_dir():
        raise InputError("daq.picture_not_svg", target=target)
    target.mkdir(parents=True, exist_ok=True)
    written = []
    for travel in travels:
        path = target / f"{travel.joint.name}.svg"
        _save(_figure([travel]), path)
        written.append(path)
    return written


def _figure(travels: list[Travel]) -> Any:
    from matplotlib.figure import Figure

    figure = Figure(figsize=(_INCHES[0], _INCHES[1] * len(travels)), layout="constrained")
    axes = figure.subplots(len(travels), 2, squeeze=False)
    for (left, right), travel in zip(axes, travels, strict=True):
        assert travel.joint.cylinder is not None and travel.x is not None and travel.r is not None
        name, kind = travel.joint.name, travel.joint.cylinder.linkage.type
        q, unit = (np.degrees(travel.q), "deg") if travel.revolute else (1e3 * travel.q, "mm")
        left.plot(q, 1e3 * travel.x, color=_CURVE)
        for end, text in ((0.0, "retracted"), (1e3 * travel.joint.cylinder.stroke, "extended")):
            left.axhline(end, color=_STROKE, linewidth=0.8, linestyle="--")
            left.annotate(text, (q[-1], end), ha="right", va="bottom", fontsize=7, color=_STROKE)
        left.set_title(f"{name}: piston ({kind})", fontsize=9, loc="left")
        left.set_ylabel("x [mm]", fontsize=8)
        right.plot(q, (1e3 if travel.revolute else 1.0) * travel.r, color=_LEVER)
        low, high = right.get_ylim()
        if low * high < 0 or min(abs(low), abs(high)) < 0.3 * max(abs(low), abs(high)):
            right.axhline(0.0, color=_STROKE, linewidth=0.8, linestyle="--")
        right.set_title(f"{name}: lever arm", fontsize=9, loc="left")
        right.set_ylabel("r = dx/dq [mm/rad]" if travel.revolute else "r = dx/dq", fontsize=8)
        for ax in (left, right):
            ax.set_xlabel(f"q [{unit}]", fontsize=8)
            ax.tick_params(labelsize=7)
            ax.grid(color="#e3e7eb", linewidth=0.6)
            ax.spines[["top", "right"]].set_visible(False)
    return figure


def _save(figure: Any, path: Path) -> None:
    import matplotlib

    with matplotlib.rc_context({"svg.hashsalt": "hilfit", "svg.fonttype": "none"}):  # the same file every time
        figure.savefig(path, format="svg", metadata={"Date": None})
