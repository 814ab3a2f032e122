"""Panels with axes, lines, bands and points as SVG text.

Only what the report's figures need, written directly: laying out and writing six panels with a general plotting
library takes longer than identifying an arm. Lengths are in the drawing's own units (a page is 690 of them wide,
text is 10 high); colours are CSS variables of the page, so one drawing is right in light, in dark and on paper.
Widths of texts are estimated generously: which font the reader has is not known.
"""

from __future__ import annotations

import html
import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from fitting.arrays import FloatArray
from fitting.report.text import fixed, scientific

INK, MUTED, RULE = "var(--ink)", "var(--muted)", "var(--rule)"
BEFORE, AFTER, LAW = "var(--before)", "var(--after)", "var(--law)"

SIZE = 10.0
_CHARACTER = 0.6 * SIZE
DASHED = "7 3.5"
DOTTED = "2.4 2.4"
#: A line with more points is drawn by the extremes of so many stretches: finer than a page can show.
_STRETCHES = 1000


def text_width(text: str) -> float:
    """Bound the width of a text."""
    return _CHARACTER * len(text)


@dataclass(frozen=True)
class Axis:
    """One axis: its ends, and where it is marked.

    Attributes
    ----------
    low, high : the ends, in the values' unit
    ticks : values that are marked
    labels : what is written there, in units of ``factor``
    factor : power of ten that was taken out, empty where it is 1
    """

    low: float
    high: float
    ticks: tuple[float, ...]
    labels: tuple[str, ...]
    factor: str = ""

    @property
    def label_width(self) -> float:
        """Width of the widest label."""
        return max((text_width(label) for label in self.labels), default=0.0)


def axis(
    *values: FloatArray,
    marks: int,
    margin: float = 0.05,
    ends: tuple[float, float] | None = None,
    decimal: str = ".",
) -> Axis:
    """Make an axis of all values (or from end to end), marked at most ``marks`` times at round numbers."""
    if ends is None:
        parts = [part for part in values if len(part)]
        low = min((float(part.min()) for part in parts), default=0.0)
        high = max((float(part.max()) for part in parts), default=1.0)
        if high - low <= 1e-12 * max(abs(low), abs(high)):
            low, high = low - (0.5 * abs(low) or 0.5), high + (0.5 * abs(high) or 0.5)
        low, high = low - margin * (high - low), high + margin * (high - low)
    else:
        low, high = ends
    step = _step(high - low, marks)
    numbers = range(math.ceil(low / step - 1e-9), math.floor(high / step + 1e-9) + 1)
    ticks = tuple(step * number for number in numbers)
    largest = max((abs(tick) for tick in ticks), default=0.0)
    exponent = math.floor(math.log10(largest) + 1e-9) if largest else 0
    taken = 0 if -4 < exponent < 5 else exponent
    shown = step / 10.0**taken
    decimals = next(d for d in range(17) if d == 16 or abs(shown * 10**d - round(shown * 10**d)) < 1e-6)
    labels = tuple(fixed(tick / 10.0**taken, decimals).replace(".", decimal) for tick in ticks)
    return Axis(low, high, ticks, labels, scientific(taken) if taken else "")


def _step(span: float, marks: int) -> float:
    """Find the smallest of 1, 2, 2.5, 5 times a power of ten for at most ``marks`` marks in ``span``."""
    least = span / max(1, marks)
    power = 10.0 ** math.floor(math.log10(least))
    return next(m * power for m in (1.0, 2.0, 2.5, 5.0, 10.0) if m * power >= least * (1 - 1e-9))


