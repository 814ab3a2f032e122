"""Trials: each takes back one mistake, and the best arm that could exist is fitted once more.

A trial is a changed set of samples, a changed machine file, or other weights of the measured signals in a joint's
effort. What counts is how much better the efforts are explained: the sum over the joints of the logarithm of the
misfit, before and after, with all misfits below :data:`fitting.checks.mistakes.physical.LEAST_MISFIT` alike.

What accuses: the misfit of a joint falls by :data:`CLEAR` at least and is sound afterwards, no other joint gets worse,
and the nominal value is far from what any effect of the catalogue can be, because only gross values are tried. Effects
leave a few per cent of the effort unexplained (21 % on a slewing axis that is tilted by five degrees, which no trial
halves), measured machines up to a fifth, and no trial halves that either. What only puts channels or roles right
(exact) is tried however small the misfit is: a permutation has no size that could be an effect's.

Some effects can be most of a joint's effort and are no mistakes: they are tried before an effort is called unexplained
(:func:`with_payload`, :func:`with_couplings`).
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TypeAlias

import numpy as np

from daq.messages import Sentence
from fitting.arrays import BoolArray
from fitting.checks.mistakes.channel_trials import efforts, in_one_recording, motions, recordings, scales, times
from fitting.checks.mistakes.hypothesis import CLEAR, Build, Hypothesis, Targets
from fitting.checks.mistakes.machine_trials import effects, gravity, lengths, sizes
from fitting.checks.mistakes.physical import (
    LEAST_MISFIT,
    Physical,
    Trial,
    declared,
    fit,
    joint_columns,
    measured_effort,
    without,
)
from fitting.checks.mistakes.samples import POSITIONS

#: What is left of a joint's effort afterwards: measured machines have up to a quarter.
SOUND = 0.30
#: Misfit from which trials are made at all: 4 to 5 % are usual on small joints of sound machines.
SUSPECT = 0.10
#: Share of the largest effort (at cylinders: pressure) of the arm that a joint has to carry.
CARRIES = 0.02
#: No other joint may get worse by more than this factor.
WORSE = 1.4
#: Misfits below this are alike where the whole arm is in question; it is explained badly from so many times this on.
FINEST_MISFIT, _BADLY = 0.004, 2.0
#: Sum over the joints of the logarithm of the misfit's fall that a slip has to have: twice by CLEAR, all but.
_SLIP = 1.5
#: Of two trials that explain alike, the simpler one is named: within this share of the logarithm's gain.
ALIKE = 0.12
#: Nothing separates these; so many are named beside the one that is accused.
THE_SAME, _MOST_ALTERNATIVES = 0.02, 3
_MOST_MISTAKES, _MOST_ROUNDS = 3, 4
#: Share of the joints that have to be explained better by a factor where a recording as a whole is in question.
_MOST_JOINTS, _BETTER = 0.5, 1.4
#: Samples of a recording, and share of them, in which a joint has to move to be a witness of what is wrong in it.
_LEAST_SAMPLES, _LEAST_PART = 20, 0.2
#: Trials of one round that are fitted with bounds, after all were without.
_MOST_BOUNDED = 12
#: A joint among the others is explained so many times worse than alone, and this badly.
_ALONE_WELL, _LEAST_APART = 2.5, 0.04
#: Moments at which a load may be picked up, evenly over the longest recording.
_MOMENTS = 15
#: Shares of the usual speed and acceleration at which a saturating coupling bends.
_KNEES = (0.1, 0.3, 1.0)


@dataclass(frozen=True)
class Accused:
    """A hypothesis that explains the efforts, with misfits before and after, and how much it is worth.

    ``alternatives`` explain as much to within :data:`THE_SAME`.
    """

    hypothesis: Hypothesis
    joint: int
    before: Physical
    after: Physical
    gain: float
    alternatives: tuple[Hypothesis, ...] = ()


#: What is accused, and trial and targets with it taken back.
_Found: TypeAlias = tuple[Accused, Trial, Targets]


def _gain(before: Physical, after: Physical, *, free: bool = False) -> float:
    """Sum the logarithm of the misfit's fall over the joints."""
    first, second = before.misfits, (after.free if free else after.misfits)
    both = np.isfinite(first) & np.isfinite(second)
    a = np.hypot(first[both], LEAST_MISFIT)
    b = np.hypot(second[both], LEAST_MISFIT)
    return float(np.sum(np.log(a / b)))


