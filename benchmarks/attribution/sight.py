"""Lambda: how large a true effect is in the noise once the base model has taken what it can.

``lambda^2 = |P W d|^2`` with ``d`` the effect's waveform in the efforts (ideal transducers, the same disturbance with
the effect and without; none at all for a delay or a gain, which would move the disturbance, too, and a delay's as
:func:`delayed` has it), through an identification filter of 3 Hz; ``W`` the whitening by the *true* covariance of the
noise; ``P`` the projection off the columns of the base model (drives and rigid body, all joints, all fitted
recordings) on the true motion. It is the root of the noncentrality of the chi-square that the true effect adds.

The noise's covariance is known in closed form: a first-order disturbance, Poisson knocks (half sines with uniform
amplitudes; Campbell's theorem), white noise and steps of both pressure transducers, and those of the encoders, twice
differentiated, times the links' inertia: on a crane's slewing axis nearly all of it. So is what restless joints do
above half the rate, where no encoder follows. While rods are unpinned only the cylinder's own mass moves. Nothing here
uses the fit's filters, noise estimates or decisions; the rigid body's columns come from its regressor.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from functools import cache

import numpy as np
from scipy import linalg, signal
from scipy.interpolate import make_interp_spline

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import base_regressor, reduce_parameters
from fitting.arm.dynamics import rigid_body_regressor
from fitting.arm.linkage import lever_arm
from fitting.arrays import FloatArray
from sim_backends.plant.controller import LOOP_FREQUENCY, VALVE_NOISE_TIME, output_std
from sim_backends.plant.hydraulics import direction
from sim_backends.plant.plant import KNOCK_TIME
from sim_backends.plant.truth import SensorQuality, Truth

Table = Mapping[str, FloatArray]

BANDWIDTH = 3.0  # Hz
FITTED = ("unloaded", "train-1", "train-2", "repeat")
# Frequencies that the filter attenuates by 30 dB and more are not blown up again by the whitening.
_FLOOR = 1e-3
_TRIM = 50  # samples at each end: the fit's trajectory filter cannot use them either
_REST = 1e-9


def delayed(
    machine: Machine, tables: Mapping[str, Table], joint: str, seconds: float
) -> dict[str, dict[str, FloatArray]]:
    """Delay a joint's pressures in the tables, ``p - tau dp/dt``, as far as samples resolve.

    Friction turns round within a millisecond. A delay moves the share ``tau rate`` of all turns beyond a sample
    (0.7 ms at 50 Hz: one in thirty), which then is off by all of it, and leaves the others as they were. That has
    ``1 / (tau rate)`` times the energy that counts here, and only for who knows each turn to the millisecond.
    """
    found: dict[str, dict[str, FloatArray]] = {}
    for stem, table in tables.items():
        names = f"{joint}.head_pressure", f"{joint}.rod_pressure"
        late = {name: table[name] - seconds * _derivatives(table[name], machine.rate_hz)[1] for name in names}
        found[stem] = {**table, **late}
    return found


def zeros_of(lever: FloatArray) -> FloatArray:
    """Compute what a zero error does to the gap at these levers (n,): the piston's, the joint's, (n, 2)."""
    return np.column_stack([np.ones(len(lever)), lever])


def beyond(columns: FloatArray, values: FloatArray) -> FloatArray:
    """Compute what columns (n, k) do not explain of values (n,)."""
    return np.asarray(values - columns @ np.linalg.lstsq(columns, values, rcond=None)[0])


def gap_std(quality: SensorQuality, lever: FloatArray) -> float:
    """Compute the noise of a sample of the gap between both position sensors, m, at levers (n,)."""
    angle = (quality.encoder_std**2 + quality.encoder_resolution**2 / 12) * float(np.mean(lever**2))
    return float(np.sqrt(quality.piston_std**2 + quality.piston_resolution**2 / 12 + angle))


class Sight:
    """Visibility of effects on one machine with one motion and one measurement chain.

    Parameters
    ----------
    machine, truth, quality
        Of the case.
    bare : mapping
        Ideal tables of the fitted recordings without any effect, by stem.
    positions : bool
        Count what noise of the encoders, and motion that they do not follow, make of inertia.
    lines : bool
        Count that for spectral lines, too.
    """

    def __init__(
        self,
        machine: Machine,
        truth: Truth,
        quality: SensorQuality,
        bare: Mapping[str, Table],
        positions: bool = True,
        lines: bool = True,
    ) -> None:
        self._machine = machine
        self._bare = bare
        rate = machine.rate_hz
        half = round(3.0 * rate / BANDWIDTH)
        self._filter = signal.firwin(2 * half + 1, BANDWIDTH, window=("kaiser", 8.0), fs=rate)
        self._step = max(1, int(rate / (2.75 * BANDWIDTH)))
        lags = round(8.0 * rate)
        joints = range(len(machine.joints))
        covariances = np.array([noise_covariance(machine, truth, quality, joint, lags) for joint in joints])
        angles = np.stack([bare["train-1"][_encoder(machine, j.name)] for j in machine.joints], axis=1)
        masses = {
            True: inertias(machine, truth, angles),
            False: np.diag([truth.cylinders[j.name].m ** 2 for j in machine.joints]),
        }
        moved = {loaded: mass @ restlessness(machine, quality, loaded, lags) for loaded, mass in masses.items()}
        self._broad = {loaded: covariances + lines * own for loaded, own in moved.items()}
        self._whitening = {
            loaded: [self._whitener(noise) for noise in covariances + positions * own] for loaded, own in moved.items()
        }
        self._basis = self._base_columns(bare)
        self._position_std = [self._gap_noise(quality, joint) for joint in joints]

    def force(self, tables: Mapping[str, Table], bare: Mapping[str, Table] | None = None) -> float:
        """Compute lambda of what differs in the efforts between these ideal tables and those without the effect
        (``bare``; if absent, the ones that this sight was made from)."""
        projected, total = np.zeros(self._basis[0].shape[1]), 0.0
        for joint in range(len(self._machine.joints)):
            differences = {stem: self._difference(tables, bare or self._bare, stem, joint) for stem in FITTED}
            white = np.concatenate([self._white(joint, own, stem) for stem, own in differences.items()])
            total += float(white @ white)
            projected += self._basis[joint].T @ white
        return float(np.sqrt(max(total - float(projected @ projected), 0.0)))

    def broadband(self, tables: Mapping[str, Table]) -> float:
        """Compute the same without filter and projection, for spectral lines: they may lie above the filter's band."""
        total = 0.0
        for joint in range(len(self._machine.joints)):
            for stem in FITTED:
                covariance = self._broad[stem != "unloaded"][joint]
                difference = self._difference(tables, self._bare, stem, joint)
                difference = difference - difference.mean()
                density = _density(covariance, np.asarray(np.fft.rfftfreq(len(difference)), dtype=np.float64))
                power = np.abs(np.fft.rfft(difference)) ** 2
                weight = np.full(len(power), 2.0)
                weight[0] = 1.0
                total += float(np.sum(weight * power / density)) / len(difference)
        return float(np.sqrt(total))

    def mismatch(self, tables: Mapping[str, Table], *, zeros: int = 0) -> float:
        """Compute the largest RMS over the joints of the change of the gap between both position sensors, in noise
        widths of one sample of that gap; beyond what ``zeros`` sensors' zeros explain: the piston's, the joint's.
        """
        worst = 0.0
        for number in range(len(self._machine.joints)):
            parts = [
                self._gap(tables, stem, number) - self._gap(self._bare, stem, number)
                for stem in FITTED
                if stem != "unloaded"
            ]
            change = np.concatenate(parts)
            if zeros:
                change = beyond(zeros_of(self._levers(tables, number))[:, :zeros], change)
            worst = max(worst, float(np.sqrt(np.mean(change**2))) / self._position_std[number])
        return worst

    # Waveforms

    def _difference(self, tables: Mapping[str, Table], bare: Mapping[str, Table], stem: str, joint: int) -> FloatArray:
        return _effort(self._machine, tables[stem], joint) - _effort(self._machine, bare[stem], joint)

    def _gap(self, tables: Mapping[str, Table], stem: str, joint: int) -> FloatArray:
        described = self._machine.joints[joint]
        assert described.cylinder is not None
        table = tables[stem]
        x = described.cylinder.linkage.piston_position(table[_encoder(self._machine, described.name)])
        return np.asarray(table[f"{described.name}.piston_position"] - x)

    def _levers(self, tables: Mapping[str, Table], joint: int) -> FloatArray:
        described = self._machine.joints[joint]
        assert described.cylinder is not None
        stems = (stem for stem in FITTED if stem != "unloaded")
        angles = [tables[stem][_encoder(self._machine, described.name)] for stem in stems]
        return np.asarray(lever_arm(described.cylinder.linkage, np.concatenate(angles)))

    def _gap_noise(self, quality: SensorQuality, joint: int) -> float:
        described = self._machine.joints[joint]
        assert described.cylinder is not None
        return gap_std(quality, lever_arm(described.cylinder.linkage, np.linspace(*described.limits.position, 101)))

    # Filter, whitening, projection

    def _reduce(self, values: FloatArray) -> FloatArray:
        trimmed = values[_TRIM : len(values) - _TRIM]
        taps = self._filter if values.ndim == 1 else self._filter[:, None]
        return np.asarray(signal.oaconvolve(trimmed, taps, mode="valid", axes=0)[:: self._step])

    def _white(self, joint: int, values: FloatArray, stem: str) -> FloatArray:
        reduced = self._reduce(values)
        factor = self._whitening[stem != "unloaded"][joint](len(reduced))
        return np.asarray(linalg.solve_triangular(factor, reduced, lower=True))

    def _whitener(self, covariance: FloatArray) -> Callable[[int], FloatArray]:
        """Return the reduced noise's lower Cholesky factor by length of the series, from its autocovariance (lags,)."""
        kernel = np.correlate(self._filter, self._filter, mode="full")  # lags -(L-1) .. L-1
        symmetric = np.concatenate([covariance[:0:-1], covariance])
        reduced = signal.fftconvolve(symmetric, kernel, mode="same")[len(covariance) - 1 :: self._step]
        rate = self._machine.rate_hz
        frequency = np.linspace(0.0, BANDWIDTH, 200) / rate
        response = np.abs(signal.freqz(self._filter, worN=2 * np.pi * frequency)[1]) ** 2
        floor = _FLOOR * float(np.median(_density(covariance, frequency) * response)) / self._step
        reduced[0] += floor

        @cache
        def factor(length: int) -> FloatArray:
            column = np.zeros(length)
            known = min(length, len(reduced))
            column[:known] = reduced[:known]
            return np.asarray(linalg.cholesky(linalg.toeplitz(column), lower=True))

        return factor

    def _base_columns(self, bare: Mapping[str, Table]) -> list[FloatArray]:
        """Compute per joint an orthonormal basis of the whitened base columns over all fitted recordings."""
        machine = self._machine
        base = reduce_parameters(machine)
        count = len(machine.joints)
        rows: list[list[FloatArray]] = [[] for _ in range(count)]
        for stem in FITTED:
            loaded = stem != "unloaded"
            q = np.stack([bare[stem][_encoder(machine, j.name)] for j in machine.joints], axis=1)
            q, qd, qdd = _derivatives(q, machine.rate_hz)
            x = np.stack([bare[stem][f"{j.name}.piston_position"] for j in machine.joints], axis=1)
            x, v, a = _derivatives(x, machine.rate_hz)
            body = base_regressor(machine, base, q, qd, qdd) if loaded else None
            for number, joint in enumerate(machine.joints):
                assert joint.cylinder is not None
                columns = np.zeros((len(q), 5 * count + len(base)))
                own = (a[:, number], x[:, number], direction(v[:, number]), v[:, number], np.cbrt(v[:, number]))
                columns[:, 5 * number : 5 * number + 5] = np.stack(own, axis=1)
                if body is not None:
                    r = lever_arm(joint.cylinder.linkage, q[:, number])
                    columns[:, 5 * count :] = body[:, number] / r[:, None]
                rows[number].append(self._white(number, columns, stem))
        stacked = [np.vstack(parts) for parts in rows]
        whole = np.vstack(stacked)
        norms = np.linalg.norm(whole, axis=0)
        used = norms > _REST * norms.max()
        basis, triangle, _ = linalg.qr(whole[:, used] / norms[used], mode="economic", pivoting=True)
        pivots = np.abs(np.diag(triangle))
        basis = basis[:, pivots > 1e-9 * pivots[0]]
        ends = np.cumsum([len(part) for part in stacked])[:-1]
        return list(np.split(basis, ends))


