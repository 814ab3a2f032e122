"""How fine a law is: as many basis functions as its curve takes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.residual.laws import Law
from fitting.residual.scoring import Score, score_terms
from fitting.residual.surfaces import Surface
from fitting.residual.terms import Model
from fitting.selection.evidence import named_evidence
from fitting.signals.splines import spline_knots

#: Basis functions that a law may have in the end: as many as its curve takes.
RESOLUTIONS = (4, 6, 8, 12, 16, 24, 32)


def resolved(model: Model, score: Score) -> Score:
    """The law with as many basis functions as are most probable: a bump may be narrow, a slope needs few."""
    law = score.term.content
    assert isinstance(law, Law)
    if isinstance(law, Surface):
        return score
    values = np.concatenate([law.values(model.views[index][score.term.joint or 0]) for index in model.fitted])
    terms = [
        replace(score.term, content=replace(law, knots=tuple(spline_knots(values, count).tolist())))
        for count in RESOLUTIONS
    ]
    trials = score_terms(model, terms, [1] * len(terms))
    if not trials:
        return score
    gain, live = np.array([s.gain for s in trials]), np.array([float(s.live) for s in trials])
    shown = np.sqrt(np.maximum(gain.max(), 9.0))
    return trials[int(np.argmax(named_evidence(gain, live, np.array([shown]))[:, 0]))]
