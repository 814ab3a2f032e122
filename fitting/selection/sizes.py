"""How large what is looked for can be, and how large what is left of what was found."""

from __future__ import annotations

import numpy as np

from fitting.arrays import FloatArray
from fitting.residual.scoring import Score
from fitting.residual.terms import Model
from fitting.selection import priors
from fitting.selection.gains import efforts


class Sizes:
    """Amplitudes that terms beside a model can have, standard deviations.

    Parameters
    ----------
    model : what is there
    visible : (n,) amplitude per joint of effects that were found
    failed : (n,) the same of names that did not hold elsewhere: what they lived on is open to a law of that joint
    """

    def __init__(self, model: Model, visible: FloatArray, failed: FloatArray) -> None:
        self._visible, self._failed = visible, failed
        self._largest = efforts(model)

    def limit(self, score: Score) -> float:
        """Largest amplitude of a term: what can be seen of it when it is as large as the whole effort."""
        place = None if score.term.everywhere else score.term.joint
        whole = float(np.sqrt(np.sum(self._largest**2))) if place is None else float(self._largest[place])
        return score.surviving * whole

    def left(self, joint: int, law: bool = False) -> FloatArray:
        """Amplitudes of what found effects leave on a joint; none where nothing was found."""
        seen = self._visible
        others = float(np.sqrt(max(np.sum(seen**2) - seen[joint] ** 2, 0.0)))
        own = float(np.hypot(seen[joint], priors.SPILL * others))
        return (own if law else float(np.hypot(own, self._failed[joint]))) * np.array(priors.LEFTOVERS)
