"""Distance of the true effect from nothing and from other names of the catalogue: what data can separate at all.

The noise is what a fit is left with at the *true* parameters on an undisturbed model: noise of the efforts, and what
noise of the positions makes of the regressors. Its spectrum is taken from all fitted recordings without the effect.
``seen`` is lambda in that noise: about lambda in the noise of the efforts alone, and much less where a heavy link's
acceleration has to be separated from a coarse encoder.

A rival that is fitted together with the base takes the part ``gain`` of the true waveform's ``lambda^2``. What is left,
``sqrt(lambda^2 - gain)``, is how far the data speak against it: the root of the noncentrality of a test between both.
Below :data:`TELLABLE` a test at one per cent does not separate them more often than not, so they belong in one set. For
an effect in no catalogue it is how far the data are from its nearest catalogue name.

The waveform is the plant's own, without noise; the rivals' columns are the fit's, in every shape of their grids.
"""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, replace
from pathlib import Path

import numpy as np

from benchmarks.attribution.judging import recordings_of
from benchmarks.attribution.making import DELAY, OF_THE_SIGNAL, BenchCase, place_of, undisturbed
from benchmarks.attribution.recipe import KINEMATIC, Selection, opened
from benchmarks.attribution.sight import FITTED, delayed
from benchmarks.attribution.verdicts import truth_vector
from fitting.arrays import FloatArray
from fitting.effects import effects
from fitting.loop.session import Session
from fitting.regression.design import NoiseModel, full_residual
from fitting.residual.scoring import Candidates, catalogue_terms
from fitting.residual.terms import Model, fit_model
from fitting.signals.spectrum import Whitening, whitening
from sim_backends.plant.cases import STEMS
from sim_backends.undeclared import EffectSpec

Tables = Mapping[str, Mapping[str, FloatArray]]

TELLABLE = 3.0


@dataclass(frozen=True)
class Rival:
    """An effect of the catalogue beside the true one: ``beyond`` is what of lambda it cannot explain."""

    id: str
    joint: str | None
    beyond: float


@dataclass(frozen=True)
class Apart:
    """Separability of a case.

    Attributes
    ----------
    seen : lambda in the noise that a fit is left with, positions' noise included
    rivals : catalogue effects on the true effect's joint (and of the whole machine), nearest first
    """

    seen: float
    rivals: tuple[Rival, ...]


def apart(case: BenchCase, selection: Selection) -> Apart | None:
    """Compute how far the true effect is from nothing, and from other names.

    None for cases with no effect, with two, and for those that only bend an encoder.
    """
    if len(case.effects) != 1 or case.effects[0].id in KINEMATIC:
        return None
    (true,) = case.effects
    _, plan, quality = opened(case.key, selection)
    recorded = {stem: plan.record(stem, (), quality)[0] for stem in STEMS}
    session = Session(case.machine, recordings_of(case.machine, recorded))
    quiet = undisturbed(quality) if true.id in OF_THE_SIGNAL else quality
    spec = EffectSpec(true.id, true.joint, true.size)
    ideal = [{stem: plan.record(stem, e, quiet)[1] for stem in FITTED} for e in ((spec,), ())]
    if true.id == DELAY and true.joint is not None:
        ideal[0] = delayed(case.machine, ideal[1], true.joint, true.size)
    model = _in_true_noise(session, case)
    model = replace(model, fit=replace(model.fit, residual=_waveform(model, list(recorded), ideal[0], ideal[1])))
    total = float(sum(part @ part for part in model.fit.residual))
    names = [joint.name for joint in case.machine.joints]
    joint = None if true.joint is None else names.index(true.joint)
    offered = [
        (term, grid)
        for term, grid in zip(*catalogue_terms(model, effects()), strict=True)
        if joint is None or term.joint == joint or term.everywhere
    ]
    best: dict[tuple[str, str | None], float] = {}
    for score in Candidates(model, [t for t, _ in offered], [g for _, g in offered]).scores(model).values():
        place = score.term.id, None if score.term.joint is None else names[score.term.joint]
        best[place] = max(best.get(place, 0.0), score.gain)
    found = [Rival(i, j, float(np.sqrt(max(total - gain, 0.0)))) for (i, j), gain in best.items()]
    return Apart(float(np.sqrt(total)), tuple(sorted(found, key=lambda rival: rival.beyond)))


def stored_apart(folder: Path | None, case: BenchCase, selection: Selection) -> Apart | None:
    """Read or compute a case's separability; kept beside a cached case until it is deleted there."""
    file = None if folder is None else place_of(folder, case.key, selection) / "apart.json"
    if file is not None and file.is_file():
        content = json.loads(file.read_text(encoding="utf-8"))
        return None if content is None else Apart(content["seen"], tuple(Rival(**r) for r in content["rivals"]))
    found = apart(case, selection)
    if file is not None:
        file.write_text(json.dumps(None if found is None else asdict(found), indent=1), encoding="utf-8")
    return found


def _in_true_noise(session: Session, case: BenchCase) -> Model:
    """Fit the base model with the noise that is left at the true parameters."""
    prepared = session.plain
    design, theta = prepared.design, truth_vector(case.machine, case.truth, prepared.design)

    def whitenings(loaded: bool) -> tuple[Whitening, ...]:
        own, joints = [i for i in prepared.fitted if design.segments[i].loaded == loaded], range(len(design.blocks))
        return tuple(whitening([full_residual(design, theta, j, i) for i in own], design.bank) for j in joints)

    noise = NoiseModel(whitenings(True), True, whitenings(False))
    return fit_model(design, noise, prepared.fitted, (), session.prior)


def _waveform(model: Model, stems: list[str], there: Tables, bare: Tables) -> tuple[FloatArray, ...]:
    """Compute the true effect in the rows of the fit, whitened, with the base projected out."""
    design, fit = model.design, model.fit
    parts = []
    for number, joint in enumerate(design.machine.joints):
        cylinder = joint.cylinder
        assert cylinder is not None
        rows = []
        for index in model.fitted:
            segment = design.segments[index]
            stem = stems[segment.recording]
            head, rod = (there[stem][f"{joint.name}.{c}"] - bare[stem][f"{joint.name}.{c}"] for c in _CHAMBERS)
            force = design.bank.trimmed(head * cylinder.head_area - rod * cylinder.rod_area)
            at = design.bank.trimmed(there[stem]["time"])
            force = force[(at > segment.t[0] - _CLOSE) & (at < segment.t[-1] + _CLOSE)]  # a part may have been left out
            rows.append(design.white(model.noise, number, index, design.bank.reduce(force)))
        white = np.concatenate(rows)
        parts.append(np.concatenate([white, np.zeros(len(fit.residual[number]) - len(white))]))  # a prior's rows
    shadow = sum(q.T @ part for q, part in zip(fit.orthonormal, parts, strict=True))
    return tuple(part - q @ shadow for q, part in zip(fit.orthonormal, parts, strict=True))


_CHAMBERS = ("head_pressure", "rod_pressure")
_CLOSE = 1e-6  # s
