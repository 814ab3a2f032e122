"""The page ``docs/measured-machines.md``: before and after; every number is of the run that made it.

Figures are SVG that does not change unless the numbers do: salted ids, no date, text as text."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.measured import emps as emps_module
from benchmarks.measured.emps import Emps
from benchmarks.measured.seals import BANDWIDTH_HZ, Seal, line
from benchmarks.measured.splits import WAYS, Ways, named
from benchmarks.measured.stacks import Found
from benchmarks.measured.staubli import Staubli
from benchmarks.targets import Check
from fitting.arrays import FloatArray

_HEAD = """# Measured machines

Made by `hilfit bench measured --page docs/measured-machines.md`; every number and figure is of that run. The data is
not part of this repository: it is looked for in `../shared/data`, or where the command is told. What is not there is
left out of a run.

**Relative error** is `100 |measured − predicted| / |measured|`, the figure that identification papers print. The base
models of EMPS and TX40 below are fitted by ordinary least squares, as there. The loop gets the recordings and the
machine file, and nothing else; its effects are then refitted with the base.
"""


_SPLITS = """## The base model on another motion

Fitted on one motion, judged on another of which nothing was used, in three bandwidths; relative error of all joints on
moving rows. *Least squares* is the same regression without a prior, *possible* the nearest fit within what physics
allows.

"""


def page(
    emps: Emps | None,
    staubli: Staubli | None,
    seals: Sequence[Seal],
    beside: Sequence[Ways],
    splits: str,
    checks: Sequence[Check],
) -> str:
    """Write the whole page; leave out machines that were not run; ``splits``: the table of all splits."""
    parts = [_HEAD]
    if checks:
        parts.append(_checks(checks))
    if splits:
        parts.append(_SPLITS + splits)
    if beside:
        parts.append(_ways(beside))
    if emps is not None:
        parts.append(_emps(emps))
    if staubli is not None:
        parts.append(_staubli(staubli))
    if seals:
        parts.append(_seals(seals))
    return "\n".join(parts)


def _table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def _checks(checks: Sequence[Check]) -> str:
    marks = {True: "met", False: "**missed**", None: ""}
    rows = []
    for check in checks:
        bound = "" if check.target_shown == "so" else check.bound
        target = f"{bound} {check.target_shown or check.target}".strip() if check.bound else ""
        rows.append([check.name, check.shown, target, marks[check.met]])
    return _table(["", "measured", "target", ""], rows)


def _code(name: str) -> str:
    """Format an effect's id as code; a law in words."""
    return name if " " in name else f"`{name}`"


def _found(found: Found) -> str:
    rows = []
    for name, joint, item, rivals in found.lines:
        evidence = item["evidence"]
        shape = ", ".join(f"{k} = {v:.3g}" for k, v in item["term"]["shape"].items())
        held = f"{evidence['held_out_z']:.1f}"
        validate = evidence.get("validate_gain")
        rows.append(
            [
                _code(name),
                joint,
                shape or "–",
                f"{evidence['gain']:.0f}",
                held,
                "–" if validate is None else f"{validate:+.0f}",
                ", ".join(_code(rival) for rival in rivals) or "–",
            ]
        )
    text = f"Verdict of the loop (bandwidth {found.bandwidth_hz:.1f} Hz): `{found.verdict}`.\n\n"
    head = [
        "effect",
        "joint",
        "shape",
        "chi-square gained",
        "standard errors, held-out blocks",
        "gain on `validate`",
        "cannot be told from",
    ]
    return text + _table(head, rows) + _left(found)


def _left(found: Found) -> str:
    """List the strongest candidates that were not taken, with the reason."""
    taken = {(item["term"]["effect"], item["term"]["joint"]) for _, _, item, _ in found.lines}
    others = [c for c in found.candidates if (c["id"], c["joint"]) not in taken]
    strongest = sorted(others, key=lambda c: -float(c["score"]))[:3]
    rows = [
        [
            _code(c["id"]),
            "machine" if c["joint"] is None else str(c["joint"] + 1),
            f"{c['score']:.0f}",
            str(c["reason"]),
        ]
        for c in strongest
    ]
    return "\nThe strongest that were not taken:\n\n" + _table(["effect", "joint", "score", "why not"], rows)


