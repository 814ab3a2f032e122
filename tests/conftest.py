"""What all tests share."""

import os

from hypothesis import HealthCheck, settings

# One BLAS thread per process, before numpy is loaded: tests run side by side on two cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")

# The same examples in every run, and none fails because the computer was busy.
settings.register_profile(
    "hilfit", derandomize=True, database=None, deadline=None, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("hilfit")