@dataclass(frozen=True)
class Panel:
    """A rectangle of a drawing with its axes; everything is clipped to it.

    Attributes
    ----------
    left, top, width, height : the rectangle
    x, y : axes
    name : id of its clip path, unique on the page
    """

    left: float
    top: float
    width: float
    height: float
    x: Axis
    y: Axis
    name: str

    def across(self, values: npt.ArrayLike) -> FloatArray:
        """Return the horizontal places of values."""
        return self.left + (np.asarray(values, dtype=float) - self.x.low) / (self.x.high - self.x.low) * self.width

    def down(self, values: npt.ArrayLike) -> FloatArray:
        """Return the vertical places of values."""
        return self.top + (self.y.high - np.asarray(values, dtype=float)) / (self.y.high - self.y.low) * self.height

    def frame(
        self,
        inside: Iterable[str],
        *,
        title: str = "",
        x_label: str = "",
        y_label: str = "",
        x_marks: bool = True,
        y_marks: bool = True,
        rules: bool = True,
    ) -> str:
        """Draw the panel around what is ``inside``; ``*_marks`` and labels are left out where a neighbour has them.

        ``rules``: whether the vertical axis' marks go on as lines across the panel.
        """
        right, bottom = self.left + self.width, self.top + self.height
        across = list(zip(self.across(self.x.ticks).tolist(), self.x.labels, strict=True))
        down = list(zip(self.down(self.y.ticks).tolist(), self.y.labels, strict=True))
        uprights = "".join(f"M{u:.2f} {self.top:.2f}V{bottom:.2f}" for u, _ in across)
        levels = "".join(f"M{self.left:.2f} {v:.2f}H{right:.2f}" for v, _ in down) if rules else ""
        parts = [
            f'<clipPath id="{self.name}"><rect x="{self.left:.2f}" y="{self.top:.2f}" width="{self.width:.2f}" '
            f'height="{self.height:.2f}"/></clipPath>',
            f'<g class="marks">{_path(uprights, RULE, 0.6)}</g>',
            _path(levels, RULE, 0.6),
            _path(f"M{self.left:.2f} {self.top:.2f}V{bottom:.2f}H{right:.2f}", RULE, 0.8),
            f'<g clip-path="url(#{self.name})"><g class="along">',
            *inside,
            "</g></g>",
        ]
        if x_marks:
            parts += [
                '<g class="marks">',
                *(text(u, bottom + 13, label, anchor="middle") for u, label in across),
                "</g>",
            ]
            parts += [text(right, bottom + 27, self.x.factor, anchor="end")] if self.x.factor else []
        if x_label:
            parts.append(text(self.left + self.width / 2, bottom + 28, x_label, anchor="middle"))
        if y_marks:
            parts += [text(self.left - 5, v + 3.6, label, anchor="end") for v, label in down]
            parts += [text(self.left, self.top - 5, self.y.factor, anchor="end")] if self.y.factor else []
        if y_label:
            parts.append(_upright(self.left - self.y.label_width - 12, self.top + self.height / 2, y_label))
        if title:
            parts.append(text(self.left, self.top - 7, title, colour=INK))
        return "\n".join(parts)

    def line(self, x: FloatArray, y: FloatArray, colour: str, *, width: float = 1.6, dash: str = "") -> str:
        """Draw a line through points."""
        u, v = self.across(x), self.down(y)
        if len(u) > 2 * _STRETCHES:
            kept = _extremes(v)
            u, v = u[kept], v[kept]
        # A round end would fill the gaps of a dashed line.
        ends = f'stroke-dasharray="{dash}"' if dash else 'stroke-linecap="round"'
        stroke = f'fill="none" stroke="{colour}" stroke-width="{width:g}" stroke-linejoin="round" {ends}'
        return f'<polyline points="{_points(u, v)}" {stroke}/>'

    def band(self, x: FloatArray, low: FloatArray, high: FloatArray, colour: str, opacity: float) -> str:
        """Draw the area between two lines."""
        u = self.across(x)
        points = _points(np.concatenate([u, u[::-1]]), np.concatenate([self.down(high), self.down(low)[::-1]]))
        return f'<polygon points="{points}" fill="{colour}" fill-opacity="{opacity:g}"/>'

    def dots(
        self, x: FloatArray, y: FloatArray, colour: str, *, radius: float, opacity: float = 1.0, hollow: bool = False
    ) -> str:
        """Draw a dot at every point; overlapping ones add up."""
        how = f'fill="none" stroke="{colour}" stroke-width="0.7" stroke-' if hollow else f'fill="{colour}" fill-'
        places = zip(self.across(x).tolist(), self.down(y).tolist(), strict=True)
        dots = "".join(f'<circle cx="{u:.1f}" cy="{v:.1f}" r="{radius:g}"/>' for u, v in places)
        return f'<g {how}opacity="{opacity:g}">{dots}</g>'

    def diamonds(self, x: FloatArray, y: FloatArray, colour: str) -> str:
        """Draw a diamond at every point."""
        places = zip(self.across(x).tolist(), self.down(y).tolist(), strict=True)
        return f'<path d="{"".join(_diamond(u, v) for u, v in places)}" fill="{colour}"/>'

    def bars(self, x_from: FloatArray, x_to: FloatArray, y: FloatArray, colour: str) -> str:
        """Draw horizontal strokes from one value to the other."""
        ends = zip(self.across(x_from).tolist(), self.across(x_to).tolist(), self.down(y).tolist(), strict=True)
        return _path("".join(f"M{u:.2f} {v:.2f}H{w:.2f}" for u, w, v in ends), colour, 3.0)

    def level(self, y: float) -> str:
        """Draw a line across at one value."""
        return _path(f"M{self.left:.2f} {float(self.down(y)):.2f}h{self.width:.2f}", MUTED, 0.8)

    def upright(self, x: float, colour: str = MUTED, width: float = 0.8, dash: str = "") -> str:
        """Draw a line from bottom to top at one value."""
        return _path(f"M{float(self.across(x)):.2f} {self.top:.2f}v{self.height:.2f}", colour, width, dash)


