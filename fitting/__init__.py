"""Identification of hydraulically driven arms: kinematics, dynamics, both stages, excitation, and the residual loop.

==============  ====================================================================================================
``arrays``      types of arrays
``arm``         Denavit-Hartenberg table, linkages, dynamics, base parameters
``signals``     filters, recordings to smooth motion and measured effort, spectra
``regression``  the one linear regression: rows, drive, noise, priors, what is determined; hours from a file
``estimators``  estimators that can be plugged in
``effects``     the catalogue, one file each
``residual``    views, terms, scores, replicas, spectral lines, changes in time: what evidence is made of
``selection``   priors, evidence, search, gate, probabilities
``excitation``  motions and their design (as files: :mod:`daq.motion_files`)
``planning``    what a motion will show: forecast, detection limits, the next experiment
``checks``      mistakes in files and wiring
``report``      the report and its figures
``loop``        the loop on recordings: session, kinematics, attribution, long recordings
``model``       what an identification hands over: evaluated, stored, exported
``valve``       command to speed of each axis, its effects, its inverse
``pipeline``    the stages, their program, the verdict
``commands``    the commands of identification
==============  ====================================================================================================

A room imports only those above it; a contract in ``pyproject.toml`` states the order.

Everything here is small matrices: one BLAS thread is fastest, and two processes with two threads each on two cores
spend most of their time waiting for one another. So, unless the environment states otherwise, BLAS is asked for one
thread before numpy is loaded.
"""

import os
from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from fitting.loop.session import Options, Request
    from fitting.pipeline.stages import identify, run_stage

from fitting.pipeline.stage_names import STAGES

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
del _variable

__all__ = ["STAGES", "Options", "Request", "identify", "run_stage"]

_HOMES = {
    "Options": "fitting.loop.session",
    "Request": "fitting.loop.session",
    "identify": "fitting.pipeline.stages",
    "run_stage": "fitting.pipeline.stages",
}


def __getattr__(name: str) -> Any:
    """Load the public names when they are first asked for: a server names stages without loading numerics."""
    if name in _HOMES:
        return getattr(import_module(_HOMES[name]), name)
    raise AttributeError(f"module 'fitting' has no attribute '{name}'")
