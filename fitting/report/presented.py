"""What a page needs beyond the numbers of `report.json`: the verdict as a sentence, figures as values, and messages.

They are added keys of `hilfit/report/1`: ``summary``, ``figures`` and ``messages``. A program that draws for people
(the service's page) states and shows the same as `report.html` without knowing the wording or the signals.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

import numpy as np

from daq.messages import messages_in
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
    """Add ``summary`` (in all languages), ``figures`` (scatter, friction, diagnostics) and ``messages`` to ``report``.

    Returns
    -------
    A new report. ``figures.scatter`` has at most :data:`POINTS` points of each cloud, in the order of the samples;
    ``direction`` and ``law_back`` are null where :class:`fitting.report.model.Scatter` has None. Values have
    :data:`DIGITS` significant digits, those that do not exist are null.
    """
    summaries = {code: _summary(report, language(code)) for code in codes()}
    return {
        **report,
        "summary": {**summaries.pop(ENGLISH.code), "languages": summaries},
        "figures": {
            "scatter": [_values(item) for item in figures.scatter],
            "friction": [_values(item) for item in figures.friction],
            "diagnostics": [_values(item) for item in figures.diagnostics],
        },
        "messages": messages_in(report),
    }


def _summary(report: Mapping[str, Any], own: Language) -> dict[str, str]:
    loop = report["loop"]
    titles = {
        str(e["id"]): own.translated(str(e["title"])) for e in (*loop["candidates"], *loop["effects"]) if e.get("title")
    }
    return {"label": wording.label(loop, own), "sentence": wording.verdict_sentence(report, titles, own)}


#: Of each figure the arrays that have a value per sample, and how many values are kept of them.
_SAMPLES: dict[type[Any], tuple[tuple[str, ...], int]] = {
    Scatter: (("x", "before", "after", "partial", "direction"), POINTS),
    FrictionCurve: ((), POINTS),
    JointDiagnostics: (("time", "measured", "before", "after"), COURSE),
}


def _values(item: Scatter | FrictionCurve | JointDiagnostics) -> dict[str, Any]:
    """Return a figure's values by its fields' names; those of samples thinned."""
    thinned, most = _SAMPLES[type(item)]
    step = max(1, -(-len(getattr(item, thinned[0])) // most)) if thinned else 1
    result: dict[str, Any] = {}
    for name, value in vars(item).items():
        if isinstance(value, np.ndarray):
            own = value[::step] if name in thinned else value
            result[name] = (
                own.astype(int).tolist() if name == "direction" else _short(own, 6 if name == "time" else DIGITS)
            )
        else:
            result[name] = value if not isinstance(value, float) or math.isfinite(value) else None
    return result


def _short(values: FloatArray, digits: int) -> list[float | None]:
    return [float(f"{v:.{digits - 1}e}") if math.isfinite(v) else None for v in np.asarray(values, dtype=float)]
