"""``hilfit doctor``: what it says of computers that are not as they should be, each with what to do."""

from __future__ import annotations

import json
import os
from pathlib import Path

import pytest
from service_fakes import MACHINE

from server.commands import command_line as cli
from server.commands import doctor_command as probes


def interface(root: Path, name: str, *, up: bool, kind: str = "280") -> None:
    """A network interface as the kernel shows it; 280 is a CAN controller's type (linux/if_arp.h)."""
    (root / name).mkdir(parents=True)
    (root / name / "type").write_text(f"{kind}\n")
    (root / name / "flags").write_text("0x1\n" if up else "0x0\n")


def test_can_interfaces_that_are_there_down_or_missing(tmp_path: Path) -> None:
    interface(tmp_path, "can0", up=True)
    interface(tmp_path, "can1", up=False)
    interface(tmp_path, "eth0", up=True, kind="1")
    lines = {line.text: line for line in probes.can_interfaces(tmp_path)}
    assert lines["can0 is up"].level == "ok"
    assert lines["can1 is down"].level == "note" and "ip link set can1 up" in lines["can1 is down"].do
    assert len(lines) == 2
    wanted = list(probes.can_interfaces(tmp_path, {"can1": "boom", "can7": "crane"}))
    assert {line.text for line in wanted if line.level == "problem"} == {
        "can1 is down",
        "can7, of bus 'crane', is not there",
    }


def test_a_computer_without_can_is_no_problem(tmp_path: Path) -> None:
    assert [line.level for line in probes.can_interfaces(tmp_path)] == ["note"]


def test_variables_that_nothing_reads_are_named_with_the_right_ones() -> None:
    known = {"HILFIT_EXCITE_SEED": "--seed of 'hilfit excite'", "HILFIT_PORT": "the service"}
    lines = list(probes.environment({"HILFIT_SEED": "1", "HILFIT_PORT": "1", "PATH": "/"}, known))
    assert [(line.level, line.do) for line in lines] == [("ok", ""), ("problem", "write HILFIT_EXCITE_SEED")]


def test_a_data_directory_that_others_can_read(tmp_path: Path) -> None:
    place = tmp_path / "data"
    place.mkdir()
    place.chmod(0o755)
    line = probes.data_directory(place)
    assert line.level == "note" and line.do == f"chmod 700 {place}"
    place.chmod(0o700)
    assert probes.data_directory(place).level in ("ok", "note")
    assert "others" not in probes.data_directory(place).text


def test_a_file_in_the_place_of_the_data_directory(tmp_path: Path) -> None:
    (tmp_path / "data").write_text("")
    assert probes.data_directory(tmp_path / "data").level == "problem"


@pytest.mark.parametrize("class_asked", [os.SCHED_OTHER if hasattr(os, "SCHED_OTHER") else 0])
def test_asking_for_real_time_leaves_the_caller_as_it_was(class_asked: int) -> None:
    before = os.sched_getscheduler(0)
    line = probes.scheduling()
    assert os.sched_getscheduler(0) == before == class_asked
    assert line.level == "ok" or "rtprio" in line.do


def test_refused_real_time_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(1, "Operation not permitted")

    monkeypatch.setattr("os.sched_setscheduler", refuse)
    line = probes.scheduling()
    assert line.level == "note" and "CAP_SYS_NICE" in line.do


def test_asking_for_precedence_leaves_the_caller_as_it_was() -> None:
    before = os.getpriority(os.PRIO_PROCESS, 0)
    line = probes.precedence()
    assert os.getpriority(os.PRIO_PROCESS, 0) == before
    assert line.level == "ok" or "LimitNICE" in line.do


def test_refused_precedence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError(13, "Permission denied")

    monkeypatch.setattr("os.setpriority", refuse)
    monkeypatch.setattr("os.getpriority", lambda *_: 0)  # whatever ran in this process before
    line = probes.precedence()
    assert line.level == "note" and "LimitNICE=-10" in line.do and "--ulimit nice=30" in line.do


def test_a_library_that_is_too_new_is_a_problem(monkeypatch: pytest.MonkeyPatch) -> None:
    real = probes.version
    monkeypatch.setattr(probes, "version", lambda name: "99.0" if name == "numpy" else real(name))
    problems = [line for line in probes.libraries() if line.level == "problem"]
    assert len(problems) == 1
    assert problems[0].text.startswith("numpy: is 99.0") and problems[0].do.startswith("pip install 'numpy")


def test_every_note_and_problem_says_what_to_do(
    capsys: pytest.CaptureFixture[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HILFIT_DANCE", "1")
    with pytest.raises(SystemExit) as ended:
        cli.main(["doctor", "--data-dir", str(tmp_path), "--json"])
    said = json.loads(capsys.readouterr().out)
    assert ended.value.code == 1 and not said["ready"]
    assert all(line["do"] for line in said["lines"] if line["level"] != "ok")
    topics = {line["topic"].split()[0] for line in said["lines"]}
    assert topics >= {
        "program",
        "libraries",
        "extra",
        "environment",
        "data",
        "shared",
        "scheduling",
        "precedence",
        "CAN",
        "time",
    }


def test_a_machine_whose_interface_is_not_there(capsys: pytest.CaptureFixture[str], tmp_path: Path) -> None:
    text = MACHINE.replace("interface: virtual", "interface: socketcan")
    path = tmp_path / "machine.yaml"
    path.write_text(text)
    with pytest.raises(SystemExit) as ended:
        cli.main(["doctor", str(path), "--data-dir", str(tmp_path / "data")])
    out = capsys.readouterr().out
    assert ("interface: socketcan" in text) == ("is not there" in out) == (ended.value.code == 1)
    assert "is not there" in out


def test_where_uploaded_machines_may_go_is_said() -> None:
    assert "nowhere" in probes.bus_places(()).text
    assert probes.bus_places(("can:socketcan:can0", "tcp:192.0.2.0/24:502")).text.endswith(
        "can:socketcan:can0, tcp:192.0.2.0/24:502"
    )


def test_where_webhooks_may_go_is_said() -> None:
    assert probes.webhook_places(()).text == "webhooks may be delivered to nowhere"
    places = ("https://erp.example", "http://192.0.2.7")
    assert probes.webhook_places(places).text.endswith("https://erp.example, http://192.0.2.7")
