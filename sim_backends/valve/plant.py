"""The valve plant: spools, oil and load advanced together, any number of machines side by side.

Per axis the oil of two chambers and the motion of the joint, per machine the supply line::

    C_k(x) dp_k/dt = Q_in,k - Q_out,k - losses_k - a_k v        k = head, rod;  a = (A1, -A2)
    M(q) q'' + h(q, q') = r (sum_k a_k p_k - resistance(x, v))   x = x(q), v = r q'
    C_s dp_s/dt = Q_pump(p_s) - sum Q_in

Edges with a small drop and small chambers make this stiff. It is advanced by ROS2, a linearly implicit method of two
stages (Verwer, Spee, Blom and Hundsdorfer, SIAM J. Sci. Comput. 20, 1999): L-stable, and of second order whatever
Jacobian it is given, so the Jacobian here holds only what is stiff: slopes of the flows, oil against mass, friction,
end stops. Its linear system is reduced by hand to one of the size of the joints. Arrays have machines last: (J, P),
chambers (2, J, P); a command is held over a step.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from sim_backends.arrays import FloatArray
from sim_backends.valve.chambers import Chambers, Pumps
from sim_backends.valve.lands import Lands
from sim_backends.valve.load import Pose, load_of
from sim_backends.valve.spools import Spools
from sim_backends.valve.truth import CylinderOil, ValvePlantTruth

STEP = 1.0e-3  # s
GAMMA = 1.0 - np.sqrt(0.5)
REST_PRESSURE = 5.0e5  # Pa above tank in the chamber that does not hold the load, of a machine placed at rest


@dataclass(frozen=True)
class PlantState:
    """Everything that flows and moves at one moment.

    Attributes
    ----------
    time : (P,) s since power-on
    q, qd, x, v : (J, P) joints and pistons, rad or m, and per second
    stroke : (J, P) of the spools, fraction of full
    pressure : (2, J, P) Pa of head and rod chambers
    supply, tank : (P,) Pa
    temperature : (P,) K
    """

    time: FloatArray
    q: FloatArray
    qd: FloatArray
    x: FloatArray
    v: FloatArray
    stroke: FloatArray
    pressure: FloatArray
    supply: FloatArray
    tank: FloatArray
    temperature: FloatArray


@dataclass(frozen=True)
class Flows:
    """Flows of the oil at one moment, m^3/s.

    Attributes
    ----------
    lands : (2, 2, J, P) into and out of, head and rod chamber
    lost : (2, J, P) leaving a chamber elsewhere (negative: made up from tank)
    pump : (P,)
    """

    lands: FloatArray
    lost: FloatArray
    pump: FloatArray


@dataclass
class _Point:
    """Integrated values: joints, pressures, the supply, openings of counterbalance valves, the pump's aim."""

    q: FloatArray
    qd: FloatArray
    p: FloatArray
    supply: FloatArray
    held: FloatArray
    aim: FloatArray

    def plus(self, factor: float, slope: _Point) -> _Point:
        return _Point(
            *(own + factor * other for own, other in zip(vars(self).values(), vars(slope).values(), strict=True))
        )


@dataclass
class _Slopes:
    """Right-hand sides at a point, and what the Jacobian there is made of; ``effort`` is ``M q''``."""

    effort: FloatArray
    rates: _Point
    pose: Pose
    own: FloatArray
    across: FloatArray
    inward: FloatArray
    lever: FloatArray
    over_v: FloatArray
    over_x: FloatArray
    capacity: FloatArray
    pump: FloatArray


