# The service and its workers in one image; which of them runs is the command. Nothing in it runs as root.
ARG BASE=docker.io/library/python:3.11-slim-bookworm@sha256:a36c24f9cbdf4fd0f52d67f0823eeac19c2028c637cecc392d97f980d4fec56b
FROM ${BASE} AS build
WORKDIR /source
COPY locks/image.txt locks/image.txt
COPY deploy/trim.sh deploy/trim.sh
RUN apt-get update \
 && apt-get install --yes --no-install-recommends binutils \
 && python -m venv /opt/hilfit \
 && /opt/hilfit/bin/pip install --no-cache-dir --disable-pip-version-check --require-hashes -r locks/image.txt \
 && deploy/trim.sh /opt/hilfit \
 && /opt/hilfit/bin/python -c "import asammdf, asyncua, cantools, mujoco, paho.mqtt.client, pyarrow.parquet, s3fs, scipy.optimize"
COPY pyproject.toml README.md LICENSE ./
COPY daq daq
COPY fitting fitting
COPY hilfit hilfit
COPY server server
COPY sim_backends sim_backends
RUN /opt/hilfit/bin/pip install --no-cache-dir --disable-pip-version-check --no-deps --no-build-isolation . \
 && cd /opt/hilfit/lib/python3*/site-packages \
 && rm -rf pip* setuptools* pkg_resources _distutils_hack distutils-precedence.pth

# For backups, without the package's Perl; Debian 12 has PostgreSQL 15, like the database of docker-compose.yml.
FROM ${BASE} AS clients
RUN apt-get update \
 && apt-get install --yes --no-install-recommends postgresql-client-15

FROM ${BASE}
RUN apt-get update \
 && apt-get install --yes --no-install-recommends libpq5 \
 && rm -rf /var/lib/apt/lists/* \
 && useradd --system --uid 10001 --create-home --home-dir /data hilfit \
 && install --directory --owner hilfit --mode 700 /storage /backups
COPY --from=clients /usr/lib/postgresql/15/bin/pg_dump /usr/lib/postgresql/15/bin/pg_restore /usr/lib/postgresql/15/bin/
COPY --from=build /opt/hilfit /opt/hilfit
ENV PATH=/opt/hilfit/bin:$PATH PYTHONUNBUFFERED=1 HILFIT_DATA_DIR=/data
USER hilfit
WORKDIR /data
VOLUME /data /storage /backups
EXPOSE 8350
STOPSIGNAL SIGTERM
CMD ["hilfit", "serve", "--host", "0.0.0.0"]
