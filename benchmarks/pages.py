"""Pages of Markdown that benchmarks write: a template beside the benchmark, filled with the numbers of one run.

Figures are SVG that does not change unless the numbers do: salted ids, no date, text as text.
"""

from __future__ import annotations

import io
import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Any

import jinja2
import numpy as np

from fitting.arrays import FloatArray

#: Colours of what is true, of the base model, and of what the loop made of it.
TRUTH, BEFORE, AFTER = "#333333", "#b3541e", "#1f6f8b"
_POINTS = 400
_BINS = 30


def filled(template: str, **values: object) -> str:
    """Fill a template of this package; ``| f(".2f")`` in it formats a number as Python does.

    Parameters
    ----------
    template : path in the package ``benchmarks``
    values : what the template names
    """
    environment = jinja2.Environment(
        loader=jinja2.FileSystemLoader(Path(__file__).parent),
        undefined=jinja2.StrictUndefined,
        trim_blocks=True,
        lstrip_blocks=True,
        keep_trailing_newline=True,
        autoescape=False,  # Markdown
    )
    environment.filters["f"] = format
    return environment.get_template(template).render(**values)


def write(page: Path, text: str, figures: Mapping[str, str]) -> None:
    """Write a page, and its figures, by name, into a folder beside it that is called like the page."""
    folder = page.with_suffix("")
    folder.mkdir(parents=True, exist_ok=True)
    for name, drawn in figures.items():
        (folder / f"{name}.svg").write_text(drawn, encoding="utf-8")
    page.write_text(text, encoding="utf-8")


def residuals(x: FloatArray, before: FloatArray, after: FloatArray, label: str, unit: str) -> str:
    """Plot the residual against ``x`` before and after, side by side on one scale, with means of bins."""

    def draw(figure: Any) -> None:
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        panels = ((before, BEFORE, "base model"), (after, AFTER, "after the loop"))
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

    with matplotlib.rc_context(fname=Path(__file__).with_name("pages.mplstyle")):
        figure = Figure(figsize=(width, height), layout="constrained")
        FigureCanvasSVG(figure)
        draw(figure)
        out = io.StringIO()
        figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = re.sub(r"<metadata>.*?</metadata>\s*", "", out.getvalue(), flags=re.DOTALL)
    # Coordinates to a hundredth of a point: what is left out is below what any screen shows.
    return re.sub(r"(\d+\.\d{2})\d+", r"\1", text)
