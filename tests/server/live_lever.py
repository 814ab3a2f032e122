"""A lever whose physics a test knows: motion and torque over time, with friction that can be changed."""

from __future__ import annotations

from typing import Any

import numpy as np
from service_fakes import MACHINE

from daq import Recording, parse_machine
from fitting.loop.session import Options, Session
from fitting.model.arm_model import ArmModel
from fitting.model.handover import hand_over
from fitting.residual.terms import Term, fit_model

RATE = 50.0
#: Noise of the angle in rad and of the torque in N m.
ANGLE_STD, TORQUE_STD = 2e-5, 0.5
COULOMB, VISCOUS, INERTIA, WEIGHT = 6.0, 12.0, 4.0, 60.0
Array = np.ndarray[Any, Any]


def signals(
    seconds: float, seed: int, coulomb: float | Array = COULOMB, bias: float = 0.0
) -> tuple[Array, dict[str, Array]]:
    """Time, and the SI values of the channels; ``coulomb`` may change over time."""
    random = np.random.default_rng(seed)
    t = np.arange(round(seconds * RATE)) / RATE
    q, v, a = np.zeros_like(t), np.zeros_like(t), np.zeros_like(t)
    for k in range(1, 6):
        w, phase, size = 2 * np.pi * 0.11 * k * (1 + 0.07 * random.uniform(-1, 1)), random.uniform(0, 6), 0.25 / k
        q += size * np.sin(w * t + phase)
        v += size * w * np.cos(w * t + phase)
        a -= size * w**2 * np.sin(w * t + phase)
    torque = INERTIA * a + WEIGHT * np.cos(q) + coulomb * np.sign(v) + VISCOUS * v + bias
    return t, {
        "joint1.angle": q + ANGLE_STD * random.standard_normal(len(t)),
        "joint1.torque": torque + TORQUE_STD * random.standard_normal(len(t)),
    }


def recording(seconds: float, seed: int, role: str, **change: Any) -> Recording:
    t, values = signals(seconds, seed, **change)
    return Recording("lever", role, f"{role}.csv", f"{seed}", RATE, t, values)


def session() -> Session:
    """Data of an identification of the lever."""
    machine = parse_machine(MACHINE)
    recordings = [recording(60, 1, "train"), recording(40, 2, "validate")]
    return Session(machine, recordings, Options(loop=False, bandwidth_hz=3.0))


def handed_over(made: Session, terms: tuple[Term, ...] = ()) -> ArmModel:
    """The model that an identification of the lever hands over, with some effects."""
    model = (
        fit_model(made.plain.design, made.plain.noise, made.plain.fitted, terms, made.prior)
        if terms
        else (made.base_model)
    )
    data = [{"role": r.role, "file": r.file, "sha256": r.sha256, "samples": len(r)} for r in made.recordings]
    report = {"created": "2026-01-01T00:00:00+00:00", "software": {}, "data": data, "loop": {"verdict": "x"}}
    return hand_over(made, (), model, report)
