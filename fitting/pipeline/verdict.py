"""The verdict of an identification: what may be concluded of the model, from what every stage found.

Strictest first:

``check_input``      a mistake in files or wiring is more likely than any effect;
``implausible``      a parameter is significantly impossible;
``not_examined``     nobody looked for what the model lacks;
``unexplained``, ``ambiguous``, ``effect_added``   as the loop found;
``nothing_missing``  only where everything speaks for it: no finding, a probability that nothing is missing of at least
                     a half, a noise floor that is one, an error on ``validate`` (root mean square, offsets included)
                     of at most :data:`MOST_NOISE` floors and what the parameters' own uncertainty makes there, and the
                     same answer at other bandwidths of the filter. Where something speaks against it the verdict is
                     ``unexplained`` with the reasons.

Beside it is a label where the recordings leave the verdict open:

``cannot_tell``      nothing was found, but the noise is not known, or nothing is not probable enough
                     (:data:`NEEDED`): what to record next is among the reasons;
``depends_on_band``  another bandwidth of the filter gives another verdict.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import scipy

from daq.messages import Sentence
from fitting.estimators.effort_fit import CHANCE
from fitting.pipeline.results.loop_results import Attributed
from fitting.pipeline.results.stage_results import Checked, Refitted, Residual, StageResults
from fitting.regression.error_sizes import in_floors
from fitting.selection.evidence import least_gain

#: Error on the validation motion, in noise floors, up to which nothing is missing.
MOST_NOISE = 1.2
#: Probability that nothing is missing from which on that is reported: two to one.
NEEDED = 2.0 / 3.0
#: Deviations from zero below which a coefficient would not have been named at another bandwidth.
NAMED_FROM = math.sqrt(least_gain(1))


def verdict(results: StageResults, joints: Sequence[str]) -> tuple[str, list[str]]:
    """Return the verdict by all stages before the report, and what was in the way of a better one."""
    mistakes = [f for f in results[Checked].findings if f.severity == "mistake"]
    if mistakes:
        return "check_input", [f.text for f in mistakes]
    impossible = results[Refitted].plausibility.violations
    if impossible:
        return "implausible", [str(v["text"]) for v in impossible]
    found = results[Attributed]
    if not found.looked:
        return "not_examined", []
    kinematics, outcome = results[Residual].kinematics, found.verdict
    added = [own for own in found.accepted if not own.term.is_line]
    if found.nothing_more < 0.5:
        more = Sentence("fitting.more_is_missing", count=len(added), probability=found.nothing_more)
        return outcome, [more]
    if outcome in ("unexplained", "ambiguous"):
        silent = outcome == "unexplained" and not (added or found.unconfirmed)
        return outcome, [Sentence("fitting.nothing_missing_probability", probability=found.nothing)] if silent else []
    if results[Residual].laws:
        return "unexplained", []
    if kinematics:
        return ("ambiguous" if any(f.effect["indistinguishable_from"] for f in kinematics) else "effect_added"), []
    if outcome != "nothing_missing":
        return outcome, []
    against = _against_nothing_missing(results, joints)
    return ("unexplained", against) if against else (outcome, _what_to_record(results))


def label(results: StageResults) -> str | None:
    """Return the label beside the verdict; None where undisputed."""
    found, residual = results[Attributed], results[Residual]
    if not found.looked:
        return None
    others = [cutoff for item in found.accepted for cutoff in item.evidence.get("cutoffs", ())[1:]]
    faint = any(abs(own["value"]) < NAMED_FROM * own["std"] for own in others)
    if faint or any(other.found for other in found.other_bands):
        return "depends_on_band"
    silent = not (found.accepted or found.unconfirmed or found.lines or residual.kinematics or residual.laws)
    if silent and found.nothing >= 0.5 and not (found.nothing >= NEEDED and all(residual.floor_valid)):
        return "cannot_tell"
    return None


def _what_to_record(results: StageResults) -> list[str]:
    """List what would decide whether something is missing, where probabilities do not."""
    found = results[Attributed]
    if label(results) != "cannot_tell" or found.nothing >= NEEDED:
        return []
    return [Sentence("fitting.nothing_missing_uncertain", probability=found.nothing)]


def _against_nothing_missing(results: StageResults, joints: Sequence[str]) -> list[str]:
    """Explain why "nothing is missing" is unproven, although nothing was found; empty where proven."""
    reasons: list[str] = []
    refitted = results[Refitted]
    invalid = [joints[n] for n, valid in enumerate(results[Residual].floor_valid) if not valid]
    if invalid:
        reasons.append(Sentence("fitting.noise_not_known_record", joints=", ".join(invalid)))
    times = in_floors(refitted.errors["after"]["validate_rms"], results[Residual].noise_floor)
    # In short recordings two equal noises differ by chance.
    rows = (max(refitted.independent_rows[role], 1.0) for role in ("validate", "train"))
    chance = math.sqrt(float(scipy.stats.f.isf(CHANCE, *rows)))
    allowed = math.hypot(max(MOST_NOISE, chance), refitted.parameter_error)
    if times is not None and times > allowed:
        reasons.append(Sentence("fitting.validation_motion_error_offsets", times=times, allowed=allowed))
    for other in results[Attributed].other_bands:
        if other.found:
            reasons.append(
                Sentence("fitting.other_band_finds", bandwidth_hz=other.bandwidth_hz, found=", ".join(other.found))
            )
    return reasons
