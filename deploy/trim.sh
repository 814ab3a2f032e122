#!/bin/sh
# Leave out of an environment what no hilfit runs: tests and headers of libraries, what debuggers read, drawing by OpenGL,
# Arrow's own ways over the network, and all of Amazon's services but S3.
set -eu
cd "$1"/lib/python3*/site-packages
find . -depth -type d -name tests -exec rm -rf {} +
rm -rf mujoco/studio OpenGL pyarrow/include pyarrow/src pyarrow/*flight* pyarrow/*s3*
find botocore/data -mindepth 1 -maxdepth 1 -type d ! -name s3 ! -name sts ! -name 'sso*' -exec rm -rf {} +
# Not what auditwheel has changed, which stands in *.libs.
find . -name '*.so*' ! -path '*.libs/*' -exec strip --strip-debug {} +
