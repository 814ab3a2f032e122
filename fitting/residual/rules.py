"""The rules of the loop: what may be chosen, what is a name and what a law, what counts as one set.

Decisions and where their numbers come from (``docs/decisions/0003-attribution.md``, ``0015``, ``0021``):


accuse
    A candidate has to gain :data:`ACCUSE` beyond the price of its parameters. One parameter then needs a chi-square
    of 20 (p = 8e-6), which pays for some hundred independent looks per joint at one per cent.
name or law
    A named effect that leaves a spline of one signal clearly better off is not the explanation; the law is said.
set
    Two candidates with one parameter differ by ``lambda^2 (1 - rho^2)`` on average, with twice its root as
    standard deviation; a rival within :data:`SET_WIDTH` could be the truth with a chance of more than half a per cent.
hold
    It has to hold on blocks of the fitted recordings that were left out of the fit.
confirm
    What does not lower the whitened error of `validate` is refused, whatever it gained in training.
"""

from __future__ import annotations

from collections.abc import Sequence

from fitting.effects.base import Effect
from fitting.residual.confirmation import OnValidate
from fitting.residual.cross_validation import HeldOut
from fitting.residual.findings import Accepted, Candidate, Family
from fitting.residual.laws import Law
from fitting.residual.scoring import Score
from fitting.residual.terms import Term

ACCUSE = 14.0
SET_WIDTH = 7.0
SET_SHARE = 0.02
LAW_WINS = 6.0
LAW_WINS_SHARE = 0.05
MOST_EFFECTS = 4
MOST_RIVALS = 2
#: Share of a law's gain from which on a name of its joint has its shape searched before the two are compared, and how
#: many names.
NEAR_SHARE, MOST_SHARPENED = 0.25, 2
#: A name that leaves this share of its own gain, significantly, in what two runs of one motion share, was wrong.
#: What is left of many times its gain is another matter.
DOUBT_SHARE, UNRELATED_SHARE, MISFIT_Z = 0.33, 3.0, 4.0
#: Share of a gain from which on it rests on one joint.
ONE_JOINT = 0.9
#: A candidate that keeps this share of its gain beside the one that was added explains something else: no rival.
ANOTHER_SHARE = 0.5
#: Contenders whose null is drawn, and replicas that are drawn before the decision is looked at again.
MOST_CONTENDERS = 24
LEAST_DRAWS = 3
#: Standard errors by which the gain on held-out blocks has to be above zero; more where no validation motion is there.
LEAST_Z, LEAST_Z_ALONE = 1.5, 3.0
#: What keeps this share of its gain on held-out blocks holds, even if a few of them brought it all: a resonance rings
#: where it was hit, a load is overrun in one place.
HELD_SHARE = 0.5
#: What is left of an effect's own gain on its own joint is the difference between its formula and nature's.
MISFIT_SHARE = 0.1
#: The same for a spline's limited resolution, in the signal that it is a law of.
LAW_MISFIT_SHARE = 0.25
#: The same where it stands in one set with that effect: nature's formula may lie between the two.
RIVAL_SHARE = 1 / 3
#: The same on other joints, where only the coupling through the rigid body shows.
SPILL_SHARE = 0.01
#: The same of what nothing explains: a model that is known to be wrong spills more.
UNEXPLAINED_SPILL = 0.05
#: A law that still gains this share of a named effect's gain on the same joint says that the name was wrong.
REFUTED_SHARE = 0.25
#: The same where the law, alone, takes :data:`OVERLAP` of the name's gain: both explain one thing, and one of them is
#: not its formula. Right formulas leave less than a hundredth as a rule; those that are short series, some more.
OUTDONE_SHARE, SERIES_SHARE, OVERLAP = 0.02, 0.06, 1 / 3


def objection(choice: Score, held_out: HeldOut, validate: OnValidate | None) -> str:
    """Why a term is not to be added; empty if there is nothing against it.

    A validation motion that could not show a right effect is as good as none, unless it shows that this one is wrong.
    """
    if too_faint(choice, held_out):
        return (
            f"the rows that show it are {held_out.own_noise:.1f} times as noisy as the motion as a whole; against that "
            f"it gains {held_out.own_gain:.1f} of chi-square, less than the noise and its price ask for"
        )
    if choice.term.confined:  # most blocks know nothing of it, and no other recording does: it has to be plain
        if held_out.gain >= HELD_SHARE * choice.gain and choice.score > 2 * ACCUSE:
            return ""
        return "it acts in one recording only, and is not significant enough to be believed without another"
    blind = is_blind(choice, validate)
    alone = validate is None or blind
    if not (held_out.gain > 0 and held_out.z >= LEAST_Z_ALONE if alone else _holds(choice.gain, held_out, LEAST_Z)):
        return (
            f"it does not hold on blocks that were left out of the fit (chi-square {held_out.gain:+.1f}, "
            f"{held_out.z:.1f} standard errors)"
        )
    if validate is not None and validate.gain <= 0 and not blind:
        return f"it does not help on the validation motion (chi-square {validate.gain:+.1f})"
    return ""


