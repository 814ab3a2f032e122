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
        raise InputError("daq.mjcf_needs_mujoco", path=path) from None
    try:
        model = mujoco.MjModel.from_xml_path(str(path))
    except ValueError as error:
        raise InputError("daq.mjcf_not_readable", path=path, error=" ".join(str(error).split())) from None
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
                raise InputError("daq.mjcf_other_joint", path=path, name=name, body=names[body])
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
        raise InputError("daq.chain_without_motion_world", path=path, tip=names[chosen])
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
            raise InputError("daq.chain_no_body", path=path, tip=tip, ends=ends)
        return names.index(tip)
    moving = [body for body in range(1, model.nbody) if model.body_jntnum[body]]
    last_moving = [b for b in moving if not any(b in _way(model, other)[:-1] for other in moving)]
    if not last_moving:
        raise InputError("daq.chain_no_body_moves", path=path)
    if len(last_moving) > 1:
        ends = [names[body] for body in last_moving]
        raise InputError("daq.chain_branches", path=path, ends=ends)
    last = last_moving[0]
    while len(children := np.flatnonzero(model.body_parentid[1:] == last) + 1) == 1:
        last = int(children[0])
    return last
