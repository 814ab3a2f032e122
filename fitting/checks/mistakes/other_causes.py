"""Effects that can be most of a joint's effort, and are no mistakes: tried before an effort is called unexplained.

A load that is picked up at some moment: from then on, the last link has further point masses. Forces that another
joint's motion causes at a joint, which can be most of a small joint's effort: the joint's own model with functions of
every other joint's position, speed and acceleration beside it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.checks.mistakes.physical import Physical, Trial, declared, fit, friction, measured_effort, without

#: Moments that are tried, evenly over the longest recording.
_MOMENTS = 15
#: Shares of the usual speed and acceleration at which a saturating coupling bends.
_KNEES = (0.1, 0.3, 1.0)


def with_payload(trial: Trial) -> Physical:
    """Fit the best arm with a payload picked up (or put down) in the course of each recording."""
    since = trial.samples.since
    best: tuple[float, Physical] | None = None
    for moment in np.linspace(0.0, float(since.max()), _MOMENTS + 2)[1:-1]:
        for carried in (since > moment, since < moment):
            after = fit(replace(trial, exchange=False, carried=carried.astype(float)))
            left = float(np.nansum(np.log(after.misfits + 0.02)))
            if best is None or left < best[0]:
                best = left, after
    assert best is not None
    return best[1]


def with_couplings(trial: Trial, number: int) -> float:
    """Compute the misfit of one joint where the other joints' motion may push it; NaN if undetermined."""
    motion, samples, machine = trial.motion, trial.samples, trial.machine
    rows = motion.active[:, number] & samples.loaded & samples.used
    others = [k for k in range(len(machine.joints)) if k != number]
    if not declared(machine, samples, number) or np.count_nonzero(rows) < 60 or not others:
        return np.nan
    y = measured_effort(trial, number)[0]
    body = trial.body[:, number] / motion.r[:, [number]]
    columns = [body, motion.a[:, number], friction(motion.v[:, number], motion.speed_noise[number])]
    columns += [np.ones(len(y)), motion.x[:, number]]
    for other in others:
        columns.append(motion.q[:, other])
        for rate in (motion.qd[:, other], motion.qdd[:, other]):
            usual = max(float(np.sqrt(np.mean(rate[rows] ** 2))), 1e-12)
            columns += [rate / usual, *(np.tanh(rate / (knee * usual)) for knee in _KNEES)]
    A, target = np.column_stack(columns)[rows], y[rows]
    spread = float(np.linalg.norm(target - target.mean()))
    return float(np.linalg.norm(without(A, target))) / spread if spread > 0 else np.nan
