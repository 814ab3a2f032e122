"""What all tests share."""

import os

# One BLAS thread per process, before numpy is loaded: tests run side by side on two cores.
for variable in ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS"):
    os.environ.setdefault(variable, "1")
