"""What a notebook shows of results: tables, and figures by matplotlib."""

from __future__ import annotations

import html
from collections.abc import Iterable, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from fitting.report.text import number, percent, unit, with_std

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of figures, in inches: width, and height of each joint.
_WIDTH, _HEIGHT = 8.0, 1.9


def result_line(report: Mapping[str, Any]) -> str:
    """Return ``effect_added: friction that depends on the piston position at joint2; error -65 %``."""
    loop, change = report["loop"], report["overall"].get("change_percent")
    found = [f"{one.get('title') or one['id']} at {one.get('joint') or 'the whole machine'}" for one in loop["effects"]]
    error = [] if change is None else [f"error {percent(change)}"]
    return f"{loop['verdict']}" + "".join(f"{sign} {text}" for sign, text in zip(": ;", [*found, *error], strict=False))


def result_html(report: Mapping[str, Any]) -> str:
    """Write the verdict in a sentence, and the errors on the held-out motion."""
    rows = []
    for joint, own in report["errors"].items():
        before, after = (own[which].get("validate", own[which].get("train")) for which in ("before", "after"))
        rows.append((joint, number(before), number(after), unit(own["unit"]), number(own["noise_floor"])))
    table = _table(("joint", "error before", "after", "unit", "noise floor"), rows)
    return f"<p>{html.escape(report['summary']['sentence'])}</p>{table}"


def parameters_html(parameters: Mapping[str, tuple[float, float, str]]) -> str:
    """Write every parameter with its standard deviation."""
    rows = [(name, with_std(value, std), unit(own)) for name, (value, std, own) in parameters.items()]
    return _table(("parameter", "value", "unit"), rows)


def plot_result(report: Mapping[str, Any], joints: Sequence[str] | None = None) -> Figure:
    """Plot each joint's measured and predicted effort over the held-out motion, and their difference."""
    from matplotlib import pyplot as plt

    own = [one for one in report["figures"]["diagnostics"] if joints is None or one["joint"] in joints]
    figure, axes = plt.subplots(
        len(own), 2, squeeze=False, sharex=True, figsize=(_WIDTH, _HEIGHT * len(own)), layout="constrained"
    )
    for (left, right), one in zip(axes, own, strict=True):
        time, measured, before, after = (
            np.array(one[key], dtype=float) for key in ("time", "measured", "before", "after")
        )
        left.plot(time, measured, color="0.2", label="measured")
        left.plot(time, measured - after, "--", color="#0b6e75", label="predicted")
        left.set(ylabel=f"{one['joint']} [{unit(one['unit'])}]")
        right.plot(time, before, color="#b4531a", linewidth=1.0, label="error before")
        right.plot(time, after, color="#0b6e75", linewidth=1.0, label="error after")
    for axis in axes[0]:
        axis.legend(loc="upper right", fontsize="small")
    for axis in axes[-1]:
        axis.set(xlabel="time [s]")
    drawn: Figure = figure
    return drawn


def plot_valves(report: Mapping[str, Any], joints: Sequence[str] | None = None) -> Figure:
    """Plot each axis' curve of speed over command at the reference drops, and the measured speed."""
    from matplotlib import pyplot as plt

    own = {name: axis for name, axis in report["axes"].items() if joints is None or name in joints}
    figure, axes = plt.subplots(
        len(own),
        2,
        squeeze=False,
        figsize=(_WIDTH, 1.3 * _HEIGHT * len(own)),
        layout="constrained",
        width_ratios=(1, 2),
    )
    for (left, right), (name, axis) in zip(axes, own.items(), strict=True):
        shown = axis["figures"]
        left.plot(shown["curve"]["command"], shown["curve"]["speed"], color="#0b6e75")
        left.set(ylabel=f"{name} [m/s]", xlabel="command [of full]")
        right.plot(shown["time"], np.array(shown["measured"], dtype=float), color="0.2", label="measured")
        right.plot(shown["time"], shown["predicted"], "--", color="#0b6e75", label="predicted")
        right.set(xlabel="time [s]")
        right.legend(loc="upper right", fontsize="small")
    drawn: Figure = figure
    return drawn


def _table(titles: Iterable[str], rows: Iterable[Sequence[str]]) -> str:
    head = "".join(f"<th>{html.escape(title)}</th>" for title in titles)
    body = "".join("<tr>" + "".join(f"<td>{html.escape(cell)}</td>" for cell in row) + "</tr>" for row in rows)
    return f"<table><thead><tr>{head}</tr></thead><tbody>{body}</tbody></table>"