def noise_covariance(machine: Machine, truth: Truth, quality: SensorQuality, joint: int, lags: int) -> FloatArray:
    """Compute the autocovariance (lags,) in N^2 of the noise in ``p1 A1 - p2 A2``, per recorded sample.

    ``(d f_c)^2 exp(-t / tau)`` of the disturbance; ``rate size^2 / 3 int s(u) s(u + t) du`` of the knocks; at lag 0
    also ``(A1^2 + A2^2)(std^2 + step^2 / 12)`` of the transducers.
    """
    described = machine.joints[joint]
    cylinder = described.cylinder
    assert cylinder is not None
    coulomb = truth.cylinders[described.name].f_c
    time = np.arange(lags) / machine.rate_hz
    covariance = (quality.disturbance * coulomb) ** 2 * np.exp(-time / max(quality.disturbance_time, 1e-9))
    fine = KNOCK_TIME / 400
    shape = np.sin(np.pi * (np.arange(400) + 0.5) / 400)
    overlap = np.correlate(shape, shape, mode="full")[399:] * fine
    knocks = np.interp(time, fine * np.arange(400), overlap, right=0.0)
    covariance += quality.knock_rate * (quality.knock_size * coulomb) ** 2 / 3.0 * knocks
    transducer = quality.pressure_std**2 + quality.pressure_resolution**2 / 12
    covariance[0] += (cylinder.head_area**2 + cylinder.rod_area**2) * transducer
    return np.asarray(covariance)


