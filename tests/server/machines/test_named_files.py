"""Machine files from clients must not tell which files there are on the computer that serves."""

from __future__ import annotations

import json
from pathlib import Path

import pytest
import yaml

from daq.errors import MachineFileError
from server.machines.inspect_machine import look
from sim_backends import default_machine

BUSES = """
buses:
  - {name: can, type: canopen, interface: socketcan, channel: can0, listen_only: true, nodes: [{node: 5, eds: "%s"}]}
  - {name: engine, type: can_signals, interface: socketcan, channel: can1, dbc: ["%s"]}
"""


def machine_file(folder: Path, eds: str, dbc: str) -> Path:
    machine, _ = default_machine()
    plain = json.loads(machine.model_dump_json(by_alias=True, exclude_none=True))
    del plain["buses"]
    for channel in plain["channels"]:
        del channel["source"]
    path = folder / "sent.yaml"
    path.write_text(yaml.safe_dump(plain, sort_keys=False) + BUSES % (eds, dbc))
    return path


@pytest.mark.slow
@pytest.mark.parametrize("elsewhere", ["/etc/passwd.eds", "../other.eds", "sub/../../x.eds", r"..\\x.eds", "C:/x.eds"])
@pytest.mark.parametrize("kind", ["eds", "dbc"])
def test_paths_that_lead_elsewhere_are_refused_in_one_line(kind: str, elsewhere: str, tmp_path: Path) -> None:
    paths = {"eds": "encoder.eds", "dbc": "arm.dbc", kind: elsewhere}
    with pytest.raises(MachineFileError, match="outside the machine's own folder") as refused:
        look(machine_file(tmp_path, **paths), tmp_path / "out.json")
    line = str(refused.value)
    assert "\n" not in line
    assert ("node 5" in line) == (kind == "eds")
    assert not (tmp_path / "out.json").exists()


def test_the_refusal_does_not_tell_whether_a_file_exists(tmp_path: Path) -> None:
    there = tmp_path / "there.eds"
    there.write_text("")
    answers = []
    for path in (there, tmp_path / "missing.eds"):
        with pytest.raises(MachineFileError) as refused:
            look(machine_file(tmp_path, str(path), "arm.dbc"), tmp_path / "out.json")
        answers.append(str(refused.value))
    assert answers[0] == answers[1]


def test_names_beside_the_machine_file_are_taken(tmp_path: Path) -> None:
    assert look(machine_file(tmp_path, "encoder.eds", "dbc/arm.dbc"), tmp_path / "out.json") == {"name": "folding-arm"}
