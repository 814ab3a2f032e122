"""``deploy/hilfit.service``: what it starts exists, how open it is, and that the documentation says so."""

from __future__ import annotations

import re
import shutil
import subprocess
from pathlib import Path

import pytest

from server.commands.command_line import PARTS, load_commands
from server.platform.processes.precedence import NICENESS

ROOT = Path(__file__).parents[2]
UNIT = ROOT / "deploy" / "hilfit.service"
LINES = [line for line in UNIT.read_text().splitlines() if "=" in line and not line.startswith("#")]
SETTINGS = [tuple(line.split("=", 1)) for line in LINES]
#: Most that `systemd-analyze security` may find open, of 10: a service that is on the network and at serial adapters.
MOST = 2.0


def values(name: str) -> list[str]:
    return [value for key, value in SETTINGS if key == name]


def test_the_command_and_its_options_exist() -> None:
    (command,) = values("ExecStart")
    program, name, *rest = command.split()
    assert program.endswith("/bin/hilfit")
    (part,) = [part for part in PARTS if name in part.commands]
    known = {option for parameter in load_commands(part)[name].params for option in parameter.opts}
    assert {option for option in rest if option.startswith("--")} <= known
    assert values("RestartPreventExitStatus") == ["2"]


def test_acquisition_may_have_what_it_needs() -> None:
    assert {"AF_CAN", "AF_INET", "AF_INET6", "AF_UNIX"} <= set(values("RestrictAddressFamilies")[0].split())
    assert {value.split()[0] for value in values("DeviceAllow")} >= {"char-ttyUSB", "char-ttyACM", "char-ttyS"}
    assert values("LimitNICE") == [str(NICENESS)]
    assert int(values("LimitRTPRIO")[0]) >= 10
    calls = " ".join(values("SystemCallFilter"))
    for name in ("landlock_create_ruleset", "landlock_add_rule", "landlock_restrict_self"):
        assert name in calls
    assert values("PrivateDevices") == values("PrivateNetwork") == []


@pytest.mark.skipif(
    shutil.which("systemd-analyze") is None, reason="there is no systemd-analyze: apt-get install systemd"
)
def test_how_open_it_is_stands_in_the_documentation() -> None:
    command = ["systemd-analyze", "security", "--offline=yes", "--no-pager", str(UNIT)]
    done = subprocess.run(command, capture_output=True, text=True, check=True)
    assert "ignoring" not in done.stderr, done.stderr
    (found,) = re.findall(r"Overall exposure level for hilfit.service: ([0-9.]+)", done.stdout)
    assert float(found) <= MOST
    text = (ROOT / "docs" / "operation.md").read_text()
    (said,) = re.findall(r"exposure level of ([0-9.]+)", text)
    assert abs(float(said) - float(found)) <= 0.3, "versions of systemd count a little differently"
