"""What a page needs beyond the numbers of `report.json`: the verdict as a sentence, and the figures as values.

Both are added keys of `hilfit/report/1`: ``summary`` and ``figures``. A program that draws for people (the service's
page) says and shows the same as `report.html` without knowing the wording or the signals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from fitting.arrays import FloatArray
from fitting.report import wording
from fitting.report.languages import ENGLISH, Language, codes, language
from fitting.report.model import Figures, FrictionCurve, JointDiagnostics, Scatter

#: Points of a cloud at most: a structure that a person can see is there with fewer.
POINTS = 400
#: Moments of a joint's course over time at most.
COURSE = 1200
#: Significant digits of drawn values: a pixel is a thousandth of a figure.
DIGITS = 4


def presented(report: Mapping[str, Any], figures: Figures) -> dict[str, Any]:
    """``report`` with ``summary`` (in all languages) and ``figures`` (scatter, friction, diagnostics).

    Parameters
    ----------
    report : report of schema `hilfit/report/1`; left as it is
    figures : what `report.html` draws

    Returns
    -------
    A new report. ``figures.scatter`` has at most :data:`POINTS` points of each cloud, in the order of the samples;
    ``direction`` and ``law_back`` are null where :class:`fitting.report.model.Scatter` has None. Values have
    :data:`DIGITS` significant digits, those that do not exist are null.
    """
    said = {code: _said(report, language(code)) for code in codes()}
    return {
        **report,
        "summary": {**said.pop(ENGLISH.code), "languages": said},
        "figures": {
            "scatter": [_scatter(item) for item in figures.scatter],
            "friction": [_friction(item) for item in figures.friction],
            "diagnostics": [_diagnostics(item) for item in figures.diagnostics],
        },
    }


def _said(report: Mapping[str, Any], speaks: Language) -> dict[str, str]:
    loop = report["loop"]
    titles = {
        str(e["id"]): speaks.said(str(e["title"])) for e in (*loop["candidates"], *loop["effects"]) if e.get("title")
    }
    return {"label": wording.label(loop, speaks), "sentence": wording.verdict_sentence(report, titles, speaks)}


def _scatter(item: Scatter) -> dict[str, Any]:
    step = max(1, -(-len(item.x) // POINTS))
    return {
        "joint": item.joint,
        "variable": item.variable,
        "unit": item.unit,
        "effort_unit": item.effort_unit,
        "x": _short(item.x[::step]),
        "before": _short(item.before[::step]),
        "after": _short(item.after[::step]),
        "partial": None if item.partial is None else _short(item.partial[::step]),
        "direction": None if item.direction is None else [int(way) for way in item.direction[::step]],
        "law_x": _short(item.law_x),
        "law_y": _short(item.law_y),
        "law_std": _short(item.law_std),
        "law_back": None if item.law_back is None else _short(item.law_back),
    }


def _friction(curve: FrictionCurve) -> dict[str, Any]:
    return {
        "joint": curve.joint,
        "unit_x": curve.unit_x,
        "unit_y": curve.unit_y,
        "speed": _short(curve.speed),
        "force": _short(curve.force),
        "std": _short(curve.std),
        "after": None if curve.after is None else _short(curve.after),
    }


def _diagnostics(own: JointDiagnostics) -> dict[str, Any]:
    step = max(1, -(-len(own.time) // COURSE))
    result: dict[str, Any] = {"joint": own.joint, "unit": own.unit}
    for key in ("fit_before", "fit_after", "bound"):
        value = float(getattr(own, key))
        result[key] = value if math.isfinite(value) else None
    for key in ("time", "measured", "before", "after"):
        result[key] = _short(getattr(own, key)[::step], 6 if key == "time" else DIGITS)
    for key in ("lag", "auto", "cross_lag", "cross", "frequency", "density_before", "density_after"):
        result[key] = _short(getattr(own, key))
    return result


def _short(values: FloatArray, digits: int = DIGITS) -> list[float | None]:
    return [float(f"{v:.{digits - 1}e}") if math.isfinite(v) else None for v in np.asarray(values, dtype=float)]
