"""The run as a whole: confusion table, rates against targets, found against lambda, coverage, time, reliability.

A statement is one thing that a report gives a probability: "nothing is missing", an effect on a joint
(each member of a set by itself), a law of one signal on a joint. It is right or it is not, and its probability is to be
the frequency of that. Results without probabilities are taken at their word: the first of a set is taken for certain.

Sources: A. Dawid, "The well-calibrated Bayesian", 1982; C. Guo et al., "On calibration of modern neural networks",
2017 (expected calibration error); G. Brier, "Verification of forecasts expressed in terms of probability", 1950.
"""

from __future__ import annotations

import json
from collections import Counter
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from scipy.stats import beta, chi2, ncx2

from benchmarks.attribution.apart import TELLABLE
from benchmarks.attribution.recipe import KINDS, TARGETS
from benchmarks.attribution.verdicts import RESULTS, kind_of
from benchmarks.cases import Line
from benchmarks.pages import filled
from benchmarks.targets import Check, figure, rate
from fitting.effects import effect

BINS = (4.0, 5.0, 6.0, 8.0, 10.0, 15.0, 20.0, 30.0, 66.0)
#: Looks that one per cent of false alarms is shared among: 30 effects on 6 joints, some four shapes each.
LOOKS = 720
FALSE_ALARMS = 0.01
_NAMED = ("right", "in set")
_QUIET = ("unexplained", "silent")


def seen_by_theory(size: float) -> float:
    """Compute the chance that a test which knows the waveform detects an effect of lambda ``size``.

    One degree of freedom, noncentral chi-square with noncentrality lambda squared, at one per cent of false alarms
    over :data:`LOOKS` looks (Bonferroni): chi-square above 19.
    """
    return float(ncx2.sf(threshold(), 1, size**2))


def threshold() -> float:
    """Compute the chi-square of one degree of freedom at the level of :func:`seen_by_theory`."""
    return float(chi2.isf(FALSE_ALARMS / LOOKS, 1))


def checks(lines: Sequence[Line]) -> list[Check]:
    """Compare every rate of the benchmark with its target."""
    done = [line for line in lines if line["result"] not in ("made", "not made")]

    def of(*kinds: str) -> list[Line]:
        return [line for line in done if line["kind"] in kinds]

    def count(among: Iterable[Line], *results: str) -> int:
        return sum(line["result"] in results for line in among)

    null, large, medium, small = of("null"), of("large"), of("medium"), of("small")
    outside, pairs = of("outside"), of("pairs")
    clean = sum(line["result"] in _NAMED and not line.get("surplus") for line in of("kinematic"))
    with_effects = [line for line in done if line["kind"] != "null"]
    surplus = sum(line.get("surplus", 0) > 0 for line in with_effects)
    found = [
        rate("no effect: accused", count(null, "accused", "error"), len(null), "at most", 0.01),
        rate("a wrong name alone", sum(bool(line.get("wrong_alone")) for line in done), len(done), "at most", 0.005),
        figure("members of the largest set", float(max((x.get("widest", 0) for x in done), default=0)), "{:g}", most=3),
        rate("large: right or in the set", count(large, *_NAMED), len(large), "at least", 0.97),
        *_visible("large", large),
        rate("kinematic: right or in the set, no surplus", clean, len(of("kinematic")), "at least", 0.95),
        rate("medium: right or in the set", count(medium, *_NAMED), len(medium), "at least", 0.8),
        *_visible("medium", medium),
        rate("medium: named, but wrong", len(medium) - count(medium, *_NAMED, *_QUIET), len(medium), "at most", 0.0),
        rate("small: right or in the set", count(small, *_NAMED), len(small)),
        *_outside(outside),
        rate("pairs: both right or in sets", count(pairs, *_NAMED), len(pairs), "at least", 0.9),
        rate("surplus effects where one was found", surplus, len(with_effects), "at most", 0.02),
        rate("fit failed", count(done, "error"), len(done), "at most", 0.0),
    ]
    found += [*_bands(done), *_calibration(done), *coverage(done), *_seconds(done)]
    return [check for check in found if check.shown != "no cases"]


