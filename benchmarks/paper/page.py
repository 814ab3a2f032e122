"""The page of the claims and its figures, as SVG. Verdicts follow from the numbers of the run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.pages import AFTER, BEFORE, TRUTH, filled, svg, write
from benchmarks.paper.runs import (
    PUBLISHED_COUNTS,
    PUBLISHED_STD,
    ArmRun,
    Claims,
    CylinderRun,
    StribeckRun,
    checks,
    claims_of,
    over_floor,
)
from benchmarks.targets import Outcome, Show
from fitting.arrays import FloatArray

_UNITS = {"m": "kg", "K": "N/m", "f_c": "N", "f_v": "N s/m", "f_s": "N (s/m)^(1/3)"}
#: Percent: differences below are none.
_EQUAL = 0.05
#: Errors on an unseen motion of up to so many noise floors are noise.
_MOST_FLOORS = 1.2
#: Deviations from the truth beyond which a 95 % interval does not hold it.
_Z95 = 1.96


def run(count: int, seed: int, data: Path, page: Path | None, show: Show) -> Outcome:
    """Make the runs, and the page where one is wanted."""
    claims = claims_of(count, seed, data, show)
    if page is not None:
        figures = {"cylinders": _cylinders_figure(claims.shown), "stribeck": _stribeck_figure(claims.stribeck)}
        write(page, text(claims, page.stem), figures)
    return Outcome(checks(claims), claims.skipped)


def text(claims: Claims, folder: str) -> str:
    """Write the page; ``folder`` has its figures."""
    own, simulated = claims.shown, [each.compared for each in claims.arms]
    machines = {f"{each.arm} arm {each.seed}": each.compared for each in claims.arms} | dict(claims.measured)
    contenders = [compared["contenders"] for compared in machines.values()]
    estimates = [estimate for each in own.cylinders for estimate in each.estimates]
    better, worse, _ = sides(machines.values(), "one_shot_with_unloaded")
    return filled(
        "paper/page.md.j2",
        claims=claims,
        folder=folder,
        folding=sum(each.arm == "folding" for each in claims.arms),
        deviations=_deviations,
        as_published=own.counts == PUBLISHED_COUNTS and own.rank == own.counts[1],
        base_inside=sum(_deviations(*estimate) < _Z95 for _, *estimate in own.base),
        units=_UNITS,
        inside=sum(_deviations(*estimate) < _Z95 for estimate in estimates),
        total=len(estimates),
        worst={name: max(each.apart(name) for each in own.cylinders) for name in _UNITS},
        curves_apart=max(_curve_error(each) for each in own.cylinders),
        residuals=(
            ("published, motion that was fitted", PUBLISHED_STD),
            ("here, motions that were fitted", own.fitted),
            ("here, another motion", own.unseen),
            ("here, noise floor", own.floor),
        ),
        lower=sum(a < b for a, b in zip(own.fitted, PUBLISHED_STD, strict=True)),
        floors=over_floor(own),
        most_floors=_MOST_FLOORS,
        machines=machines,
        simulated=simulated,
        sides=sides,
        conditioned=_conditioned(contenders),
        gains=better > worse,
        refits=(sum(own["joint_refit"]["overall"] < own["one_shot"]["overall"] for own in contenders), len(contenders)),
    )


def _deviations(value: float, std: float, truth: float) -> float:
    """Compute how many standard deviations an estimate is from the truth."""
    return abs(value - truth) / std if std > 0 else float("inf")


def _curve_error(own: CylinderRun) -> float:
    """Compute the RMS distance of a friction curve from the truth over the RMS of the truth, over the speeds."""
    v = np.linspace(-own.fastest, own.fastest, 201)
    found, _, truth = curve(own, v)
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def sides(compared: Iterable[Mapping[str, Any]], against: str) -> tuple[int, int, int]:
    """Count where the two stages are better, worse, and the same within the interval, against another way."""
    intervals = [own["against"][against]["ci95_percent"] for own in compared if against in own["against"]]
    known = [interval for interval in intervals if interval is not None]
    better, worse = sum(high < -_EQUAL for _, high in known), sum(low > _EQUAL for low, _ in known)
    return better, worse, len(known) - better - worse


def _conditioned(contenders: Iterable[Mapping[str, Any]]) -> tuple[int, int]:
    """Count the machines on which the two stages are better conditioned, and those of which that is known."""
    pairs = [(own["hierarchical"]["condition_number"], own["one_shot"]["condition_number"]) for own in contenders]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    return sum(a < (1.0 - _EQUAL / 100.0) * b for a, b in known), len(known)


def curve(own: CylinderRun, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute stage 1's friction (N,) in N at piston speeds (N,) in m/s, its standard deviation, and the truth."""
    k = [own.names.index(name) for name in ("f_c", "f_v", "f_s")]
    B = np.column_stack([np.sign(v), v, np.cbrt(v)])
    std = np.sqrt(np.einsum("ni,ij,nj->n", B, own.covariance[np.ix_(k, k)], B))
    return np.asarray(B @ own.theta[k]), np.asarray(std), np.asarray(B @ own.truth[k])


def _cylinders_figure(own: ArmRun) -> str:
    """Plot friction over piston speed of every cylinder: stage 1, its 95 % band, and the truth."""

    def draw(figure: Any) -> None:
        for ax, each in zip(figure.subplots(2, 3).flat, own.cylinders, strict=False):
            half = np.geomspace(0.01 * each.fastest, each.fastest, 50)
            v = np.concatenate([-half[::-1], half])
            found, std, truth = curve(each, v)
            ax.fill_between(1e3 * v, found - _Z95 * std, found + _Z95 * std, color=AFTER, alpha=0.25, linewidth=0)
            ax.plot(1e3 * v, found, color=AFTER, linewidth=1.3, label="stage 1, 95 % band")
            ax.plot(1e3 * v, truth, "--", color=TRUTH, linewidth=1.0, label="truth")
            ax.set_title(each.joint, fontsize=10)
        figure.axes[0].legend(loc="upper left", fontsize=8)
        for ax in figure.axes[3:]:
            ax.set_xlabel("piston speed [mm/s]")
        for ax in (figure.axes[0], figure.axes[3]):
            ax.set_ylabel("friction [N]")

    return svg(draw, 9.0, 5.0)


def _stribeck_figure(own: StribeckRun) -> str:
    """Plot friction with a bump that the base model lacks, before and after the loop."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        v = 1e3 * own.speed
        ax.plot(v, own.base, color=BEFORE, linewidth=1.3, label=f"base model: {own.before:.1f} N off")
        ax.plot(v, own.corrected, color=AFTER, linewidth=1.3, label=f"after the loop: {own.after:.1f} N off")
        ax.plot(v, own.truth, "--", color=TRUTH, linewidth=1.0, label="truth")
        ax.set_xlabel("piston speed [mm/s]")
        ax.set_ylabel("friction with damping [N]")
        ax.legend(loc="upper left")

    return svg(draw, 6.4, 3.8)