def too_faint(choice: Score, held_out: HeldOut) -> bool:
    """Whether a gain is not significant against the noise of just the rows that show it."""
    return held_out.own_gain - (choice.gain - choice.score) <= ACCUSE


def is_blind(choice: Score, validate: OnValidate | None) -> bool:
    """Whether the validation motion has nothing to say of a plain effect: no gain, and none to be expected."""
    if validate is None or validate.gain > 0 or validate.tells or validate.refutes:
        return False
    return choice.score > 2 * ACCUSE


def _holds(gain: float, held_out: HeldOut, least_z: float) -> bool:
    return held_out.gain > 0 and (held_out.z >= least_z or held_out.gain >= HELD_SHARE * gain)


def best_by_family(scores: Sequence[Score]) -> dict[Family, Score]:
    """Best shape of each effect on each joint; plausible ones come before implausible ones."""
    best: dict[Family, Score] = {}
    for score in scores:
        present = best.get(score.term.family)
        if present is None or (score.plausible, score.score) > (present.plausible, present.score):
            best[score.term.family] = score
    return best


def best_by_joint(scores: Sequence[Score]) -> dict[int | None, Score]:
    """Best law of each joint."""
    best: dict[int | None, Score] = {}
    for score in scores:
        if score.term.joint not in best or score.score > best[score.term.joint].score:
            best[score.term.joint] = score
    return best


def choose(names: Sequence[Score], laws: Sequence[Score], accepted: Sequence[Accepted]) -> Score | None:
    """The next thing to add: the best name, or a law that leaves the best name behind."""
    names = [s for s in names if s.calibrated > ACCUSE and not is_misfit(s, accepted)]
    laws = [s for s in laws if s.calibrated > ACCUSE]
    laws = [s for s in laws if not is_misfit(s, accepted) or refutes(s, accepted) is not None]
    name = max(names, key=lambda s: s.score, default=None)
    law = max(laws, key=lambda s: s.score, default=None)
    if law is None or name is None:
        return law if name is None else name
    return law if law.score - name.score > max(LAW_WINS, LAW_WINS_SHARE * law.gain) else name


def is_misfit(score: Score, accepted: Sequence[Accepted]) -> bool:
    """Whether a gain is small enough to be what an accepted effect's formula leaves of nature's."""
    return any(_is_misfit_of(score, item) for item in accepted)


def _is_misfit_of(score: Score, item: Accepted) -> bool:
    term, gain, joint = item.score.term, item.score.gain, score.term.joint
    if any(rival.term.family == score.term.family for rival in item.rivals):
        return score.gain < RIVAL_SHARE * gain
    if score.places and term.joint is not None and not term.everywhere:
        elsewhere = score.gain * min(1.0, 1.0 - score.places[term.joint])
        if elsewhere >= SPILL_SHARE * gain and elsewhere - (score.gain - score.score) > ACCUSE:
            return False  # another joint confirms it
    if item.score.places and joint is not None and not score.term.everywhere:
        here = gain * max(0.0, item.score.places[joint])  # what acts everywhere shows itself on some joints most
        return score.gain < max(MISFIT_SHARE * here, SPILL_SHARE * gain)
    own = term.everywhere or term.joint == joint or score.term.everywhere
    share = MISFIT_SHARE if own else SPILL_SHARE
    if isinstance(term.content, Law) and own and _same_signal(score, term.content):
        content = score.term.content
        # The odd part of a law is no misfit of its even part: one signal may have both.
        other_part = isinstance(content, Law) and content.signed != term.content.signed
        share = SPILL_SHARE if other_part else LAW_MISFIT_SHARE
    return score.gain < share * gain


