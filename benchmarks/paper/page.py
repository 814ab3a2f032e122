"""The page of the claims, as Markdown, and its figures, as SVG. Verdicts follow from the numbers of the run."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured.page import svg, table
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
        _write(page, claims)
    return Outcome(checks(claims), claims.skipped)


def _write(page: Path, claims: Claims) -> None:
    """Write the page, and its figures into a folder of the same name beside it."""
    folder = page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    (folder / "cylinders.svg").write_text(_cylinders_figure(claims.shown), encoding="utf-8")
    (folder / "stribeck.svg").write_text(_stribeck_figure(claims.stribeck), encoding="utf-8")
    page.write_text(text(claims, folder.name), encoding="utf-8")


def text(claims: Claims, folder: str) -> str:
    """Write the page; ``folder`` has its figures."""
    parts = [
        *_head(claims),
        *_counts(claims.shown),
        *_cylinders(claims.shown, folder),
        *_errors(claims),
        *_stribeck(claims, folder),
        *_ways(claims),
    ]
    return "\n".join(parts) + "\n"


def _head(claims: Claims) -> Iterator[str]:
    folding = sum(each.arm == "folding" for each in claims.arms)
    yield "# The claims, made again\n"
    yield "Made by `hilfit bench paper --page docs/paper.md`; every number, figure and verdict is of that run. hilfit began"
    yield "with a paper about a hydraulically driven arm of six joints: cylinders first, then the rigid body with their"
    yield "friction frozen. That arm and its recordings are not at hand. So each of its tables is made again *in kind*, on"
    yield f"{folding} folding and {len(claims.arms) - folding} slewing arms whose truth the simulator knows (60 s at 50 Hz a"
    yield "recording, noise, steps and disturbances), and, where it can be, on machines that somebody measured."
    for line in claims.skipped:
        yield f"Left out of this run: {line}.\n"


def _counts(own: ArmRun) -> Iterator[str]:
    before, after = own.counts
    yield f"## {before} parameters to {after}\n"
    yield "Thirteen standard parameters a link (mass, three first moments, six of inertia; Coulomb and viscous friction, drive"
    yield f"inertia) are {before} for six joints. Stage 1 takes friction and drives; of the rigid body, six parallel horizontal"
    yield f"axes leave {after} combinations, regrouped as below (folding arm {own.seed}, stage 2 with friction frozen).\n"
    rows = []
    for name, value, std, truth in own.base:
        off = abs(value - truth) / std if std > 0 else float("inf")
        rows.append([f"`{name}`", f"{value:.4g}", f"{std:.2g}", f"{truth:.4g}", f"{off:.1f} std"])
    yield table(["base parameter", "found", "std", "truth", "off by"], rows)
    inside = sum(abs(value - truth) < _Z95 * std for _, value, std, truth in own.base)
    same = own.counts == PUBLISHED_COUNTS and own.rank == after
    yield f"**Verdict.** {'As published.' if same else 'Not as published.'} The regressor of all rigid-body parameters at random"
    yield f"states has rank {own.rank} by its singular values, a count that does not use the regrouping. {inside} of {after}"
    yield "95 % intervals hold the truth.\n"


def _cylinders(own: ArmRun, folder: str) -> Iterator[str]:
    names = own.cylinders[0].names
    yield "## Stage 1, cylinder by cylinder\n"
    yield "From the recording with the rods off their pins, value ± standard deviation, and the truth in brackets:\n"
    inside, total, rows = 0, 0, []
    worst = dict.fromkeys(_UNITS, 0.0)
    for each in own.cylinders:
        cells = []
        deviations = np.sqrt(np.diag(each.covariance))
        for name, value, std, truth in zip(each.names, each.theta, deviations, each.truth, strict=True):
            cells.append(f"{value:.4g} ± {std:.2g} ({truth:.4g})")
            inside += abs(value - truth) < _Z95 * std
            total += 1
            worst[name] = max(worst[name], abs(value / truth - 1.0))
        rows.append([each.joint, *cells, f"{each.residual_std:.3g}"])
    yield table(["cylinder", *(f"{name} [{_UNITS[name]}]" for name in names), "residual std [N]"], rows)
    yield f"![friction of the six cylinders]({folder}/cylinders.svg)\n"
    apart = max(_curve_error(each) for each in own.cylinders)
    yield f"**Verdict.** {inside} of {total} 95 % intervals hold the truth ({0.95 * total:.0f} would be right). Coulomb friction is at most"
    yield f"{100 * worst['f_c']:.1f} % off and stiffness {100 * worst['K']:.1f} %. The friction *curve* is at most {100 * apart:.1f} % off; how it is"
    yield f"shared out between `f_v` ({100 * worst['f_v']:.0f} % off at worst) and `f_s` ({100 * worst['f_s']:.0f} %) is told badly, because the two"
    yield f"are nearly one column at these speeds; nor is the moving mass ({100 * worst['m']:.0f} %), which slow motions hardly show.\n"


def _curve_error(own: CylinderRun) -> float:
    """Compute the RMS distance of a friction curve from the truth over the RMS of the truth, over the speeds."""
    v = np.linspace(-own.fastest, own.fastest, 201)
    found, _, truth = curve(own, v)
    return float(np.linalg.norm(found - truth) / np.linalg.norm(truth))


def _errors(claims: Claims) -> Iterator[str]:
    own = claims.shown
    yield "## Residual by joint\n"
    yield "Standard deviation of measured minus computed joint torque in N m. The published figures are of another arm, and of"
    yield "the motion that was fitted.\n"
    yield "| | " + " | ".join(own.joints) + " |"
    yield "|---" * (len(own.joints) + 1) + "|"
    rows: Sequence[tuple[str, Sequence[float]]] = (
        ("published, motion that was fitted", PUBLISHED_STD),
        ("here, motions that were fitted", own.fitted.tolist()),
        ("here, another motion", own.unseen.tolist()),
        ("here, noise floor", own.floor.tolist()),
    )
    for name, values in rows:
        yield f"| {name} | " + " | ".join(f"{value:.3f}" for value in values) + " |"
    lower = sum(a < b for a, b in zip(own.fitted, PUBLISHED_STD, strict=True))
    yield ""
    yield f"**Verdict.** Lower than published at {lower} of {len(own.joints)} joints, which says little: the arms differ in size, and so do"
    left = "nothing is left above the noise" if over_floor(own) <= _MOST_FLOORS else "something is left above the noise"
    yield f"their sensors. What can be said is that {left}: on a motion that no fit has seen the error is"
    yield f"{over_floor(own):.2f} noise floors over all joints, the floor being what two recordings of one motion do not share. Whether the"
    yield "published errors are at their arm's floor, the publication does not say: it has one motion, and that was fitted.\n"


def _stribeck(claims: Claims, folder: str) -> Iterator[str]:
    own = claims.stribeck
    floor, before, after = own.errors
    yield "## Stribeck curves\n"
    yield f"The same kind of arm with {own.size:.0f} N more friction at breakaway in one cylinder, fading with speed by a law that"
    yield "is not the catalogue's. Stage 1's three terms (Coulomb, viscous, cube root) have no such bump; the loop has to find it.\n"
    yield f"![friction with a bump]({folder}/stribeck.svg)\n"
    found = "Found" if own.named else "Not found"
    yield f"**Verdict.** {found}: the loop says {own.findings}. The friction curve is {own.before:.1f} N from the truth before and"
    yield f"{own.after:.1f} N after (root mean square over the speeds drawn); the joint's error on `validate` went from {before:.3g} to"
    yield f"{after:.3g} N m at a noise floor of {floor:.3g}.\n"


def _ways(claims: Claims) -> Iterator[str]:
    yield "## Two stages against one\n"
    yield "Condition number of the worst regression, and error on the motion that no fit has seen, change from the one-shot"
    yield "regression to the two stages with its 95 % interval (negative: the two stages are better). *Unloaded too* gives the"
    yield "one-shot regression the recordings of the free cylinders as well, which is the fair comparison.\n"
    head = ["machine", "condition, two stages", "one-shot", "error against one-shot", "against one-shot, unloaded too"]
    named = {f"{each.arm} arm {each.seed}": each.compared for each in claims.arms} | dict(claims.measured)
    yield table([*head, "joint refit against one-shot"], [_way_row(*own) for own in named.items()])
    simulated = [each.compared for each in claims.arms]
    yield f"**Verdict.** Simulated arms: {_tally(simulated)} With the unloaded recordings in both: {_tally(simulated, unloaded=True)}"
    if claims.measured:
        yield f"Measured machines: {_tally(list(claims.measured.values()))}"
    yield _conclusion(named)
    yield ""


def _way_row(name: str, compared: Mapping[str, Any]) -> list[str]:
    ways, against = compared["contenders"], compared["against"]
    cells = [name]
    for way in ("hierarchical", "one_shot"):
        number = ways[way]["condition_number"]
        cells.append("–" if number is None else f"{number:.3g}")
    for way in ("one_shot", "one_shot_with_unloaded"):
        cells.append(_change(against[way]) if way in against else "–")
    joint = 100.0 * (ways["joint_refit"]["overall"] / ways["one_shot"]["overall"] - 1.0)
    return [*cells, f"{joint:+.1f} %"]


def _change(found: Mapping[str, Any]) -> str:
    if found["change_percent"] is None:
        return "–"
    low, high = found["ci95_percent"]
    return f"{found['change_percent']:+.1f} % ({low:+.1f} to {high:+.1f})"


def _sides(compared: Sequence[Mapping[str, Any]], *, unloaded: bool) -> tuple[int, int, int]:
    """Count where the two stages are better, worse, and the same within the interval."""
    key = "one_shot_with_unloaded" if unloaded else "one_shot"
    intervals = [own["against"][key]["ci95_percent"] for own in compared if key in own["against"]]
    known = [interval for interval in intervals if interval is not None]
    better, worse = sum(high < -_EQUAL for _, high in known), sum(low > _EQUAL for low, _ in known)
    return better, worse, len(known) - better - worse


def _tally(compared: Sequence[Mapping[str, Any]], *, unloaded: bool = False) -> str:
    better, worse, same = _sides(compared, unloaded=unloaded)
    return f"two stages better on {better}, worse on {worse}, the same within the interval on {same}."


def _conclusion(named: Mapping[str, Mapping[str, Any]]) -> str:
    every = list(named.values())
    pairs = [
        (own["contenders"]["hierarchical"]["condition_number"], own["contenders"]["one_shot"]["condition_number"])
        for own in every
    ]
    known = [(a, b) for a, b in pairs if a is not None and b is not None]
    conditioned = sum(a < (1.0 - _EQUAL / 100.0) * b for a, b in known)
    refits = [own["contenders"]["joint_refit"]["overall"] / own["contenders"]["one_shot"]["overall"] for own in every]
    better, worse, _ = _sides(every, unloaded=True)
    order = (
        "fitting in two stages alone gains nothing"
        if better <= worse
        else "fitting in two stages gains something even then"
    )
    return (
        f"The two stages are better conditioned on {conditioned} of {len(known)} machines. Held against a one-shot regression of the "
        f"same recordings, {order}: what the hierarchy is worth is that it uses the free cylinders at all, and that friction "
        "can be looked at apart. The joint refit of both stages, weighted by the noise, has a smaller error than the one-shot "
        f"regression on {sum(ratio < 1.0 for ratio in refits)} of {len(refits)}. Where a machine has more than its model and its "
        "noise explain, those weights are wrong, and hilfit hands out equal ones instead "
        "([measured machines](measured-machines.md), [decision 34](decisions/0034-weights-on-measured-machines.md))."
    )


_TRUTH, _BASE, _CORRECTED = "#333333", "#b3541e", "#1f6f8b"


def _friction_columns(v: FloatArray) -> FloatArray:
    """Compute columns (N, 3) of ``f_c``, ``f_v`` and ``f_s`` at piston speeds (N,), m/s."""
    return np.column_stack([np.sign(v), v, np.cbrt(v)])


def curve(own: CylinderRun, v: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Compute stage 1's friction (N,) in N at piston speeds, its standard deviation, and the truth."""
    k = [own.names.index(name) for name in ("f_c", "f_v", "f_s")]
    B = _friction_columns(v)
    std = np.sqrt(np.einsum("ni,ij,nj->n", B, own.covariance[np.ix_(k, k)], B))
    return np.asarray(B @ own.theta[k]), np.asarray(std), np.asarray(B @ own.truth[k])