def _apart(current: Physical) -> BoolArray:
    """Find joints explained well alone and badly among the others: their effort's scale is not the others'."""
    return np.asarray((current.misfits > _ALONE_WELL * current.own) & (current.misfits > _LEAST_APART))


def _suspicious(current: Physical) -> BoolArray:
    """Find joints whose misfit is worth trials."""
    return np.asarray(((current.misfits > SUSPECT) | _apart(current)) & ~(current.shares < CARRIES))


def _worth_trying(option: Hypothesis, current: Physical) -> bool:
    """Return whether a joint that a hypothesis is about is explained badly enough for it.

    An exact one may be about a joint of any misfit that can fall as far as it asks for.
    """
    own = _suspicious(current)
    if option.exact:
        least = LEAST_MISFIT if option.recording is None else FINEST_MISFIT  # the others dilute what is wrong in one
        falls = np.hypot(current.misfits, least) / least
        return not np.all((falls < option.least)[list(option.joints) or slice(None)])
    # Where a link is, and how it moves, shows at any joint that carries it or is carried by it.
    everywhere = option.code in ("length", "axis", "linkage") or bool(set(POSITIONS) & set(option.channels))
    about = [] if everywhere else list(option.joints)
    there = bool(np.isnan(current.misfits[about]).any()) or bool(own[about].any()) if about else True
    return (option.slip and _badly_everywhere(current)) or (bool(own.any()) and there)


def _badly_everywhere(current: Physical) -> bool:
    """Return whether most joints are explained worse than by filtering and thinning a perfect fit."""
    misfits = current.misfits[~(current.shares < CARRIES) & np.isfinite(current.misfits)]
    return bool(len(misfits)) and float(np.median(misfits)) > _BADLY * FINEST_MISFIT


@dataclass(frozen=True)
class Searched:
    """Mistakes that explain the efforts, the nominal fit, and fit and trial with mistakes and effects taken back."""

    accused: tuple[Accused, ...]
    nominal: Physical
    current: Physical
    trial: Trial


def search(trial: Trial) -> Searched:
    """Find the fewest mistakes that explain the efforts.

    Greedy: the best hypothesis is taken back, then the next one is looked for beside it, three at most.
    """
    trial = trial.exchanging(len(trial.machine.joints) > 1)
    targets: Targets = {}
    nominal = current = fit(trial)
    found: list[Accused] = []
    for _ in range(_MOST_ROUNDS):
        if len(found) == _MOST_MISTAKES:
            break
        # All are compared: a wrong bore explains more than the exchange of cables that it resembles.
        tried = [*_everywhere(trial), *_one_by_one(trial)]
        tried += [own for number in _odd_ones(trial, targets, current) for own in in_one_recording(trial, number)]
        best = _best(trial, targets, current, tuple(o for o in tried if _worth_trying(o, current)))
        if best is None:
            break
        accused, trial, targets = best
        current = accused.after
        if accused.hypothesis.code:
            found.append(accused)
    return Searched(tuple(found), nominal, current, trial)


def _odd_ones(trial: Trial, targets: Targets, current: Physical) -> list[int]:
    """Find recordings without which a joint is explained far better, however good it is: they may hold a mistake."""
    found = []
    for option in recordings(trial):
        if option.code != "other_machine" or option.recording is None:
            continue
        changed, wanted = option.build(trial, targets)
        after = fit(changed, wanted, bounded=False)
        a, b = np.hypot(current.misfits, FINEST_MISFIT), np.hypot(after.free, FINEST_MISFIT)
        if np.any((a / b > CLEAR) & ~(current.shares < CARRIES)):
            found.append(option.recording)
    return found


