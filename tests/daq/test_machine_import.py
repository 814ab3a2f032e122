"""Machine files from URDF, xacro and MJCF: the table's poses against the models' own, and what is refused."""

from __future__ import annotations

import json
import xml.etree.ElementTree as ET
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest
import typer
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from typer.testing import CliRunner

from daq.commands import cli_machine
from daq.errors import InputError
from daq.kinematics import Chain, draft_machine, read_chain, table_of
from daq.kinematics.table import PARALLEL
from daq.machine.machine_check import check_machine
from daq.machine.machine_file import Machine, parse_machine

TX40 = Path(__file__).parents[2].parent / "shared" / "data" / "staubli_tx40" / "tx40_mdh_modified.urdf"


def transform(xyz: Any = (0, 0, 0), rotation: Rotation | None = None) -> np.ndarray:
    pose = np.eye(4)
    pose[:3, 3] = xyz
    if rotation is not None:
        pose[:3, :3] = rotation.as_matrix()
    return pose


def numbers(text: str | None, otherwise: str = "0 0 0") -> list[float]:
    return [float(part) for part in (text or otherwise).split()]


def urdf_pose(root: ET.Element, tip: str, q: dict[str, float]) -> np.ndarray:
    """Forward kinematics of a URDF, by scipy's Euler angles and rotation vectors."""
    above = {j.find("child").get("link"): j for j in root.findall("joint")}  # type: ignore[union-attr]
    pose = np.eye(4)
    while tip in above:
        joint = above[tip]
        origin = joint.find("origin")
        rpy = numbers(None if origin is None else origin.get("rpy"))
        step = transform(numbers(None if origin is None else origin.get("xyz")), Rotation.from_euler("xyz", rpy))
        axis = joint.find("axis")
        direction = np.array(numbers(None if axis is None else axis.get("xyz"), "1 0 0"))
        direction = direction / np.linalg.norm(direction)
        value = q.get(str(joint.get("name")), 0.0)
        if joint.get("type") in ("revolute", "continuous"):
            step = step @ transform(rotation=Rotation.from_rotvec(value * direction))
        elif joint.get("type") == "prismatic":
            step = step @ transform(value * direction)
        pose = step @ pose
        tip = joint.find("parent").get("link")  # type: ignore[union-attr, assignment]
    return pose


def table_pose(machine: Machine, q: np.ndarray) -> np.ndarray:
    """Pose of the last frame by the four elementary motions of the standard table, as documented."""
    pose = np.eye(4)
    for joint, value in zip(machine.joints, q, strict=True):
        turn, slide = (value, 0.0) if joint.type == "revolute" else (0.0, value)
        pose = pose @ transform((0, 0, joint.dh.d + slide), Rotation.from_rotvec([0, 0, joint.dh.theta + turn]))
        pose = pose @ transform((joint.dh.a, 0, 0), Rotation.from_rotvec([joint.dh.alpha, 0, 0]))
    return pose


def agrees(chain: Chain, pose: Any, tolerance: float = 1e-7) -> Machine:
    """The machine file's table moves as ``pose`` of joint values (n,) does, up to fixed transforms at both ends."""
    machine = parse_machine(draft_machine(chain, "test"))
    table = table_of(chain)
    rng = np.random.default_rng(1)
    for _ in range(4):
        q = rng.uniform(-2, 2, len(machine.joints))
        np.testing.assert_allclose(table.base @ table_pose(machine, q) @ table.end, pose(q), atol=tolerance)
    np.testing.assert_allclose(table.base[:3, :3] @ machine.gravity, chain.gravity, atol=1e-8)
    return machine


def test_the_urdf_file_of_the_tx40_gives_its_kinematics() -> None:
    if not TX40.exists():
        pytest.skip("shared/data is not beside the repository")
    root = ET.parse(TX40).getroot()
    chain = read_chain(TX40)
    names = [axis.name for axis in chain.axes]
    # The file rounds quarter turns to four digits; made exact, they move the tip by micrometres.
    machine = agrees(chain, lambda q: urdf_pose(root, chain.tip, dict(zip(names, q, strict=True))), 5e-5)
    rows = [(j.dh.a, j.dh.alpha, j.dh.d) for j in machine.joints]
    published = [(0, -np.pi / 2, 0.32), (0.225, 0, 0), (0, np.pi / 2, 0.035), (0, -np.pi / 2, 0.225), (0, np.pi / 2, 0)]
    np.testing.assert_allclose(rows[:5], published, atol=1e-9)
    assert machine.joints[0].limits.position == (-3.14, 3.14) and machine.joints[5].limits.velocity == 12.217


AXES = ["1 0 0", "0 1 0", "0 0 1", "0 0 -1", "0.3 -0.5 0.8"]


