"""Figures of the page, as SVG that does not change unless the numbers do: salted ids, no date, text as text."""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from benchmarks.measured.seals import Seal, line
from fitting.arrays import FloatArray

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