def _bands(lines: Sequence[Line]) -> list[Check]:
    """Check cases judged at several bands: whether the verdict is one, or is reported to depend on them."""
    known = [list(line["bands"].values()) for line in lines if "bands" in line]
    same = [len({verdict for verdict, *_ in own}) == 1 for own in known]
    names = [len({json.dumps(verdict[1:3]) for verdict in own}) == 1 for own in known]
    labelled = [own[0][3] for own in known]
    honest = sum(a or b for a, b in zip(same, labelled, strict=True))
    return [
        rate("the same verdict at every band", sum(same), len(known)),
        rate("the same names and laws at every band", sum(names), len(known)),
        rate("the same verdict, or said to depend on the band", honest, len(known), "at least", 0.95),
    ]


def _seconds(lines: Sequence[Line]) -> Iterator[Check]:
    """Check processor time of cases without a bootstrap, which the target is for, and with one."""
    for words, bootstrap, middle, most in (("without", False, 2.9, 8.0), ("with", True, None, 10.0)):
        own = [line["seconds"] for line in lines if "seconds" in line and bool(line.get("bootstrap", 1)) == bootstrap]
        if own:
            name = f"CPU seconds a case {words} bootstrap"
            yield figure(f"{name}, median", float(np.median(own)), "{:.1f} s", most=middle)
            yield figure(f"{name}, 95th percentile", float(np.percentile(own, 95)), "{:.1f} s", most=most)


def _visible(kind: str, lines: Sequence[Line]) -> list[Check]:
    """Check, of one class, those that are as large in the noise that a fit is left with."""
    visible = [line for line in lines if line.get("apart") and line["apart"]["seen"] >= TARGETS[kind][0]]
    named = sum(line["result"] in _NAMED for line in visible)
    return [rate(f"{kind} in the noise of positions, too: right or in the set", named, len(visible))]


def _outside(lines: Sequence[Line]) -> list[Check]:
    """Check effects of no catalogue. Where it is known how near a name comes, the targets are for those that none
    explains: what a catalogue effect with its parameters reproduces within the noise is not outside the catalogue."""
    found = []
    beyond = [line for line in lines if not untellable(line)]
    near = [line for line in lines if line not in beyond]
    for words, among, target in (("outside", beyond, True), ("outside, those within noise of a name", near, False)):
        right = sum(line["result"] == "right" for line in among)
        wrong = sum(line["result"] == "wrong" and _named_for_sure(line) for line in among)
        least, most = (("at least", 0.95), ("at most", 0.02)) if target else ((), ())
        found.append(rate(f"{words}: law, joint and variable right", right, len(among), *least))
        found.append(rate(f"{words}: a catalogue name, likely", wrong, len(among), *most))
    visible = [line for line in beyond if line.get("apart") and line["apart"]["seen"] >= TARGETS["outside"][0]]
    right = sum(line["result"] == "right" for line in visible)
    found.append(rate("outside, as large in the noise of positions: right", right, len(visible)))
    series = sum(line["result"] == "wrong" and _is_series_of_its_variable(line) for line in beyond)
    found.append(rate("outside: the name is a series of the right variable at the right joint", series, len(beyond)))
    return found


def _is_series_of_its_variable(line: Line) -> bool:
    """Test whether all that was named is a short series, for any smooth law, of a variable of the effect."""
    true = {(e["joint"], v.rpartition(".")[2]) for e in line["effects"] for v in e["variables"]}
    named = {(name, joint) for members in line["said"]["sets"] for name, joint in members}
    return all(effect(name).series and (joint, _variable(name)) in true for name, joint in named)


def _variable(name: str) -> str:
    """Return the signal of an effect as laws name it: its own position is that of its piston."""
    variable = effect(name).variable
    return "piston_position" if variable == "joint_position" else variable.rpartition(".")[2]


def _named_for_sure(line: Line) -> bool:
    """Test whether a name was given half the probability or more; one without a probability was."""
    names = {(name, joint) for members in line["said"]["sets"] for name, joint in members}
    stated = _alternatives(line["said"])
    known = [p for own in stated for name, joint, p in own if (name, joint) in names]
    return not known or max(known) >= 0.5


def untellable(line: Line) -> list[dict[str, Any]]:
    """List catalogue effects, other than the true one, that a case's data cannot separate from it."""
    true = {(e["id"], e["reported"]) for e in line["effects"]}
    known = line.get("apart") or {}
    near = [r for r in known.get("rivals", ()) if r["beyond"] < TELLABLE]
    return [r for r in near if (r["id"], r["joint"]) not in true]


