"""Rigid-body dynamics that are linear in the inertial parameters: ``tau = Y(q, q', q'') pi``.

``tau = M(q) q'' + C(q, q') q' + G(q)`` by Newton and Euler, from the Denavit-Hartenberg table. The parameters
of link ``i``, in its frame ``i`` (of whichever convention the table is in, :mod:`fitting.arm.geometry`), are in this
order::

    m  mx  my  mz  Ixx  Ixy  Ixz  Iyy  Iyz  Izz

mass (kg), first moments ``m c`` (kg m), and the inertia about the frame's origin (kg m^2; ``Ixy`` is the
matrix entry, ``-integral of x y dm``). Then ``pi`` is (10 n,), link after link. The *standard* parameters are
13 per joint: these ten, then ``f_c`` (times sgn q'), ``f_v`` (times q') and the drive inertia ``J`` (times
q''). A motor that turns with several joints (:attr:`fitting.arm.geometry.Geometry.coupled`) adds three: with
``w = sum c_k q'_k`` its speed referred to its own joint, ``c_k (f_cm sgn w + f_vm w + Jm w')`` on every joint ``k``.

How the regressor is computed. Link ``i`` needs the force ``f = m a + B h`` and, about the frame's origin, the
moment ``n = h x a + I w' + w x (I w)``, where ``h`` are the first moments, ``a`` the acceleration of the
origin less gravity, ``w`` the angular velocity and ``B = S(w') + S(w) S(w)``. A joint ``j <= i`` that gives
link ``i`` the angular velocity ``u`` and its origin the velocity ``s`` per unit of joint speed feels ``s . f
+ u . n``; that is linear in the ten parameters, so::

    m:  s . a        h:  B' s + a x u        I:  u . (I w' + w x (I w))

where the second factors belong to the link alone and are computed once for all joints.

Everything is kept as one array over the samples per vector component, and a component that is zero for every
sample (half of them with twists of 0 and 90 degrees, nearly all of them for a planar arm) is the float 0.0
and skipped.

Sources: Khalil and Dombre, *Modeling, Identification and Control of Robots*, 2002, chapters 9 and 12;
Siciliano et al.,
*Robotics*, 7.3 (the velocities per unit of joint speed are the columns of the link's Jacobian).
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from daq.machine.machine_file import Machine
from fitting.arm.expected import expected_sign
from fitting.arm.geometry import Geometry, geometry_of, link_frames
from fitting.arrays import FloatArray, IntArray

Component = float | FloatArray  # one component of a vector, over the samples; exactly 0.0 where it vanishes
Vector = tuple[Component, Component, Component]

LINK_PARAMETERS = ("m", "mx", "my", "mz", "Ixx", "Ixy", "Ixz", "Iyy", "Iyz", "Izz")
JOINT_PARAMETERS = (*LINK_PARAMETERS, "f_c", "f_v", "J")

# Samples per pass: long enough that the arithmetic outweighs the calls, short enough for the caches.
_CHUNK = 16384
_CHECKED = 20  # states of the self-check
COUPLED_PARAMETERS = ("f_cm", "f_vm", "Jm")
_ZERO: Vector = (0.0, 0.0, 0.0)
_Units = list[tuple[Vector, Vector]]  # per joint: angular velocity of the link and velocity of its frame's origin


def rigid_body_regressor(
    machine: Machine | Geometry,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    *,
    columns: Sequence[int] | IntArray | None = None,
    gravity: npt.ArrayLike | None = None,
) -> FloatArray:
    """Compute the regressor of the rigid-body dynamics, for all samples at once.

    Parameters
    ----------
    machine : arm of ``n`` joints
    q, qd, qdd : joint positions, speeds and accelerations, shape (N, n); rad or m, per second, per second squared
    columns : which of the ``10 n`` columns to compute (e.g. the independent ones of a base set); all if None
    gravity : acceleration of gravity in the base frame instead of the machine's, m/s^2; shape (3,), or (N, 3) where the
        base tilts while it moves

    Returns
    -------
    ndarray
        ``Y`` with ``tau = Y pi``, shape (N, n, number of columns), N m (N) per unit of the parameter. Its
        memory runs along the samples, so that :func:`stacked` costs nothing.

    Raises
    ------
    ValueError
        If the shapes do not fit the machine.
    """
    geometry = geometry_of(machine)
    n = geometry.joints
    motion = [_samples(geometry, values, what) for values, what in ((q, "q"), (qd, "qd"), (qdd, "qdd"))]
    chosen = np.arange(10 * n) if columns is None else np.asarray(columns, dtype=np.intp)
    if chosen.size and (chosen.min() < 0 or chosen.max() >= 10 * n):
        raise ValueError(f"columns must be 0 to {10 * n - 1}, not {chosen.min()} to {chosen.max()}")
    g = geometry.gravity if gravity is None else np.asarray(gravity, dtype=float)
    samples = motion[0].shape[0]
    if g.shape not in ((3,), (samples, 3)):
        raise ValueError(f"gravity has shape {g.shape}; it must be (3,) or ({samples}, 3)")
    places: list[list[tuple[int, int]]] = [[] for _ in range(n)]  # per link: parameter, output column
    for place, column in enumerate(chosen):
        places[column // 10].append((int(column % 10), place))
    out = np.zeros((len(chosen), n, samples))
    for start in range(0, samples, _CHUNK):
        part = slice(start, min(start + _CHUNK, samples))
        states = _components(motion, part)
        acceleration = _vector(-g if g.ndim == 1 else -g[part].T)
        _fill(geometry, states, acceleration, places, out[:, :, part])
    return out.transpose(2, 1, 0)


def standard_regressor(
    machine: Machine | Geometry,
    q: npt.ArrayLike,
    qd: npt.ArrayLike,
    qdd: npt.ArrayLike,
    *,
    gravity: npt.ArrayLike | None = None,
) -> FloatArray:
    """Compute all standard parameters' regressor, (N, n, 13 n + 3 c), in the order of :func:`standard_names`."""
    geometry = geometry_of(machine)
    n = geometry.joints
    rigid = rigid_body_regressor(machine, q, qd, qdd, gravity=gravity)
    speed, acceleration = np.asarray(qd, dtype=float), np.asarray(qdd, dtype=float)
    out = np.zeros((13 * n + 3 * len(geometry.coupled), n, rigid.shape[0]))
    out[13 * n :] = coupled_regressor(geometry, speed, acceleration).transpose(2, 1, 0)
    for i in range(n):
        out[13 * i : 13 * i + 10] = rigid[:, :, 10 * i : 10 * i + 10].transpose(2, 1, 0)
        out[13 * i + 10, i] = np.sign(speed[:, i])
        out[13 * i + 11, i] = speed[:, i]
        if i not in geometry.link_side:
            out[13 * i + 12, i] = acceleration[:, i]
    return out.transpose(2, 1, 0)


