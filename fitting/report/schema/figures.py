"""``summary`` and ``figures`` of `report.json`: the result in words, and the values that its figures draw."""

from __future__ import annotations

from pydantic import Field

from fitting.report.schema.parts import Part

Points = list[float | None]


class Said(Part):
    """The result in a few words and in one sentence."""

    label: str
    sentence: str


class Summary(Said):
    """In English, and by their codes in the other languages of the report."""

    languages: dict[str, Said] = Field(default_factory=dict)


class ScatterFigure(Part):
    """Residual against the variable of what was found, and the law (:class:`fitting.report.model.Scatter`)."""

    joint: str
    variable: str
    unit: str
    effort_unit: str
    x: Points
    before: Points
    after: Points
    partial: Points | None = None
    direction: list[int] | None = None
    law_x: Points
    law_y: Points
    law_std: Points
    law_back: Points | None = None


class FrictionFigure(Part):
    """Friction over speed, before and after (:class:`fitting.report.model.FrictionCurve`)."""

    joint: str
    unit_x: str
    unit_y: str
    speed: Points
    force: Points
    std: Points
    after: Points | None = None


class DiagnosticsFigure(Part):
    """What is left of one joint over time, lag and frequency (:class:`fitting.report.model.JointDiagnostics`)."""

    joint: str
    unit: str
    fit_before: float | None
    fit_after: float | None
    bound: float | None
    time: list[float]
    measured: Points
    before: Points
    after: Points
    lag: list[float]
    auto: Points
    cross_lag: list[float]
    cross: Points
    frequency: list[float]
    density_before: Points
    density_after: Points


class FigureData(Part):
    """Values of the figures."""

    scatter: list[ScatterFigure] = Field(default_factory=list)
    friction: list[FrictionFigure] = Field(default_factory=list)
    diagnostics: list[DiagnosticsFigure] = Field(default_factory=list)