def _best(trial: Trial, targets: Targets, current: Physical, options: Sequence[Hypothesis]) -> _Found | None:
    screened = []
    for option in options:
        try:
            # A hypothesis may be absurd (a linkage that cannot close): its numbers are then no numbers, and lose.
            with np.errstate(all="ignore"):
                changed, wanted = option.build(trial, targets)
                if changed is not trial and not targets:
                    changed = changed.exchanging(False)
                best_case = fit(changed, wanted, bounded=False)
        except (KeyError, ValueError, ArithmeticError, np.linalg.LinAlgError):
            continue  # an earlier finding took the channel away, or the change cannot be computed
        if _helped(trial, option, current, replace(best_case, misfits=best_case.free)) is not None:
            screened.append((_gain(current, best_case, free=True), option, changed, wanted))
    screened.sort(key=lambda item: -item[0])
    screened = screened[:_MOST_BOUNDED]
    fitted: list[_Found] = []
    top = 0.0
    for bound, option, changed, wanted in screened:
        if bound < (1 - ALIKE) * top:
            break
        after = fit(changed, wanted)
        joint = _helped(trial, option, current, after)
        if joint is None:
            continue
        gain = _gain(current, after)
        top = max(top, gain)
        fitted.append((Accused(option, joint, current, after, gain), changed.exchanging(trial.exchange), wanted))
    near = [item for item in fitted if item[0].gain > (1 - ALIKE) * top]
    if not near:
        return None
    accused, changed, wanted = min(near, key=lambda item: (item[0].hypothesis.price, -item[0].gain))
    same = [item[0] for item in near if item[0] is not accused and item[0].gain > (1 - THE_SAME) * accused.gain]
    same.sort(key=lambda item: (item.hypothesis.price, -item.gain))
    others = tuple(own.hypothesis for own in same if own.hypothesis.code)[:_MOST_ALTERNATIVES]
    return replace(accused, alternatives=others), changed, wanted


def _helped(trial: Trial, option: Hypothesis, before: Physical, after: Physical) -> int | None:
    """Return the joint that is newly explained; None if there is none, or another is explained worse.

    A joint that carries next to nothing of the arm's effort (a wrist, whose cables weigh as much) accuses nobody.
    """
    whole = option.recording is not None and not option.joints
    if option.recording is not None and option.exact:
        before = _within(trial, option.recording, before, after)
    a, b = np.hypot(before.misfits, LEAST_MISFIT), np.hypot(after.misfits, LEAST_MISFIT)
    if np.any(b > WORSE * a):
        return None
    informative = ~(before.shares < CARRIES)
    if option.recording is not None:
        informative &= _moves_in(trial, option.recording)
    if option.code == "wrong_role":
        informative &= np.array([joint.cylinder is not None for joint in trial.machine.joints])
    if option.slip:
        fine = np.hypot(before.misfits, FINEST_MISFIT) / np.hypot(after.misfits, FINEST_MISFIT)
        known = informative & np.isfinite(fine)
        gains = np.log(fine[known])
        if known.any() and gains.min() > -np.log(WORSE) and gains.max() > np.log(CLEAR) and gains.sum() > _SLIP:
            return int(np.nanargmax(np.where(known, fine, 0.0)))
    fall = np.where((after.misfits < SOUND) & informative, a / b, 0.0)
    if not informative.any() or (whole and np.mean((fall >= _BETTER)[informative]) < _MOST_JOINTS):
        return None  # rods are on or off, and a machine is another one, at all joints; a valve acts otherwise at one
    asked = np.ones(len(fall), dtype=bool) if option.exact else _suspicious(before)
    joint = int(np.nanargmax(np.where(asked, fall, 0.0)))
    return joint if asked[joint] and fall[joint] >= option.least else None


def _moves_in(trial: Trial, recording: int) -> BoolArray:
    """Return which joints move enough in a recording to be informative: a parked one holds any load."""
    mine = (trial.samples.recording == recording) & trial.samples.used
    part = np.count_nonzero(trial.motion.active[mine], axis=0)
    return np.asarray(part >= max(_LEAST_SAMPLES, _LEAST_PART * np.count_nonzero(mine)))


