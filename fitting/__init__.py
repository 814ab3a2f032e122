"""Identification of hydraulically driven arms: kinematics, dynamics, both stages, excitation, and the residual loop.

=====================  =====================================================================================
``geometry linkage dynamics base_parameters``   the arm: Denavit-Hartenberg table to base-parameter regressor
``motion excitation``                           motion files and their design
``signals preparation``                         recordings to smooth motion and measured effort
``drive regression noise prior``                the one linear regression, its noise, what is known before
``estimators``                                  estimators that can be plugged in
``cylinder_stage rigid_body_stage``             stages 1 and 2, and the one-shot regression
``effects residual loop``                       the catalogue, and the loop that chooses from it
``session stages results report``               one identification, stage by stage, and its report
=====================  =====================================================================================

Everything here is small matrices: one BLAS thread is fastest, and two processes with two threads each on two cores spend
most of their time waiting for one another. So, unless the environment says otherwise, BLAS is asked for one thread
before numpy is loaded.
"""

import os

for _variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(_variable, "1")
del _variable

from fitting.session import Options, Request  # noqa: E402
from fitting.stages import STAGES, identify, run_stage  # noqa: E402

__all__ = ["STAGES", "Options", "Request", "identify", "run_stage"]
