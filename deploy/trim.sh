#!/bin/sh
# Leave out of an environment what no hilfit runs: tests and headers of libraries, drawing by OpenGL, all of
# Amazon's services but S3, and the solver of a vendor with a licence of its own that scs can do without.
set -eu
cd "$1"/lib/python3*/site-packages
find . -depth -type d -name tests -exec rm -rf {} +
rm -rf scs/_scs_mkl* scs/LICENSE-INTEL-MKL.txt mujoco/studio OpenGL pyarrow/include pyarrow/src
find botocore/data -mindepth 1 -maxdepth 1 -type d ! -name s3 ! -name sts ! -name 'sso*' -exec rm -rf {} +
