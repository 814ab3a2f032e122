"""The verdict of an identification: what may be said of the model, from what every stage found.

Strictest first:

``check_input``      a mistake in files or wiring is more likely than any effect;
``implausible``      a parameter is significantly impossible;
``not_examined``     nobody looked for what the model lacks;
``unexplained``, ``ambiguous``, ``effect_added``   as the loop found;
``nothing_missing``  only where everything speaks for it: no finding, a noise floor that is one, an error on
                     ``validate`` (root mean square, offsets included) of at most :data:`MOST_NOISE` floors and what
                     the parameters' own uncertainty makes there, and the same answer at other bandwidths of the
                     filter. Where something speaks against it, structure is left, and the verdict is ``unexplained``
                     with the reasons.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import Any

from scipy import stats

Results = Mapping[str, Mapping[str, Any]]

#: Error on the validation motion, in noise floors, up to which nothing is missing.
MOST_NOISE = 1.2
#: Chance that short recordings of a machine without anything missing exceed it.
CHANCE = 1e-3


def verdict(results: Results, joints: Sequence[str]) -> tuple[str, list[str]]:
    """The verdict and what was in the way of a better one.

    Parameters
    ----------
    results : of all stages before the report
    joints : names
    """
    mistakes = [f for f in results["check"].get("findings", ()) if f.get("severity", "mistake") == "mistake"]
    if mistakes:
        return "check_input", [str(f["text"]) for f in mistakes]
    impossible = results["refit"]["plausibility"]["violations"]
    if impossible:
        return "implausible", [str(v["text"]) for v in impossible]
    found = results["attribution"]
    if not found.get("looked", True):
        return "not_examined", []
    kinematics, said = results["residual"]["kinematics"], str(found["verdict"])
    if said in ("unexplained", "ambiguous"):
        return said, []
    if kinematics:
        return ("ambiguous" if any(f["rivals"] for f in kinematics) else "effect_added"), []
    if said != "nothing_missing":
        return said, []
    against = against_nothing_missing(results, joints)
    return ("unexplained", against) if against else (said, [])


def against_nothing_missing(results: Results, joints: Sequence[str]) -> list[str]:
    """Why it cannot be said that nothing is missing, although nothing was found; empty where it can."""
    reasons = []
    invalid = [joints[n] for n, valid in enumerate(results["residual"]["floor_valid"]) if not valid]
    if invalid:
        reasons.append(
            f"the noise of {', '.join(invalid)} is not known: record the training motion a second time (role repeat)"
        )
    times = in_floors(results["refit"]["errors"]["after"]["validate_rms"], results["residual"]["noise_floor"])
    allowed = math.hypot(_noise_ratio(results["refit"]["independent_rows"]), results["refit"]["parameter_error"])
    if times is not None and times > allowed:
        reasons.append(
            f"on the validation motion the error, offsets included, is {times:.3g} times the noise, and noise and "
            f"uncertain parameters explain no more than {allowed:.3g}"
        )
    for other in results["attribution"].get("other_bands", ()):
        if other["found"]:
            names = ", ".join(other["found"])
            reasons.append(f"with a bandwidth of {other['bandwidth_hz']:.3g} Hz the loop finds {names}")
    return reasons


def _noise_ratio(rows: Mapping[str, float]) -> float:
    """Ratio of two noises that are one, at most: :data:`MOST_NOISE`, or what chance makes of short recordings."""
    chance = float(stats.f.isf(CHANCE, max(rows["validate"], 1.0), max(rows["train"], 1.0)))
    return max(MOST_NOISE, math.sqrt(chance))


def in_floors(errors: Sequence[float | None], floor: Sequence[float]) -> float | None:
    """Root mean square over the joints of error over noise floor; None where no joint has both."""
    pairs = [(e, f) for e, f in zip(errors, floor, strict=True) if e is not None and f > 0]
    return math.sqrt(sum((e / f) ** 2 for e, f in pairs) / len(pairs)) if pairs else None
