"""Trials of efforts: chambers swapped, signs, units, cables exchanged between joints, bore and rod, scale."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping

import numpy as np

from fitting.checks.findings import worded
from fitting.checks.mistakes.factors import gains
from fitting.checks.mistakes.hypothesis import Build, Hypothesis, Targets
from fitting.checks.mistakes.physical import Trial, declared


def _weighted(number: int, change: Callable[[dict[str, float]], dict[str, float]]) -> Build:
    def build(trial: Trial, targets: Targets) -> tuple[Trial, Targets]:
        own = dict(targets.get(number) or declared(trial.machine, trial.samples, number))
        return trial, {**targets, number: change(own)}

    return build


def efforts(trial: Trial, *, exchanges: bool = True) -> Iterator[Hypothesis]:
    machine, samples = trial.machine, trial.samples
    n = len(machine.joints)
    for j, joint in enumerate(machine.joints):
        if trial.blocks[j] is None:
            continue
        own = declared(machine, samples, j)
        head, rod = f"head_pressure{j}", f"rod_pressure{j}"
        if head in own and joint.cylinder is not None:
            A1, A2 = joint.cylinder.head_area, joint.cylinder.rod_area
            yield Hypothesis(
                *worded("swapped_chambers"), (j,),
                _weighted(j, lambda w, h=head, r=rod, a=A1, b=A2: {**w, h: -b, r: a}),  # type: ignore[misc]
                ("head_pressure", "rod_pressure"), exact=True,
            )  # fmt: skip
            for name, quantity in ((head, "head_pressure"), (rod, "rod_pressure")):
                signal = samples.get(quantity, j)
                if signal is not None and np.median(signal.value) < 0:  # a pressure with the right sign is positive
                    yield Hypothesis(
                        *worded("sign/scale"), (j,),
                        _weighted(j, lambda w, c=name: {**w, c: -w[c]}), (quantity,), factor=-1.0, price=1.2,  # type: ignore[misc]
                        exact=True,
                    )  # fmt: skip
                channel = machine.channel(quantity, joint.name)
                assert channel is not None
                for gain, unit in gains("Pa", machine.conversion(channel).factor).items():
                    yield Hypothesis(
                        *worded("unit/like", says=unit), (j,),
                        _weighted(j, lambda w, c=name, g=gain: {**w, c: g * w[c]}), (quantity,), factor=gain,  # type: ignore[misc]
                    )  # fmt: skip
        measured = next((q for q in ("cylinder_force", "joint_effort") if f"{q}{j}" in own), None)
        yield Hypothesis(
            *worded("sign/effort" if measured is None else "sign/scale"), (j,),
            _weighted(j, lambda w: {k: (v if k == "known" else -v) for k, v in w.items()}),
            (measured,) if measured else ("head_pressure", "rod_pressure"), factor=-1.0, price=1.3,
            exact=True,
        )  # fmt: skip
        if n > 1 and measured is not None:
            channel = machine.channel(measured, joint.name)
            assert channel is not None
            for gain, unit in gains(machine.si_unit(channel), machine.conversion(channel).factor).items():
                yield Hypothesis(
                    *worded("unit/like", says=unit), (j,),
                    _weighted(j, lambda w, g=gain: {k: g * v for k, v in w.items()}), (measured,), factor=gain,  # type: ignore[misc]
                )  # fmt: skip
        for other in range(j + 1, n) if exchanges else ():
            yield from _exchanges(trial, j, other)


def _exchanges(trial: Trial, j: int, other: int) -> Iterator[Hypothesis]:
    """Exchange channels of two joints: the whole effort, or one chamber."""
    machine, samples = trial.machine, trial.samples
    own, theirs = declared(machine, samples, j), declared(machine, samples, other)
    names = machine.joints[j].name, machine.joints[other].name
    quantities = sorted(
        {k.rstrip("0123456789") for k in own if k != "known"} & {k.rstrip("0123456789") for k in theirs}
    )
    if not quantities or trial.blocks[other] is None:
        return
    sets = [tuple(quantities)] + [(q,) for q in quantities if len(quantities) > 1]

    def build_of(chosen: tuple[str, ...]) -> Build:
        def renamed(weights: Mapping[str, float], a: int, b: int) -> dict[str, float]:
            return {(k[: -len(str(a))] + str(b) if k != "known" and k.rstrip("0123456789") in chosen else k): v
                    for k, v in weights.items()}  # fmt: skip

        def build(trial: Trial, targets: Targets) -> tuple[Trial, Targets]:
            first = targets.get(j) or declared(trial.machine, trial.samples, j)
            second = targets.get(other) or declared(trial.machine, trial.samples, other)
            return trial, {**targets, j: renamed(first, j, other), other: renamed(second, other, j)}

        return build

    for chosen in sets:
        what = " and ".join(q.replace("_", " ") for q in chosen)
        yield Hypothesis(
            *worded("exchanged_channels", what=what, first=names[0], second=names[1]), (j, other),
            build_of(chosen), chosen, price=1.1, exact=True,
        )  # fmt: skip


def sizes(trial: Trial) -> Iterator[Hypothesis]:
    """Try another bore or rod: both areas estimated, with all other joints as the measure."""
    for j, joint in enumerate(trial.machine.joints):
        block = trial.blocks[j]
        if block is None or joint.cylinder is None or f"head_pressure{j}" not in block.names:
            continue
        bore, rod = joint.cylinder.bore, joint.cylinder.rod
        for factor in (0.1, 0.5, 0.63, 0.7, 0.794, 1.25, 1.4, 1.6, 2.0, 10.0):
            for code, b, d in (("bore", factor * bore, rod), ("rod", bore, factor * rod)):
                if not 0 < d < b:
                    continue
                A1, A2 = np.pi / 4 * b**2, np.pi / 4 * (b**2 - d**2)
                old, new = (bore, b) if code == "bore" else (rod, d)
                yield Hypothesis(
                    *worded(code, part=code, new=1e3 * new, old=1e3 * old), (j,),
                    _weighted(j, lambda w, h=f"head_pressure{j}", r=f"rod_pressure{j}", a=A1, c=A2: {**w, h: a, r: -c}),  # type: ignore[misc]
                    key=("joints", j, "cylinder", code), factor=factor, price=1.5,
                )  # fmt: skip


#: Scales of a whole effort that are tried; a transducer's gain is an effect up to ten per cent.
SCALES = (0.1, 0.2, 0.3, 0.4, 0.5, 0.6, 0.7, 0.8, 1.25, 1.4, 1.6, 2.0, 2.5, 3.3, 5.0, 10.0)


def scales(trial: Trial) -> Iterator[Hypothesis]:
    """Try a joint's effort too large or too small as a whole, whatever the reason."""
    for j in range(len(trial.machine.joints)):
        if trial.blocks[j] is None or len(trial.machine.joints) < 2:
            continue
        for factor in SCALES:
            yield Hypothesis(
                *worded("effort_scale", times=1 / factor), (j,),
                _weighted(j, lambda w, g=factor: {k: (v if k == "known" else g * v) for k, v in w.items()}),  # type: ignore[misc]
                key=("joints", j), factor=factor, price=1.75,
            )  # fmt: skip
