"""Serial chains from MuJoCo models (MJCF): MuJoCo itself reads the file, with its defaults, classes and includes."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from daq.errors import InputError
from daq.kinematics.chain import Axis, Chain


def mjcf_chain(path: Path, tip: str | None) -> Chain:
    """Read the chain from the world to the body ``tip``, or to the only end that moves.

    Raises
    ------
    InputError
        With file, joint or body, and the cure.
    """
    try:
        import mujoco
    except ImportError:
        raise InputError(f"{path}: MJCF files need MuJoCo: pip install 'hilfit[sim]', or give a URDF file") from None
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError(f"{path}: MuJoCo cannot read it: {' '.join(str(error).split())}") from None
    names = [mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_BODY, body) or f"body{body}" for body in range(model.nbody)]
    chosen = _tip(model, names, path, tip)
    bodies = _way(model, chosen)
    data = mujoco.MjData(model)
    data.qpos[:] = 0.0  # zero as the file counts, whatever pose it was drawn in
    hinge, slide, free, ball = (int(getattr(mujoco.mjtJoint, f"mjJNT_{k}")) for k in ("HINGE", "SLIDE", "FREE", "BALL"))
    for start, kind in zip(model.jnt_qposadr, model.jnt_type, strict=True):
        if kind in (free, ball):  # elsewhere in the model: a quaternion that turns nothing
            data.qpos[start + (3 if kind == free else 0)] = 1.0
    mujoco.mj_kinematics(model, data)
    axes, notes = list[Axis](), list[str]()
    for body in bodies:
        for joint in range(model.body_jntadr[body], model.body_jntadr[body] + model.body_jntnum[body]):
            name = mujoco.mj_id2name(model, mujoco.mjtObj.mjOBJ_JOINT, joint) or f"joint{joint}"
            kind = int(model.jnt_type[joint])
            if kind not in (hinge, slide):
                raise InputError(
                    f"{path}: joint '{name}' of body '{names[body]}' is neither hinge nor slide; an arm stands on the "
                    "ground: fix its base, or end the chain before it with --tip"
                )
            low, high = (float(value) for value in model.jnt_range[joint])
            axes.append(
                Axis(
                    name,
                    "revolute" if kind == hinge else "prismatic",
                    data.xanchor[joint].copy(),
                    data.xaxis[joint].copy(),
                    (low, high) if model.jnt_limited[joint] and low < high else None,
                    None,
                )
            )
    if not axes:
        raise InputError(f"{path}: no joint between the world and '{names[chosen]}' moves; choose another --tip")
    end = np.eye(4)
    end[:3, :3], end[:3, 3] = data.xmat[chosen].reshape(3, 3), data.xpos[chosen]
    label = model.names[: model.names.find(b"\0")].decode() or path.stem
    gravity = np.array(model.opt.gravity, dtype=float)
    return Chain(label, "world", names[chosen], tuple(axes), end, gravity, tuple(notes))


def _way(model: Any, body: int) -> list[int]:
    way = []
    while body > 0:
        way.append(body)
        body = int(model.body_parentid[body])
    return way[::-1]


def _tip(model: Any, names: list[str], path: Path, tip: str | None) -> int:
    parents = {int(parent) for parent in model.body_parentid[1:]}
    if tip is not None:
        if tip not in names[1:]:
            ends = [names[b] for b in range(1, model.nbody) if b not in parents]
            raise InputError(f"{path}: there is no body '{tip}'; one of {', '.join(ends)}")
        return names.index(tip)
    moving = [body for body in range(1, model.nbody) if model.body_jntnum[body]]
    last_moving = [b for b in moving if not any(b in _way(model, other)[:-1] for other in moving)]
    if not last_moving:
        raise InputError(f"{path}: no body moves; give a model of an arm")
    if len(last_moving) > 1:
        listed = ", ".join(names[body] for body in last_moving)
        raise InputError(f"{path}: the arm branches; choose where it ends with --tip, one of {listed}")
    last = last_moving[0]
    while len(children := np.flatnonzero(model.body_parentid[1:] == last) + 1) == 1:
        last = int(children[0])
    return last