def _cylinders_figure(own: ArmRun) -> str:
    """Plot friction over piston speed of every cylinder: stage 1, its 95 % band, and the truth."""

    def draw(figure: Any) -> None:
        for ax, each in zip(figure.subplots(2, 3).flat, own.cylinders, strict=False):
            half = np.geomspace(0.01 * each.fastest, each.fastest, 50)
            v = np.concatenate([-half[::-1], half])
            found, std, truth = curve(each, v)
            ax.fill_between(1e3 * v, found - _Z95 * std, found + _Z95 * std, color=_CORRECTED, alpha=0.25, linewidth=0)
            ax.plot(1e3 * v, found, color=_CORRECTED, linewidth=1.3, label="stage 1, 95 % band")
            ax.plot(1e3 * v, truth, "--", color=_TRUTH, linewidth=1.0, label="truth")
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
        ax.plot(v, own.base, color=_BASE, linewidth=1.3, label=f"base model: {own.before:.1f} N off")
        ax.plot(v, own.corrected, color=_CORRECTED, linewidth=1.3, label=f"after the loop: {own.after:.1f} N off")
        ax.plot(v, own.truth, "--", color=_TRUTH, linewidth=1.0, label="truth")
        ax.set_xlabel("piston speed [mm/s]")
        ax.set_ylabel("friction with damping [N]")
        ax.legend(loc="upper left")

    return svg(draw, 6.4, 3.8)
