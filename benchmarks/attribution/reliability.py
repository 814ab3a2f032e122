"""Whether stated probabilities are frequencies: reliability diagram, expected calibration error, Brier score.

A statement is one thing that an identification says with a probability: "nothing is missing", an effect on a joint
(each member of a set by itself), a law of one signal on a joint. It is right or it is not. Results without
probabilities are taken at their word: what stands first is said for certain.

Sources: A. Dawid, "The well-calibrated Bayesian", 1982; C. Guo et al., "On calibration of modern neural networks",
2017 (expected calibration error); G. Brier, "Verification of forecasts expressed in terms of probability", 1950.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta

from benchmarks.targets import Check, figure

Line = dict[str, Any]
Statement = tuple[float, bool]

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
#: Largest expected calibration error.
LARGEST_ERROR = 0.05


@dataclass(frozen=True)
class Bin:
    """Statements of nearly one probability: how many, their mean probability, and the share of them that is right."""

    count: int
    stated: float
    right: float
    low: float
    high: float


def statements(lines: Iterable[Line]) -> list[Statement]:
    """List every statement of a run: its probability, and whether it is right."""
    found: list[Statement] = []
    for line in lines:
        said = line.get("said")
        if said is None:
            continue
        if not said["sets"] and not said["laws"]:
            nothing = said.get("nothing")
            found.append((1.0 if nothing is None else float(nothing), not line["effects"]))
        for own in alternatives(said):
            found += [(p, _right(line, name, joint)) for name, joint, p in own]
    return found


def alternatives(said: dict[str, Any]) -> list[list[tuple[str, str | None, float]]]:
    """List alternatives per finding, with probabilities; where there are none, the first, for certain."""
    stated = said.get("stated") or []
    if stated and isinstance(stated[0][0], list):
        return [[(str(name), joint, float(p)) for name, joint, p in own] for own in stated]
    return [[(str(name), joint, 1.0)] for name, joint in (*(members[0] for members in said["sets"]), *said["laws"])]


def _right(line: Line, name: str, joint: str | None) -> bool:
    """Test whether an effect, or a law of its signal on its joint, is there; a law of a catalogued effect is wrong.

    A law is right of an effect outside the catalogue only.
    """
    for effect in line["effects"]:
        if line["kind"] == "outside":
            if joint == effect["joint"] and name in effect["variables"]:
                return True
        elif (name, joint) == (effect["id"], effect["reported"]):
            return True
    return False


def diagram(said: Sequence[Statement]) -> list[Bin]:
    """Bin statements by probability, with the share that is right and its 90 % interval (Jeffreys)."""
    found = []
    for low, high in pairwise(EDGES):
        own = [(p, right) for p, right in said if low <= p < high or (high == 1.0 and p == 1.0)]
        if not own:
            continue
        hits, count = sum(right for _, right in own), len(own)
        low_end, high_end = (float(beta.ppf(level, hits + 0.5, count - hits + 0.5)) for level in (0.05, 0.95))
        found.append(Bin(count, float(np.mean([p for p, _ in own])), hits / count, low_end, high_end))
    return found


def calibration_error(said: Sequence[Statement]) -> float:
    """Compute the expected calibration error: distance of probability and share, weighted by statements."""
    return float(sum(b.count * abs(b.stated - b.right) for b in diagram(said)) / max(len(said), 1))


def brier(said: Sequence[Statement]) -> float:
    """Compute the mean squared distance of the probabilities from what is true (0 or 1)."""
    return float(np.mean([(p - right) ** 2 for p, right in said])) if said else float("nan")


def text(lines: Sequence[Line]) -> list[str]:
    """Write the diagram as a table."""
    rows = [f"{'stated':>8s} {'right':>8s} {'90 % interval':>16s} {'statements':>11s}"]
    for b in diagram(statements(lines)):
        interval = f"{100 * b.low:.0f} to {100 * b.high:.0f} %"
        rows.append(f"{100 * b.stated:7.1f}% {100 * b.right:7.1f}% {interval:>16s} {b.count:11d}")
    return rows


def draw(lines: Sequence[Line], target: Path) -> None:
    """Draw the diagram: share that is right over stated probability, with intervals and numbers of statements."""
    from matplotlib.figure import Figure

    found = diagram(statements(lines))
    stated, right = np.array([b.stated for b in found]), np.array([b.right for b in found])
    ends = np.array([[b.right - b.low, b.high - b.right] for b in found]).T
    picture = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = picture.add_subplot()
    axes.plot([0, 100], [0, 100], color="#999999", linewidth=1, label="as stated")
    axes.errorbar(
        100 * stated, 100 * right, 100 * np.maximum(ends, 0.0), fmt="o", color="#1f6f8b", capsize=3,
        label="right, with 90 % intervals",
    )  # fmt: skip
    for b in found:
        axes.annotate(str(b.count), (100 * b.stated, 100 * b.right), (7, -11), textcoords="offset points", fontsize=8)
    axes.set(xlabel="stated probability, %", ylabel="right, %", xlim=(-3, 106), ylim=(-3, 106))
    axes.legend(loc="upper left", frameon=False)
    picture.savefig(target, dpi=110)


def checks(lines: Sequence[Line]) -> list[Check]:
    """Check the expected calibration error against its target, and the Brier score."""
    said = statements(lines)
    if not said:
        return []
    error, score = calibration_error(said), brier(said)
    return [
        Check(
            "expected calibration error of stated probabilities",
            error,
            f"{100 * error:.1f} %",
            bound="at most",
            target=LARGEST_ERROR,
            target_shown=f"{100 * LARGEST_ERROR:.0f} %",
        ),
        figure("Brier score of stated probabilities", score, "{:.3f}"),
    ]