def coupled_regressor(
    machine: Machine | Geometry, qd: npt.ArrayLike, qdd: npt.ArrayLike, *, speed_noise: npt.ArrayLike | None = None
) -> FloatArray:
    """Compute the regressor of motors of several joints, (N, n, 3 c): ``f_cm, f_vm, Jm`` of each.

    Parameters
    ----------
    machine : arm of ``n`` joints, ``c`` of whose motors are coupled to other joints
    qd, qdd : joint speeds and accelerations, (N, n); or expressions in their place
    speed_noise : standard deviation of every joint's speed, (n,): the sign is then its expectation
    """
    geometry = geometry_of(machine)
    speed, acceleration = np.asanyarray(qd), np.asanyarray(qdd)
    noise = np.zeros(geometry.joints) if speed_noise is None else np.asarray(speed_noise, dtype=float)
    felt = np.array([float(joint not in geometry.link_side) for joint in range(geometry.joints)])
    columns = []
    for row in geometry.coupling:
        own = speed @ row
        for column in (expected_sign(own, float(np.linalg.norm(noise * row))), own, acceleration @ row):
            columns.append((felt * row)[:, None] * column)
    return np.stack(columns).transpose(2, 1, 0) if columns else np.zeros((len(speed), geometry.joints, 0))


def stacked(Y: FloatArray) -> FloatArray:
    """Stack the observation matrix ``W``, shape (n N, p): joint 1's samples first, then joint 2's, and so on.

    A view, in Fortran order, of what the functions of this module return; a copy of anything else.
    """
    samples, n, p = Y.shape
    return Y.transpose(2, 1, 0).reshape(p, n * samples).T


def standard_of_link(mass: float, centre: npt.ArrayLike, central: FloatArray) -> FloatArray:
    """Compute a link's ten parameters from mass (kg), centre of mass (3,) and inertia (3, 3) about that, its frame."""
    c = np.asarray(centre, dtype=float)
    inertia = central + mass * (c @ c * np.eye(3) - np.outer(c, c))
    return np.array([mass, *(mass * c), *inertia[np.triu_indices(3)]])