def inseparable(lines: Sequence[Line]) -> list[str]:
    """List pairs that the data cannot separate: number of cases, distance, and their report."""
    table: dict[tuple[str, str], list[tuple[Line, dict[str, Any]]]] = {}
    for line in lines:
        if line["kind"] not in ("large", "medium", "small") or "said" not in line:
            continue
        for rival in untellable(line):
            table.setdefault((line["effects"][0]["id"], rival["id"]), []).append((line, rival))
    rows = []
    for (true, other), own in sorted(table.items()):
        reported: Counter[str] = Counter()
        for line, rival in own:
            pair = [line["effects"][0]["id"], line["effects"][0]["reported"]], [rival["id"], rival["joint"]]
            sets = [[list(member) for member in members] for members in line["said"]["sets"]]
            both = any(pair[0] in members and pair[1] in members for members in sets)
            alone = [pair[n] in [m for members in sets for m in members] for n in (0, 1)]
            one = "the true one" if alone[0] else "the other" if alone[1] else "neither"
            reported["both in a set" if both else one] += 1
        distance = float(np.median([rival["beyond"] for _, rival in own]))
        words = ", ".join(f"{what} {n}" for what, n in reported.most_common())
        rows.append(f"{true} | {other}: {len(own)} cases, apart by {distance:.1f} in the median; said: {words}")
    return rows


def coverage(lines: Sequence[Line]) -> list[Check]:
    """Compute the share of 95 % intervals that hold the truth, per kind of parameter; all against the target.

    Parameters of one case share its noise, so the printed interval of the share is a little too narrow.
    """
    inside: Counter[str] = Counter()
    total: Counter[str] = Counter()
    for line in lines:
        for name, (value, std, truth) in line.get("parameters", {}).items():
            kind = kind_of(name)
            total[kind] += 1
            inside[kind] += abs(value - truth) <= 1.959964 * std
    found = [rate(f"95 % intervals that hold the truth: {kind}", inside[kind], total[kind]) for kind in sorted(total)]
    if total:
        whole = (sum(inside.values()), sum(total.values()))
        found.append(rate("95 % intervals that hold the truth: all", *whole, "at least", 0.92))
        found.append(rate("95 % intervals that hold the truth: all", *whole, "at most", 0.98))
    return found


def found_against_size(lines: Sequence[Line], measured: bool = False) -> list[dict[str, float]]:
    """Count per bin of lambda the effects of the catalogue that were named (alone or in a set), those at least located
    (a set or a law at the right joint), and compute what theory gives for the same sizes.

    ``measured``: lambda in the noise that a fit is left with, for the cases where it is known.
    """

    def size(line: Line) -> float | None:
        known = line.get("apart")
        if measured:
            return float(known["seen"]) if known else None
        return float(line["effects"][0]["seen"])

    single = [line for line in lines if line["kind"] in ("large", "medium", "small") and "said" in line]
    sizes = [(line, seen) for line in single if (seen := size(line)) is not None]
    bins = pairwise((0.0, *BINS) if measured else BINS)
    binned = [(low, high, [(line, seen) for line, seen in sizes if low <= seen < high]) for low, high in bins]
    return [
        {
            "low": low,
            "high": high,
            "cases": len(own),
            "named": sum(line["result"] in _NAMED for line, _ in own),
            "located": sum(bool(line["located"]) for line, _ in own),
            "theory": float(np.mean([seen_by_theory(seen) for _, seen in own])),
        }
        for low, high, own in binned
        if own
    ]


def redrawn(lines: Sequence[Line]) -> list[str]:
    """Count draws that were given up, by effect."""
    counts: Counter[str] = Counter(r["id"] for line in lines for r in line.get("redrawn", ()))
    return [f"{effect} {n}" for effect, n in counts.most_common()]


def _truth_text(line: Line) -> str:
    """Describe the true effects of a case in a few words."""
    parts = [f"{e['id']}@{e['reported'] or 'machine'} ({e['seen']:.1f})" for e in line.get("effects", ())]
    return " + ".join(parts) or "-"


def _findings_text(line: Line) -> str:
    """Describe what was found, in a few words."""
    findings = line.get("said")
    if findings is None:
        return str(line.get("error", "-"))
    sets = ["|".join(f"{effect}@{joint or 'machine'}" for effect, joint in members) for members in findings["sets"]]
    laws = [f"law({variable})@{joint or 'machine'}" for variable, joint in findings["laws"]]
    return "; ".join(sets + laws) or "nothing"


