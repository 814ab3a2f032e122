"""The figures as SVG that takes its colours from the page.

Drawn with fixed placeholder colours, which are then replaced by the page's CSS variables: one file is right in light,
in dark and on paper. Text stays text. The output depends on the input alone: ids are hashed with a fixed salt, and no
date is written.
"""

from __future__ import annotations

import html
import io
import re
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from fitting.report.model import FloatArray, FrictionCurve, Scatter, Worst
from fitting.report.text import number, unit, words

# Placeholder -> CSS variable. The values themselves are never seen.
_COLOURS = {
    "#010101": "var(--ink)",
    "#020202": "var(--muted)",
    "#030303": "var(--rule)",
    "#040404": "var(--before)",
    "#050505": "var(--after)",
    "#060606": "var(--law)",
}
_INK, _MUTED, _RULE, _BEFORE, _AFTER, _LAW = _COLOURS

_SETTINGS: Mapping[str, Any] = {
    "svg.hashsalt": "hilfit",
    "svg.fonttype": "none",
    "text.parse_math": False,
    "font.family": ["DejaVu Sans"],
    "font.size": 10.0,
    "axes.edgecolor": _RULE,
    "axes.labelcolor": _MUTED,
    "axes.titlecolor": _INK,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.axisbelow": True,
    "axes.grid": True,
    "axes.formatter.use_mathtext": False,
    "axes.formatter.limits": (-4, 5),
    "axes.unicode_minus": True,
    "grid.color": _RULE,
    "grid.linewidth": 0.6,
    "xtick.color": _MUTED,
    "ytick.color": _MUTED,
    "xtick.major.size": 0.0,
    "ytick.major.size": 0.0,
    "text.color": _INK,
    "lines.linewidth": 1.6,
    "lines.solid_capstyle": "round",
    "legend.frameon": False,
    "legend.labelcolor": _INK,
    "figure.facecolor": "none",
    "axes.facecolor": "none",
}

#: Points drawn per cloud at most: more only makes the file larger.
_POINTS = 900
_BINS = 24
_DASHED: Any = (0, (4, 2))


def _figure(width: float, height: float) -> Any:
    from matplotlib.backends.backend_svg import FigureCanvasSVG
    from matplotlib.figure import Figure

    figure = Figure(figsize=(width, height), layout="constrained")
    FigureCanvasSVG(figure)
    return figure


def _svg(figure: Any, prefix: str, label: str) -> str:
    """SVG element of a figure: ids carry ``prefix`` so that several fit one page; ``label`` is for screen readers."""
    out = io.StringIO()
    figure.savefig(out, format="svg", metadata={"Date": None, "Creator": None, "Format": None, "Type": None})
    text = out.getvalue()
    text = text[text.index("<svg") :]
    text = re.sub(r"<metadata>.*?</metadata>", "", text, flags=re.DOTALL)
    text = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    # Groups carry ids that nothing refers to.
    text = re.sub(r'<g id="[^"]*"', "<g", text)
    text = re.sub(r'\bid="([^"]+)"', rf'id="{prefix}-\1"', text)
    text = re.sub(r'href="#([^"]+)"', rf'href="#{prefix}-\1"', text)
    text = re.sub(r"url\(#([^)]+)\)", rf"url(#{prefix}-\1)", text)
    for placeholder, variable in _COLOURS.items():
        text = text.replace(placeholder, variable)
    box = re.search(r'viewBox="([^"]+)"', text)
    opening = f'<svg viewBox="{box[1] if box else ""}" role="img" aria-label="{html.escape(label)}">'
    text = opening + text[text.index(">") + 1 :]
    text = re.sub(r"\n\s*", "\n", text)
    return text.strip()


