"""Targets beside what was measured: the common form of every benchmark's result."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal

Bound = Literal["at least", "at most"]
#: What gets a line of progress, and one that nobody reads.
Show = Callable[[str], None]
#: Kinds of arms that the benchmarks of the two stages and of motions have.
Arm = Literal["folding", "slewing"]
ARMS: tuple[Arm, ...] = ("folding", "slewing")
_HOLDS = "holds"
#: Of confidence intervals.
LEVEL = 0.95


def silent(line: str) -> None:
    """Show nothing."""


def clopper_pearson(count: int, of: int) -> tuple[float, float]:
    """Compute a proportion's exact confidence interval (Clopper and Pearson, Biometrika 26, 1934)."""
    from scipy.stats import binomtest

    found = binomtest(count, of).proportion_ci(LEVEL, method="exact")
    return float(found.low), float(found.high)


@dataclass(frozen=True)
class Check:
    """One number, and what it should be.

    Attributes
    ----------
    name : what was measured
    measured : the number; None if it could not be
    shown : the number as it is printed, with counts and interval
    bound, target : what it should be; None where there is no target
    """

    name: str
    measured: float | None
    shown: str
    bound: Bound | None = None
    target: float | None = None
    target_shown: str = ""

    @property
    def met(self) -> bool | None:
        """True if the target is met; None without a target or a measurement."""
        if self.bound is None or self.target is None or self.measured is None:
            return None
        return self.measured >= self.target if self.bound == "at least" else self.measured <= self.target

    def as_json(self) -> dict[str, Any]:
        """Return it for ``--json``."""
        return {key: own for key, own in vars(self).items() if key != "target_shown"} | {"met": self.met}


def figure(
    name: str,
    value: float,
    form: str = "{}",
    *,
    most: float | None = None,
    least: float | None = None,
    shown: str | None = None,
) -> Check:
    """Check a number to be at most or at least a target; ``form`` has its unit, ``shown`` more than the number."""
    unit, target = form.partition("}")[2], most if least is None else least
    shown = shown or form.format(value)
    if target is None:
        return Check(name, value, shown)
    return Check(name, value, shown, "at most" if least is None else "at least", target, f"{target:g}{unit}")


def rate(name: str, count: int, of: int, bound: Bound | None = None, target: float | None = None) -> Check:
    """Check a proportion with its counts and 95 % interval."""
    if of == 0:
        return Check(name, None, "no cases", bound, target, "" if target is None else f"{100 * target:g} %")
    low, high = clopper_pearson(count, of)
    shown = f"{100 * count / of:.1f} % ({count} of {of}; {100 * low:.1f} to {100 * high:.1f} %)"
    return Check(name, count / of, shown, bound, target, "" if target is None else f"{100 * target:g} %")


def lines_of(checks: Sequence[Check]) -> list[str]:
    """Write one line each: met or missed, name, number, target."""
    width = max((len(check.name) for check in checks), default=0)
    marks = {True: "ok    ", False: "MISSED", None: "      "}
    lines = []
    for check in checks:
        target = f", {check.bound} {check.target_shown or check.target}" if check.bound else ""
        target = "" if check.target_shown == _HOLDS else target
        lines.append(f"{marks[check.met]} {check.name:{width}s}  {check.shown}{target}")
    return lines


def missed(checks: Sequence[Check]) -> int:
    """Count the targets that are missed."""
    return sum(check.met is False for check in checks)


@dataclass(frozen=True)
class Outcome:
    """Result of a benchmark.

    Attributes
    ----------
    checks : numbers and their targets
    notes : lines for people, printed before them
    content : what ``--json`` prints beside them
    """

    checks: tuple[Check, ...]
    notes: tuple[str, ...] = ()
    content: Mapping[str, Any] = field(default_factory=dict)


def together(parts: Sequence[Outcome]) -> Outcome:
    """Put the checks and notes of several parts one after another."""
    return Outcome(tuple(c for part in parts for c in part.checks), tuple(n for part in parts for n in part.notes))


def fact(name: str, holds: bool, shown: str) -> Check:
    """Check something that has to be so."""
    return Check(name, float(holds), shown, "at least", 1.0, _HOLDS)