def case_text(line: Line) -> str:
    """Describe a case in one line."""
    surplus = "+surplus" if line.get("surplus") else ""
    seconds = line.get("seconds", line.get("make_seconds", 0.0))
    head = f"{line['kind']}:{line['number']:<4d} {line.get('arm', ''):12s} {line['result'] + surplus:16s}"
    return f"{head} {seconds:5.1f} s  {_truth_text(line)}  ->  {_findings_text(line)}"


def text(lines: Sequence[Line]) -> list[str]:
    """Write everything but the single cases, for people."""
    by_kind = {kind: [line for line in lines if line["kind"] == kind] for kind in KINDS}
    by_effect: dict[str, Counter[str]] = {}
    for line in lines:
        if len(line.get("effects", ())) == 1:
            by_effect.setdefault(line["effects"][0]["id"], Counter())[line["result"]] += 1
    wrong = [line for line in lines if line.get("wrong_alone") or line["result"] in ("accused", "wrong set", "error")]
    sizes = {"noise of the efforts": False, "noise that a fit is left with": True}
    page = filled(
        "attribution/summary.txt.j2",
        results=[r for r in (*RESULTS, "made", "not made") if any(line["result"] == r for line in lines)],
        counts={kind: Counter(line["result"] for line in own) for kind, own in by_kind.items() if own},
        surplus={kind: sum(line.get("surplus", 0) > 0 for line in own) for kind, own in by_kind.items()},
        wrong=[case_text(line) for line in wrong],
        by_effect={effect: sorted(counts.items()) for effect, counts in sorted(by_effect.items())},
        sizes={words: found_against_size(lines, measured) for words, measured in sizes.items()},
        threshold=threshold(),
        looks=LOOKS,
        bins=diagram(statements(lines)) if any("said" in line for line in lines) else None,
        tellable=TELLABLE,
        pairs=inseparable(lines),
        redrawn=redrawn(lines),
    )
    return page.splitlines()


def compared(old: Sequence[Line], new: Sequence[Line]) -> list[str]:
    """List cases of both runs that came out differently."""

    def outcome(line: Line) -> tuple[Any, ...]:
        return line["result"], line.get("surplus", 0), _findings_text(line)

    before = {(line["kind"], line["number"], line["seed"]): line for line in old}
    rows, changes, both = [], Counter[str](), 0
    for line in new:
        earlier = before.get((line["kind"], line["number"], line["seed"]))
        if earlier is None or earlier.get("recipe") != line.get("recipe"):
            continue  # another recipe makes another case of the same key
        both += 1
        if outcome(earlier) != outcome(line):
            rows.append(f"  {line['kind']}:{line['number']} {_truth_text(line)}")
            for word, which in (("was", earlier), ("is ", line)):
                surplus = "+surplus" if which.get("surplus") else ""
                rows.append(f"    {word} {which['result']}{surplus}: {_findings_text(which)}")
        if earlier["result"] != line["result"]:
            changes[f"{line['kind']}: {earlier['result']} -> {line['result']}"] += 1
    head = [f"compared on {both} cases; {len(rows) // 3} say something else than before"]
    return head + rows + [f"  {n:3d} {change}" for change, n in changes.most_common()]


Statement = tuple[float, bool]

EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
#: Largest expected calibration error.
LARGEST_ERROR = 0.05


@dataclass(frozen=True)
class Bin:
    """Statements of nearly one probability: how many, their mean probability, and the share of them that is right."""

    count: int
    stated: float
    right: float
    low: float
    high: float


def statements(lines: Iterable[Line]) -> list[Statement]:
    """List every statement of a run: its probability, and whether it is right."""
    found: list[Statement] = []
    for line in lines:
        findings = line.get("said")
        if findings is None:
            continue
        if not findings["sets"] and not findings["laws"]:
            nothing = findings.get("nothing")
            found.append((1.0 if nothing is None else float(nothing), not line["effects"]))
        for own in _alternatives(findings):
            found += [(p, _right(line, name, joint)) for name, joint, p in own]
    return found


