"""Identification of hydraulically driven arms: kinematics, dynamics, both stages, excitation, and the residual loop.

=====================  =====================================================================================
``geometry linkage dynamics base_parameters``   the arm: Denavit-Hartenberg table to base-parameter regressor
``motion excitation``                           motion files and their design
``signals preparation``                         recordings to smooth motion and measured effort
``drive regression noise prior``                the one linear regression, its noise, what is known before
``estimators``                                  estimators that can be plugged in
``cylinder_stage rigid_body_stage stage_two``   stages 1 and 2, and the one-shot regression
``estimator_choice instruments body_prior``     which estimator stage 2 uses, and what it needs
``comparison flags``                            two stages against one; parameters that are poorly determined
``effects residual loop``                       the catalogue, and the loop that chooses from it
``stored streamed long_rows``                   recordings of hours: from a file, segment by segment
``search_pieces everything sharper``            the loop on those: on which pieces, and held against everything
``session stages results report``               one identification, stage by stage, and its report
``model``                                       what it hands over: evaluated, stored, exported
=====================  =====================================================================================

Everything here is small matrices: one BLAS thread is fastest, and two processes with two threads each on two cores
spend most of their time waiting for one another. So, unless the environment says otherwise, BLAS is asked for one
thread before numpy is loaded.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fitting.session import Options, Request
    from fitting.stages import identify, run_stage

from fitting.stage_names import STAGES

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
del _variable

__all__ = ["STAGES", "Options", "Request", "identify", "run_stage"]

_HOMES = {
    "Options": "fitting.session",
    "Request": "fitting.session",
    "identify": "fitting.stages",
    "run_stage": "fitting.stages",
}


def __getattr__(name: str) -> Any:
    """Load the public names when they are first asked for: a server names stages without loading numerics."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'fitting' has no attribute '{name}'")