class ValvePlant:
    """Machines with valves, advanced side by side from rest.

    Parameters
    ----------
    machines : P pairs of a machine file and its truth; all with the same number and kind of joints
    dt : float
        Step in s; delays are whole steps.
    power_on : (P,) array, optional
        Seconds since power-on at which each machine starts (how warm its oil is).
    rngs : P generators, optional
        What restless pilot stages draw from; without them all are calm.
    """

    def __init__(
        self,
        machines: Sequence[tuple[Machine, ValvePlantTruth]],
        dt: float = STEP,
        power_on: npt.ArrayLike = 0.0,
        rngs: Sequence[np.random.Generator] | None = None,
    ) -> None:
        names = [[joint.name for joint in machine.joints] for machine, _ in machines]
        truths = [truth for _, truth in machines]
        valves = [[t.valves[name] for name in row] for t, row in zip(truths, names, strict=True)]
        oils = [[t.cylinders[name] for name in row] for t, row in zip(truths, names, strict=True)]
        supplies, fluids = [t.supply for t in truths], [t.oil for t in truths]
        self.dt = dt
        self.shape = (len(names[0]), len(machines))
        self._load = load_of([(machine, truth.links) for machine, truth in machines])
        self._spools = Spools([[valve.spool for valve in row] for row in valves], dt, rngs)
        self._lands = Lands(valves, oils)
        self._chambers = Chambers([machine for machine, _ in machines], oils, valves, fluids, supplies)
        self._pumps = Pumps(supplies, fluids)
        self._counterbalance = _Counterbalances.of(oils, self.shape)
        self._ambient, self._heating, self._warm_up = (
            np.array([getattr(fluid, key) for fluid in fluids]) for key in ("ambient", "heating", "warm_up")
        )
        self.time = np.broadcast_to(np.asarray(power_on, dtype=np.float64), self.shape[1:]).copy()
        limits = np.array([[joint.limits.position for joint in machine.joints] for machine, _ in machines])
        zeros = np.zeros(self.shape)
        self._at = _Point(zeros, zeros, np.zeros((2, *self.shape)), zeros[0], np.zeros((2, *self.shape)), zeros[0])
        self._conductance = self._lands.conductance(self._spools.stroke, self._warmth())
        self.place(self._load.pose(limits.mean(axis=2).T).x)

    def place(self, x: npt.ArrayLike, speed: npt.ArrayLike = 0.0) -> None:
        """Put pistons (J, P) somewhere (m), with pressures that hold the load there at rest; spools are left as is.

        ``speed`` (J, P) is that of the joints at this moment, in rad/s or m/s.
        """
        x = np.broadcast_to(np.asarray(x, dtype=np.float64), self.shape)
        q = self._load.joint(x)
        zeros = np.zeros(self.shape)
        chambers, pose = self._chambers, self._load.pose(q)
        force = pose.bias(zeros) / pose.lever + chambers.spring * x
        least = chambers.tank + REST_PRESSURE
        head, rod = chambers.area[0], -chambers.area[1]
        first = np.maximum((force + least * rod) / head, least)
        p = np.stack([first, (first * head - force) / rod])
        aim = self._pumps.wanted(p, np.zeros(p.shape, dtype=bool))
        qd = np.broadcast_to(np.asarray(speed, dtype=np.float64), self.shape).copy()
        self._at = _Point(q.copy(), qd, p, aim.copy(), self._counterbalance.wanted(p), aim)

    def step(self, command: npt.ArrayLike) -> None:
        """Advance by ``dt`` under commands (J, P), fractions of full, that are sent now."""
        stroke = self._spools.stroke
        self._spools.step(np.broadcast_to(np.asarray(command, dtype=np.float64), self.shape), self._warmth())
        self.time = self.time + self.dt
        before, self._conductance = self._conductance, self._lands.conductance(self._spools.stroke, self._warmth())
        here = self._slopes(self._at, before, stroke)
        solve = _Solver(here, self, GAMMA * self.dt)
        first = solve(here.rates, here.effort)
        there = self._at.plus(self.dt, first)
        rates = self._slopes(there, self._conductance, self._spools.stroke)
        acceleration = _solved(self._mass(rates.pose), rates.effort)
        second = rates.rates.plus(-2.0, first)
        second = solve(second, _times(solve.mass, acceleration - 2.0 * first.qd))
        self._at = self._at.plus(1.5 * self.dt, first).plus(0.5 * self.dt, second)
        np.clip(self._at.held, 0.0, 1.0, out=self._at.held)

    @property
    def state(self) -> PlantState:
        """Present state."""
        at = self._at
        pose = self._load.pose(at.q)
        temperature = self._ambient + self._heating * self._warmth()
        return PlantState(self.time, at.q, at.qd, pose.x, pose.lever * at.qd, self._spools.stroke, at.p, at.supply,
                          self._chambers.tank, temperature)  # fmt: skip

    def flows(self) -> Flows:
        """Compute where the oil goes now."""
        lands, _ = self._through(self._at, self._conductance)
        lost = self._chambers.losses(self._at.p, self._spools.stroke)[0]
        return Flows(lands, lost, self._pumps.flow(self._at.supply, self._at.aim)[0])

    def kinetic_energy(self) -> FloatArray:
        """Compute the energy of arm and pistons, (P,) in J."""
        qd = self._at.qd
        return np.asarray(0.5 * (qd * _times(self._mass(self._load.pose(self._at.q)), qd)).sum(axis=0))

    def _warmth(self) -> FloatArray:
        return np.asarray(1.0 - np.exp(-np.maximum(self.time, 0.0) / self._warm_up))

    def _mass(self, pose: Pose) -> FloatArray:
        """Compute mass matrices (J, J, P) with the pistons'."""
        full = pose.mass.copy()
        for j in range(self.shape[0]):
            full[j, j] += self._chambers.mass[j] * pose.lever[j] ** 2
        return full

    def _through(self, at: _Point, conductance: FloatArray) -> tuple[FloatArray, FloatArray]:
        drop = np.stack([at.supply - at.p, at.p - self._chambers.tank])
        return self._lands.flow(conductance, drop, at.held)

    def _slopes(self, at: _Point, conductance: FloatArray, stroke: FloatArray) -> _Slopes:
        chambers, pumps = self._chambers, self._pumps
        pose = self._load.pose(at.q)
        x, lever = pose.x, pose.lever
        v = lever * at.qd
        force, over_v, over_x = chambers.resistance(x, v)
        effort = lever * ((chambers.area * at.p).sum(axis=0) - force - chambers.mass * pose.bend * at.qd**2)
        effort -= pose.bias(at.qd)
        flow, slope = self._through(at, conductance)
        out, own, across = chambers.losses(at.p, stroke)
        capacity = chambers.capacity(x)
        rates = _Point(
            q=at.qd,
            qd=at.qd,  # replaced by what the solver makes of ``effort``
            p=(flow[0] - flow[1] - out - chambers.area * v) / capacity,
            supply=np.empty(0),
            held=(self._counterbalance.wanted(at.p) - at.held) / self._counterbalance.lag,
            aim=(pumps.wanted(at.p, conductance[0] > 0.0) - at.aim) / pumps.lag,
        )
        pump, falls = pumps.flow(at.supply, at.aim)
        rates.supply = (pump - flow[0].sum(axis=(0, 1))) / pumps.capacity
        return _Slopes(
            effort, rates, pose, own + slope.sum(axis=0), across, slope[0], lever, over_v, over_x, capacity, falls
        )