def self_check(machine: Machine | Geometry) -> float:
    """Compute the largest difference of ``Y pi`` from a Newton-Euler recursion over that joint's largest effort.

    The recursion shares no code with the regressor. It works in the base frame with the transforms of
    :func:`fitting.arm.geometry.link_frames`, centres of mass and central inertias, one sample and one link at a time.
    Random links, states within the machine's limits.
    """
    geometry = geometry_of(machine)
    rng = np.random.default_rng(0)
    n, samples = geometry.joints, _CHECKED
    q = rng.uniform(geometry.position_limits[:, 0], geometry.position_limits[:, 1], (samples, n))
    qd = rng.uniform(-1, 1, (samples, n)) * geometry.velocity_limits
    qdd = rng.uniform(-1, 1, (samples, n)) * geometry.acceleration_limits
    mass = rng.uniform(1, 50, n)
    centre = rng.uniform(-0.5, 0.5, (n, 3))
    half = rng.normal(size=(n, 3, 3))
    central = half @ half.transpose(0, 2, 1)
    pi = np.array([standard_of_link(mass[i], centre[i], central[i]) for i in range(n)])
    expected = np.array(
        [_newton_euler(geometry, mass, centre, central, *state) for state in zip(q, qd, qdd, strict=True)]
    )
    found = rigid_body_regressor(geometry, q, qd, qdd) @ pi.ravel()
    scale = np.maximum(np.abs(expected).max(axis=0), np.finfo(float).tiny)
    return float((np.abs(found - expected) / scale).max())


def _newton_euler(
    geometry: Geometry,
    mass: FloatArray,
    centre: FloatArray,
    central: FloatArray,
    q: FloatArray,
    qd: FloatArray,
    qdd: FloatArray,
) -> FloatArray:
    frames = link_frames(geometry, q)

    def joint_frame(joint: int) -> int:
        return joint + 1 if geometry.modified else joint

    w, wd, a = np.zeros(3), np.zeros(3), -geometry.gravity
    forces, moments, centres = [], [], []
    for i in range(geometry.joints):
        axis = frames[joint_frame(i), :3, 2]
        arm = frames[i + 1, :3, 3] - frames[i, :3, 3]
        if geometry.modified:  # the way to joint i belongs to the link before
            a = a + _product(wd, arm) + _product(w, _product(w, arm))
        if geometry.revolute[i]:
            wd = wd + axis * qdd[i] + _product(w, axis * qd[i])
            w = w + axis * qd[i]
        else:
            a = a + axis * qdd[i] + 2 * _product(w, axis * qd[i])
        if not geometry.modified:
            a = a + _product(wd, arm) + _product(w, _product(w, arm))
        rotation = frames[i + 1, :3, :3]
        offset = rotation @ centre[i]
        inertia = rotation @ central[i] @ rotation.T
        forces.append(mass[i] * (a + _product(wd, offset) + _product(w, _product(w, offset))))
        moments.append(inertia @ wd + _product(w, inertia @ w))
        centres.append(frames[i + 1, :3, 3] + offset)
    tau = np.zeros(geometry.joints)
    for j in range(geometry.joints):
        axis, origin = frames[joint_frame(j), :3, 2], frames[joint_frame(j), :3, 3]
        for i in range(j, geometry.joints):
            load = moments[i] + _product(centres[i] - origin, forces[i]) if geometry.revolute[j] else forces[i]
            tau[j] += axis @ load
    return tau


def _product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Compute the cross product of vectors (3,), ten times as fast as numpy's of arrays."""
    (ax, ay, az), (bx, by, bz) = a.tolist(), b.tolist()
    return np.array([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx])


def _samples(geometry: Geometry, values: npt.ArrayLike, what: str) -> FloatArray:
    array = np.asarray(values, dtype=float)
    if array.ndim != 2 or array.shape[1] != geometry.joints:
        raise ValueError(f"{what} has shape {array.shape}; it must be (samples, {geometry.joints})")
    return array


def _components(motion: list[FloatArray], part: slice) -> list[list[Component]]:
    """Return per joint ``[q, qd, qdd]`` as contiguous arrays; zeros become 0.0."""
    columns = [np.ascontiguousarray(values[part].T) for values in motion]
    if len({array.shape for array in columns}) != 1:
        raise ValueError("q, qd and qdd must have the same number of samples")
    return [[columns[0][i], *(row[i] if row[i].any() else 0.0 for row in columns[1:])] for i in range(len(columns[0]))]