@dataclass(frozen=True)
class Entry:
    """One entry of a legend; ``kind`` is ``line``, ``dot`` or ``diamond``."""

    label: str
    colour: str
    dash: str = ""
    width: float = 1.6
    kind: str = "line"


def legend(entries: Sequence[Entry], left: float, middle: float, *, centred: float | None = None) -> str:
    """Draw entries in a row of middle line ``middle``, from ``left`` on or about ``centred``."""
    widths = [30 + text_width(entry.label) + 16 for entry in entries]
    start = left if centred is None else max(0.0, centred - sum(widths) / 2)
    parts = []
    for entry, width in zip(entries, widths, strict=True):
        if entry.kind == "dot":
            parts.append(f'<circle cx="{start + 12:.2f}" cy="{middle:.2f}" r="4" fill="{entry.colour}"/>')
        elif entry.kind == "diamond":
            parts.append(f'<path d="{_diamond(start + 12, middle)}" fill="{entry.colour}"/>')
        else:
            parts.append(_path(f"M{start:.2f} {middle:.2f}h24", entry.colour, entry.width, entry.dash))
        parts.append(text(start + 30, middle + 3.6, entry.label, colour=INK))
        start += width
    return "\n".join(parts)


def text(x: float, y: float, content: str, *, anchor: str = "start", colour: str = MUTED) -> str:
    """Draw a text on one line; its content is escaped."""
    return f'<text x="{x:.2f}" y="{y:.2f}" text-anchor="{anchor}" fill="{colour}">{html.escape(content)}</text>'


def drawing(width: float, height: float, label: str, parts: Iterable[str], *, zoom: Panel | None = None) -> str:
    """Write the SVG element; ``label`` for screen readers, ``zoom`` the lowest of panels to zoom along x."""
    data = ""
    if zoom is not None:
        places = (zoom.left, zoom.width, zoom.x.low, zoom.x.high, zoom.top + zoom.height)
        data = f' data-zoom="{" ".join(f"{place:.6g}" for place in places)}"'
    opening = (
        f'<svg viewBox="0 0 {width:g} {height:g}" role="img" aria-label="{html.escape(label)}" font-size="{SIZE:g}"'
        f"{data}>"
    )
    return "\n".join([opening, *parts, "</svg>"])


def _upright(x: float, y: float, content: str) -> str:
    return (
        f'<text transform="translate({x:.2f} {y:.2f}) rotate(-90)" text-anchor="middle" fill="{MUTED}">'
        f"{html.escape(content)}</text>"
    )


def _points(u: FloatArray, v: FloatArray) -> str:
    return " ".join(["%.2f,%.2f"] * len(u)) % tuple(np.column_stack([u, v]).ravel().tolist())  # at once: half the time


def _path(d: str, colour: str, width: float, dash: str = "") -> str:
    dashes = f' stroke-dasharray="{dash}"' if dash else ""
    return f'<path d="{d}" fill="none" stroke="{colour}" stroke-width="{width:g}"{dashes}/>'


def _diamond(u: float, v: float) -> str:
    return f"M{u:.2f} {v - 4.9:.2f}l4.9 4.9l-4.9 4.9l-4.9 -4.9z"


def _extremes(v: FloatArray) -> npt.NDArray[np.intp]:
    """Find each stretch's lowest and highest point, in order: the line looks the same without the rest."""
    kept = [part[[np.argmin(v[part]), np.argmax(v[part])]] for part in np.array_split(np.arange(len(v)), _STRETCHES)]
    return np.unique(np.concatenate([[0], *kept, [len(v) - 1]]).astype(np.intp))
