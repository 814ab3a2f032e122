"""Small arms, motions and recordings with known parameters, for the tests of the identification.

The forces are put together here: rigid body from :func:`arm_examples.inverse_dynamics` (itself tested against
another library), friction and stiffness written out as in the issue of the model. Nothing here filters or
differentiates: positions, speeds and accelerations come from the same sums of sines.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cache
from typing import Any

import numpy as np
import yaml
from arm_examples import inverse_dynamics

from daq.machine.machine_file import Machine, parse_machine
from daq.recordings.recording import Recording
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.linkage import lever_arm, piston_motion
from fitting.effects.base import Effect
from fitting.loop.session import Options, Session
from fitting.regression.design import Design, build_design
from fitting.residual.terms import Term, extra_columns
from fitting.residual.views import SegmentViews, Views
from fitting.signals.filters import filter_bank
from fitting.signals.preparation import PositionNoise, Segment, segments_of

RATE = 50.0
DRIVE = ("m", "K", "f_c", "f_v", "f_s")
EXACT = PositionNoise(0.0, 0.0, 0.0)
#: Recordings of one session, in this order: role, seed of the motion.
USUAL = (("unloaded", 1), ("train", 2), ("repeat", 2), ("validate", 3))
#: Most replicas for a candidate: a third of the default, which samples, demonstration and ``hilfit bench attribution``
#: have. With 18 a search takes half as long again, and names the same.
REPLICAS = 6


def planar_machine(
    n: int = 2, *, sensors: str = "both", effort: str = "pressures", kinds: str | None = None, name: str = "test-arm"
) -> Machine:
    """``n`` parallel horizontal axes (or what ``kinds`` says: ``R``, ``P``; lower case without a cylinder).

    ``sensors`` is ``both``, ``joint`` or ``piston``; ``effort`` is ``pressures`` or ``cylinder_force``.
    """
    kinds = kinds or "R" * n
    joints: list[dict[str, Any]] = []
    channels: list[dict[str, Any]] = []
    for i, kind in enumerate(kinds):
        joint = f"joint{i + 1}"
        revolute = kind in "Rr"
        twist = 0.0 if set(kinds) <= set("Rr") else np.pi / 2
        content: dict[str, Any] = {
            "name": joint,
            "type": "revolute" if revolute else "prismatic",
            "dh": {"a": 0.8 - 0.15 * i, "alpha": twist * (i % 2), "d": 0.0, "theta": 0.0},
            "limits": {"position": [-0.6, 0.6] if revolute else [0.05, 0.35], "velocity": 0.8, "acceleration": 3.0},
        }
        position, pushed = ("rad", "N m") if revolute else ("m", "N")
        if kind.isupper():
            linkage = {"type": "three_pin", "a": 0.45, "b": 0.16, "offset": 1.7, "retracted": 0.37}
            content["cylinder"] = {
                "bore": 0.08,
                "rod": 0.045,
                "stroke": 0.3 if revolute else 0.4,
                "damping": 150.0,
                "linkage": linkage if revolute else {"type": "direct"},
            }
            if sensors in ("both", "piston"):
                channels.append({"name": f"{joint}.x", "quantity": "piston_position", "joint": joint, "unit": "m"})
            if effort == "pressures":
                for chamber in ("head", "rod"):
                    quantity = f"{chamber}_pressure"
                    channels.append({"name": f"{joint}.{chamber}", "quantity": quantity, "joint": joint, "unit": "Pa"})
            else:
                channels.append({"name": f"{joint}.force", "quantity": "cylinder_force", "joint": joint, "unit": "N"})
        else:
            channels.append({"name": f"{joint}.effort", "quantity": "joint_effort", "joint": joint, "unit": pushed})
        if sensors in ("both", "joint") or kind.islower():
            channels.append({"name": f"{joint}.q", "quantity": "joint_position", "joint": joint, "unit": position})
        joints.append(content)
    return parse_machine(
        yaml.safe_dump(
            {
                "schema": "hilfit/machine/1",
                "name": name,
                "rate_hz": RATE,
                "gravity": [0.0, -9.81, 0.0],
                "joints": joints,
                "channels": channels,
            }
        )
    )


@dataclass(frozen=True)
class Truth:
    """What an arm really is: inertial parameters (10 n,), and per joint ``m K f_c f_v f_s`` (n, 5)."""

    pi: np.ndarray
    drive: np.ndarray

    def theta(self, machine: Machine) -> np.ndarray:
        """In the order of a design of a machine whose joints all have cylinders."""
        return np.concatenate([self.drive.ravel(), reduce_parameters(machine).from_standard(self.pi)])


def truth(n: int, seed: int = 7) -> Truth:
    """Links of a few ten kilograms; friction of some ten newtons."""
    rng = np.random.default_rng(seed)
    pi = []
    for i in range(n):
        m = 40.0 / (i + 1)
        c = np.array([-0.35 + 0.05 * rng.normal(), 0.03 * rng.normal(), 0.0])
        central = m * 0.05 * np.eye(3)
        about = central + m * (c @ c * np.eye(3) - np.outer(c, c))
        pi.append([m, *(m * c), *about[np.triu_indices(3)]])
    drive = np.array([[6.0, 500.0, 90.0, 900.0, 60.0]]) * rng.uniform(0.8, 1.2, (n, 5))
    return Truth(np.array(pi).ravel(), drive)


@dataclass(frozen=True)
class Motion:
    """Joint motion (N, n) and the motion of the driving elements, exact."""

    t: np.ndarray
    q: np.ndarray
    qd: np.ndarray
    qdd: np.ndarray
    x: np.ndarray
    v: np.ndarray
    a: np.ndarray
    r: np.ndarray
    loaded: bool


def sines(n: int, seconds: float, seed: int, moving: Sequence[int] | None = None) -> tuple[np.ndarray, ...]:
    """Time (N,), and numbers in [-1, 1] with two derivatives, (N, n): five sines of 0.04 to 0.35 Hz per column."""
    rng = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    f = rng.uniform(0.04, 0.35, (n, 5))
    phase = rng.uniform(0, 2 * np.pi, (n, 5))
    size = rng.uniform(0.5, 1.0, (n, 5)) / (f / 0.1 + 1.0)
    size /= size.sum(axis=1, keepdims=True)
    if moving is not None:
        size[[j for j in range(n) if j not in moving]] = 0.0
    w = 2 * np.pi * f
    angle = w[None] * t[:, None, None] + phase[None]
    return (
        t,
        (size * np.sin(angle)).sum(2),
        (size * w * np.cos(angle)).sum(2),
        (-size * w**2 * np.sin(angle)).sum(2),
    )


def make_motion(
    machine: Machine, role: str, seed: int, seconds: float = 40.0, moving: Sequence[int] | None = None
) -> Motion:
    """A motion within the limits; unloaded ones move the pistons of an arm that is parked at mid-range."""
    n = len(machine.joints)
    t, u, ud, udd = sines(n, seconds, seed, moving)
    middle = np.array([np.mean(j.limits.position) for j in machine.joints])
    half = np.array([np.diff(j.limits.position)[0] / 2 for j in machine.joints]) * 0.9
    if role == "unloaded":
        q, still = np.tile(middle, (len(t), 1)), np.zeros_like(u)
        stroke = np.array([0.0 if j.cylinder is None else j.cylinder.stroke for j in machine.joints])
        x, v, a = stroke / 2 + 0.45 * stroke * u, 0.45 * stroke * ud, 0.45 * stroke * udd
        r = np.stack([_lever(machine, j, q[:, j]) for j in range(n)], axis=1)
        for j, joint in enumerate(machine.joints):
            if joint.cylinder is None:
                x[:, j], v[:, j], a[:, j] = q[:, j], 0.0, 0.0
        return Motion(t, q, still, still, x, v, a, r, False)
    q, qd, qdd = middle + half * u, half * ud, half * udd
    x, v, a = q.copy(), qd.copy(), qdd.copy()
    for j, joint in enumerate(machine.joints):
        if joint.cylinder is not None:
            x[:, j], v[:, j], a[:, j] = piston_motion(joint.cylinder.linkage, q[:, j], qd[:, j], qdd[:, j])
    r = np.stack([_lever(machine, j, q[:, j]) for j in range(n)], axis=1)
    return Motion(t, q, qd, qdd, x, v, a, r, True)


def _lever(machine: Machine, joint: int, q: np.ndarray) -> np.ndarray:
    cylinder = machine.joints[joint].cylinder
    return np.ones_like(q) if cylinder is None else lever_arm(cylinder.linkage, q)


def force(machine: Machine, arm: Truth, motion: Motion) -> np.ndarray:
    """Drive efforts (N, n): ``m a + (c + f_v) v + K x + f_c sgn v + f_s |v|^(1/3) sgn v + tau / r``.

    A joint without a cylinder has ``f_c sgn v + f_v v`` only, in its own unit.
    """
    total = np.zeros_like(motion.q)
    for j, joint in enumerate(machine.joints):
        m, K, f_c, f_v, f_s = arm.drive[j]
        v, s = motion.v[:, j], np.sign(motion.v[:, j])
        total[:, j] = f_c * s + f_v * v
        if joint.cylinder is not None:
            total[:, j] += m * motion.a[:, j] + joint.cylinder.damping * v + K * motion.x[:, j]
            total[:, j] += f_s * np.cbrt(v)
    if motion.loaded:
        total += inverse_dynamics(machine, arm.pi, motion.q, motion.qd, motion.qdd) / motion.r
    return total


def exact_segment(motion: Motion, effort: np.ndarray, role: str, recording: int = 0) -> Segment:
    """A segment as preparation would give it if filters and sensors were perfect."""
    nothing = np.full_like(motion.q, np.nan)
    return Segment(
        recording=recording,
        role=role,
        start=0,
        t=motion.t,
        q=motion.q,
        qd=motion.qd,
        qdd=motion.qdd,
        x=motion.x,
        v=motion.v,
        a=motion.a,
        r=motion.r,
        effort=effort,
        p1=nothing,
        p2=back_pressure(motion),
        rest=np.zeros(motion.q.shape, dtype=bool),
        loaded=motion.loaded,
        temperature=None,
        gap=nothing,
    )


def back_pressure(motion: Motion) -> np.ndarray:
    """Rod pressures (N, n) in Pa: a return line that throttles."""
    return 6e5 + 2e6 * motion.v + 1e6 * np.sin(2 * np.pi * motion.t / 17.0)[:, None] * motion.v


def exact_design(
    machine: Machine, arm: Truth, recordings: Sequence[tuple[str, int]] = USUAL, bandwidth: float = 3.0, **motion: Any
) -> Design:
    """A design over perfect signals without noise."""
    segments = []
    for number, (role, seed) in enumerate(recordings):
        moved = make_motion(machine, role, seed, **motion)
        segments.append(exact_segment(moved, force(machine, arm, moved), role, number))
    bank = filter_bank(RATE, bandwidth)
    return build_design(machine, reduce_parameters(machine), bank, [EXACT] * len(machine.joints), segments)


def exact_views(machine: Machine, arm: Truth, **options: Any) -> tuple[Design, Views]:
    """A design over perfect signals and its views at the true parameters."""
    design = exact_design(machine, arm, **options)
    return design, SegmentViews(design, arm.theta(machine), design.indices("unloaded", "train", "repeat"))


def injected(
    machine: Machine,
    arm: Truth,
    effect: Effect,
    joint: int | None,
    shape: dict[str, float],
    values: Sequence[float],
    recordings: Sequence[tuple[str, int]] = USUAL,
    **motion: Any,
) -> list[np.ndarray]:
    """What an effect of this size adds to the drive efforts of the recordings, (N, n) each.

    Columns that hold the model's force are built until the force with the effect in it agrees with itself.
    """
    design, views = exact_views(machine, arm, recordings=recordings, **motion)
    fitted = design.indices("unloaded", "train", "repeat")
    term = Term(effect, joint, shape)
    theta = np.concatenate([arm.theta(machine), values])
    for _ in range(6 if effect.uses_model else 1):
        extra = extra_columns(design, views, [term])
        views = SegmentViews(design, theta, fitted, extra)
    added = []
    for index in range(len(design.segments)):
        own = [
            np.zeros(len(design.segments[index])) if c is None else c @ np.asarray(values)
            for c in (extra.columns[j][index] for j in range(len(machine.joints)))
        ]
        added.append(np.stack(own, axis=1))
    return added


@dataclass(frozen=True)
class Noise:
    """Standard deviations: position sensors (rad or m), white force noise and AR(1) force disturbance (N)."""

    joint: float = 2e-5
    piston: float = 1e-5
    white: float = 8.0
    slow: float = 3.0
    pole: float = 0.9


QUIET = Noise(0.0, 0.0, 0.0, 0.0)


def disturbance(rng: np.random.Generator, samples: int, noise: Noise) -> np.ndarray:
    """White noise and a first-order one, (samples,)."""
    slow = np.zeros(samples)
    drive = rng.normal(size=samples) * noise.slow * np.sqrt(1 - noise.pole**2)
    state = noise.slow * rng.normal()
    for k in range(samples):
        state = noise.pole * state + drive[k]
        slow[k] = state
    return slow + noise.white * rng.normal(size=samples)


def sample(
    machine: Machine,
    motion: Motion,
    effort: np.ndarray,
    role: str,
    seed: int,
    noise: Noise | None = None,
    joint_reading: Callable[[int, np.ndarray], np.ndarray] = lambda joint, q: q,
    late: dict[int, float] | None = None,
    number: int = 0,
) -> Recording:
    """What the machine's sensors say of a motion and its drive efforts.

    ``joint_reading`` maps true to measured joint positions; ``late`` gives the delay of a joint's effort in seconds.
    """
    noise = noise or Noise()
    rng = np.random.default_rng([seed, number])
    values: dict[str, np.ndarray] = {}
    samples = len(motion.t)
    rods = back_pressure(motion)
    for j, joint in enumerate(machine.joints):
        measured = effort[:, j] + disturbance(rng, samples, noise)
        rod = rods[:, j] + 2000.0 * np.sign(noise.white) * rng.normal(size=samples)  # the head chamber takes it up
        delay = (late or {}).get(j, 0.0)
        if delay:
            measured, rod = (np.interp(motion.t - delay, motion.t, signal) for signal in (measured, rod))
        for channel in (c for c in machine.channels if c.joint == joint.name):
            if channel.quantity == "joint_position":
                value = joint_reading(j, motion.q[:, j]) + noise.joint * rng.normal(size=samples)
            elif channel.quantity == "piston_position":
                value = motion.x[:, j] + noise.piston * rng.normal(size=samples)
            elif channel.quantity == "head_pressure":
                assert joint.cylinder is not None
                value = (measured + rod * joint.cylinder.rod_area) / joint.cylinder.head_area
            elif channel.quantity == "rod_pressure":
                value = rod
            else:
                value = measured
            values[channel.name] = value
    return Recording(
        machine=machine.name,
        role=role,
        file=f"{role}-{number}.parquet",
        sha256=f"{role}-{number}",
        rate_hz=machine.rate_hz,
        time=motion.t,
        values=values,
    )


def make_recordings(
    machine: Machine,
    arm: Truth,
    recordings: Sequence[tuple[str, int]] = USUAL,
    *,
    added: Sequence[np.ndarray] | None = None,
    noise: Noise | None = None,
    seed: int = 1,
    seconds: float = 40.0,
    moving: Sequence[int] | None = None,
    **sensors: Any,
) -> list[Recording]:
    """Recordings of an arm, one per (role, seed of the motion); ``added`` goes on top of the drive efforts."""
    result = []
    for number, (role, motion_seed) in enumerate(recordings):
        motion = make_motion(machine, role, motion_seed, seconds, moving if role != "unloaded" else None)
        effort = force(machine, arm, motion)
        if added is not None:
            effort = effort + added[number]
        result.append(sample(machine, motion, effort, role, seed, noise, number=number, **sensors))
    return result


def make_session(machine: Machine, arm: Truth, *args: Any, options: Options | None = None, **kwargs: Any) -> Session:
    """A session of :func:`make_recordings`."""
    return Session(machine, make_recordings(machine, arm, *args, **kwargs), options or Options(bootstrap=REPLICAS))


@cache
def clean_session(n: int = 2) -> Session:
    """An arm with nothing missing, shared by tests that only read it."""
    return make_session(planar_machine(n), truth(n))


def shifted(recording: Recording, samples: int) -> Recording:
    """The recording without its first ``samples`` rows: the same motion, started later."""
    cut = {name: value[samples:] for name, value in recording.values.items()}
    return replace(recording, time=recording.time[samples:] - recording.time[samples], values=cut)


def prepare(*given: Any, **options: Any) -> tuple[Segment, ...]:
    """All segments of :func:`fitting.signals.preparation.segments_of`."""
    return tuple(segments_of(*given, **options))
