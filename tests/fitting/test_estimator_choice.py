"""The option `--estimator`: found, fit for the arm, or refused in one line."""

from __future__ import annotations

import json
import sys
from importlib.metadata import EntryPoint
from pathlib import Path
from types import ModuleType

import numpy as np
import pytest
from synthetic_arm import clean_session, planar_machine, truth

from daq.errors import InputError
from daq.seams import ESTIMATORS
from fitting.arm.base_parameters import reduce_parameters
from fitting.arm.geometry import geometry_of
from fitting.estimators import Estimator, estimator, estimator_ids
from fitting.estimators.conformance import check_estimator
from fitting.loop.session import Options
from fitting.pipeline.cylinder_stage import identify_cylinders
from fitting.pipeline.stage_two import Choice, chosen, identify_rigid_body, refit_rigid_body

IDS = ("ols", "possible", "ridge", "wls")


def choice(options: Options) -> Choice:
    machine = planar_machine(2)
    return chosen(options, reduce_parameters(machine), geometry_of(machine))


@pytest.mark.slow
def test_all_registered_estimators_load_and_conform() -> None:
    assert set(IDS) <= set(estimator_ids())
    for name in estimator_ids():
        found = estimator(name)
        assert found.name == name
        check_estimator(found)


def test_the_joint_refit_is_the_default_and_no_plug_in() -> None:
    found = choice(Options())
    assert found.name == "gls" and found.estimator is None and found.colour == "hac"


@pytest.mark.parametrize(
    ("options", "says"),
    [
        (Options(estimator="lad"), "there is no estimator 'lad'; use one of gls, ols, possible, ridge, wls"),
        (Options(covariance="grey"), "there is no covariance 'grey'; use one of hac, bootstrap, white"),
        (Options(estimator="ridge"), "needs a prior"),
        (Options(estimator="ridge", prior="nowhere.yaml"), "nowhere.yaml: cannot be read"),
    ],
)
def test_a_choice_that_cannot_be_is_refused_in_one_line(options: Options, says: str) -> None:
    with pytest.raises(InputError) as caught:
        choice(options)
    assert says in str(caught.value) and "\n" not in str(caught.value)


def test_a_prior_that_nobody_would_use_is_refused(tmp_path: Path) -> None:
    base = reduce_parameters(planar_machine(2))
    entries = [{"expression": e, "value": 1.0, "std": 0.1} for e in base.expressions]
    path = tmp_path / "report.json"
    path.write_text(json.dumps({"schema": "hilfit/report/1", "rigid_body": {"parameters": entries}}), encoding="utf-8")
    assert choice(Options(estimator="ridge", prior=str(path))).prior is not None
    with pytest.raises(InputError, match=r"report\.json: a prior is used by"):
        choice(Options(prior=str(path)))


def plug_in(monkeypatch: pytest.MonkeyPatch, value: str) -> None:
    point = EntryPoint("mine", value, ESTIMATORS.group)
    monkeypatch.setattr("daq.seams.entry_points", lambda group: (point,))


def test_a_plug_in_is_used_without_asking_anything_of_it(monkeypatch: pytest.MonkeyPatch) -> None:
    from fitting.estimators import OrdinaryLeastSquares

    class Mine:
        name = "mine"
        fit = OrdinaryLeastSquares().fit

    module = ModuleType("a_plug_in_of_mine")
    module.Mine = Mine  # type: ignore[attr-defined]
    monkeypatch.setitem(sys.modules, "a_plug_in_of_mine", module)
    plug_in(monkeypatch, "a_plug_in_of_mine:Mine")
    found = choice(Options(estimator="mine")).estimator
    assert found is not None
    design = clean_session(2).plain.design
    cylinders = identify_cylinders(design, clean_session(2).plain.noise, clean_session(2).prior)
    one, other = identify_rigid_body(design, cylinders, found), identify_rigid_body(design, cylinders)
    assert one.estimator == "mine" and np.array_equal(one.theta, other.theta)


@pytest.mark.parametrize(
    ("value", "says"),
    [("no_such_module:X", "cannot be loaded"), ("pathlib:Path", "is no fitting.estimators.base.Estimator")],
)
def test_a_broken_plug_in_is_one_clear_line(monkeypatch: pytest.MonkeyPatch, value: str, says: str) -> None:
    plug_in(monkeypatch, value)
    with pytest.raises(InputError, match=says) as caught:
        choice(Options(estimator="mine"))
    assert "'mine'" in str(caught.value) and "\n" not in str(caught.value)


# --- stage 2 with each --------------------------------------------------------------------------------------------


@pytest.mark.slow
@pytest.mark.parametrize("name", [i for i in IDS if i != "ridge"])
@pytest.mark.parametrize("final", [False, True], ids=["stage-2", "refit"])
def test_each_estimator_recovers_the_base_parameters_within_its_deviations(name: str, final: bool) -> None:
    session = clean_session(2)
    design, fit = session.plain.design, session.base_model.fit
    own: Estimator = estimator(name)
    if final:
        found = refit_rigid_body(design, fit.theta, fit.covariance, own)
    else:
        found = identify_rigid_body(design, identify_cylinders(design, session.plain.noise, session.prior), own)
    base = design.parameters.base_slice
    assert found.estimator == name and found.determined.all()
    z = (found.theta - truth(2).theta(session.machine))[base] / found.std[base]
    # Six parameters that hang together: a root mean square above 2.2 has a chance below one in a thousand.
    assert np.sqrt(np.mean(z**2)) < 2.2


def test_what_was_frozen_adds_to_the_deviations() -> None:
    session = clean_session(2)
    design, fit = session.plain.design, session.base_model.fit
    with_, without = (
        refit_rigid_body(design, fit.theta, factor * fit.covariance, estimator("wls")) for factor in (1.0, 0.0)
    )
    base = design.parameters.base_slice
    assert np.array_equal(with_.theta, without.theta)
    assert (with_.std[base] > without.std[base]).all()
    # On top, not instead: variances add, and four times the frozen covariance adds four times as much.
    four = refit_rigid_body(design, fit.theta, 4.0 * fit.covariance, estimator("wls"))
    added = with_.std[base] ** 2 - without.std[base] ** 2
    assert four.std[base] ** 2 - without.std[base] ** 2 == pytest.approx(4.0 * added, rel=1e-9)


def test_the_joint_fits_own_deviations_come_back_from_its_parts() -> None:
    # Generalised least squares, block by block: var(base) = var(base | drive) + G var(drive) G'. The weights here are
    # those of white residuals, so the two agree only roughly: the frozen part must be of the right size.
    session = clean_session(2)
    design, fit = session.plain.design, session.base_model.fit
    base = design.parameters.base_slice
    found = refit_rigid_body(design, fit.theta, fit.covariance, estimator("wls"))
    ratio = found.std[base] / fit.std[base]
    assert 0.7 < np.median(ratio) < 2.0
