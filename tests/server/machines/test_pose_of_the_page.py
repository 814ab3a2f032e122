"""The page draws arms with kinematics of its own; their poses are those of the identification, which shares no code.

Both read one file; ``python tests/server/machines/test_pose_of_the_page.py`` writes it anew.
"""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from daq import Machine, load_machine, parse_machine
from fitting.arm.geometry import link_frames

ROOT = Path(__file__).parents[3]
POSES = ROOT / "server" / "web" / "src" / "views" / "pose" / "poses.fixture.json"
#: Rows of a table: kind, a, alpha, d, theta. Joints of either kind about axes that are neither parallel nor upright.
ROWS = (
    ("revolute", 0.1, np.pi / 2, 0.6, 0.2),
    ("revolute", 0.8, -0.4, 0.05, -0.3),
    ("prismatic", 0.2, 0.7, 0.4, 0.5),
    ("revolute", 0.3, -np.pi / 2, -0.1, 1.1),
)


def mixed(convention: str) -> Machine:
    """An arm of :data:`ROWS`."""
    joints, channels = [], []
    for number, (kind, a, alpha, d, theta) in enumerate(ROWS, 1):
        name, turns = f"joint{number}", kind == "revolute"
        limits = {"position": [-1.0, 1.0], "velocity": 1.0, "acceleration": 1.0}
        dh = {"a": a, "alpha": alpha, "d": d, "theta": theta}
        joints.append({"name": name, "type": kind, "dh": dh, "limits": limits})
        for quantity, unit in (("joint_position", "rad" if turns else "m"), ("joint_effort", "N m" if turns else "N")):
            channels.append({"name": f"{name}.{quantity}", "quantity": quantity, "joint": name, "unit": unit})
    content = {
        "schema": "hilfit/machine/1",
        "name": convention,
        "rate_hz": 50,
        "convention": convention,
        "gravity": [0.0, 0.0, -9.81],
        "joints": joints,
        "channels": channels,
    }
    return parse_machine(json.dumps(content))


def cases() -> list[dict[str, Any]]:
    """Arms as the page reads them, positions, and the frames there."""
    arms = [load_machine(ROOT / "sim_backends" / "machines" / "folding_arm.yaml"), mixed("standard"), mixed("modified")]
    random = np.random.default_rng(5)
    found = []
    for arm in arms:
        q = random.uniform(-0.6, 0.6, len(arm.joints))
        joints = [
            {
                "name": joint.name,
                "type": joint.type,
                "dh": {name: getattr(joint.dh, name) for name in ("a", "alpha", "d", "theta")},
                "limits": {"position": list(joint.limits.position)},
            }
            for joint in arm.joints
        ]
        description = {"convention": arm.convention, "gravity": list(arm.gravity), "joints": joints}
        found.append({"arm": description, "q": q.tolist(), "frames": link_frames(arm, q).tolist()})
    return found


def test_the_poses_that_the_page_is_tested_with_are_true() -> None:
    for kept, now in zip(json.loads(POSES.read_text()), cases(), strict=True):
        assert kept["arm"] == now["arm"]
        assert kept["q"] == pytest.approx(now["q"])
        assert np.asarray(kept["frames"]) == pytest.approx(np.asarray(now["frames"]), abs=1e-12)


if __name__ == "__main__":
    POSES.write_text(json.dumps(cases(), indent=1) + "\n")