def _emps(result: Emps) -> str:
    published = emps_module.PUBLISHED
    base = [
        [
            name,
            unit,
            f"{published[name]:.4f}",
            f"{result.base[name]:.4f}",
            f"{100 * (result.base[name] / published[name] - 1):+.2f} %",
        ]
        for name, unit in (("M", "kg"), ("Fv", "N s/m"), ("Fc", "N"), ("offset", "N"))
    ]
    own, cross = emps_module.PUBLISHED_ERRORS
    errors = [
        ["base, published", f"{own:.2f} %", f"{cross:.2f} %"],
        ["base", f"{result.before[0]:.2f} %", f"{result.before[1]:.2f} %"],
        ["with asymmetric friction, published", f"{emps_module.PUBLISHED_ASYMMETRIC_ERROR:.2f} %", "–"],
        ["with asymmetric friction alone", f"{result.asymmetric[0]:.2f} %", f"{result.asymmetric[1]:.2f} %"],
        ["with all that the loop added", f"{result.after[0]:.2f} %", f"{result.after[1]:.2f} %"],
    ]
    return f"""## EMPS: a carriage on a ball screw

A. Janot, M. Gautier, M. Brunot, *Data set and reference models of EMPS*, Workshop on Nonlinear System Identification
Benchmarks, 2019. [Machine file](../benchmarks/measured/machines/emps.yaml): one prismatic joint, `joint_effort`, and
`drive: {{offset: true}}`, because the published base model has an offset too.

{_table(["base model", "unit", "published", "here", "difference"], base)}
Fitted in a band of {emps_module.BANDWIDTH_HZ:g} Hz. Errors are taken on every row after decimation by ten, as the
publication does. On undecimated samples the base model has {result.raw[0]:.2f} % and {result.raw[1]:.1f} %: the edges
of the pulses are outside any band of the motion.

{_table(["relative error", "own motion", "predicted on the pulses"], errors)}
The reference repeats itself exactly every 6.24 s. So the loop was given the first two periods as `train`, the last two
as `repeat` and the pulses as `validate`; options were left as they are.

{_found(result.found)}
![residual against speed](measured-machines/emps.svg)
"""


def _staubli(result: Staubli) -> str:
    def row(name: str, errors: object) -> list[str]:
        values = (getattr(errors, key) for key in ("every_row", "every_row_blocks", "moving", "moving_blocks"))
        return [name, *(f"{value:.2f} %" for value in values)]

    rows = [row("base model", result.base), row("with what the loop added", result.after)]
    rows += [row(f"base with `{name}` on every joint (not chosen)", errors) for name, errors in result.trials.items()]
    joints = [
        [f"joint{number + 1}", f"{before:.2f} %", f"{after:.2f} %"]
        for number, (before, after) in enumerate(result.joints)
    ]
    friction = [[f"`{name}`", f"{old:.4f}", f"{new:.4f}"] for name, old, new in result.friction]
    refused = []
    for name in result.trials:
        own = max((c for c in result.found.candidates if c["id"] == name), key=lambda c: float(c["score"]))
        refused.append(f"`{name}` (best on joint{own['joint'] + 1}, score {own['score']:.0f}: {own['reason']})")
    return f"""## Stäubli TX40: six axes with a coupled wrist

Data and published parameters: TX40 example of FIGAROH (T. Nguyen and others; CNRS; Apache-2.0).
[Machine file](../benchmarks/measured/machines/staubli_tx40.yaml): motors are measured (`motor_position`,
`motor_effort`), the motor of joint 6 turns with joint 5 too (`drive.coupled`). One recording of 9 s, decimated from
5 kHz to 500 Hz without delay; no repeat, so the noise floor is an estimate.

The recording tells {result.parameters} parameters: 36 of the links, 4 drive inertias, Coulomb and viscous friction and
an offset of each joint, and three of motor 6. The base model of a direct drive has no cube root of the speed, nor has
the published one.

| relative error, all joints | every row | five blocks | moving rows | five blocks |
|---|---|---|---|---|
{chr(10).join("| " + " | ".join(r) + " |" for r in rows)}

*Every row*: low-passed to 20 Hz and decimated to 50 Hz as for the published parameters, standstill and reversals
included. *Moving rows*: what is fitted, in a band of {result.bandwidth_hz:.1f} Hz. *Five blocks*: contiguous in time,
fitted on four, judged on the fifth (the effects were chosen on the whole recording).

{_found(result.found)}
Refused: {"; ".join(refused)}.
Put on every joint all the same, either makes the left-out blocks worse (table above).

{_table(["every row", "base", "after"], joints)}
![residual of joint 1 against its speed](measured-machines/staubli.svg)

Drive parameters of the base model beside the published ones (ordinary least squares, in the published meaning):

{_table(["parameter", "published", "here"], friction)}"""