def urdf(seed: int, joints: int) -> str:
    """A random arm: axes at right angles or askew, parallel, in line, meeting; fixed joints between; a camera."""
    rng = np.random.default_rng(seed)
    parts, parent = ['<robot name="random arm">', '<link name="base"/>'], "base"
    for number in range(joints):
        for kind in ("fixed", rng.choice(["revolute", "prismatic", "continuous"])):
            rpy = [rng.choice([0, np.pi / 2, -np.pi / 2, 1.5708, np.pi, rng.uniform(-3, 3)]) for _ in range(3)]
            xyz = [rng.choice([0.0, 0.0, rng.uniform(-0.5, 0.5)]) for _ in range(3)]
            child = f"{kind}{number}"
            origin = f'<origin xyz="{" ".join(map(str, xyz))}" rpy="{" ".join(map(str, rpy))}"/>'
            ends = f'<parent link="{parent}"/><child link="{child}"/>'
            axis = f'<axis xyz="{rng.choice(AXES)}"/>' if rng.uniform() < 0.9 else ""
            limit = '<limit lower="-1.5" upper="2" velocity="0.7"/>' if kind != "continuous" else ""
            name = f"{'j' if kind != 'fixed' else 'f'}{number}"
            parts += [
                f'<link name="{child}"/>',
                f'<joint name="{name}" type="{kind}">{origin}{ends}{axis}{limit}</joint>',
            ]
            parent = child
    parts.append(
        '<link name="camera"/><joint name="c" type="fixed"><parent link="fixed0"/><child link="camera"/></joint>'
    )
    return "\n".join([*parts, "</robot>"])


@pytest.mark.slow
@given(st.integers(0, 1_000_000), st.integers(1, 7))
@settings(max_examples=40, deadline=None)
def test_random_urdf_chains(tmp_path_factory: pytest.TempPathFactory, seed: int, joints: int) -> None:
    path = tmp_path_factory.getbasetemp() / "random.urdf"
    path.write_text(urdf(seed, joints), encoding="utf-8")
    chain = read_chain(path)
    for one, other in zip(chain.axes, chain.axes[1:], strict=False):  # not between parallel and askew
        sine = np.linalg.norm(np.cross(one.direction, other.direction))
        assume(sine < PARALLEL or sine > 1e-2)
    root = ET.parse(path).getroot()
    names = [axis.name for axis in chain.axes]
    assert names == [f"j{number}" for number in range(joints)]
    exact = "1.5708" not in path.read_text(encoding="utf-8")
    machine = agrees(
        chain,
        lambda q: urdf_pose(root, chain.tip, dict(zip(names, q, strict=True))),
        # Quarter turns of four digits are 4e-6 rad off, six of them over some metres and radians.
        1e-7 if exact else 4e-4,
    )
    assert all(joint.limits.velocity in (0.7, 1.0) for joint in machine.joints)


def mjcf(seed: int, joints: int) -> str:
    rng = np.random.default_rng(seed)
    text, closing = "", ""
    for number in range(joints):
        euler = " ".join(str(rng.choice([0, 90, rng.uniform(-180, 180)])) for _ in range(3))
        position = " ".join(f"{rng.uniform(-0.4, 0.4):.6f}" for _ in range(3))
        text += f'<body name="b{number}" pos="{position}" euler="{euler}"><geom size="0.05" mass="1"/>'
        for part in range(1 + (rng.uniform() < 0.3)):
            kind = rng.choice(["hinge", "slide"])
            at = " ".join(f"{rng.uniform(-0.2, 0.2):.6f}" for _ in range(3))
            limit = 'range="-40 70" limited="true"' if rng.uniform() < 0.5 else ""
            ref = 'ref="0.3"' if rng.uniform() < 0.3 else ""
            text += f'<joint name="j{number}{part}" type="{kind}" axis="{rng.choice(AXES)}" pos="{at}" {limit} {ref}/>'
        closing = "</body>" + closing
    end = '<body name="tool" pos="0.1 0.2 0.3" euler="10 20 30"><geom size="0.01" mass="0.1"/></body>'
    option = '<option gravity="1 2 -9"/>'
    return (
        f'<mujoco model="random"><compiler angle="degree"/>{option}<worldbody>{text}{end}{closing}</worldbody></mujoco>'
    )