def _vector(values: FloatArray) -> Vector:
    x, y, z = (
        (float(row) if np.ndim(row) == 0 else np.ascontiguousarray(row)) if np.any(row) else 0.0 for row in values
    )
    return x, y, z


# Arithmetic that skips zeros. The products with 1.0 are skipped too: cosines of 0 and sines of 90 degrees.


def _mul(a: Component, b: Component) -> Component:
    if isinstance(a, float):
        if a == 0.0:
            return 0.0
        if a == 1.0:
            return b
    if isinstance(b, float):
        if b == 0.0:
            return 0.0
        if b == 1.0:
            return a
    return a * b


def _add(a: Component, b: Component) -> Component:
    if isinstance(a, float) and a == 0.0:
        return b
    if isinstance(b, float) and b == 0.0:
        return a
    return a + b


def _sub(a: Component, b: Component) -> Component:
    if isinstance(b, float) and b == 0.0:
        return a
    if isinstance(a, float) and a == 0.0:
        return -b
    return a - b


def _plus(a: Vector, b: Vector) -> Vector:
    return _add(a[0], b[0]), _add(a[1], b[1]), _add(a[2], b[2])


def _cross(a: Vector, b: Vector) -> Vector:
    return (
        _sub(_mul(a[1], b[2]), _mul(a[2], b[1])),
        _sub(_mul(a[2], b[0]), _mul(a[0], b[2])),
        _sub(_mul(a[0], b[1]), _mul(a[1], b[0])),
    )


@dataclass(frozen=True)
class _Link:
    """Link ``i`` at every sample, all in its own frame."""

    w: Vector  # angular velocity
    wd: Vector  # angular acceleration
    a: Vector  # acceleration of the origin, less gravity
    unit: tuple[tuple[Vector, Vector], ...]  # per joint j <= i: (u, s) per unit of joint speed


def _links(geometry: Geometry, states: list[list[Component]], a: Vector) -> Iterator[_Link]:
    """Iterate forward: velocities and accelerations of the links, base to tip."""
    w: Vector = _ZERO
    wd: Vector = _ZERO
    unit: _Units = []
    sines, cosines = geometry.sin_alpha, geometry.cos_alpha
    for i, (q, qd, qdd) in enumerate(states):
        sa, ca, along = float(sines[i]), float(cosines[i]), float(geometry.a[i])
        revolute = bool(geometry.revolute[i])
        angle = geometry.theta[i] + q if revolute else float(geometry.theta[i])
        ct: Component = np.cos(angle) if revolute else _snap(np.cos(angle))
        st: Component = np.sin(angle) if revolute else _snap(np.sin(angle))
        d: Component = float(geometry.d[i]) if revolute else geometry.d[i] + q

        def about_x(v: Vector, ca: float = ca, sa: float = sa) -> Vector:
            """Compute ``Rx(alpha)' v``."""
            return v[0], _add(_mul(ca, v[1]), _mul(sa, v[2])), _sub(_mul(ca, v[2]), _mul(sa, v[1]))

        def about_z(v: Vector, ct: Component = ct, st: Component = st) -> Vector:
            """Compute ``Rz(theta)' v``."""
            return _add(_mul(ct, v[0]), _mul(st, v[1])), _sub(_mul(ct, v[1]), _mul(st, v[0])), v[2]

        if geometry.modified:  # link i - 1 reaches to joint i before that moves
            (w, wd, a), unit = _turned(about_x, (w, wd, a), unit)
            a, unit = _carried((along, 0.0, d), (w, wd, a), unit)
        if revolute:
            # w x (z qd) = qd (w_y, -w_x, 0)
            wd = _add(wd[0], _mul(qd, w[1])), _sub(wd[1], _mul(qd, w[0])), _add(wd[2], qdd)
            w = w[0], w[1], _add(w[2], qd)
        else:
            double = _mul(2.0, qd)
            a = _add(a[0], _mul(double, w[1])), _sub(a[1], _mul(double, w[0])), _add(a[2], qdd)
        unit = [*unit, ((0.0, 0.0, 1.0), _ZERO) if revolute else (_ZERO, (0.0, 0.0, 1.0))]
        (w, wd, a), unit = _turned(about_z, (w, wd, a), unit)
        if not geometry.modified:
            (w, wd, a), unit = _turned(about_x, (w, wd, a), unit)
            a, unit = _carried((along, _mul(sa, d), _mul(ca, d)), (w, wd, a), unit)
        yield _Link(w, wd, a, tuple(unit))


