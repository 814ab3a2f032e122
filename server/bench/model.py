"""The model outside its report: exports against it, C's time beside Pinocchio, and what the 95 % band is worth.

Arms are simulated here: a folding arm of six cylinders with links, friction and a position-dependent friction that are
known, recorded with noise. The same numbers are asked of measured machines by ``--measured``.
"""

from __future__ import annotations

import ctypes
import shutil
import subprocess
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt

from daq.machine_file import Machine
from daq.recording import Recording
from fitting.base_parameters import base_regressor
from fitting.model import motion
from fitting.model.arm_model import ArmModel
from fitting.model.codec import load_model
from fitting.model.export import export_model
from fitting.model.export.c import identifier, states
from fitting.model.export.tracing import Tracer
from fitting.model.prediction import load_recording, predict
from server.bench.targets import Check, Outcome

FloatArray = npt.NDArray[np.float64]

#: Strictest settings under which the C has to compile without a word.
STRICT = ("-std=c99", "-pedantic", "-Wall", "-Wextra", "-Wconversion", "-Wdouble-promotion", "-Werror")
_CALLS = 200_000
_TIMER = """
#include "{name}.h"
#include <stddef.h>
void many(const double *rows, size_t count, size_t times, double *sum);
void many(const double *rows, size_t count, size_t times, double *sum)
{{
    size_t k;
    double tau[{n}];
    for (k = 0; k < times; ++k) {{
        const double *row = rows + (k % count) * {width};
        {name}_inverse_dynamics(row, row + {n}, row + {n2}, 0.0, tau);
        *sum += tau[0];
    }}
}}
"""
