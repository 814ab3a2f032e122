"""The simulated machine: arm, cylinders, oil, controller and transducers, advanced in physics steps of 1 ms or less.

The motion is the controller's (:mod:`sim_backends.plant.controller`); MuJoCo computes the effort for it; the
cylinders' own laws, disturbances and undeclared effects decide what the chambers deliver; the valves split that
force into two chamber pressures. One :meth:`Plant.advance` handles any number of steps at once: a whole recording
offline, one acquisition period on the simulated buses.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from daq.errors import InputError
from daq.machine.machine_file import Machine
from daq.machine.quantities import MOTOR_QUANTITIES
from sim_backends.arrays import FloatArray
from sim_backends.plant import hydraulics
from sim_backends.plant.arm import Arm, ArmDesign
from sim_backends.plant.controller import Controller
from sim_backends.plant.linear_filter import ColouredNoise
from sim_backends.plant.motion import Motion
from sim_backends.plant.sensors import SensorChain
from sim_backends.plant.truth import SensorQuality, Truth
from sim_backends.undeclared import UNDECLARED, Block, EffectSpec, Place, Readings, UndeclaredEffect, check_spec

PHYSICS_RATE = 1000.0  # Hz, at least
RIGID_RATE = 200.0  # Hz, at least: the arm's effort is smooth and taken as linear in between
KNOCK_TIME = 0.04  # s, half a sine
GRIP_TIME = 0.4  # s that it takes to pick a payload up
PRESSURE_ROUNDS = 50  # at most, until a friction and the pressures that it makes agree
PRESSURE_FORCE = 1.0e-6  # N, to which they do
SETTLE_TIME = 2.0  # s at rest before an offline recording starts


@dataclass(frozen=True)
class StepSizes:
    """Division of an acquisition period."""

    dt: float  # s, physics step
    per_period: int  # physics steps in a period
    stride: int  # physics steps between two evaluations of the arm

    @classmethod
    def of(cls, rate_hz: float) -> StepSizes:
        """Compute steps for an acquisition at ``rate_hz``."""
        rigid = max(1, int(np.ceil(RIGID_RATE / rate_hz - 1e-9)))
        stride = max(1, int(np.ceil(PHYSICS_RATE / (rate_hz * rigid) - 1e-9)))
        return cls(1.0 / (rate_hz * rigid * stride), rigid * stride, stride)


class Plant:
    """One simulated machine, from power-on.

    Parameters
    ----------
    machine, truth : what is declared, and what is true
    undeclared : sequence of EffectSpec
        Effects that the machine file does not know.
    quality : SensorQuality
    rng : numpy.random.Generator
        Source of everything random; the same generator state gives the same machine. Disturbance, tracking,
        transducers and the hidden shapes of effects draw from separate streams, so adding an effect leaves the
        noise as it was.
    shapes : numpy.random.Generator, optional
        Another source for the hidden shapes of effects (pitch, centre, time constant): the same one for all
        recordings of one machine.
    """

    def __init__(
        self,
        machine: Machine,
        truth: Truth,
        *,
        undeclared: Sequence[EffectSpec] = (),
        quality: SensorQuality | None = None,
        rng: np.random.Generator,
        shapes: np.random.Generator | None = None,
    ) -> None:
        _fits(machine, truth)
        quality = quality or SensorQuality()
        self.machine = machine
        self.steps = StepSizes.of(machine.rate_hz)
        dt = self.steps.dt
        disturbance, knocks, tracking, sensors, own_shapes = rng.spawn(5)
        shapes = shapes or own_shapes
        design = ArmDesign(machine, truth)
        self.effects = [_effect(spec, machine, truth, dt, shapes) for spec in undeclared]
        for effect in self.effects:
            design = effect.redesign(design)
        self.design = design
        self.arm = Arm(design)
        self._bank = hydraulics.CylinderBank.of(machine, design.truth)
        drives = [design.truth.drives[j.name] for j in machine.joints if j.cylinder is None]
        self._drives = np.array([d.f_c for d in drives]), np.array([d.f_v for d in drives])
        count = len(machine.joints)
        coulomb = self._bank.f_c.copy()
        coulomb[self._bank.driven] = self._drives[0]
        self._restlessness = quality.disturbance * coulomb
        self._disturbance = ColouredNoise(quality.disturbance_time, dt, count, disturbance)
        self._knocks = _Knocks(quality.knock_rate, quality.knock_size * coulomb, dt, knocks)
        limits = np.array([joint.limits.position for joint in machine.joints])
        ends = np.sort(np.stack([self._pistons(limits[:, 0]), self._pistons(limits[:, 1])], axis=1), axis=1)
        self.controller = Controller(
            machine, ends, self._pistons, tracking=quality.tracking, dt=dt, grain=self.steps.per_period, rng=tracking
        )
        self._chain = SensorChain(machine, quality, sensors)
        names = [joint.name for joint in machine.joints]
        self._columns = [(c.quantity, None if c.joint is None else names.index(c.joint)) for c in machine.channels]
        self._elapsed = 0
        self._last_effort: dict[str, FloatArray] = {}

    def _pistons(self, q: FloatArray) -> FloatArray:
        row = q[None, :]
        return np.asarray(self.arm.piston(row, np.zeros_like(row), np.zeros_like(row))[0][0])

    @property
    def time(self) -> float:
        """Machine time in s since power-on."""
        return self._elapsed * self.steps.dt

    def set_clock(self, periods: int) -> None:
        """Set machine time to ``periods`` acquisition periods; slow effects (warming, creeping) start at 0."""
        self._elapsed = periods * self.steps.per_period

    def coming(self, most: int) -> int:
        """Count acquisition periods, at most ``most``, left of the controller's segment; all at rest."""
        return min(most, self.controller.remaining // self.steps.per_period) or most

    def advance(self, periods: int) -> FloatArray:
        """Run ``periods`` acquisition periods; measured values (periods, channels) in SI, taken at their ends."""
        return self.measured(self.sample(periods))

    def sample(self, periods: int) -> FloatArray:
        """Advance like :meth:`advance`, ideal transducers: no noise, no steps, no saturation."""
        rows, left = [], periods * self.steps.per_period
        while left > 0:
            n = min(left, self.controller.remaining or left)
            rows.append(self._ideal(n)[self.steps.per_period - 1 :: self.steps.per_period])
            left -= n
        return np.concatenate(rows)

    def measured(self, ideal: FloatArray) -> FloatArray:
        """Measure ideal values (periods, channels) with the transducers."""
        return self._chain(ideal)

    def _ideal(self, n: int) -> FloatArray:
        block, force, effort = self.step(n)
        readings = Readings(
            joint_position=block.q.copy(),
            piston_position=block.x.copy(),
            head_pressure=block.p1.copy(),
            rod_pressure=block.p2.copy(),
            cylinder_force=force,
            joint_effort=effort,
            supply_pressure=self._supply(block),
        )
        for effect in self.effects:
            effect.sense(block, readings)
        return self.channels(block, readings)

    def step(self, n: int) -> tuple[Block, FloatArray, FloatArray]:
        """Run ``n`` physics steps; the state, the hydraulic forces (n, J) in N and the joint efforts (n, J)."""
        reference = self.controller.advance(n)
        dt = self.steps.dt
        time = np.arange(self._elapsed + 1, self._elapsed + n + 1, dtype=np.float64) * dt
        self._elapsed += n
        p, v, a = reference.position, reference.speed, reference.acceleration
        if reference.pinned:
            q, qd, qdd = p, v, a
            x, v, a, lever = self.arm.piston(q, qd, qdd)
        else:
            q = np.tile(self.controller.park, (n, 1))
            qd = qdd = np.zeros_like(q)
            x, lever = p, self.arm.piston(q, qd, qdd)[3]
        zeros = np.zeros_like(q)
        temperature = hydraulics.oil_temperature(time, self.design.truth.hydraulics)
        block = Block(dt, time, reference.motion_time, reference.pinned, q, qd, qdd, x, v, a, lever, zeros,
                      temperature, zeros.copy(), zeros.copy())  # fmt: skip
        effort = self._effort(block) if reference.pinned else zeros.copy()
        force = self._forces(block, effort)
        return block, force, effort

    def _effort(self, block: Block) -> FloatArray:
        """Compute joint efforts (n, J) of the arm, without pistons' masses; set ``block.load``."""
        effort = self._rigid("rigid", block, block.q, block.qd, block.qdd)
        bent = [(e, d) for e in self.effects if (d := e.deflection(effort[:, e.joint])) is not None]
        if bent:
            q, qd, qdd = block.q.copy(), block.qd.copy(), block.qdd.copy()
            for effect, (angle, rate, change) in bent:
                q[:, effect.joint] -= angle
                qd[:, effect.joint] -= rate
                qdd[:, effect.joint] -= change
            effort = self._rigid("bent", block, q, qd, qdd)
        for effect in self.effects:
            extra = effect.joint_effort(block)
            if extra is not None:
                effort[:, effect.joint] += extra
        block.load = effort / block.lever
        return effort

    def _rigid(self, memory: str, block: Block, q: FloatArray, qd: FloatArray, qdd: FloatArray) -> FloatArray:
        """Interpolate MuJoCo's inverse dynamics between every ``stride``-th step, less the tendons' masses."""
        n, stride = len(q), self.steps.stride
        at = np.arange(stride - 1, n, stride)
        carried = np.clip((block.motion_time[at] - self.design.payload_from) / GRIP_TIME, 0.0, 1.0)
        sparse = self.arm.effort(q[at], qd[at], qdd[at], carried)
        _, _, a, lever = self.arm.piston(q[at], qd[at], qdd[at])
        sparse -= np.where(self.arm.has_tendon, lever * self._bank.m * a, 0.0)
        before = self._last_effort.get(memory, sparse[0])
        self._last_effort[memory] = sparse[-1]
        knots = np.concatenate([[-1], at])
        values = np.concatenate([before[None, :], sparse])
        steps = np.arange(n)
        return np.stack([np.interp(steps, knots, values[:, j]) for j in range(values.shape[1])], axis=1)

    def _forces(self, block: Block, effort: FloatArray) -> FloatArray:
        """Compute hydraulic forces (n, J) in N; set chamber pressures, complete drives' ``effort``."""
        bank = self._bank
        n = len(block.time)
        force = block.load + self._restlessness * self._disturbance(n) + self._knocks(n)
        force += bank.resistance(block.x, block.v, block.a)
        if bank.driven.any():
            driven = bank.driven
            rate = block.qd[:, driven]
            force[:, driven] += self._drives[0] * hydraulics.direction(rate, 1.0e-3) + self._drives[1] * rate
            effort[:, driven] = force[:, driven]
        for effect in self.effects:
            if not effect.feels_pressure:
                _push(effect, block, force)
        self._fill_chambers(block, force)
        pressed = [effect for effect in self.effects if effect.feels_pressure]
        free = force
        for _ in range(PRESSURE_ROUNDS if pressed else 0):
            before, force = force, free.copy()
            for effect in pressed:
                _push(effect, block, force)
            self._fill_chambers(block, force)
            if np.allclose(force, before, rtol=0.0, atol=PRESSURE_FORCE):
                break
        return force

    def _fill_chambers(self, block: Block, force: FloatArray) -> None:
        block.p1, block.p2 = hydraulics.chamber_pressures(
            force, block.v, self._bank.head_area, self._bank.rod_area, self.design.truth.hydraulics
        )

    def _supply(self, block: Block) -> FloatArray:
        bank = self._bank
        inflow = np.where(block.v > 0.0, block.v * bank.head_area, -block.v * bank.rod_area)
        flow = inflow[:, ~bank.driven].sum(axis=1)
        return hydraulics.supply_pressure(flow, self.design.truth.hydraulics)

    def channels(self, block: Block, readings: Readings) -> FloatArray:
        """Return ideal values (n, channels) of readings in a block, in the machine file's order."""
        n = len(block.time)
        out = np.empty((n, len(self._columns)))
        for k, (quantity, j) in enumerate(self._columns):
            if j is not None:
                out[:, k] = getattr(readings, quantity)[:, j]
            elif quantity == "oil_temperature":
                out[:, k] = block.temperature
            elif quantity == "supply_pressure":
                out[:, k] = readings.supply_pressure
            elif quantity == "tank_pressure":
                out[:, k] = self.design.truth.hydraulics.tank
            else:  # inclinometer: roll about the base's first axis, pitch about its second
                out[:, k] = self.design.tilt[0 if quantity == "base_roll" else 1]
        return out


class _Knocks:
    """Rare half-sine force spikes on each cylinder: stones, relief valves, somebody climbing on."""

    def __init__(self, rate: float, size: FloatArray, dt: float, rng: np.random.Generator) -> None:
        self._chance, self._size, self._rng = rate * dt, size, rng
        steps = max(2, round(KNOCK_TIME / dt))
        self._shape = np.sin(np.pi * (np.arange(steps) + 0.5) / steps)
        self._rest = np.zeros((0, len(size)))

    def __call__(self, n: int) -> FloatArray:
        steps, columns = len(self._shape), len(self._size)
        out = np.zeros((max(n + steps, len(self._rest)), columns))
        out[: len(self._rest)] = self._rest
        hits = self._rng.random((n, columns)) < self._chance
        for k, j in zip(*np.nonzero(hits), strict=True):
            out[k : k + steps, j] += self._rng.uniform(-1.0, 1.0) * self._size[j] * self._shape
        self._rest = out[n:]
        return out[:n]


def _push(effect: UndeclaredEffect, block: Block, force: FloatArray) -> None:
    """Add what the chambers overcome for an effect to hydraulic forces (n, J) in N, in place."""
    extra = effect.piston_force(block)
    if extra is not None:
        force[:, effect.joint] += extra


def _effect(spec: EffectSpec, machine: Machine, truth: Truth, dt: float, rng: np.random.Generator) -> UndeclaredEffect:
    check_spec(spec, machine)
    names = [joint.name for joint in machine.joints]
    joint = None if spec.joint is None else names.index(spec.joint)
    return UNDECLARED[spec.id](Place(machine, truth, joint, dt, rng.spawn(1)[0]), spec.size)


_NOT_SIMULATED = MOTOR_QUANTITIES | {"joint_velocity", "external_force"}


def _fits(machine: Machine, truth: Truth) -> None:
    if len(truth.links) != len(machine.joints):
        raise InputError(
            "sim_backends.truth_other_links", links=len(truth.links), machine=machine.name, joints=len(machine.joints)
        )
    for joint in machine.joints:
        known = truth.drives if joint.cylinder is None else truth.cylinders
        if joint.name not in known:
            what = "drives" if joint.cylinder is None else "cylinders"
            raise InputError("sim_backends.truth_lacks", table=what, joint=joint.name)
    for channel in machine.channels:
        if channel.quantity in _NOT_SIMULATED:
            raise InputError("sim_backends.quantity_not_simulated", channel=channel.name, quantity=channel.quantity)
    for joint in machine.joints:
        if joint.cylinder is not None and joint.cylinder.vented is not None:
            raise InputError("sim_backends.vented_not_simulated", joint=joint.name)
        if joint.drive is not None and (joint.drive.coupled or joint.drive.effort == "link_side"):
            raise InputError("sim_backends.coupled_not_simulated", joint=joint.name)


def record(
    machine: Machine,
    truth: Truth,
    motion: Motion,
    *,
    undeclared: Sequence[EffectSpec | tuple[str, str | None, float]] = (),
    quality: SensorQuality | None = None,
    rng: np.random.Generator,
    shapes: np.random.Generator | None = None,
) -> dict[str, FloatArray]:
    """Record ``motion`` once, without buses.

    The machine is switched on at rest in the motion's first pose, settles, and time 0 is where the motion starts.

    Parameters
    ----------
    machine, truth, undeclared, quality, rng, shapes : as for :class:`Plant`; an effect may be a tuple ``(id, joint,
        size)``
    motion : what the arm's controller follows

    Returns
    -------
    dict
        ``time`` in s and one array (n,) per channel name, in SI units.
    """
    both = record_beside_ideal(machine, truth, motion, undeclared=undeclared, quality=quality, rng=rng, shapes=shapes)
    return both[0]


def record_beside_ideal(
    machine: Machine,
    truth: Truth,
    motion: Motion,
    *,
    undeclared: Sequence[EffectSpec | tuple[str, str | None, float]] = (),
    quality: SensorQuality | None = None,
    rng: np.random.Generator,
    shapes: np.random.Generator | None = None,
) -> tuple[dict[str, FloatArray], dict[str, FloatArray]]:
    """Record as :func:`record` does, and with ideal transducers in the same run.

    Disturbances, knocks and tracking errors are in both; the transducers' noise, steps and saturation only in the
    first. The difference of two ideal tables, with an effect and without, is that effect's waveform and nothing else.
    """
    specs = [spec if isinstance(spec, EffectSpec) else EffectSpec(*spec) for spec in undeclared]
    plant = Plant(machine, truth, undeclared=specs, quality=quality, rng=rng, shapes=shapes)
    plant.controller.place(motion)
    periods = round(motion.duration * machine.rate_hz)
    settling = round(SETTLE_TIME * machine.rate_hz)
    plant.set_clock(-settling)
    settled = plant.sample(settling)
    plant.controller.follow(motion, at_once=True)
    ideal = np.concatenate([settled, plant.sample(periods)])
    measured = plant.measured(ideal)
    kept = slice(settling - 1, settling - 1 + periods)
    time = np.arange(periods) / machine.rate_hz

    def table(values: FloatArray) -> dict[str, FloatArray]:
        return {"time": time} | {channel.name: values[kept, k] for k, channel in enumerate(machine.channels)}

    return table(measured), table(ideal)