def _thinned(*arrays: FloatArray, most: int = _POINTS) -> tuple[FloatArray, ...]:
    step = max(1, -(-len(arrays[0]) // most))
    return tuple(array[::step] for array in arrays)


def _finite(*arrays: FloatArray) -> tuple[FloatArray, ...]:
    kept = np.all([np.isfinite(array) for array in arrays], axis=0)
    return tuple(np.asarray(array, dtype=float)[kept] for array in arrays)


def _binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Mean of ``y`` in bins of equal count, and where they are: shows a structure that a cloud hides."""
    order = np.argsort(x, kind="stable")
    parts = [part for part in np.array_split(order, min(_BINS, max(1, len(x) // 8))) if len(part)]
    return np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])


def _labelled(name: str, units: str) -> str:
    return f"{words(name)} [{unit(units)}]" if units else words(name)


def draw_scatter(scatter: Scatter, units: str, prefix: str) -> str:
    """Residual against the blamed variable: before and after side by side, on one scale."""
    import matplotlib

    way = np.ones(len(scatter.x)) if scatter.direction is None else np.asarray(scatter.direction, dtype=float)
    x, before, after, way = _finite(scatter.x, scatter.before, scatter.after, way)
    with matplotlib.rc_context(dict(_SETTINGS)):
        figure = _figure(9.6, 3.7)
        axes = figure.subplots(1, 2, sharex=True, sharey=True)
        for ax, y, colour, title in ((axes[0], before, _BEFORE, "before"), (axes[1], after, _AFTER, "after")):
            ax.axhline(0.0, color=_MUTED, linewidth=0.8)
            _cloud(ax, x, y, way, colour, both=scatter.direction is not None)
            ax.set_title(f"{title}: standard deviation {number(float(np.std(y)))} {unit(units)}" if len(x) else title)
            ax.set_xlabel(_labelled(scatter.variable, scatter.unit))
        if len(scatter.law_x):
            _law(axes[0], scatter)
        axes[0].set_ylabel(_labelled("measured \u2212 predicted", units))
        handles, labels = axes[0].get_legend_handles_labels()
        if handles:
            figure.legend(handles, labels, loc="outside lower center", ncols=len(handles))
        return _svg(figure, prefix, f"Residual of {scatter.joint} against {words(scatter.variable)}")


def _cloud(ax: Any, x: FloatArray, y: FloatArray, way: FloatArray, colour: str, *, both: bool) -> None:
    """Points, and their mean along the variable; forth filled and solid, back hollow and dashed."""
    suffix = {1: " forth" if both else "", -1: " back"}
    for sign, fill, style in ((1, colour, "-"), (-1, "none", _DASHED)):
        chosen = way == sign if both else np.full(len(x), sign == 1)
        if not chosen.any():
            continue
        edge = 0.0 if sign == 1 else 0.7
        ax.plot(
            *_thinned(x[chosen], y[chosen], most=_POINTS // 2 if both else _POINTS),
            "o",
            color=colour,
            markerfacecolor=fill,
            markersize=2.6,
            markeredgewidth=edge,
            alpha=0.42,
        )
        ax.plot(*_binned(x[chosen], y[chosen]), color=_INK, linestyle=style, label=f"mean{suffix[sign]}")


def _law(ax: Any, scatter: Scatter) -> None:
    ways: list[tuple[FloatArray, Any, str]] = [(scatter.law_y, "-", "law found, \u00b12 std")]
    if scatter.law_back is not None:
        ways = [(scatter.law_y, "-", "law forth, \u00b12 std"), (scatter.law_back, _DASHED, "law back")]
    for law, style, label in ways:
        x, y, std = _finite(scatter.law_x, law, scatter.law_std)
        ax.fill_between(x, y - 2 * std, y + 2 * std, color=_LAW, alpha=0.25, linewidth=0)
        ax.plot(x, y, color=_LAW, linewidth=2.4, linestyle=style, label=label)


def draw_worst(worst: Worst, prefix: str) -> str:
    """Measured and predicted effort above, their differences below; one prediction where nothing was added."""
    import matplotlib

    time, measured, before, after = _finite(worst.time, worst.measured, worst.before, worst.after)
    predictions: list[tuple[FloatArray, str, Any, str]] = [(after, _AFTER, "-", "predicted")]
    if not np.array_equal(before, after):
        predictions = [(before, _BEFORE, _DASHED, "predicted before"), (after, _AFTER, "-", "predicted after")]
    with matplotlib.rc_context(dict(_SETTINGS)):
        figure = _figure(9.6, 4.6)
        top, low = figure.subplots(2, 1, sharex=True, height_ratios=(3, 2))
        top.plot(time, measured, color=_INK, linewidth=2.2, label="measured")
        low.axhline(0.0, color=_MUTED, linewidth=0.8)
        for predicted, colour, style, label in predictions:
            top.plot(time, predicted, color=colour, linestyle=style, label=label)
            low.plot(time, measured - predicted, color=colour, linestyle=style, linewidth=1.3)
        top.set_ylabel(_labelled("effort", worst.unit))
        low.set_ylabel(_labelled("error", worst.unit))
        low.set_xlabel("time [s]")
        top.margins(x=0.01)
        figure.legend(*top.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return _svg(figure, prefix, f"Measured and predicted effort of {worst.joint}")


def draw_friction(curves: Sequence[FrictionCurve], prefix: str) -> str:
    """Friction over speed, one panel per joint."""
    import matplotlib
    from matplotlib.ticker import MaxNLocator

    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    with matplotlib.rc_context(dict(_SETTINGS)):
        figure = _figure(9.6, 2.6 * rows + 0.4)
        panels = figure.subplots(rows, columns, squeeze=False).ravel()
        for ax, curve in zip(panels, curves, strict=False):
            speed, force, std = _finite(curve.speed, curve.force, curve.std)
            ax.axhline(0.0, color=_MUTED, linewidth=0.8)
            ax.axvline(0.0, color=_MUTED, linewidth=0.8)
            ax.fill_between(speed, force - 2 * std, force + 2 * std, color=_BEFORE, alpha=0.28, linewidth=0)
            ax.plot(speed, force, color=_BEFORE, label="before, \u00b12 std")
            if curve.after is not None:
                ax.plot(*_finite(curve.speed, curve.after), color=_AFTER, linestyle=_DASHED, label="after")
            ax.set_title(curve.joint)
            ax.set_xlabel(_labelled("speed", curve.unit_x))
            ax.set_ylabel(_labelled("friction", curve.unit_y))
            # Panels are narrow: more labels than that run into each other.
            ax.xaxis.set_major_locator(MaxNLocator(nbins=3))
            ax.yaxis.set_major_locator(MaxNLocator(nbins=4))
        for ax in panels[len(curves) :]:
            ax.set_axis_off()
        named = {
            label: handle
            for ax in panels[: len(curves)]
            for handle, label in zip(*ax.get_legend_handles_labels(), strict=True)
        }
        figure.legend(list(named.values()), list(named), loc="outside lower center", ncols=2)
        return _svg(figure, prefix, "Friction of each joint over speed")


def draw_errors(rows: Sequence[tuple[str, float, float]], prefix: str) -> str:
    """Validation error in units of the noise floor, per joint: (joint, before, after)."""
    import matplotlib

    with matplotlib.rc_context(dict(_SETTINGS)):
        figure = _figure(9.6, 0.34 * len(rows) + 1.2)
        ax = figure.subplots()
        height = np.arange(len(rows), dtype=float)[::-1]
        before = np.array([row[1] for row in rows])
        after = np.array([row[2] for row in rows])
        same = np.array_equal(before, after)
        ax.hlines(height, np.minimum(before, after), np.maximum(before, after), color=_RULE, linewidth=3)
        if not same:
            ax.plot(before, height, "o", color=_BEFORE, markersize=8, label="before")
        ax.plot(after, height, "D", color=_AFTER, markersize=7, label="error" if same else "after")
        ax.axvline(1.0, color=_INK, linewidth=1.2, linestyle=(0, (2, 2)), label="measurement noise")
        ax.set_yticks(height, [row[0] for row in rows])
        ax.set_ylim(-0.6, len(rows) - 0.4)
        ax.set_xlim(left=0.0, right=1.08 * max(1.0, float(before.max()), float(after.max())))
        ax.grid(visible=False, axis="y")
        ax.set_xlabel("error on the validation motion, in multiples of the measurement noise")
        figure.legend(*ax.get_legend_handles_labels(), loc="outside upper left", ncols=3)
        return _svg(figure, prefix, "Error of each joint before and after, in multiples of its measurement noise")