_NAMES = {
    "whitened": "weighted by the noise",
    "equal": "all efforts alike",
    "least_squares": "the same without a plausible arm",
    "possible": "physically possible, and no more",
    "one_shot": "plain least squares",
    "two_stage": "two stages",
}


def _ways(results: Sequence[Ways]) -> str:
    rows = []
    for own in results:
        for title, errors in (("training", own.training), ("another motion", own.held_out)):
            cells = {way: f"{error:.2f} %" for way, error in errors.items()}
            marks = [f"**{cells[way]}**" if way == own.chosen else cells.get(way, "–") for way in WAYS]
            rows.append([own.machine, title, *marks, f"{own.ratio:.3f}"])
    found = [f"{own.machine}: {'; '.join(map(named, own.impossible)) or 'none'}" for own in results]
    return f"""## Every way to the parameters beside plain least squares

Relative error of the base model in the identification band, same rows and filter for all; what is handed out is set in
bold. The last column is the training error of the fit that is weighted by the measured noise over that of least
squares: above 1.02 equal weights are handed out ([decision 34](decisions/0034-weights-on-measured-machines.md)).
Weighted and equal stand beside a plausible arm ([decision 66](decisions/0066-plausible-arm.md)).

{_table(["machine", "motion", *(_NAMES[way] for way in WAYS), "ratio"], rows)}
Impossible parameters that the reports name. {". ".join(found)}.
"""


def _seals(results: Sequence[Seal]) -> str:
    readings, tried, slopes = [], [], []
    for seal in results:
        for reading in seal.readings:
            speeds = f"{1e3 * reading.retracting:.1f}, {1e3 * reading.extending:.1f}"
            friction = f"{reading.friction:.2f} ± {reading.std:.3f}"
            cells = (f"{reading.bar:.2f}", f"{reading.width:.2f}", friction, speeds, str(reading.cycles))
            readings.append([seal.name, *cells])
        for trial in seal.trials:
            names = [_code(n) + (f" or {' or '.join(map(_code, r))}" if r else "") for n, _, _, r in trial.found.lines]
            fitted = f"{trial.fitted:.2f} ± {trial.fitted_std:.2f}"
            errors = (_pair(trial.before[0], trial.after[0]), _pair(trial.before[1], trial.after[1]))
            kept = "–" if trial.kept is None else f"{trial.kept} bar"
            tried.append([seal.name, kept, "; ".join(names) or "nothing", fitted, *errors])
        slopes.append([seal.name, f"{1e3 * seal.bore:.2f}", f"{seal.slope:.2f} ± {seal.slope_std:.2f}"])
    trial_head = ["seal", "kept", "added by the loop", "slope [N/bar]", "error, fitted [N]", "error, kept [N]"]
    read_head = ["seal", "pressure [bar]", "half width [N]", "friction [N]", "speeds in, out [mm/s]", "cycles"]
    return f"""## Pneumatic cylinder: seal friction against pressure

Data: Zillen, TU Delft (CC0). [Machine file](../benchmarks/measured/machines/pneumatic_cylinder.yaml): a cylinder
whose rod chamber is open (`vented: rod`) and whose rod is moved by a tester with a load cell (`external_force`). One
recording a pressure; every pressure between the lowest and the highest is kept for `validate` once. The bore is that of
the area which carries the mean force, because the data set does not give it and it differs with the seal. Bandwidth
{BANDWIDTH_HZ:g} Hz; the first cycle is left out.

Friction over pressure, read from the widths of the force loops:

{_table(["seal", "bore [mm]", "slope [N/bar]"], slopes)}
![friction against pressure](measured-machines/seals.svg)

What the loop added, with no help; the slope is that of pressure-dependent friction in a joint refit beside the other
effects:

{_table(trial_head, tried)}
With one open chamber the force that the cylinder carries *is* its pressure times its area, so friction that grows with
the load and friction that grows with the pressure are one column, and the loop says so: they come as a set. A
back-pressure in the other chamber would tell them apart. With two pressures only there is nothing to validate on.

Friction is half the width of the force loop at mid-stroke less what the pressure regulator's own hysteresis contributes
to it. The tester pushes in the slower the higher the pressure is, so these recordings do not quite tell pressure from
speed: the widths count all of it as pressure, the refit shares it out, and where the two move in step (O-ring257) speed
can take pressure's place. The Kidney seal's friction levels off, and at the retracted end it sticks.

{_table(read_head, readings)}"""


