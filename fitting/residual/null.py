"""Null distribution of a candidate's gain: a parametric bootstrap through the measurement chain.

Scores are chi-squares only as long as the regressors are exact. They are not: positions are noisy, accelerations more
so, and a column may look like what that noise leaves. So the fitted model is taken for the whole truth and the
recordings are made again: the model's own efforts along the smoothed motion get block-resampled measurement noise, the
positions get their sensors' noise once more, and everything from the filters on is done as for the real recordings.
What the candidate is worth on such a replica is a draw from its null distribution: its mean is a bias, of which any
share may be in the real value, and its spread beyond the theory's takes from the gain's weight.

Source: B. Efron and R. Tibshirani, An Introduction to the Bootstrap, 1993; moving blocks: H. R. Kuensch, Annals of
Statistics 17, 1989.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from daq.machine.machine_file import Joint, Machine
from daq.recordings.recording import Recording
from fitting.arrays import FloatArray
from fitting.regression.design import predicted_effort
from fitting.residual.terms import Model
from fitting.signals.preparation import Segment, shortest

#: Standard deviation of each position channel's noise, by channel name, SI.
PositionStd = Mapping[str, float]

BLOCK_SECONDS = 3.0
_FADE_SECONDS = 0.3
#: Inflation that is usual, and how many draws that knowledge is worth: 18 replicas of 450 candidates of nine cases
#: scatter 1.2 times as in theory, their logarithms by 0.28 more than 18 draws do (`benchmarks/results/evidence.md`).
USUAL_INFLATION, PRIOR_DRAWS = 1.2, 25
#: Chance of another one, of any size up to the largest.
UNUSUAL, _MOST = 0.05, 100.0
#: Share of the bias in replicas that is expected of a machine: on 40 simulated arms without any effect it is
#: 0.5 +- 0.1 (`benchmarks/results/evidence.md`), and not more than all of it in any of 188 estimates.
BIAS_SHARE = 0.5
_SHARES = 65
_WELL_DETERMINED = 1e-3


@dataclass(frozen=True)
class Null:
    """Values of one candidate's parameters on replicas, where the present model is the whole truth.

    Attributes
    ----------
    values : (B, k), one row per replica
    information : (k, k) information of the candidate's parameters, the model's own projected out
    live : directions that the candidate has
    """

    values: FloatArray
    information: FloatArray
    live: int

    def joined(self, more: Null) -> Null:
        """Join both sets of draws."""
        return Null(np.vstack([self.values, more.values]), self.information, max(self.live, more.live))

    @property
    def draws(self) -> int:
        """Number of replicas."""
        return len(self.values)

    @property
    def bias(self) -> FloatArray:
        """Bias: what noise in the regressors makes of parameters that are zero, (k,).

        The mean of the draws, shrunk by what their own scatter makes of a mean (James and Stein): nothing is taken off
        where the draws show no bias.
        """
        mean = self._determined(self.values.mean(axis=0)[None, :])[0]
        length = float(mean @ self.information @ mean)
        scatter = self.live * self.inflation / self.draws
        return np.asarray(mean * max(0.0, 1.0 - scatter / max(length, 1e-300)))

    @property
    def inflation(self) -> float:
        """Variance of the values over the theory's, at least 1; joined with what is usual."""
        spread = self._determined(self.values - self.values.mean(axis=0))
        return self._joined(float(np.einsum("bi,ij,bj->", spread, self.information, spread)), self.live)

    def inflation_along(self, values: FloatArray) -> float:
        """Compute the inflation of noise along values (k,): noise that hangs together is not alike in every way.

        A constant in 16 coefficients is a constant: it has the variance that it has in one.
        """
        direction = self._determined(np.asarray(values, dtype=float)[None, :])[0]
        length = float(direction @ self.information @ direction)
        if not length > 0:
            return self.inflation
        spread = self._determined(self.values - self.values.mean(axis=0))
        return self._joined(float(np.sum((spread @ (self.information @ direction / np.sqrt(length))) ** 2)), 1)

    def _joined(self, total: float, live: int) -> float:
        """Join a sum of squares of draws in so many directions with what is usual, or unusual: the mean of the share
        of a gain, ``1 / inflation``."""
        freedom, prior = max(self.draws - 1, 0) * live, PRIOR_DRAWS * live
        usual = (total + prior * USUAL_INFLATION) / (freedom + prior)
        if not total > freedom * usual:
            return max(1.0, usual)
        seen, variance = total / freedom, 2.0 / freedom + 2.0 / PRIOR_DRAWS
        right = np.exp(-0.5 * np.log(seen / USUAL_INFLATION) ** 2 / variance) / np.sqrt(2.0 * np.pi * variance)
        right /= right + UNUSUAL / (1.0 - UNUSUAL) / np.log(_MOST)
        return max(1.0, float(1.0 / (right / usual + (1.0 - right) / seen)))

    def _determined(self, values: FloatArray) -> FloatArray:
        """Return rows of values in well-determined directions only: the others differ between replicas."""
        own = np.diag(self.information)
        scale = np.sqrt(np.where(own > 0, own, 1.0))
        strength, directions = np.linalg.eigh(self.information / np.outer(scale, scale))
        well = directions[:, strength > _WELL_DETERMINED * strength[-1]]
        return np.asarray((values * scale) @ well @ well.T / scale)

    def uncertainty(self, information: FloatArray, gain: float) -> float:
        """Return the chi-square uncertainty of a gain by the bias that was taken off; 0 where none was."""
        length = float(self.bias @ information @ self.bias)
        return BIAS_SHARE**2 * length + 2.0 * float(np.sqrt(gain * self.inflation / self.draws)) if length else 0.0

    def weight(self, values: FloatArray, information: FloatArray) -> float:
        """Compute the chi-square of values as fitted against estimates of nothing with any share of bias.

        How much of the bias a machine has is not known: any share from none to all is as likely. So the likelihood of
        nothing is averaged over the share. Everything is divided by the inflation along the values.
        """
        own, inflation = float(values @ information @ values), self.inflation_along(values)
        length = float(self.bias @ information @ self.bias) ** 0.5
        along = float(values @ information @ self.bias) / length if length else 0.0
        shares = np.linspace(0.0, 1.0, _SHARES)
        left = np.asarray((along - length * shares) ** 2 / inflation, dtype=float)
        least = float(np.min(left))
        mixed = least - 2.0 * float(np.log(np.mean(np.exp(-0.5 * (left - least)))))
        return max(0.0, own - along**2) / inflation + mixed


