"""Models for the tests: handed over by a fit, with parameters that the test chooses."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
from synthetic_arm import Truth, make_session, planar_machine, truth

from daq.machine.machine_file import Machine
from fitting.arm.base_parameters import reduce_parameters
from fitting.effects import effect
from fitting.effects.base import Effect
from fitting.loop.session import Session
from fitting.model.arm_model import ArmModel
from fitting.model.handover import hand_over
from fitting.residual.laws import Law
from fitting.residual.terms import Model, Term, fit_model
from fitting.signals.splines import spline_knots

SECONDS = 14.0


@cache
def session_of(joints: int = 2, kinds: str | None = None) -> Session:
    """A short session of a planar arm (or of ``kinds``)."""
    machine = planar_machine(joints, kinds=kinds)
    return make_session(machine, truth(len(machine.joints)), seconds=SECONDS)


def report_of(session: Session) -> dict[str, Any]:
    """The part of a report that a hand-over takes."""
    data = [{"role": r.role, "file": r.file, "sha256": r.sha256, "samples": len(r)} for r in session.recordings]
    return {"created": "2026-01-01T00:00:00+00:00", "software": {}, "data": data, "loop": {"verdict": "effect_added"}}


def fitted(session: Session, terms: Sequence[Term]) -> Model:
    """The joint refit with some terms."""
    plain = session.plain
    return fit_model(plain.design, plain.noise, plain.fitted, terms, session.prior, passes=3 if terms else 1)


def term_of(session: Session, name: str, joint: int, choice: int = 0) -> Term:
    """An effect on a joint in one of its shapes."""
    own = effect(name)
    machine, view = session.machine, session.base_model.views[session.plain.fitted[1]][joint]
    shape = dict(list(own.shapes(view))[choice])
    others = own.variants(machine, joint)[0]
    if others:
        shape["other"] = float(others[0])
    if name == "supply_ripple":
        shape |= {f"phase_{number}": 0.4 * number for number in range(len(session.recordings))}
    return Term(own, None if own.machine_wide else joint, shape)


def law_of(session: Session, signal: str, joint: int, *, signed: bool = False) -> Term:
    """A law of the joint's own signal."""
    law = Law(signal, None, signed, False, (0.0, 1.0))
    views = session.base_model.views
    values = np.concatenate([law.values(views[index][joint]) for index in session.plain.fitted])
    return Term(replace(law, knots=tuple(spline_knots(values, 6).tolist())), joint)


def applies(own: Effect, machine: Machine) -> int | None:
    """A joint that an effect can be fitted to, None if there is none."""
    return next((joint for joint in (1, 0) if own.applies(machine, joint)), None)


def model_with(terms: Sequence[Term], session: Session, size: float = 100.0) -> ArmModel:
    """A handed-over model whose effects are so many standard deviations larger than they were found."""
    model = hand_over(session, (), fitted(session, terms), report_of(session))
    first = len(model.parameters)
    passes = []
    for own in model.passes:
        theta = own.theta.copy()
        theta[first:] += size * model.std[first : len(theta)]
        passes.append(replace(own, theta=theta))
    return replace(model, passes=tuple(passes))


def true_model(machine: Machine, arm: Truth, session: Session) -> ArmModel:
    """A model without effects that has the true parameters, friction with exact signs."""
    model = hand_over(session, (), fitted(session, ()), report_of(session))
    exact = tuple(replace(own, speed=0.0, turning=0.0) for own in model.noise)
    return replace(model, noise=exact, passes=(replace(model.passes[-1], theta=arm.theta(machine)),))


def model_of(machine: Machine, session: Session) -> ArmModel:
    """A model of another machine with the session's joints: its drives, and base parameters at random."""
    base = reduce_parameters(machine)
    model = model_with((), session)
    drive = model.theta[: model.parameters.drive_count]
    theta = np.concatenate([drive, np.random.default_rng(2).normal(size=len(base)) * 5.0])
    count = len(theta)
    return replace(
        model,
        machine=machine,
        base=base,
        passes=(replace(model.passes[-1], theta=theta),),
        covariance=np.eye(count),
        told=np.ones(count, dtype=bool),
    )
