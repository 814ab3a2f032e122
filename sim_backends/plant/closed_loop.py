"""The simulated arm driven by pressures: forward dynamics, and a position controller that closes the loop.

:class:`sim_backends.plant.plant.Plant` takes the motion as given and computes its forces. Here the chambers push and
the arm moves: MuJoCo's inertia and bias forces, the cylinders' own laws, restless seals. The controller is what the
makers of such arms fit: proportional, integral and derivative on each piston's position, tuned to one effective mass,
and, if there is a table, the feedforward of its pressures.

Integration is semi-implicit with the friction's slope taken implicitly, so that dry friction holds still.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import mujoco
import numpy as np

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.controller import LOOP_DAMPING, LOOP_FREQUENCY
from sim_backends.plant.hydraulics import CylinderBank, chamber_pressures
from sim_backends.plant.linear_filter import ColouredNoise
from sim_backends.plant.motion import Motion, SplinePath
from sim_backends.plant.sensors import SensorChain
from sim_backends.plant.truth import SensorQuality, Truth

STEP = 1.0e-3  # s
#: Half-width of the smoothed Coulomb jump, m/s: what an integrator of this step can hold still.
FRICTION_SPEED = 1.0e-3
#: Piston position that a loop is at most off by without its integrator, m.
LOAD_ERROR = 10.0e-3
#: Seconds at the start pose before the motion, in which integrators find the load.
SETTLE_TIME = 6.0


@dataclass(frozen=True)
class Gains:
    """Of one position controller per piston: N/m, N s/m, N/(m s); arrays (J,)."""

    proportional: FloatArray
    derivative: FloatArray
    integral: FloatArray


@dataclass(frozen=True)
class Run:
    """A motion that was followed: (N, J) at the physics steps, from the motion's start on.

    Attributes
    ----------
    t : (N,) s
    wanted, q, qd : joint positions wanted and reached, and speeds
    x, force : piston positions, and forces of the chambers in N
    """

    t: FloatArray
    wanted: FloatArray
    q: FloatArray
    qd: FloatArray
    x: FloatArray
    force: FloatArray


class ClosedLoop:
    """A simulated arm of cylinders under a position controller.

    Parameters
    ----------
    machine, truth : what is declared, and what is true; every joint has a cylinder
    quality : how restless seals are; still if None
    rng : source of what is random
    """

    def __init__(
        self,
        machine: Machine,
        truth: Truth,
        quality: SensorQuality | None = None,
        rng: np.random.Generator | None = None,
    ) -> None:
        self.machine, self.truth = machine, truth
        self.arm = Arm(ArmDesign(machine, truth))
        self.bank = CylinderBank.of(machine, truth)
        if self.bank.driven.any():
            raise ValueError("every joint needs a cylinder")
        n = len(machine.joints)
        quality = quality or SensorQuality.perfect()
        self._restlessness = quality.disturbance * self.bank.f_c
        self._noise = ColouredNoise(quality.disturbance_time, STEP, n, rng or np.random.default_rng(0))
        self._mass = np.zeros((n, n))

    def gains(self, integral: bool = True) -> Gains:
        """Tune the controller: each loop as fast as the simulated machine's, for the mass at mid-range.

        A loop on little mass is made stiffer: so that neither dry friction nor what the load changes over the arm's
        poses leaves more than :data:`LOAD_ERROR` before the integrator has taken it.
        """
        limits = np.array([joint.limits.position for joint in self.machine.joints])
        poses = np.random.default_rng(0).uniform(limits[:, 0], limits[:, 1], (64, len(limits)))
        changes = np.ptp([self.holding(pose) for pose in poses], axis=0) + 2.0 * self.bank.f_c
        q = np.array([np.mean(joint.limits.position) for joint in self.machine.joints])
        mass = np.diag(self._dynamics(q, np.zeros_like(q))[0]) / self.lever(q) ** 2
        stiffness = np.maximum(mass * (2 * np.pi * LOOP_FREQUENCY) ** 2, changes / LOAD_ERROR)
        w = np.sqrt(stiffness / mass)
        return Gains(stiffness, 2 * LOOP_DAMPING * w * mass, 0.3 * w * stiffness * float(integral))

    def lever(self, q: FloatArray) -> FloatArray:
        """Compute lever arms (J,) at a pose."""
        return self._piston(q, np.zeros_like(q))[2]

    def holding(self, q: FloatArray) -> FloatArray:
        """Compute forces of the chambers (J,) in N that hold a pose, without friction."""
        still = np.zeros_like(q)
        x, _, lever = self._piston(q, still)
        return np.asarray(self.arm.effort(q[None], still[None], still[None])[0] / lever + self.bank.K * x)

    def tip_efforts(self, q: FloatArray, force: FloatArray) -> FloatArray:
        """Compute joint efforts (J,) of a force (3,) in N on the tip, in the axes of the base."""
        model, data = self.arm.model, self.arm.data
        data.qpos[:] = q
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        last = model.nbody - 1
        tail = np.array([self.machine.joints[-1].dh.a, 0.0, 0.0])
        jacobian = np.zeros((3, model.nv))
        mujoco.mj_jac(model, data, jacobian, None, data.xpos[last] + data.xmat[last].reshape(3, 3) @ tail, last)
        return np.asarray(jacobian.T @ force)

    def record(self, run: Run, quality: SensorQuality, rng: np.random.Generator) -> dict[str, FloatArray]:
        """Record the transducers in a run, at the machine's rate: time in s and a value (n,) per channel, SI."""
        step = round(1.0 / self.machine.rate_hz / STEP)
        part, bank, names = slice(step - 1, None, step), self.bank, [joint.name for joint in self.machine.joints]
        v = self.arm.piston(run.q, run.qd, np.zeros_like(run.q))[1]
        pressures = chamber_pressures(run.force, v, bank.head_area, bank.rod_area, self.truth.hydraulics)
        known = {
            "joint_position": run.q,
            "piston_position": run.x,
            "head_pressure": pressures[0],
            "rod_pressure": pressures[1],
        }
        supply = self.truth.hydraulics
        constant = {
            "oil_temperature": supply.ambient, "supply_pressure": supply.supply, "tank_pressure": supply.tank,
        }  # fmt: skip
        channels, count = self.machine.channels, len(run.t[part])
        ideal = np.stack(
            [
                np.full(count, constant.get(c.quantity, 0.0))
                if c.joint is None
                else known[c.quantity][part, names.index(c.joint)]
                for c in channels
            ],
            axis=1,
        )
        measured = SensorChain(self.machine, quality, rng)(ideal)
        return {"time": run.t[part]} | {channel.name: measured[:, k] for k, channel in enumerate(channels)}

    def _piston(self, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        x, v, _, lever = self.arm.piston(q[None], qd[None], np.zeros((1, len(q))))
        return x[0], v[0], lever[0]

    def _dynamics(self, q: FloatArray, qd: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Compute inertia (J, J), pistons included, and forces of speed and gravity (J,)."""
        model, data = self.arm.model, self.arm.data
        data.qpos[:], data.qvel[:] = q, qd
        mujoco.mj_fwdPosition(model, data)
        mujoco.mj_fwdVelocity(model, data)
        mujoco.mj_fullM(model, data, self._mass)
        return self._mass, data.qfrc_bias.copy()

    def follow(
        self,
        motion: Motion,
        gains: Gains,
        feedforward: Callable[[float], FloatArray] | None = None,
        external: Callable[[float, FloatArray], FloatArray] | None = None,
    ) -> Run:
        """Settle at the start of a motion of all joints, then follow it.

        Parameters
        ----------
        feedforward : forces of the chambers (J,) in N at a time of the motion; that which holds the start if None
        external : joint efforts (J,) from outside, N m, at a time of the motion and joint positions
        """
        order = [motion.joints.index(joint.name) for joint in self.machine.joints]
        path = SplinePath(motion.time, motion.positions[:, order])
        steps, settle = round(motion.duration / STEP), round(SETTLE_TIME / STEP)
        times = (np.arange(-settle, steps) + 1) * STEP
        position, speed, _ = path(np.maximum(times, 0.0))
        wanted_x, wanted_v, _, _ = self.arm.piston(position, speed * (times > 0)[:, None], np.zeros_like(position))
        q, qd = position[0].copy(), np.zeros(position.shape[1])
        start = self.holding(q)
        total, restless = np.zeros_like(q), self._restlessness * self._noise(len(times))
        kept: dict[str, list[FloatArray]] = {name: [] for name in ("q", "qd", "x", "force")}
        for k, now in enumerate(times.tolist()):
            x, v, lever = self._piston(q, qd)
            known = start if feedforward is None else feedforward(max(now, 0.0))
            total += STEP * gains.integral * (wanted_x[k] - x)
            push = gains.proportional * (wanted_x[k] - x) + gains.derivative * (wanted_v[k] - v)
            force = known + push + total
            outside = np.zeros_like(q) if external is None or now < 0 else external(now, q)
            qd = qd + STEP * self._acceleration(q, qd, x, v, lever, force - restless[k], outside)
            q = q + STEP * qd
            if k >= settle:
                for name, value in (("q", q), ("qd", qd), ("x", x), ("force", force)):
                    kept[name].append(value)
        arrays = {name: np.array(values) for name, values in kept.items()}
        return Run(np.asarray(times[settle:], dtype=np.float64), position[settle:], **arrays)

    def _acceleration(
        self,
        q: FloatArray,
        qd: FloatArray,
        x: FloatArray,
        v: FloatArray,
        lever: FloatArray,
        force: FloatArray,
        outside: FloatArray,
    ) -> FloatArray:
        bank = self.bank
        mass, bias = self._dynamics(q, qd)
        smooth = np.tanh(v / FRICTION_SPEED)
        root = np.cbrt(v * v / (1.0 + (FRICTION_SPEED / np.maximum(np.abs(v), 1e-12)) ** 2) + 1e-12)
        friction = bank.f_c * smooth + bank.f_v * v + bank.f_s * smooth * np.abs(np.cbrt(v)) + bank.c * v + bank.K * x
        slope = bank.f_c * (1.0 - smooth**2) / FRICTION_SPEED + bank.f_v + bank.c + bank.f_s / (3.0 * root)
        effort = lever * (force - friction) + outside - bias
        return np.asarray(np.linalg.solve(mass + STEP * np.diag(lever**2 * slope), effort))
