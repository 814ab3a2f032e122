"""One BLAS thread for this process and those that it starts: processor times mean something then."""

from __future__ import annotations

import os

_THREADS = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


def one_blas_thread() -> None:
    """Call it before numpy is loaded; processes that are started later have it anyway."""
    for variable in _THREADS:
        os.environ[variable] = "1"