def _within(trial: Trial, recording: int, before: Physical, after: Physical) -> Physical:
    """Compute misfits in one recording alone: all that is explained afterwards was missing in it, not in the others."""
    mine = (trial.samples.recording == recording) & trial.samples.used
    part, whole = (np.count_nonzero(trial.motion.active[rows], axis=0) for rows in (mine, trial.samples.used))
    share = part / np.maximum(whole, 1)
    fallen = np.maximum(before.misfits**2 - after.misfits**2, 0.0) / np.maximum(share, 1e-3)
    return replace(before, misfits=np.where(share > 0, np.sqrt(after.misfits**2 + fallen), before.misfits))


def _everywhere(trial: Trial) -> Iterator[Hypothesis]:
    """Try one mistake made at every joint: its sign, its chambers, the direction of gravity."""
    n = len(trial.machine.joints)
    if n < 2:
        return
    groups: dict[tuple[str, tuple[str, ...]], list[Hypothesis]] = {}
    for own in [*efforts(trial, exchanges=False), *motions(trial, exchanges=False)]:
        if own.code in ("swapped_chambers", "sign"):
            groups.setdefault((own.code, own.channels), []).append(own)
    for (code, channels), members in groups.items():
        if len(members) > 1:
            seen = "fitting.look_swapped_every_joint" if code == "swapped_chambers" else "fitting.every_joint_look_if"
            text = Sentence(seen, what=" and ".join(q.replace("_", " ") for q in channels))
            joints, build, factor = tuple(m.joints[0] for m in members), _one_after_another(members), members[0].factor
            yield Hypothesis(code, text, members[0].cure, joints, build, channels, factor=factor, price=0.9, every=True)


def _one_after_another(members: Sequence[Hypothesis]) -> Build:
    def build(trial: Trial, targets: Targets) -> tuple[Trial, Targets]:
        for member in members:
            trial, targets = member.build(trial, targets)
        return trial, targets

    return build


def _one_by_one(trial: Trial) -> Iterator[Hypothesis]:
    """Try mistakes of one channel, recording or number, and the effects that resemble them."""
    for tried in (efforts, motions, recordings, gravity, effects, sizes, scales, lengths, times):
        yield from tried(trial)


def with_payload(trial: Trial) -> Physical:
    """Fit the best arm with a payload picked up (or put down) in the course of each recording."""
    since = trial.samples.since
    moments = np.linspace(0.0, float(since.max()), _MOMENTS + 2)[1:-1]
    carried = (own for moment in moments for own in (since > moment, since < moment))
    fits = (fit(replace(trial, exchange=False, carried=own.astype(float))) for own in carried)
    return min(fits, key=lambda own: float(np.nansum(np.log(own.misfits + 0.02))))


def with_couplings(trial: Trial, number: int) -> float:
    """Compute the misfit of one joint where the other joints' motion may push it; NaN if undetermined."""
    motion, samples, machine = trial.motion, trial.samples, trial.machine
    rows = motion.active[:, number] & samples.loaded & samples.used
    others = [k for k in range(len(machine.joints)) if k != number]
    if not declared(machine, samples, number) or np.count_nonzero(rows) < 60 or not others:
        return np.nan
    y = measured_effort(trial, number)[0]
    columns = [joint_columns(trial, number)]
    for other in others:
        columns.append(motion.q[:, other])
        for rate in (motion.qd[:, other], motion.qdd[:, other]):
            usual = max(float(np.sqrt(np.mean(rate[rows] ** 2))), 1e-12)
            columns += [rate / usual, *(np.tanh(rate / (knee * usual)) for knee in _KNEES)]
    A, target = np.column_stack(columns)[rows], y[rows]
    spread = float(np.linalg.norm(target - target.mean()))
    return float(np.linalg.norm(without(A, target))) / spread if spread > 0 else np.nan