@pytest.mark.slow
@given(st.integers(0, 1_000_000), st.integers(1, 5))
@settings(max_examples=25, deadline=None)
def test_random_mjcf_chains_move_as_mujoco_moves_them(
    tmp_path_factory: pytest.TempPathFactory, seed: int, joints: int
) -> None:
    path = tmp_path_factory.getbasetemp() / "random.xml"
    path.write_text(mjcf(seed, joints), encoding="utf-8")
    chain = read_chain(path)
    for one, other in zip(chain.axes, chain.axes[1:], strict=False):
        sine = np.linalg.norm(np.cross(one.direction, other.direction))
        assume(sine < 1e-9 or sine > 1e-2)
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)

    def pose(q: np.ndarray) -> np.ndarray:
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        return transform(data.body("tool").xpos, Rotation.from_matrix(data.body("tool").xmat.reshape(3, 3)))

    machine = agrees(chain, pose)
    assert len(machine.joints) == model.njnt and chain.tip == "tool"
    for joint, limited, own in zip(machine.joints, model.jnt_limited, model.jnt_range, strict=True):
        if limited:
            np.testing.assert_allclose(joint.limits.position, own, rtol=1e-9)


GRIPPER = """<robot name="arm">
<link name="base"/><link name="upper"/><link name="hand"/><link name="left"/><link name="right"/><link name="sensor"/>
<joint name="shoulder" type="revolute"><parent link="base"/><child link="upper"/><axis xyz="0 0 1"/>
  <limit lower="-1" upper="1" velocity="2"/></joint>
<joint name="wrist" type="revolute"><origin xyz="0.5 0 0" rpy="1.57 0 0"/><parent link="upper"/><child link="hand"/>
  <axis xyz="0 0 1"/><limit lower="0" upper="0"/></joint>
<joint name="l" type="prismatic"><parent link="hand"/><child link="left"/><limit lower="0" upper="0.1"/></joint>
<joint name="r" type="prismatic"><parent link="hand"/><child link="right"/><limit lower="0" upper="0.1"/>
  <mimic joint="l"/></joint>
<joint name="s" type="fixed"><parent link="upper"/><child link="sensor"/></joint>
</robot>"""


def written(tmp_path: Path, text: str, name: str = "arm.urdf") -> Path:
    path = tmp_path / name
    path.write_text(text, encoding="utf-8")
    return path


def test_an_arm_that_branches_ends_where_it_is_told(tmp_path: Path) -> None:
    path = written(tmp_path, GRIPPER)
    with pytest.raises(InputError, match=r"arm\.urdf: the arm branches; .*--tip, one of left, right"):
        read_chain(path)
    chain = read_chain(path, "hand")
    assert [axis.name for axis in chain.axes] == ["shoulder", "wrist"] and chain.tip == "hand"
    assert chain.notes == ("wrist: its rpy was rounded to quarter turns, 1.57 0 0 rad",)
    text = draft_machine(chain, "arm.urdf")
    machine = parse_machine(text)
    assert machine.joints[0].dh.alpha == pytest.approx(np.pi / 2, abs=1e-9) and machine.joints[0].dh.a == 0.5
    assert "TODO: position, velocity, acceleration guessed" in text and "# wrist: its rpy was rounded" in text
    assert [axis.name for axis in read_chain(path, "left").axes] == ["shoulder", "wrist", "l"]
    with pytest.raises(InputError, match="there is no link 'fist'; one of left, right, sensor"):
        read_chain(path, "fist")
    with pytest.raises(InputError, match=r"joint 'r' mimics .* --tip"):
        read_chain(path, "right")
    with pytest.raises(InputError, match=r"no joint between 'base' and 'base' moves"):
        read_chain(path, "base")


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('<parent link="base"/>', "", "lacks its name, parent or child"),
        ('type="revolute"', 'type="floating"', "joint 'shoulder' is floating; .*--tip"),
        ('<axis xyz="0 0 1"/>', '<axis xyz="0 0 0"/>', "axis xyz is zero"),
        ('xyz="0.5 0 0"', 'xyz="0.5 0"', "origin xyz is '0.5 0'; write 3 numbers"),
        ('upper="1"', 'upper="one"', "limit upper is 'one'; write 1 number"),
        ('<link name="base"/>', '<link name="base"/><link name="lost"/>', "2 links without a parent"),
        ("</robot>", "", "is no XML"),
        ('<robot name="arm">', "<sdf>", "is no XML"),
    ],
)
def test_urdf_files_that_cannot_be(tmp_path: Path, old: str, new: str, words: str) -> None:
    path = written(tmp_path, GRIPPER.replace(old, new, 1))
    with pytest.raises(InputError, match=rf"arm\.urdf: .*{words}"):
        read_chain(path, "hand")