class Replicas:
    """Recordings as they would be if a fitted model were the whole truth.

    Parameters
    ----------
    model : the fitted model
    position_std : noise of the position channels
    noise : per joint stretches (N,) of measurement noise of the drive effort at full rate, alike in length; of free
        cylinders it is as much less as in the model
    """

    def __init__(self, model: Model, position_std: PositionStd, noise: Sequence[Sequence[FloatArray]]) -> None:
        self._machine, self._bank = model.design.machine, model.design.bank
        self._position_std = position_std
        self._noise = [np.stack(stretch, axis=1) for stretch in zip(*noise, strict=True)]
        kinds = ((model.noise.of(joint, False), model.noise.of(joint, True)) for joint in range(len(noise)))
        self._share_unloaded = np.array([unloaded.std / loaded.std for unloaded, loaded in kinds])
        self._segments = [model.design.segments[i] for i in model.fitted]
        joints = range(len(self._machine.joints))
        theta, extra = model.fit.theta, model.extra
        self._efforts = [
            np.stack([predicted_effort(model.design, theta, joint, index, extra) for joint in joints], axis=1)
            for index in model.fitted
        ]

    @property
    def usable(self) -> bool:
        """True where a replica holds a stretch that is long enough for the filters, which it goes through once more."""
        return any(len(segment) >= shortest(self._bank) for segment in self._segments)

    def draw(self, rng: np.random.Generator) -> list[Recording]:
        """Draw one replica of the fitted recordings, in their order."""
        parts: dict[int, list[tuple[Segment, dict[str, FloatArray]]]] = {}
        for segment, effort in zip(self._segments, self._efforts, strict=True):
            drawn = resampled(self._noise, len(segment), self._bank.rate_hz, rng)
            noisy = effort + (drawn if segment.loaded else self._share_unloaded * drawn)
            parts.setdefault(segment.recording, []).append((segment, self._channels(segment, noisy, rng)))
        return [_recording(self._machine, parts[number]) for number in sorted(parts)]

    def _channels(self, segment: Segment, effort: FloatArray, rng: np.random.Generator) -> dict[str, FloatArray]:
        values: dict[str, FloatArray] = {}
        for number, joint in enumerate(self._machine.joints):
            for quantity, ideal in _ideal(joint, segment, number, effort[:, number]).items():
                channel = self._machine.channel(quantity, joint.name)
                if channel is not None:
                    std = self._position_std.get(channel.name, 0.0)
                    values[channel.name] = ideal + std * rng.standard_normal(len(ideal))
        if segment.temperature is not None:
            name = next(c.name for c in self._machine.channels if c.quantity == "oil_temperature")
            values[name] = segment.temperature
        return values


