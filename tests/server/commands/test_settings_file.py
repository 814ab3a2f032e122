"""``hilfit serve --config FILE``: what is read, what counts more, and what is refused with one line."""

from __future__ import annotations

from pathlib import Path

import pytest

from server.platform.errors import StartError
from server.platform.settings import load_settings, refuse_open_host


@pytest.fixture
def file(tmp_path: Path) -> Path:
    path = tmp_path / "hilfit.yaml"
    path.write_text("access: required\nport: 9000\npublic_hosts: [hilfit.example]\n")
    return path


def test_a_file_sets_what_it_names(file: Path) -> None:
    settings = load_settings(file)
    assert (settings.access, settings.port, settings.public_hosts) == ("required", 9000, ("hilfit.example",))
    assert settings.host == "127.0.0.1"


def test_the_environment_counts_more_and_the_command_line_most(file: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILFIT_PORT", "9001")
    assert load_settings(file).port == 9001
    assert load_settings(file, port=9002).port == 9002
    assert load_settings(file).access == "required"


def test_an_empty_file_changes_nothing(tmp_path: Path) -> None:
    path = tmp_path / "empty.yaml"
    path.write_text("# nothing yet\n")
    assert load_settings(path) == load_settings()


@pytest.mark.parametrize(
    ("text", "says"),
    [
        ("acess: required\n", "acess: is no setting; known are access, "),
        ("access: maybe\n", "access: "),
        ("port: many\n", "port: "),
        ("- access\n", "has to hold 'name: value' lines, found list"),
        ("access: [\n", "is not YAML"),
        ("port: .nan\n", "port: must be a finite number (found nan)"),
        ("public_hosts: 3\n", "public_hosts: must be a list (found 3)"),
        ("bus_places: [ttyUSB0]\n", "bus_places: 'ttyUSB0' is no place; write can:socketcan:can0, serial:/dev/ttyUSB0"),
    ],
)
def test_a_wrong_file_is_one_line_with_file_and_key(tmp_path: Path, text: str, says: str) -> None:
    path = tmp_path / "hilfit.yaml"
    path.write_text(text)
    with pytest.raises(StartError) as refused:
        load_settings(path)
    assert str(refused.value).startswith(f"{path}: {says}")
    assert "\n" not in str(refused.value)


def test_a_file_that_is_not_there(tmp_path: Path) -> None:
    with pytest.raises(StartError, match="cannot be read"):
        load_settings(tmp_path / "none.yaml")


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_loopback_needs_no_access_control(host: str) -> None:
    refuse_open_host(load_settings(host=host))


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.4", "example.org", ""])
def test_a_host_beyond_loopback_needs_access_control(host: str) -> None:
    with pytest.raises(StartError, match="access control is off"):
        refuse_open_host(load_settings(host=host))
    refuse_open_host(load_settings(host=host, access="required"))


def test_the_address_for_others() -> None:
    assert load_settings(host="10.0.0.7").public_url(8350) == "http://10.0.0.7:8350"
    assert load_settings(host="::1").public_url(8350) == "http://[::1]:8350"
    assert load_settings(public_hosts=("arm.example",)).public_url(8350) == "http://arm.example:8350"
    assert load_settings(public_hosts=("arm.example:80",)).public_url(8350) == "http://arm.example:80"