def test_files_that_are_no_arm(tmp_path: Path) -> None:
    with pytest.raises(InputError, match=r"unknown kind of file '\.step'"):
        read_chain(tmp_path / "arm.step")
    with pytest.raises(InputError, match="no such file"):
        read_chain(tmp_path / "arm.urdf")
    with pytest.raises(InputError, match="is <sdf>; a URDF file is <robot>"):
        read_chain(written(tmp_path, "<sdf/>", "arm.xml"))
    with pytest.raises(InputError, match="has no joints"):
        read_chain(written(tmp_path, "<robot/>"))
    with pytest.raises(InputError, match="MuJoCo cannot read it"):
        read_chain(written(tmp_path, "<mujoco><worldbody><bodi/></worldbody></mujoco>", "arm.xml"))
    free = '<mujoco><worldbody><body name="b"><freejoint/><geom size="1"/></body></worldbody></mujoco>'
    with pytest.raises(InputError, match=r"neither hinge nor slide; .*--tip"):
        read_chain(written(tmp_path, free, "arm.xml"))
    body = '<body name="{0}"><joint axis="0 0 1"/><geom size="1"/></body>'
    two = f"<mujoco><worldbody>{body.format('a')}{body.format('b')}</worldbody></mujoco>"
    with pytest.raises(InputError, match=r"branches; .* one of a, b"):
        read_chain(written(tmp_path, two, "arm.xml"))
    with pytest.raises(InputError, match="there is no body 'c'; one of a, b"):
        read_chain(written(tmp_path, two, "arm.xml"), "c")
    assert read_chain(written(tmp_path, two, "arm.xml"), "b").tip == "b"
    assert read_chain(written(tmp_path, GRIPPER, "arm.xml"), "hand").name == "arm"


XACRO = """<robot name="made" xmlns:xacro="http://www.ros.org/wiki/xacro">
<xacro:property name="length" value="0.4"/>
<xacro:macro name="arm_joint" params="number parent">
  <link name="l${number}"/>
  <joint name="j${number}" type="revolute"><origin xyz="${2 * length} 0 0"/><parent link="${parent}"/>
    <child link="l${number}"/><axis xyz="0 1 0"/><limit lower="-1" upper="1" velocity="1"/></joint>
</xacro:macro>
<link name="base"/>
<xacro:arm_joint number="1" parent="base"/>
<xacro:arm_joint number="2" parent="l1"/>
</robot>"""


def test_xacro_files_are_expanded(tmp_path: Path) -> None:
    chain = read_chain(written(tmp_path, XACRO, "arm.xacro"))
    machine = agrees(chain, chain.pose)
    assert [joint.name for joint in machine.joints] == ["j1", "j2"]
    assert machine.joints[0].dh.a == pytest.approx(0.8)
    broken = written(tmp_path, XACRO.replace("${2 * length}", "${2 * breadth}"), "arm.xacro")
    with pytest.raises(InputError, match=r"arm\.xacro: xacro cannot expand it \(.*breadth.*\); expand it where"):
        read_chain(broken)


def test_xacro_without_its_package_says_what_to_install(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(__import__("sys").modules, "xacro", None)
    with pytest.raises(InputError, match=r"pip install 'hilfit\[xacro\]', or expand it"):
        read_chain(written(tmp_path, XACRO, "arm.xacro"))


def run(*arguments: str) -> Any:
    app = typer.Typer()
    cli_machine.register(app)
    app.command("other")(lambda: None)
    return CliRunner().invoke(app, ["machine", "import", *arguments])


def test_the_command_writes_a_file_that_passes_the_check(tmp_path: Path) -> None:
    path, made = written(tmp_path, GRIPPER), tmp_path / "machine.yaml"
    done = run(str(path), "--tip", "hand", "-o", str(made))
    assert done.exit_code == 0, done.output
    assert "2 joints from base to hand" in done.output and "lines say TODO" in done.output
    result = check_machine(made)
    assert result.machine is not None and result.findings == ()
    again = run(str(path), "--tip", "hand", "-o", str(made))
    assert again.exit_code == 2 and "is there already; choose another name, or add --force" in again.stderr
    content = json.loads(run(str(path), "--tip", "hand", "-o", str(made), "--force", "--json").stdout)
    assert content["joints"] == ["shoulder", "wrist"] and len(content["notes"]) == 1
    missing = run(str(path), "-o", str(tmp_path / "other.yaml"))
    assert missing.exit_code == 2 and not (tmp_path / "other.yaml").exists()


def test_names_that_machine_files_do_not_allow_are_changed(tmp_path: Path) -> None:
    text = GRIPPER.replace('name="shoulder"', 'name="1st joint!"').replace('name="wrist"', 'name="1st joint?"')
    machine = parse_machine(draft_machine(read_chain(written(tmp_path, text), "hand"), "arm.urdf"))
    assert [joint.name for joint in machine.joints] == ["_1st_joint", "_1st_joint_2"]