def _turned(
    turn: Callable[[Vector], Vector], moving: tuple[Vector, Vector, Vector], unit: _Units
) -> tuple[tuple[Vector, Vector, Vector], _Units]:
    """Turn the motion ``(w, wd, a)`` and velocities per unit of joint speed into a frame."""
    w, wd, a = moving
    return (turn(w), turn(wd), turn(a)), [(turn(u), turn(s)) for u, s in unit]


def _carried(arm: Vector, moving: tuple[Vector, Vector, Vector], unit: _Units) -> tuple[Vector, _Units]:
    """Compute acceleration, and velocities per unit of joint speed, at ``arm`` on the same body."""
    w, wd, a = moving
    a = _plus(a, _plus(_cross(wd, arm), _cross(w, _cross(w, arm))))
    return a, [(u, _plus(s, _cross(u, arm))) for u, s in unit]


def _snap(value: float) -> float:
    return 0.0 if abs(value) < 1e-15 else float(value)


def _fill(
    geometry: Geometry,
    states: list[list[Component]],
    acceleration: Vector,
    places: list[list[tuple[int, int]]],
    out: FloatArray,
) -> None:
    """Write the wanted columns into ``out``, shape (columns, n, samples), which holds zeros."""
    last = max((i for i, wanted in enumerate(places) if wanted), default=-1)
    scratch = np.empty(out.shape[2])
    for i, link in enumerate(_links(geometry, states[: last + 1], acceleration)):
        a = link.a
        B = _moment_matrix(link.w, link.wd)
        for parameter, place in places[i]:
            if parameter == 0:
                for j, (_, s) in enumerate(link.unit):
                    _accumulate(out[place, j], zip(s, a, strict=True), scratch)
            elif parameter <= 3:
                k, k1, k2 = parameter - 1, parameter % 3, (parameter + 1) % 3
                minus = _sub(0.0, a[k2])
                for j, (u, s) in enumerate(link.unit):
                    terms = [*zip(s, B[k], strict=True), (a[k1], u[k2]), (minus, u[k1])]
                    _accumulate(out[place, j], terms, scratch)
            else:
                moment = _moment_of_inertia(link.w, link.wd, *_INERTIA[parameter - 4])
                for j, (u, _) in enumerate(link.unit):
                    _accumulate(out[place, j], zip(u, moment, strict=True), scratch)


def _accumulate(out: FloatArray, terms: Iterable[tuple[Component, Component]], scratch: FloatArray) -> None:
    """Add the products of ``terms`` into ``out``, which holds zeros, without temporaries."""
    first = True
    for a, b in terms:
        if (isinstance(a, float) and a == 0.0) or (isinstance(b, float) and b == 0.0):
            continue
        if first:
            np.multiply(a, b, out=out)
            first = False
        elif isinstance(a, float) and a == 1.0:
            out += b
        elif isinstance(b, float) and b == 1.0:
            out += a
        else:
            np.multiply(a, b, out=scratch)
            out += scratch


def _moment_matrix(w: Vector, wd: Vector) -> tuple[Vector, Vector, Vector]:
    """Compute columns of ``B = S(wd) + S(w) S(w)``; ``S(w) S(w) = w w' - |w|^2 E``."""
    xx, yy, zz = (_mul(c, c) for c in w)
    xy, xz, yz = _mul(w[0], w[1]), _mul(w[0], w[2]), _mul(w[1], w[2])
    return (
        (_sub(0.0, _add(yy, zz)), _add(xy, wd[2]), _sub(xz, wd[1])),
        (_sub(xy, wd[2]), _sub(0.0, _add(xx, zz)), _add(yz, wd[0])),
        (_add(xz, wd[1]), _sub(yz, wd[0]), _sub(0.0, _add(xx, yy))),
    )


def _moment_of_inertia(w: Vector, wd: Vector, row: int, column: int) -> Vector:
    """Compute ``E wd + w x (E w)`` for the symmetric unit inertia ``E`` with ones at (row, column)."""
    Ew: list[Component] = [0.0, 0.0, 0.0]
    Ewd: list[Component] = [0.0, 0.0, 0.0]
    Ew[row], Ewd[row] = w[column], wd[column]
    Ew[column], Ewd[column] = w[row], wd[row]
    return _plus((Ewd[0], Ewd[1], Ewd[2]), _cross(w, (Ew[0], Ew[1], Ew[2])))


_INERTIA = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
