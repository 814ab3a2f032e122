"""Common parts of measured machines: the loop through its stages, and the relative error that publications print."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from fitting.arrays import BoolArray, FloatArray
from fitting.loop.refits import final_model
from fitting.loop.session import Options, Request, Session
from fitting.pipeline.stages import run_stage
from fitting.residual.stored_terms import corrections_from_json, term_from_json
from fitting.residual.terms import Model, Term

Low = Callable[[FloatArray], FloatArray]

_LOOP = ("check", "cylinder_stage", "rigid_body_stage", "residual", "attribution")


@dataclass(frozen=True)
class Found:
    """Findings of the loop in a machine's recordings, with no help.

    Attributes
    ----------
    verdict : the report's
    bandwidth_hz : that it worked in
    terms : what was added, ready for a refit
    lines : per added effect ``(name, joint, evidence, rivals)``
    candidates : every candidate with status and reason
    results : of the stages, as they are stored
    """

    verdict: str
    bandwidth_hz: float
    terms: tuple[Term, ...]
    lines: tuple[tuple[str, str, Mapping[str, Any], tuple[str, ...]], ...]
    candidates: tuple[Mapping[str, Any], ...]
    results: Mapping[str, dict[str, Any]]

    @property
    def names(self) -> tuple[str, ...]:
        """Ids of the effects that were added."""
        return tuple(name for name, *_ in self.lines)

    @property
    def strongest_others(self) -> list[Mapping[str, Any]]:
        """The three strongest candidates that were not taken, the best first."""
        taken = {(item["term"]["effect"], item["term"]["joint"]) for _, _, item, _ in self.lines}
        others = [c for c in self.candidates if (c["id"], c["joint"]) not in taken]
        return sorted(others, key=lambda c: -float(c["score"]))[:3]

    def best(self, effect: str) -> Mapping[str, Any]:
        """Return the strongest candidate of an effect."""
        return max((c for c in self.candidates if c["id"] == effect), key=lambda c: float(c["score"]))

    def in_a_set(self, effect: str) -> bool:
        """Test whether an effect was added, or is in an added one's set, inseparable by the data."""
        return any(effect == name or effect in rivals for name, _, _, rivals in self.lines)


def loop(machine: Path, recordings: Sequence[tuple[str, Path]], output: Path, options: Options | None = None) -> Found:
    """Run every stage up to the attribution, as ``hilfit identify`` does."""
    request = Request(machine, tuple(recordings), output, options or Options())
    results = {stage: run_stage(stage, request) for stage in _LOOP}
    accepted = results["attribution"]["accepted"]
    names = [joint.name for joint in Session.load(request).machine.joints]
    lines = []
    for item in accepted:
        term = item["term"]
        name = str(term["effect"]) if term["law"] is None else f"law of {term['law']['signal']}"
        joint = "machine" if term["joint"] is None else names[term["joint"]]
        lines.append((name, joint, item, tuple(rival["id"] for rival in item["rivals"])))
    return Found(
        str(results["attribution"]["verdict"]),
        float(results["check"]["bandwidth_hz"]),
        tuple(term_from_json(item["term"]) for item in accepted),
        tuple(lines),
        tuple(results["attribution"]["candidates"]),
        json.loads(json.dumps(results)),
    )


def refitted(session: Session, terms: Sequence[Term], found: Found | None = None) -> Model:
    """Refit base and terms jointly on a session; kinematic corrections as the loop found them."""
    steps = [] if found is None else [s for f in found.results["residual"]["kinematics"] for s in f["steps"]]
    return final_model(session, corrections_from_json(session.machine, steps), terms)[1].model


@dataclass(frozen=True)
class Stack:
    """Columns and targets of all joints in some segments, in joint effort.

    Attributes
    ----------
    columns, target : per joint (N, p) and (N,), rows at the recording's rate, before any filter
    reduced, reduced_target : the same through the identification filter, (M, p) and (M,)
    keep : per joint (M,) False where the joint stands still
    """

    columns: tuple[FloatArray, ...]
    target: tuple[FloatArray, ...]
    reduced: tuple[FloatArray, ...]
    reduced_target: tuple[FloatArray, ...]
    keep: tuple[BoolArray, ...]

    def fit(self, inside: BoolArray | None = None) -> FloatArray:
        """Solve least squares over the moving rows (of those ``inside``, (M,)); zero where undetermined."""
        chosen = [keep if inside is None else keep & inside for keep in self.keep]
        A = np.vstack([rows[own] for rows, own in zip(self.reduced, chosen, strict=True)])
        b = np.concatenate([rows[own] for rows, own in zip(self.reduced_target, chosen, strict=True)])
        scale = np.maximum(np.linalg.norm(A, axis=0), 1e-300)
        return np.asarray(np.linalg.lstsq(A / scale, b, rcond=1e-9)[0] / scale)

    def moving_error(self, theta: FloatArray, inside: BoolArray | None = None) -> tuple[FloatArray, FloatArray]:
        """Compute error and effort of the moving rows in the identification band, all joints."""
        chosen = [keep if inside is None else keep & inside for keep in self.keep]
        effort = [y[own] for y, own in zip(self.reduced_target, chosen, strict=True)]
        parts = zip(self.reduced_target, self.reduced, chosen, strict=True)
        error = [(y - A @ theta)[own] for y, A, own in parts]
        return np.concatenate(error), np.concatenate(effort)

    def every_row(self, low: Low) -> tuple[tuple[FloatArray, ...], tuple[FloatArray, ...]]:
        """Stack columns and targets of all rows, standstill included, through a low-pass ``low`` that decimates."""
        columns = tuple(np.column_stack([low(column) for column in rows.T]) for rows in self.columns)
        return columns, tuple(low(y) for y in self.target)


def stack_of(model: Model, index: int) -> Stack:
    """Stack one segment of a model's design, drive and base columns first, then those of its terms."""
    design = model.design
    segment = design.segments[index]
    columns, target, keep = [], [], []
    for joint in range(len(design.machine.joints)):
        block = design.blocks[joint][index]
        own = model.extra.columns[joint][index]
        more = np.zeros((len(segment), len(model.extra.names))) if own is None else own
        r = segment.r[:, joint]
        columns.append(np.hstack([block.columns, more]) * r[:, None])
        target.append(block.target * r)
        keep.append(block.keep)
    return Stack(
        tuple(columns),
        tuple(target),
        tuple(design.bank.reduce(rows) for rows in columns),
        tuple(design.bank.reduce(rows) for rows in target),
        tuple(keep),
    )


def relative(error: npt.ArrayLike, effort: npt.ArrayLike) -> float:
    """Compute ``100 |error| / |effort|``, in percent: the literature's relative error."""
    return 100.0 * float(np.linalg.norm(np.asarray(error)) / np.linalg.norm(np.asarray(effort)))