@dataclass(frozen=True)
class _Counterbalances:
    """Load-holding valves on chambers, (2, J, P); where there is none the opening is 1."""

    setting: FloatArray
    ratio: FloatArray
    span: FloatArray
    lag: FloatArray

    @classmethod
    def of(cls, oils: Sequence[Sequence[CylinderOil]], shape: tuple[int, int]) -> _Counterbalances:
        setting, ratio = np.full((2, *shape), -np.inf), np.zeros((2, *shape))
        span, lag = np.ones((2, *shape)), np.full((2, *shape), 0.02)
        for p, row in enumerate(oils):
            for j, oil in enumerate(row):
                held = oil.counterbalance
                if held is not None:
                    k = ("head", "rod").index(held.chamber)
                    setting[k, j, p], ratio[k, j, p] = held.setting, held.ratio
                    span[k, j, p], lag[k, j, p] = held.span, held.lag
        return cls(setting, ratio, span, lag)

    def wanted(self, p: FloatArray) -> FloatArray:
        """Compute the openings 0 to 1 that the pressures ask for."""
        return np.asarray(np.clip((p + self.ratio * p[::-1] - self.setting) / self.span, 0.0, 1.0))


class _Solver:
    """``(1 - a J) k = f`` for the Jacobian at one point, ``a = gamma dt``, reduced to the joints.

    A chamber's ``k_p = P + S k_s - V k_v`` follows from the 2 x 2 systems of the axes; the supply's
    ``k_s = alpha - sum_j w_j k_v,j`` from its own row; what is left is
    ``(M + a (over_v r^2 + a over_x r^2 + sum_k a_k r V_k)) k_v + a sum_k a_k r S_k (sum_j w_j k_v,j) = ...``.
    """

    def __init__(self, here: _Slopes, plant: ValvePlant, a: float) -> None:
        self._a, self._here, self._plant = a, here, plant
        self.mass = plant._mass(here.pose)
        share = a / here.capacity
        self._diagonal = 1.0 + share * here.own
        self._cross = share * here.across
        self._determinant = self._diagonal[0] * self._diagonal[1] - self._cross[0] * self._cross[1]
        self._force = plant._chambers.area * here.lever  # effort of a joint per pressure
        self._V = self._of_axis(share * self._force)
        self._S = self._of_axis(share * here.inward)
        supply = a / plant._pumps.capacity
        self._of_supply = 1.0 + supply * (here.pump + (here.inward * (1.0 - self._S)).sum(axis=(0, 1)))
        self._draw = supply * here.inward  # of k_s per k_p
        self._w = (self._draw * self._V).sum(axis=0) / self._of_supply
        matrix = self.mass.copy()
        stiff = a * here.lever**2 * (here.over_v + a * here.over_x) + a * (self._force * self._V).sum(axis=0)
        self._lift = a * (self._force * self._S).sum(axis=0)
        matrix += self._lift[:, None] * self._w
        for j in range(len(stiff)):
            matrix[j, j] += stiff[j]
        self._matrix = matrix

    def _of_axis(self, f: FloatArray) -> FloatArray:
        """Solve the 2 x 2 system of each axis' chambers for right-hand sides (2, J, P)."""
        return np.asarray((self._diagonal[::-1] * f + self._cross * f[::-1]) / self._determinant)

    def __call__(self, rates: _Point, effort: FloatArray) -> _Point:
        """Solve slopes ``k`` for ``rates``, whose ``qd`` is given as ``effort = M q''``."""
        a, here = self._a, self._here
        alone = self._of_axis(rates.p)
        alpha = (rates.supply + (self._draw * alone).sum(axis=(0, 1))) / self._of_supply
        known = effort + a * (self._force * alone).sum(axis=0) + self._lift * alpha
        known -= a * here.lever**2 * here.over_x * rates.q
        k_v = _solved(self._matrix, known)
        k_s = alpha - (self._w * k_v).sum(axis=0)
        return _Point(
            q=rates.q + a * k_v,
            qd=k_v,
            p=alone + self._S * k_s - self._V * k_v,
            supply=k_s,
            held=rates.held / (1.0 + a / self._plant._counterbalance.lag),
            aim=rates.aim / (1.0 + a / self._plant._pumps.lag),
        )


def _times(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Multiply matrices (J, J, P) with vectors (J, P)."""
    return np.asarray((matrix * vector).sum(axis=1))


def _solved(matrix: FloatArray, vector: FloatArray) -> FloatArray:
    """Solve (J, J, P) systems by elimination without pivoting: mass matrices are positive definite."""
    matrix, vector = matrix.copy(), vector.copy()
    count = len(vector)
    for k in range(count):
        for i in range(k + 1, count):
            factor = matrix[i, k] / matrix[k, k]
            matrix[i, k + 1 :] -= factor * matrix[k, k + 1 :]
            vector[i] -= factor * vector[k]
    for k in reversed(range(count)):
        for i in range(k + 1, count):
            vector[k] -= matrix[k, i] * vector[i]
        vector[k] /= matrix[k, k]
    return vector
