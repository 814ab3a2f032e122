"""Files, secrets and certificates of a service: for nobody else to read, and never on a command line."""

from __future__ import annotations

import json
import os
import ssl
import stat
import subprocess
import sys
from datetime import UTC, datetime, timedelta
from pathlib import Path

import httpx2
import pytest
from cryptography import x509
from cryptography.hazmat.primitives import hashes
from service_fakes import API, MACHINE

from server.access.pairing import pairing_url
from server.commands.command_line import main
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.platform.settings import Settings, load_settings
from server.platform.tls import LIFETIME, certificate

SCRIPT = Path(__file__).parents[1] / "serve_with_fakes.py"
NOW = datetime(2026, 3, 1, tzinfo=UTC)


def open_to_others(root: Path) -> list[str]:
    return [str(path) for path in (root, *root.rglob("*")) if stat.S_IMODE(path.lstat().st_mode) & 0o077]


@pytest.mark.slow
def test_over_tls_with_a_self_signed_certificate_and_private_files(tmp_path: Path, csv: bytes) -> None:
    data_dir, log = tmp_path / "data", (tmp_path / "server.log").open("wb")
    environment = os.environ | {"HILFIT_TLS": "self-signed"}
    command = [sys.executable, str(SCRIPT), str(data_dir)]
    with log, subprocess.Popen(command, stdout=subprocess.PIPE, stderr=log, env=environment, umask=0o022) as process:
        try:
            assert process.stdout is not None
            url = json.loads(process.stdout.readline())["url"]
            assert url.startswith("https://")
            context = ssl.create_default_context(cafile=str(data_dir / "tls" / "site.crt"))
            with httpx2.Client(base_url=url, verify=context, timeout=30) as client:
                assert client.get("/healthz").json() == {"status": "ok"}
                client.post(f"{API}/machines", content=MACHINE)
                query = {"machine": "lever", "role": "train", "name": "made.csv"}
                assert client.post(f"{API}/recordings/upload", params=query, content=csv).status_code == 201
                assert client.post(f"{API}/backups").status_code == 201
                # From this computer, too, nobody is believed who says for whom they ask.
                forwarded = {"X-Forwarded-For": "192.0.2.1", "X-Forwarded-Proto": "http"}
                made = client.post(f"{API}/access/pairing-codes", json={"role": "viewer"}, headers=forwarded).json()
                certificate_of = x509.load_pem_x509_certificate((data_dir / "tls" / "site.crt").read_bytes())
                fingerprint = certificate_of.fingerprint(hashes.SHA256()).hex()
                assert made["url"] == f"{url}/#pair={made['code']}&sha256={fingerprint}"
                wrong = {"code": "0000000000", "name": "x"}
                answers = [
                    client.post(
                        f"{API}/access/pair", json=wrong, headers={"X-Forwarded-For": f"192.0.2.{n}"}
                    ).status_code
                    for n in range(8)
                ]
                assert answers.count(429) >= 2, answers
                noted = client.get(f"{API}/audit", params={"action": "access.pair_failed"}).json()["items"]
                assert {entry["subject"] for entry in noted} == {"127.0.0.1"}
            assert open_to_others(data_dir) == []
        finally:
            process.terminate()
            process.wait(30)


def test_a_directory_that_others_could_read_is_made_private(tmp_path: Path) -> None:
    (tmp_path / "data" / "recordings").mkdir(parents=True)
    (tmp_path / "data" / "recordings" / "old.parquet").write_bytes(b"")
    (tmp_path / "data" / "recordings" / "old.parquet").chmod(0o644)
    (tmp_path / "data").chmod(0o755)  # whatever mask an earlier command left in this process
    DataDirectory(tmp_path / "data")
    assert open_to_others(tmp_path / "data") == []


@pytest.mark.parametrize("command", [["backup"], ["worker"], ["restore", "x"], ["access", "pair"]])
def test_a_password_on_the_command_line_is_refused(command: list[str], capsys: pytest.CaptureFixture[str]) -> None:
    with pytest.raises(SystemExit) as ended:
        main([*command, "--database-url", "postgresql://hilfit:secret@host/name"])
    assert ended.value.code == 2
    (line,) = capsys.readouterr().err.splitlines()
    assert "HILFIT_DATABASE_PASSWORD_FILE" in line
    assert "secret@" not in line


def test_a_password_comes_from_a_file(tmp_path: Path) -> None:
    secret = tmp_path / "password"
    secret.write_text("p@ss/word\n")
    settings = load_settings(database_url="postgresql://hilfit@host/name", database_password_file=secret)
    assert settings.full_database_url == "postgresql://hilfit:p%40ss%2Fword@host/name"
    with pytest.raises(StartError, match="database_password_file"):
        _ = settings.model_copy(update={"database_password_file": tmp_path / "none"}).full_database_url


def site(tmp_path: Path, **settings: object) -> Settings:
    return Settings(data_dir=tmp_path, **{"tls": "self-signed", **settings})  # type: ignore[arg-type]


def test_the_self_made_certificate_is_kept_until_it_ends_or_names_change(tmp_path: Path) -> None:
    files = DataDirectory(tmp_path)
    first = certificate(site(tmp_path), files, lambda: NOW)
    assert first is not None and first.self_made
    assert stat.S_IMODE(first.key.stat().st_mode) == 0o600
    assert certificate(site(tmp_path), files, lambda: NOW + timedelta(days=300)) == first
    renewed = certificate(site(tmp_path), files, lambda: NOW + LIFETIME)
    named = certificate(site(tmp_path, public_hosts=("arm.example:8350",)), files, lambda: NOW + LIFETIME)
    assert renewed is not None and named is not None
    assert len({first.fingerprint, renewed.fingerprint, named.fingerprint}) == 3
    found = x509.load_pem_x509_certificate(named.path.read_bytes())
    names = found.extensions.get_extension_for_class(x509.SubjectAlternativeName).value
    assert "arm.example" in names.get_values_for_type(x509.DNSName)
    assert pairing_url("https://arm.example", "0123456789", "ab").endswith("#pair=0123456789&sha256=ab")


@pytest.mark.parametrize("wrong", ["no key", "no file", "other key", "no pem"])
def test_a_certificate_that_cannot_be_used_is_one_line(tmp_path: Path, wrong: str) -> None:
    made = [certificate(site(tmp_path / name), DataDirectory(tmp_path / name), lambda: NOW) for name in "ab"]
    assert made[0] is not None and made[1] is not None
    cert, key = made[0].path, made[0].key
    given = {
        "no key": (cert, None),
        "no file": (tmp_path / "none", key),
        "other key": (cert, made[1].key),
        "no pem": (cert, Path(__file__)),
    }[wrong]
    settings = Settings(data_dir=tmp_path, tls_cert=given[0], tls_key=given[1])
    with pytest.raises(StartError, match="--tls-") as refusal:
        certificate(settings, DataDirectory(tmp_path), lambda: NOW)
    assert "\n" not in str(refusal.value)


def test_a_given_certificate_needs_no_fingerprint(tmp_path: Path) -> None:
    made = certificate(site(tmp_path), DataDirectory(tmp_path), lambda: NOW)
    assert made is not None
    given = Settings(data_dir=tmp_path, tls_cert=made.path, tls_key=made.key)
    found = certificate(given, DataDirectory(tmp_path), lambda: NOW)
    assert found is not None and not found.self_made
    assert given.public_url(8350).startswith("https://")
