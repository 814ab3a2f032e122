"""A load that is picked up at some moment: the one effect of the catalogue that can be most of a joint's effort.

It is no mistake, so before an effort is called unexplained, it is tried: from a moment on, the last link has further
point masses.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from fitting.checks.mistakes.physical import Physical, Trial, fit

#: Moments that are tried, evenly over the longest recording.
_MOMENTS = 15


def with_payload(trial: Trial) -> Physical:
    """The best arm that picks something up (or puts it down) in the course of each recording."""
    since = trial.samples.since
    best: tuple[float, Physical] | None = None
    for moment in np.linspace(0.0, float(since.max()), _MOMENTS + 2)[1:-1]:
        for carried in (since > moment, since < moment):
            after = fit(replace(trial, exchange=False, carried=carried.astype(float)))
            left = float(np.nansum(np.log(after.misfits + 0.02)))
            if best is None or left < best[0]:
                best = left, after
    assert best is not None
    return best[1]