def is_fragment(score: Score, failed: Sequence[Score], accepted: Sequence[Accepted]) -> bool:
    """Whether a gain is a small part only of what is certainly there, on its joint or another, and yet unexplained.

    ``failed`` were significant and did not hold elsewhere: their formulas were wrong, what they lived on is there.
    """
    explained = {item.score.term.joint for item in accepted}
    for item in failed:
        joint = item.term.joint
        here = score.term.everywhere or score.term.joint == joint
        share = REFUTED_SHARE if here else UNEXPLAINED_SPILL
        if joint not in explained and score.gain < share * item.gain:
            return True
    return False


def _same_signal(score: Score, law: Law) -> bool:
    content = score.term.content
    if isinstance(content, Law):
        return not set(content.signals).isdisjoint(law.signals)
    return law.other is None and content.variable in (
        law.signal,
        "joint_position" if law.signal == "piston_position" else "",
    )


def refutes(score: Score, accepted: Sequence[Accepted]) -> int | None:
    """Number of an accepted *name* on the same joint that this law shows to be wrong."""
    for number, item in enumerate(accepted):
        term = item.score.term
        # A line in the spectrum was found on its own; no law of a signal can stand for it.
        named = isinstance(term.content, Effect) and term.id != "supply_ripple"
        named_here = named and term.joint == score.term.joint
        if named_here and score.gain > REFUTED_SHARE * item.score.gain:
            return number
    return None


def rivals(choice: Score, named: dict[Family, Score], refused: set[Family]) -> tuple[Score, ...]:
    """Candidates that gain as much, the best first; where a bias was taken off, as far as its doubt reaches."""

    def width(rival: Score) -> float:
        doubts = [s.null.doubt(s.information, s.gain) for s in (choice, rival) if s.null is not None]
        share = MISFIT_SHARE if _rests_on(choice, rival.term) or _rests_on(rival, choice.term) else SET_SHARE
        return max(SET_WIDTH, share * choice.gain) + max(doubts, default=0.0)

    near = [
        s
        for s in named.values()
        if s.plausible
        and s.term.family != choice.term.family
        and s.term.family not in refused
        and not _only_more_general(s.term, choice.term)
        and abs(choice.score - s.score) < width(s)
    ]
    return tuple(sorted(near, key=lambda s: -s.score))


def _rests_on(everywhere: Score, own: Term) -> bool:
    """Whether what acts everywhere has its evidence on one joint alone, that of another name.

    Nothing but that joint tells the two apart then, and their formulas are only as good as formulas are.
    """
    if not everywhere.places or own.joint is None:
        return False
    return everywhere.places[own.joint] > ONE_JOINT


def _only_more_general(rival: Term, name: Term) -> bool:
    """Whether a rival is the name with further parameters."""
    return isinstance(rival.content, Effect) and rival.joint == name.joint and name.id in rival.content.includes


def there(accepted: Sequence[Accepted], score: Score) -> bool:
    return any(item.score.term.family == score.term.family for item in accepted)


def law_there(accepted: Sequence[Accepted], score: Score) -> bool:
    law = score.term.content
    for item in accepted:
        present = item.score.term.content
        if not isinstance(present, Law) or not isinstance(law, Law) or item.score.term.joint != score.term.joint:
            continue
        if set(law.signals) <= set(present.signals) and law.signed == present.signed:
            return True
    return False


def record(
    table: dict[Family, Candidate],
    named: dict[Family, Score],
    accepted: Sequence[Accepted],
) -> None:
    """Note what each family could do in this round, unless it already has its say."""
    for family, score in named.items():
        if (family in table and table[family].status != "rejected") or family in {
            a.score.term.family for a in accepted
        }:
            continue
        if not score.plausible and score.score > ACCUSE:
            values = ", ".join(f"{v:.3g}" for v in score.values)
            status, reason = "rejected", f"it would need an impossible parameter ({values})"
        elif score.score <= ACCUSE:
            status, reason = (
                "rejected",
                f"gains {score.gain:.1f} of chi-square, less than the noise and its price ask for",
            )
        else:
            status, reason = "rejected", "significant, but another effect explains the same better"
        if family not in table or score.score > table[family].score:
            table[family] = Candidate(score.term.id, score.term.joint, score.score, status, reason)


def why(score: Score, validate: OnValidate | None) -> str:
    words = "; the validation motion can hardly show it" if is_blind(score, validate) else ""
    return f"gains {score.gain:.0f} of chi-square for {score.live} parameter{'s' if score.live > 1 else ''}{words}"
