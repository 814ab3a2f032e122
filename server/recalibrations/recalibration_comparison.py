"""The before/after table of a recalibration; pure functions.

Both models are judged by the same recording, which neither was fitted to: the validation recording of the
recalibration. "Then" is what the active calibration left over of its own validation recording.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from typing import Any

from daq.messages import Sentence, put_together

#: A new calibration counts as better if what it leaves over is smaller by this share on the (geometric) mean of
#: the joints, and larger by no more than ``WORSE`` at any of them.
BETTER = 0.02
WORSE = 0.05
#: The active calibration counts as outgrown where it leaves over so many times what it left then.
GREW = 1.25


def table(
    before: Mapping[str, float], after: Mapping[str, float], then: Mapping[str, float], units: Mapping[str, str]
) -> dict[str, Any]:
    """Compare what the active and the new calibration leave over, per joint.

    Parameters
    ----------
    before, after : RMS residual of the active and of the new calibration on the new recording
    then : RMS residual of the active one on its own recording
    units : of the residuals

    Returns
    -------
    ``joints`` (per joint ``before``, ``after``, ``then``, ``unit``, ``change_percent``), ``change_percent`` over all,
    ``better``, ``worse`` and ``grew`` (joints).
    """
    ratios = {joint: _ratio(after[joint], before[joint]) for joint in before}
    overall = math.exp(sum(math.log(ratio) for ratio in ratios.values()) / len(ratios))
    worse = [joint for joint, ratio in ratios.items() if ratio > 1 + WORSE]
    return {
        "joints": {
            joint: {
                "before": before[joint],
                "after": after[joint],
                "then": then.get(joint),
                "unit": units[joint],
                "change_percent": 100 * (ratios[joint] - 1),
            }
            for joint in before
        },
        "change_percent": 100 * (overall - 1),
        "better": overall <= 1 - BETTER and not worse,
        "worse": worse,
        "grew": [joint for joint in before if joint in then and _ratio(before[joint], then[joint]) > GREW],
    }


def _ratio(a: float, b: float) -> float:
    """Compute ``a / b`` for residuals; two that are nothing are equal."""
    smallest = 1e-12
    return max(a, smallest) / max(b, smallest)


def sentence(comparison: Mapping[str, Any]) -> str:
    """Describe a comparison to a person."""
    if not comparison.get("joints"):
        return str(put_together(comparison).get("note") or Sentence("server.nothing_to_compare"))
    change = comparison["change_percent"]
    text = Sentence("server.leaves_less" if change <= 0 else "server.leaves_more", percent=abs(change))
    return Sentence("server.worse_at", what=text, joints=comparison["worse"]) if comparison["worse"] else text
