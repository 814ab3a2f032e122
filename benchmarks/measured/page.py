"""The page ``docs/measured-machines.md``: before and after; every number is of the run that made it.

Figures are SVG that does not change unless the numbers do: salted ids, no date, text as text.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from benchmarks.measured.stacks import Found
from benchmarks.targets import Check, figure
from fitting.arrays import FloatArray

_HEAD = """# Measured machines

Made by `hilfit bench measured --page docs/measured-machines.md`; every number and figure is of that run. The data is
not part of this repository: it is looked for in `../shared/data`, or where the command is told. What is not there is
left out of a run.

**Relative error** is `100 |measured − predicted| / |measured|`, the figure that identification papers print. The base
models of EMPS and TX40 below are fitted by ordinary least squares, as there. The loop gets the recordings and the
machine file, and nothing else; its effects are then refitted with the base.
"""


def write(page: Path, sections: Sequence[str], checks: Sequence[Check], figures: Mapping[str, str]) -> None:
    """Write head, targets and sections; figures, by name, into a folder beside it that is called like the page."""
    folder = page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for name, drawn in figures.items():
        (folder / f"{name}.svg").write_text(drawn, encoding="utf-8")
    page.write_text("\n".join([_HEAD, *([_checks(checks)] if checks else ()), *sections]), encoding="utf-8")


def percent(name: str, value: float, target: float) -> Check:
    """Check a percentage to be at most a target."""
    return figure(name, value, "{:.2f} %", most=target)


def table(head: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    """Write a table of Markdown."""
    lines = ["| " + " | ".join(head) + " |", "|" + "---|" * len(head)]
    return "\n".join([*lines, *("| " + " | ".join(row) + " |" for row in rows)]) + "\n"


def _checks(checks: Sequence[Check]) -> str:
    marks = {True: "met", False: "**missed**", None: ""}
    rows = []
    for check in checks:
        bound = "" if check.target_shown == "so" else check.bound
        target = f"{bound} {check.target_shown or check.target}".strip() if check.bound else ""
        rows.append([check.name, check.shown, target, marks[check.met]])
    return table(["", "measured", "target", ""], rows)


def code(name: str) -> str:
    """Format an effect's id as code; a law in words."""
    return name if " " in name else f"`{name}`"


def found_text(found: Found) -> str:
    """Write verdict and added effects of a loop, and the strongest candidates that were not taken."""
    rows = []
    for name, joint, item, rivals in found.lines:
        evidence = item["evidence"]
        shape = ", ".join(f"{k} = {v:.3g}" for k, v in item["term"]["shape"].items())
        held = f"{evidence['held_out_z']:.1f}"
        validate = evidence.get("validate_gain")
        rows.append(
            [code(name), joint, shape or "–", f"{evidence['gain']:.0f}", held,
             "–" if validate is None else f"{validate:+.0f}", ", ".join(map(code, rivals)) or "–"]
        )  # fmt: skip
    text = f"Verdict of the loop (bandwidth {found.bandwidth_hz:.1f} Hz): `{found.verdict}`.\n\n"
    head = ["effect", "joint", "shape", "chi-square gained", "standard errors, held-out blocks", "gain on `validate`",
            "cannot be told from"]  # fmt: skip
    return text + table(head, rows) + _others(found)


def _others(found: Found) -> str:
    """List the strongest candidates that were not taken, with the reason."""
    taken = {(item["term"]["effect"], item["term"]["joint"]) for _, _, item, _ in found.lines}
    others = [c for c in found.candidates if (c["id"], c["joint"]) not in taken]
    strongest = sorted(others, key=lambda c: -float(c["score"]))[:3]
    rows = [
        [code(c["id"]), "machine" if c["joint"] is None else str(c["joint"] + 1), f"{c['score']:.0f}", str(c["reason"])]
        for c in strongest
    ]
    return "\nThe strongest that were not taken:\n\n" + table(["effect", "joint", "score", "why not"], rows)


_BEFORE, _AFTER = "#b3541e", "#1f6f8b"
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
        panels = ((before, _BEFORE, "base model"), (after, _AFTER, "after the loop"))
        for ax, (y, colour, title) in zip(axes, panels, strict=True):
            step = max(1, -(-len(x) // _POINTS))
            ax.plot(x[::step], y[::step], ".", color=colour, markersize=2.5, alpha=0.45)
            parts = np.array_split(np.argsort(x, kind="stable"), _BINS)
            ax.plot([x[p].mean() for p in parts], [y[p].mean() for p in parts], color="black", linewidth=1.4)
            ax.set_title(f"{title}: {np.std(y):.3g} {unit}", fontsize=10)
            ax.set_xlabel(label)
        axes[0].set_ylabel(f"measured − predicted [{unit}]")
        reach = float(np.quantile(np.abs(before), 0.998))
        axes[0].set_ylim(-1.3 * reach, 1.3 * reach)

    return svg(draw, 8.6, 3.4)


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