def _pair(before: float | None, after: float | None) -> str:
    return "–" if before is None or after is None else f"{before:.2f} → {after:.2f}"


_BEFORE, _AFTER = "#b3541e", "#1f6f8b"
_COLOURS = ("#1f6f8b", "#b3541e", "#4b7f2b", "#7a3e9d", "#8a6d00")
_MARKERS = "osD^v"
_SETTINGS: Mapping[str, Any] = {
    "svg.hashsalt": "hilfit",
    "svg.fonttype": "none",
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.grid": True,
    "axes.axisbelow": True,
    "grid.color": "#d8d8d8",
    "grid.linewidth": 0.6,
    "legend.frameon": False,
    "figure.facecolor": "white",
}
_POINTS = 400
_BINS = 30


def residuals(x: FloatArray, before: FloatArray, after: FloatArray, label: str, unit: str) -> str:
    """Plot the residual against ``x`` before and after, side by side on one scale, with means of bins."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        for ax, y, colour, title in (
            (axes[0], before, _BEFORE, "base model"),
            (axes[1], after, _AFTER, "after the loop"),
        ):
            step = max(1, -(-len(x) // _POINTS))
            ax.plot(x[::step], y[::step], ".", color=colour, markersize=2.5, alpha=0.45)
            order = np.argsort(x, kind="stable")
            parts = np.array_split(order, _BINS)
            ax.plot([x[p].mean() for p in parts], [y[p].mean() for p in parts], color="black", linewidth=1.4)
            ax.set_title(f"{title}: {np.std(y):.3g} {unit}", fontsize=10)
            ax.set_xlabel(label)
        axes[0].set_ylabel(f"measured − predicted [{unit}]")
        reach = float(np.quantile(np.abs(before), 0.998))
        axes[0].set_ylim(-1.3 * reach, 1.3 * reach)

    return svg(draw, 8.6, 3.4)


def friction(seals: Sequence[Seal]) -> str:
    """Plot friction against pressure of every seal, with standard errors and the weighted line."""

    def draw(figure: Any) -> None:
        ax = figure.subplots()
        for seal, colour, marker in zip(seals, _COLOURS, _MARKERS, strict=False):
            bar = np.array([reading.bar for reading in seal.readings])
            force = [reading.friction for reading in seal.readings]
            ax.errorbar(
                bar, force, yerr=[reading.std for reading in seal.readings], fmt=marker, color=colour, capsize=3,
                label=f"{seal.name}: {seal.slope:.2f} ± {seal.slope_std:.2f} N/bar",
            )  # fmt: skip
            start, slope, _ = line(seal.readings)
            ax.plot(bar, start + slope * bar, color=colour, linewidth=1.0)
        ax.set_xlabel("pressure [bar]")
        ax.set_ylabel("friction [N]")
        ax.set_ylim(bottom=0.0)
        ax.legend(loc="lower right")

    return svg(draw, 6.4, 4.2)


def svg(draw: Callable[[Any], None], width: float, height: float) -> str:
    """Render what ``draw`` puts on a figure of so many inches as SVG, the same for the same numbers."""
    import matplotlib
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    with matplotlib.rc_context(dict(_SETTINGS)):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", out.getvalue(), flags=re.DOTALL)
    # Coordinates to a hundredth of a point: what is left out is below what any screen shows.
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", text)
