"""The figures of the report as SVG that takes its colours from the page.

Text is kept as text. The output depends on the input alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from functools import partial

import numpy as np

from fitting.arrays import FloatArray
from fitting.report.languages import ENGLISH, Language
from fitting.report.model import Course, FrictionCurve, JointDiagnostics, Scatter
from fitting.report.plot import (
    AFTER,
    BEFORE,
    DASHED,
    DOTTED,
    INK,
    LAW,
    RULE,
    Axis,
    Entry,
    Panel,
    drawing,
    legend,
    text_width,
)
from fitting.report.plot import axis as plain_axis

_WIDTH = 690.0
#: Points drawn per cloud at most: more only makes the file larger.
_POINTS = 900
_BINS = 24
#: Room for an axis' label beside the labels of its marks, for a line of text, and for a title.
_LABEL, _LINE, _TITLE = 20.0, 20.0, 22.0
_NOTHING = np.zeros(1)


def _finite(*arrays: FloatArray) -> tuple[FloatArray, ...]:
    kept = np.all([np.isfinite(array) for array in arrays], axis=0)
    return tuple(np.asarray(array, dtype=float)[kept] for array in arrays)


def _binned(x: FloatArray, y: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Average ``y`` in bins of equal count, and return their places: a cloud hides structure."""
    order = np.argsort(x, kind="stable")
    parts = [part for part in np.array_split(order, min(_BINS, max(1, len(x) // 8))) if len(part)]
    return np.array([x[p].mean() for p in parts]), np.array([y[p].mean() for p in parts])


def _labelled(name: str, units: str, language: Language) -> str:
    return f"{name} [{language.unit(units)}]" if units else name


def _gutter(*axes: Axis) -> float:
    """Compute the room left of panels for the labels of their vertical axes."""
    return _LABEL + max(y.label_width for y in axes)


def _panel_at(
    left: float, top: float, width: float, height: float, gutter: float, x: Axis, y: Axis, name: str
) -> Panel:
    """Make one of several panels in its part of the drawing, with room for title and labels around it."""
    return Panel(left + gutter, top + _TITLE, width - gutter - 10, height - _TITLE - 40, x, y, name)


def draw_scatter(scatter: Scatter, prefix: str, language: Language = ENGLISH) -> str:
    """Draw what the law has to explain beside what is left, against its variable, on one scale."""
    text, axis, units = language.phrase, partial(plain_axis, decimal=language.decimal), scatter.effort_unit
    first, name = (scatter.before, "before") if scatter.partial is None else (scatter.partial, "without the law")
    way = np.ones(len(scatter.x)) if scatter.direction is None else np.asarray(scatter.direction, dtype=float)
    x, before, after, way = _finite(scatter.x, first, scatter.after, way)
    laws = _laws(scatter, language)
    y_axis = axis(
        before, after, _NOTHING, *(edge for _, _, y, std in laws for edge in (y - 2 * std, y + 2 * std)), marks=9
    )
    x_axis = axis(x, *(law_x for _, law_x, _, _ in laws), marks=6)
    left, top, bottom, height, gap = _gutter(y_axis), 22.0, 58.0, 284.0, 20.0
    width = (_WIDTH - left - gap - 8) / 2
    parts, entries = [], []
    for column, (y, colour, title) in enumerate(((before, BEFORE, text(name)), (after, AFTER, text("after")))):
        panel = Panel(
            left + column * (width + gap), top, width, height - top - bottom, x_axis, y_axis, f"{prefix}-{column}"
        )
        inside, named = _cloud(panel, x, y, way, colour, language, both=scatter.direction is not None)
        inside.insert(0, panel.level(0.0))
        if column == 0:
            entries = named
            for entry, law_x, law, std in laws:
                inside.append(panel.band(law_x, law - 2 * std, law + 2 * std, LAW, 0.25))
                inside.append(panel.line(law_x, law, LAW, width=entry.width, dash=entry.dash))
                entries.append(entry)
        size = language.number(float(np.std(y))) if len(x) else ""
        spread = text(": standard deviation {} {}", size, language.unit(units)) if len(x) else ""
        parts.append(
            panel.frame(
                inside,
                title=title + spread,
                x_label=_labelled(language.words(scatter.variable), scatter.unit, language),
                y_label=_labelled(text("measured \u2212 predicted"), units, language) if column == 0 else "",
                y_marks=column == 0,
            )
        )
    parts.append(legend(entries, left, height - 12, centred=_WIDTH / 2))
    label = text("Residual of {} against {}", scatter.joint, language.words(scatter.variable))
    return drawing(_WIDTH, height, label, parts)


def _cloud(
    panel: Panel, x: FloatArray, y: FloatArray, way: FloatArray, colour: str, language: Language, *, both: bool
) -> tuple[list[str], list[Entry]]:
    """Draw points, and their mean along the variable; filled, solid at positive speed, hollow, dashed at negative."""
    names = {1: "mean, speed > 0" if both else "mean", -1: "mean, speed < 0"}
    clouds, means, entries = [], [], []
    for sign, dash in ((1, ""), (-1, DASHED)):
        chosen = way == sign if both else np.full(len(x), sign == 1)
        if not chosen.any():
            continue
        step = max(1, -(-np.count_nonzero(chosen) // (_POINTS // 2 if both else _POINTS)))
        clouds.append(
            panel.dots(x[chosen][::step], y[chosen][::step], colour, radius=1.3, opacity=0.42, hollow=sign == -1)
        )
        means.append(panel.line(*_binned(x[chosen], y[chosen]), INK, dash=dash))
        entries.append(Entry(language.phrase(names[sign]), INK, dash))
    return [*clouds, *means], entries


def _laws(scatter: Scatter, language: Language) -> list[tuple[Entry, FloatArray, FloatArray, FloatArray]]:
    """Return the found laws, one or one each way: how and where drawn, values and deviation."""
    if not len(scatter.law_x):
        return []
    ways = [(scatter.law_y, "", "law found, \u00b12 std")]
    if scatter.law_back is not None:
        ways = [(scatter.law_y, "", "law at speed > 0, \u00b12 std"), (scatter.law_back, DASHED, "law at speed < 0")]
    drawn = []
    for law, dash, label in ways:
        x, y, std = _finite(scatter.law_x, law, scatter.law_std)
        drawn.append((Entry(language.phrase(label), LAW, dash, 2.4), x, y, std))
    return drawn


def _on_end(time: FloatArray) -> FloatArray:
    """Chain times of parts: where time goes back the next part begins a step later."""
    steps = np.diff(time, prepend=time[:1])
    usual = float(np.median(steps[1:])) if len(time) > 1 else 0.0
    return np.asarray(time[:1] + np.cumsum(np.where(steps < 0, usual, steps)), dtype=float)


def draw_course(course: Course, prefix: str, language: Language = ENGLISH) -> str:
    """Draw measured and predicted effort, differences below; one prediction where nothing was added.

    It can be zoomed along time where the page's script runs.
    """
    text, axis = language.phrase, partial(plain_axis, decimal=language.decimal)
    time, measured, before, after = _finite(course.time, course.measured, course.before, course.after)
    time = _on_end(time)
    predictions = [(after, Entry(text("predicted"), AFTER))]
    if not np.array_equal(before, after):
        predictions = [
            (before, Entry(text("predicted before"), BEFORE, DASHED)),
            (after, Entry(text("predicted after"), AFTER)),
        ]
    x_axis = axis(time, marks=8, margin=0.01)
    efforts = axis(measured, *(predicted for predicted, _ in predictions), marks=6)
    errors = axis(*(measured - predicted for predicted, _ in predictions), _NOTHING, marks=5)
    left, top, bottom, height, gap = _gutter(efforts, errors), 32.0, 36.0, 342.0, 16.0
    room = height - top - bottom - gap
    upper = Panel(left, top, _WIDTH - left - 8, 0.6 * room, x_axis, efforts, f"{prefix}-effort")
    lower = Panel(left, top + 0.6 * room + gap, _WIDTH - left - 8, 0.4 * room, x_axis, errors, f"{prefix}-error")
    above, below = [upper.line(time, measured, INK, width=2.2)], [lower.level(0.0)]
    for predicted, entry in predictions:
        above.append(upper.line(time, predicted, entry.colour, dash=entry.dash))
        below.append(lower.line(time, measured - predicted, entry.colour, width=1.3, dash=entry.dash))
    return drawing(
        _WIDTH,
        height,
        text("Measured and predicted effort of {}", course.joint),
        [
            legend([Entry(text("measured"), INK, width=2.2), *(entry for _, entry in predictions)], left, 10),
            upper.frame(above, y_label=_labelled(language.effort(course.unit), course.unit, language), x_marks=False),
            lower.frame(below, y_label=_labelled(text("error"), course.unit, language), x_label=f"{text('time')} [s]"),
        ],
        zoom=lower,
    )


def draw_friction(curves: Sequence[FrictionCurve], language: Language = ENGLISH) -> str:
    """Draw friction over speed, one panel per joint."""
    text, axis = language.phrase, partial(plain_axis, decimal=language.decimal)
    columns = min(3, len(curves))
    rows = -(-len(curves) // columns)
    finite = [_finite(curve.speed, curve.force, curve.std) for curve in curves]
    later = [None if c.after is None else _finite(c.speed, c.after) for c in curves]
    # Panels are narrow: more labels than that run into each other.
    x_axes = [axis(speed, _NOTHING, marks=4) for speed, _, _ in finite]
    y_axes = [
        axis(force - 2 * std, force + 2 * std, _NOTHING, *(() if after is None else after[1:]), marks=5)
        for (_, force, std), after in zip(finite, later, strict=True)
    ]
    row_height, column_width = 194.0, _WIDTH / columns
    gutters = [_gutter(*y_axes[column::columns]) for column in range(columns)]
    parts = []
    for i, curve in enumerate(curves):
        row, column = divmod(i, columns)
        place = column * column_width, row * row_height, column_width, row_height
        panel = _panel_at(*place, gutters[column], x_axes[i], y_axes[i], f"friction-{i}")
        speed, force, std = finite[i]
        inside = [
            panel.level(0.0),
            panel.upright(0.0),
            panel.band(speed, force - 2 * std, force + 2 * std, BEFORE, 0.28),
            panel.line(speed, force, BEFORE),
        ]
        after = later[i]
        if after is not None:
            inside.append(panel.line(after[0], after[1], AFTER, dash=DASHED))
        parts.append(
            panel.frame(
                inside,
                title=curve.joint,
                x_label=_labelled(text("speed"), curve.unit_x, language),
                y_label=_labelled(text("friction"), curve.unit_y, language),
            )
        )
    entries = [Entry(text("before, \u00b12 std"), BEFORE)]
    if any(after is not None for after in later):
        entries.append(Entry(text("after"), AFTER, DASHED))
    height = rows * row_height + _LINE
    parts.append(legend(entries, 0.0, height - 10, centred=_WIDTH / 2))
    return drawing(_WIDTH, height, text("Friction of each joint over speed"), parts)


def draw_diagnostics(own: JointDiagnostics, prefix: str, language: Language = ENGLISH) -> str:
    """Draw the residual's correlation with its past and the speed, white noise's bound, and the spectrum."""
    text, axis = language.phrase, partial(plain_axis, decimal=language.decimal)
    power = np.log10(np.maximum(own.density_after, 1e-300))
    drawn = (
        (own.lag, own.auto, own.bound, text("with itself"), text("lag [s]"), text("correlation")),
        (own.cross_lag, own.cross, own.bound, text("with the speed"), text("lag [s]"), text("correlation")),
        (own.frequency, power, 0.0, text("spectrum"), text("frequency [Hz]"), text("log10 of ({})\u00b2/Hz", own.unit)),
    )
    width, height = _WIDTH / 3, 210.0
    parts = []
    for column, (x, y, bound, title, x_label, y_label) in enumerate(drawn):
        x, y = _finite(x, y)
        y_axis = axis(y, np.array([-bound, bound]) if bound else y, marks=5)
        place = column * width, 0.0, width, height
        panel = _panel_at(*place, _gutter(y_axis), axis(x, marks=4), y_axis, f"{prefix}-{column}")
        inside = [panel.line(x, y, AFTER)]
        if bound:
            edge = np.full(len(x), bound)
            inside = [panel.band(x, -edge, edge, BEFORE, 0.28), panel.level(0.0), *inside]
        name = f"{own.joint} {title}" if column == 0 else title
        parts.append(panel.frame(inside, title=name, x_label=x_label, y_label=y_label))
    return drawing(_WIDTH, height, text("Correlations and spectrum of what is left at {}", own.joint), parts)


def draw_errors(rows: Sequence[tuple[str, float, float]], language: Language = ENGLISH) -> str:
    """Draw validation error in noise floors, per joint: (joint, before, after)."""
    text = language.phrase
    place = np.arange(len(rows), dtype=float)[::-1]
    before = np.array([row[1] for row in rows])
    after = np.array([row[2] for row in rows])
    same = np.array_equal(before, after)
    ends = (0.0, 1.08 * max(1.0, float(before.max()), float(after.max())))
    x_axis = plain_axis(marks=9, ends=ends, decimal=language.decimal)
    y_axis = Axis(-0.6, len(rows) - 0.4, tuple(place.tolist()), tuple(row[0] for row in rows))
    left, top = 12 + max(text_width(row[0]) for row in rows), 28.0
    panel = Panel(left, top, _WIDTH - left - 8, 24.5 * len(rows), x_axis, y_axis, "overview-errors")
    inside = [
        panel.upright(1.0, INK, 1.2, DOTTED),
        panel.bars(np.minimum(before, after), np.maximum(before, after), place, RULE),
    ]
    entries = [Entry(text("error" if same else "after"), AFTER, kind="diamond")]
    if not same:
        inside.append(panel.dots(before, place, BEFORE, radius=4))
        entries.insert(0, Entry(text("before"), BEFORE, kind="dot"))
    inside.append(panel.diamonds(after, place, AFTER))
    entries.append(Entry(text("measurement noise"), INK, DOTTED, 1.2))
    label = text("error on the validation motion, in multiples of the measurement noise")
    return drawing(
        _WIDTH,
        top + panel.height + 36,
        text("Error of each joint before and after, in multiples of its measurement noise"),
        [legend(entries, left, 10), panel.frame(inside, x_label=label, rules=False)],
    )
