"""docker-compose.yml and Dockerfile: nothing runs as root, everything is watched, every setting exists."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

import pytest
import yaml

from server.commands.command_line import PARTS, load_commands
from server.platform.settings import Settings

TOP = Path(__file__).parents[2]
#: Licences of the images, looked up by a person; a new image needs an entry here.
IMAGES = {"docker.io/library/postgres": "PostgreSQL", "docker.io/prom/prometheus": "Apache-2.0", "hilfit": "Apache-2.0"}
COMPOSE: dict[str, Any] = yaml.safe_load((TOP / "docker-compose.yml").read_text())
DOCKERFILE = (TOP / "Dockerfile").read_text()
SERVICES = COMPOSE["services"]


def test_the_services_are_database_server_two_workers_and_prometheus() -> None:
    assert set(SERVICES) == {"database", "server", "worker-1", "worker-2", "prometheus"}
    assert "--simulate" in SERVICES["server"]["command"]


@pytest.mark.parametrize("name", SERVICES)
def test_a_container_is_watched_has_a_known_image_and_does_not_run_as_root(name: str) -> None:
    service = SERVICES[name]
    assert service["healthcheck"]["test"][0] == "CMD"
    name_and_tag, _, digest = service["image"].partition("@sha256:")
    assert name_and_tag.rpartition(":")[0] in IMAGES
    assert bool(re.fullmatch("[0-9a-f]{64}", digest)) or name_and_tag == "hilfit:local", "images are named by digest"
    assert service["read_only"] is True
    assert service["cap_drop"] == ["ALL"]
    assert service["security_opt"] == ["no-new-privileges:true"]
    assert service["mem_limit"] and service["pids_limit"]
    if service["image"].startswith("hilfit:"):
        before, _, after = DOCKERFILE.partition("\nUSER hilfit\n")
        assert after
        assert "\nUSER " not in before + after
    else:
        assert service["user"] not in ("root", "0")


@pytest.mark.parametrize("name", ["server", "worker-1", "worker-2"])
def test_commands_options_and_settings_exist(name: str) -> None:
    service = SERVICES[name]
    program, command, *options = service["command"]
    assert program == "hilfit"
    (part,) = [part for part in PARTS if command in part.commands]
    known = {option for parameter in load_commands(part)[command].params for option in parameter.opts}
    assert {option for option in options if option.startswith("--")} <= known
    settings = {key.removeprefix("HILFIT_").lower() for key in service["environment"]}
    assert settings <= set(Settings.model_fields)
    if command == "worker":
        assert options == ["--name", name]
        assert f"/tmp/hilfit/lock-worker-{name}" in service["healthcheck"]["test"][-1]


def test_images_of_the_build_are_named_by_digest() -> None:
    (base,) = re.findall(r"^ARG BASE=(\S+)", DOCKERFILE, re.MULTILINE)
    assert re.search("@sha256:[0-9a-f]{64}$", base)
    assert set(re.findall(r"^FROM (\S+)", DOCKERFILE, re.MULTILINE)) == {"${BASE}"}


def test_secrets_are_files_and_nowhere_else() -> None:
    assert set(COMPOSE["secrets"]) == {secret for service in SERVICES.values() for secret in service.get("secrets", [])}
    assert all(list(secret) == ["file"] for secret in COMPOSE["secrets"].values())
    for name, service in SERVICES.items():
        for key, value in service.get("environment", {}).items():
            if "PASSWORD" in key or "SECRET" in key or "KEY" in key:
                assert key.endswith("_FILE") and value.startswith("/run/secrets/"), (name, key)
        url = service.get("environment", {}).get("HILFIT_DATABASE_URL", "")
        assert not re.search("//[^/@]*:[^@]+@", url), "no password in a URL"
        assert not any("assword" in word for word in service.get("command", []))
    assert "secrets/" in (TOP / ".gitignore").read_text().splitlines()


def test_settings_can_be_read(monkeypatch: pytest.MonkeyPatch) -> None:
    for key, value in SERVICES["server"]["environment"].items():
        monkeypatch.setenv(key, re.sub(r"\$\{\w+:[-?]([^}]*)\}", r"\1", value))
    settings = Settings()
    assert (settings.access, settings.local_jobs) == ("required", False)
    assert settings.public_hosts == ("localhost", "server")


def test_pg_dump_is_of_the_version_of_the_database() -> None:
    version = SERVICES["database"]["image"].partition("@")[0].rpartition(":")[2].partition("-")[0]
    assert f" /usr/lib/postgresql/{version}/bin/pg_dump " in DOCKERFILE


def test_prometheus_gets_a_configuration_that_can_be_read() -> None:
    (source,) = (volume.split(":")[0] for volume in SERVICES["prometheus"]["volumes"] if volume.startswith("./"))
    content = yaml.safe_load((TOP / source).read_text())
    assert "configs" not in COMPOSE, "a container whose root is read-only takes none"
    (job,) = content["scrape_configs"]
    assert job["static_configs"] == [{"targets": ["server:8350"]}]
    assert job["authorization"]["credentials_file"] == "/run/secrets/metrics_key"


def test_the_server_s_own_commands_know_what_it_serves() -> None:
    """What is an option of its command line only is not known to `docker compose exec server hilfit access pair`."""
    assert SERVICES["server"]["command"] == ["hilfit", "serve", "--simulate"]
    assert {"HILFIT_TLS", "HILFIT_HOST", "HILFIT_PUBLIC_HOSTS", "HILFIT_BACKUP_DIR"} <= set(
        SERVICES["server"]["environment"]
    )


@pytest.mark.parametrize("name", SERVICES)
def test_signals_are_handed_on_and_logs_end(name: str) -> None:
    assert SERVICES[name]["init"] is True
    assert {"max-size", "max-file"} <= set(SERVICES[name]["logging"]["options"])


def test_a_worker_shares_no_folder_with_the_server_but_the_storage() -> None:
    volumes = {name: {entry.split(":")[0] for entry in SERVICES[name]["volumes"]} for name in ("server", "worker-1")}
    assert volumes["worker-1"] == {"storage"}
    assert volumes["server"] == {"data", "backups", "storage"}


def test_the_image_has_every_extra_that_a_service_can_use() -> None:
    (line,) = (line for line in (TOP / "Makefile").read_text().splitlines() if line.startswith("EXTRAS_image"))
    assert {"sim", "postgresql", "export", "dbc", "xacro", "s3", "mqtt", "opcua"} <= set(line.split())
