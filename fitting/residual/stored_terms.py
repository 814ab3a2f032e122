"""Terms, and what was rebuilt into signals, as plain JSON: between stages, and in the file of a model."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import asdict
from typing import Any

import numpy as np

from daq.machine.machine_file import Machine
from fitting.effects import effect
from fitting.effects.base import Effect
from fitting.residual.kinematics import GapScore
from fitting.residual.laws import Law
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Term
from fitting.signals.corrections import Corrections


def term_to_json(term: Term) -> dict[str, Any]:
    """Return a term as plain JSON; :func:`term_from_json` reads it back."""
    law = asdict(term.content) if isinstance(term.content, Law) else None
    return {
        "effect": None if isinstance(term.content, Law) else term.content.id,
        "law": law and {key: list(value) if isinstance(value, tuple) else value for key, value in law.items()},
        "joint": term.joint,
        "shape": dict(term.shape),
        "rebuilt": list(term.rebuilt),
        "resampled": term.resampled,
        "held": list(term.held),
        "expected": None if term.expected is None else term.expected.tolist(),
    }


def term_from_json(value: Mapping[str, Any]) -> Term:
    """Invert :func:`term_to_json`."""
    content: Effect | Law = effect(value["effect"]) if value["law"] is None else _law_from_json(value["law"])
    applied = tuple(value["rebuilt"]), value.get("resampled", False), tuple(value.get("held", ()))
    expected = value.get("expected")
    expected = None if expected is None else np.array(expected)
    return Term(content, value["joint"], dict(value["shape"]), *applied, expected)


def _law_from_json(law: Mapping[str, Any]) -> Law:
    own: dict[str, Any] = {key: tuple(value) if isinstance(value, list) else value for key, value in law.items()}
    return (Surface if "second" in own else Law)(**own)


def corrections_from_json(machine: Machine, steps: Sequence[Mapping[str, Any]]) -> Corrections:
    """Read corrections of a machine with channels at its joints from stored ``steps``, in order."""
    corrections = Corrections(machine)
    for step in steps:
        own, joint = effect(step["effect"]), machine.joints[step["joint"]].name
        corrections = own.apply_to_signals(corrections, joint, dict(step["shape"]), tuple(step["values"]))
    return corrections


def step_to_json(step: GapScore) -> dict[str, Any]:
    """Return one rebuilt step as plain JSON."""
    return {
        "effect": step.effect.id,
        "joint": step.joint,
        "shape": dict(step.shape),
        "values": list(step.values),
    }