def _alternatives(findings: dict[str, Any]) -> list[list[tuple[str, str | None, float]]]:
    """List alternatives per finding, with probabilities; where there are none, the first, for certain."""
    stated = findings.get("stated") or []
    if stated and isinstance(stated[0][0], list):
        return [[(str(name), joint, float(p)) for name, joint, p in own] for own in stated]
    first = [members[0] for members in findings["sets"]]
    return [[(str(name), joint, 1.0)] for name, joint in (*first, *findings["laws"])]


def _right(line: Line, name: str, joint: str | None) -> bool:
    """Test whether an effect, or a law of its signal on its joint, is there; a law of a catalogued effect is wrong.

    A law is right of an effect outside the catalogue only.
    """
    if line["kind"] == "outside":
        return any(joint == own["joint"] and name in own["variables"] for own in line["effects"])
    return any((name, joint) == (own["id"], own["reported"]) for own in line["effects"])


def _binned(given: Sequence[Statement]) -> Iterator[list[Statement]]:
    """Yield the statements of each bin of probability that has any."""
    for low, high in pairwise(EDGES):
        own = [(p, right) for p, right in given if low <= p < high or (high == 1.0 and p == 1.0)]
        if own:
            yield own


def diagram(given: Sequence[Statement]) -> list[Bin]:
    """Bin statements by probability, with the share that is right and its 90 % interval (Jeffreys)."""
    found = []
    for own in _binned(given):
        hits, count = sum(right for _, right in own), len(own)
        low_end, high_end = (float(beta.ppf(level, hits + 0.5, count - hits + 0.5)) for level in (0.05, 0.95))
        found.append(Bin(count, float(np.mean([p for p, _ in own])), hits / count, low_end, high_end))
    return found


def calibration_error(given: Sequence[Statement]) -> float:
    """Compute the expected calibration error: distance of probability and share, weighted by statements."""
    return float(sum(b.count * abs(b.stated - b.right) for b in diagram(given)) / max(len(given), 1))


def calibration_error_by_chance(given: Sequence[Statement]) -> float:
    """Compute the calibration error that is expected of as many statements whose probabilities are right."""
    variances = [sum(p * (1.0 - p) for p, _ in own) for own in _binned(given)]
    # The mean distance of a normal sum is sqrt(2 / pi) of its deviation.
    return float(np.sum(np.sqrt(2.0 / np.pi * np.array(variances))) / max(len(given), 1))


def brier(given: Sequence[Statement]) -> float:
    """Compute the mean squared distance of the probabilities from what is true (0 or 1)."""
    return float(np.mean([(p - right) ** 2 for p, right in given])) if given else float("nan")


def draw_reliability(lines: Sequence[Line], target: Path) -> None:
    """Draw the diagram: share that is right over stated probability, with intervals and numbers of statements."""
    from matplotlib.figure import Figure

    found = diagram(statements(lines))
    stated, right = np.array([b.stated for b in found]), np.array([b.right for b in found])
    ends = np.array([[b.right - b.low, b.high - b.right] for b in found]).T
    picture = Figure(figsize=(5.2, 4.6), layout="constrained")
    axes = picture.add_subplot()
    axes.plot([0, 100], [0, 100], color="#999999", linewidth=1, label="as stated")
    axes.errorbar(
        100 * stated, 100 * right, 100 * np.maximum(ends, 0.0), fmt="o", color="#1f6f8b", capsize=3,
        label="right, with 90 % intervals",
    )  # fmt: skip
    for b in found:
        axes.annotate(str(b.count), (100 * b.stated, 100 * b.right), (7, -11), textcoords="offset points", fontsize=8)
    axes.set(xlabel="stated probability, %", ylabel="right, %", xlim=(-3, 106), ylim=(-3, 106))
    axes.legend(loc="upper left", frameon=False)
    picture.savefig(target, dpi=110)


def _calibration(lines: Sequence[Line]) -> list[Check]:
    """Check the expected calibration error against its target, and the Brier score."""
    given = statements(lines)
    if not given:
        return []
    error, score = calibration_error(given), brier(given)
    return [
        Check("expected calibration error of stated probabilities", error,
              f"{100 * error:.1f} % ({100 * calibration_error_by_chance(given):.1f} % by chance alone)", "at most",
              LARGEST_ERROR, f"{100 * LARGEST_ERROR:.0f} %"),
        figure("Brier score of stated probabilities", score, "{:.3f}"),
    ]  # fmt: skip