def inertias(machine: Machine, truth: Truth, q: FloatArray) -> FloatArray:
    """Compute mean squares of inertia, effort by moving joint, (N per rad/s^2)^2, (n, n), over poses (N, n)."""
    poses = q[:: max(1, len(q) // 50)]
    pi = np.concatenate([[link.mass, *link.moment, *link.inertia] for link in truth.links])
    still = np.zeros_like(poses)
    weight = rigid_body_regressor(machine, poses, still, still) @ pi
    squares = np.zeros((poses.shape[1], poses.shape[1]))
    for other in range(poses.shape[1]):
        unit = still.copy()
        unit[:, other] = 1.0
        moved = rigid_body_regressor(machine, poses, still, unit) @ pi - weight
        for number, joint in enumerate(machine.joints):
            assert joint.cylinder is not None
            lever = lever_arm(joint.cylinder.linkage, poses[:, number])
            own = truth.cylinders[joint.name].m * lever if other == number else 0.0
            squares[number, other] = float(np.mean((moved[:, number] / lever + own) ** 2))
    return squares


def restlessness(machine: Machine, quality: SensorQuality, loaded: bool, lags: int) -> FloatArray:
    """Estimate the autocovariance (n, lags) of accelerations beyond positions, of joints or of free pistons.

    Noise of the encoders, twice differentiated; and what lies above half the rate and is folded below it: the error of
    the controller's loop (:mod:`sim_backends.plant.controller`: ``w``, first-order noise with ``T``) has a density of
    acceleration that falls as ``w^4 2 T / (2 pi f T)^2``, whose sum over all multiples of the rate is ``w^4 / (6 T)``
    over the rate squared.
    """
    spans, noise = [], quality.encoder_std**2 + quality.encoder_resolution**2 / 12
    for joint in machine.joints:
        assert joint.cylinder is not None
        ends = np.array(joint.limits.position)
        spans.append(float(np.ptp(ends if loaded else joint.cylinder.linkage.piston_position(ends))))
    if not loaded:
        noise = quality.piston_std**2 + quality.piston_resolution**2 / 12
    rate, errors = machine.rate_hz, quality.tracking * np.array(spans) / output_std()
    found = np.zeros((len(spans), lags))
    found[:, :3] = noise * rate**4 * np.array([6.0, -4.0, 1.0])
    found[:, 0] += errors**2 * (2 * np.pi * LOOP_FREQUENCY) ** 4 / (6 * VALVE_NOISE_TIME * rate)
    return found


def _density(covariance: FloatArray, frequency: FloatArray) -> FloatArray:
    """Compute the two-sided spectral density per sample at frequencies in 1/sample, from the autocovariance."""
    lags = np.arange(1, len(covariance))
    near = np.unique(np.concatenate([frequency[:: max(1, len(frequency) // 400)], frequency[-1:]]))
    values = covariance[0] + 2.0 * np.cos(2 * np.pi * near[:, None] * lags[None, :]) @ covariance[1:]
    return np.asarray(np.interp(frequency, near, values))


def _effort(machine: Machine, table: Table, joint: int) -> FloatArray:
    described = machine.joints[joint]
    assert described.cylinder is not None
    head, rod = (table[f"{described.name}.{side}_pressure"] for side in ("head", "rod"))
    return np.asarray(head * described.cylinder.head_area - rod * described.cylinder.rod_area)


def _encoder(machine: Machine, joint: str) -> str:
    """Return the name of the channel with the joint's position."""
    channel = machine.channel("joint_position", joint)
    assert channel is not None
    return channel.name


def _derivatives(values: FloatArray, rate: float) -> Sequence[FloatArray]:
    """Compute values and both derivatives of noise-free columns at ``rate``, by a quintic spline."""
    time = np.arange(len(values)) / rate
    spline = make_interp_spline(time, values, k=5)
    return [np.asarray(spline(time)), np.asarray(spline.derivative(1)(time)), np.asarray(spline.derivative(2)(time))]