def resampled(noise: Sequence[FloatArray], length: int, rate_hz: float, rng: np.random.Generator) -> FloatArray:
    """Resample noise (length, n) from random blocks of stretches (N, n), random signs, faded into each other.

    All joints take the same blocks, so what they share remains shared. Fades keep the variance.
    """
    block, fade = max(2, round(BLOCK_SECONDS * rate_hz)), max(1, round(_FADE_SECONDS * rate_hz))
    usable = [stretch for stretch in noise if len(stretch) >= block + fade] or [max(noise, key=len)]
    weights = np.array([len(stretch) for stretch in usable], dtype=float)
    out = np.zeros((length + block + fade, usable[0].shape[1]))
    ramp = np.sin(0.5 * np.pi * (np.arange(fade) + 0.5) / fade)
    for start in range(0, length, block):
        stretch = usable[int(rng.choice(len(usable), p=weights / weights.sum()))]
        size = min(block + fade, len(stretch))
        first = int(rng.integers(0, len(stretch) - size + 1))
        piece = stretch[first : first + size] * rng.choice([-1.0, 1.0])
        edge = min(fade, size)
        window = np.ones(size)
        if start:
            window[:edge] = ramp[:edge]
        window[-edge:] *= ramp[:edge][::-1]
        out[start : start + size] += piece * window[:, None]
    return out[:length]


def _ideal(joint: Joint, segment: Segment, number: int, effort: FloatArray) -> dict[str, FloatArray]:
    """Compute what the joint's channels read without sensor noise, by quantity."""
    q, x, r = segment.q[:, number], segment.x[:, number], segment.r[:, number]
    qd = segment.qd[:, number]
    if joint.cylinder is None:
        return {"joint_position": q, "joint_velocity": qd, "joint_effort": effort}
    rod = segment.p2[:, number]
    external = np.zeros_like(x) if segment.external is None else segment.external[:, number]
    return {
        "external_force": external,
        "joint_position": q,
        "joint_velocity": qd,
        "piston_position": x,
        "cylinder_force": effort,
        "joint_effort": effort * r,
        "rod_pressure": rod,
        "head_pressure": (effort + rod * joint.cylinder.rod_area) / joint.cylinder.head_area,
    }


def _recording(machine: Machine, parts: Sequence[tuple[Segment, Mapping[str, FloatArray]]]) -> Recording:
    first = parts[0][0]
    return Recording(
        machine=machine.name,
        role=first.role,
        file=f"replica of recording {first.recording}",
        sha256="",
        rate_hz=machine.rate_hz,
        time=np.concatenate([segment.t for segment, _ in parts]),
        values={name: np.concatenate([values[name] for _, values in parts]) for name in parts[0][1]},
        bridged=None if first.bridged is None else np.concatenate([np.asarray(own.bridged) for own, _ in parts]),
    )
