"""The ``hilfit`` command: help, version, exit codes, one-line errors, options from the environment."""

from __future__ import annotations

import json
import socket
import subprocess
import sys
from collections.abc import Callable
from importlib.metadata import version
from pathlib import Path

import pytest
from service_fakes import MACHINE

from daq.errors import AcquisitionError, InputError
from daq.without_mdf4 import PROGRAMS
from server.access.access_desk import Access
from server.audit.audit_resource import Audit
from server.commands import command_line as cli
from server.composition.declarations import TABLES
from server.platform.database.engine import Database
from server.platform.errors import StartError
from server.platform.files import DataDirectory
from server.platform.settings import load_settings

Run = Callable[..., tuple[int, str, str]]


@pytest.fixture
def run(capsys: pytest.CaptureFixture[str]) -> Run:
    def call(*arguments: str) -> tuple[int, str, str]:
        with pytest.raises(SystemExit) as ended:
            cli.main(arguments)
        output = capsys.readouterr()
        code = ended.value.code
        return (code if isinstance(code, int) else 0), output.out, output.err

    return call


def test_version_is_that_of_the_distribution(run: Run) -> None:
    assert run("--version") == (0, f"hilfit {version('hilfit')}\n", "")


def test_help_lists_the_commands(run: Run) -> None:
    code, out, _ = run("--help")
    assert code == 0
    for part in cli.PARTS:
        for command in part.commands:
            assert f" {command} " in out


def test_another_distribution_adds_a_command_by_its_entry_point(
    run: Run, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    (tmp_path / "weigh_arm.py").write_text(
        "def register(app):\n    app.command('weigh')(lambda: print('12 kg'))\n    app.command('demo')(lambda: None)\n"
    )
    info = tmp_path / "arm_tools-1.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Metadata-Version: 2.1\nName: arm-tools\nVersion: 1\nSummary: Weighs an arm.\n")
    (info / "entry_points.txt").write_text("[hilfit.commands]\nweigh = weigh_arm\ndemo = weigh_arm\n")
    monkeypatch.syspath_prepend(tmp_path)
    _, out, _ = run("--help")
    assert "Weighs an arm." in out and out.count(" demo ") == 1 and "The whole job on a simulated machine" in out
    assert run("weigh") == (0, "12 kg\n", "")


def test_the_benchmarks_are_such_a_command_in_a_checkout(run: Run) -> None:
    _, out, _ = run("--help")
    assert "Benchmarks with targets: how right, how fast." in out
    assert {"bench"} == {name for part in cli.all_parts() for name in part.commands if part.module == "benchmarks.cli"}


@pytest.mark.parametrize("part", cli.PARTS, ids=lambda part: part.module)
def test_the_help_knows_the_commands_of_every_part(part: cli.Part) -> None:
    assert set(cli.load_commands(part)) == set(part.commands)


@pytest.mark.parametrize(
    "arguments", [["dance"], ["serve", "--prot", "1"], ["serve", "--port", "many"], ["identify"], ["effects", "show"]]
)
def test_wrong_usage_is_one_line_and_exit_code_2(run: Run, arguments: list[str]) -> None:
    code, out, err = run(*arguments)
    assert (code, out) == (2, "")
    assert err.startswith("hilfit: ") and err.count("\n") == 1
    assert "--help'" in err


def test_listening_for_other_computers_is_refused_with_one_line(run: Run, tmp_path: Path) -> None:
    code, out, err = run("serve", "--host", "0.0.0.0", "--data-dir", str(tmp_path))
    assert (code, out) == (2, "")
    assert err.startswith("hilfit: --host 0.0.0.0: is reachable from other computers")
    assert err.count("\n") == 1
    assert not list(tmp_path.iterdir())


def test_a_wrong_configuration_file_is_one_line_and_exit_code_2(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "hilfit.yaml"
    path.write_text("acces: required\n")
    code, out, err = run("serve", "--config", str(path))
    assert (code, out) == (2, "")
    assert err.startswith(f"hilfit: {path}: acces: is no setting") and err.count("\n") == 1


def test_a_file_s_host_counts_where_none_is_given(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "hilfit.yaml"
    path.write_text("host: 10.0.0.9\n")
    assert "10.0.0.9" in run("serve", "--config", str(path))[2]
    assert "10.0.0.8" in run("serve", "--config", str(path), "--host", "10.0.0.8")[2]


def test_pairing_at_the_computer_of_the_service(run: Run, tmp_path: Path) -> None:
    code, _, err = run("access", "pair", "--role", "admin", "--data-dir", str(tmp_path / "none"))
    assert code == 2 and "holds no store" in err
    assert not (tmp_path / "none").exists()
    Database(DataDirectory(tmp_path).database, TABLES, changed=lambda: None).close()
    code, out, err = run("access", "pair", "--role", "admin", "--data-dir", str(tmp_path), "--json")
    assert (code, err) == (0, "")
    made = json.loads(out)
    assert made["url"].endswith(f"/#pair={made['code']}")
    database = Database(DataDirectory(tmp_path).database, TABLES, changed=lambda: None)
    holder, _ = Access(database, Audit(database), required=True).pair(made["code"], "tablet")
    database.close()
    assert holder.role == "admin"
    assert run("access", "pair", "--role", "king", "--data-dir", str(tmp_path))[0] == 2


def test_a_port_that_is_taken_is_named(run: Run, tmp_path: Path) -> None:
    with socket.socket() as taken:
        taken.bind(("127.0.0.1", 0))
        taken.listen()
        port = str(taken.getsockname()[1])
        code, _, err = run("serve", "--port", port, "--data-dir", str(tmp_path))
    assert code == 2
    assert err.startswith(f"hilfit: --port {port}: cannot listen")


def test_the_environment_sets_every_option(run: Run, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILFIT_HOST", "10.0.0.1")
    code, _, err = run("serve")
    assert code == 2
    assert "--host 10.0.0.1" in err


def test_settings_come_from_the_environment_too(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("HILFIT_MAXIMUM_UPLOAD_BYTES", "1000")
    assert load_settings().maximum_upload_bytes == 1000
    monkeypatch.setenv("HILFIT_MAXIMUM_UPLOAD_BYTES", "lots")
    with pytest.raises(StartError, match=r"HILFIT_MAXIMUM_UPLOAD_BYTES: .* 'lots'"):
        load_settings()


@pytest.mark.parametrize(
    ("error", "code", "says"),
    [
        (InputError("a.yaml: is wrong"), 2, "hilfit: a.yaml: is wrong\n"),
        (AcquisitionError("the bus is gone"), 1, "hilfit: the bus is gone\n"),
        (
            ModuleNotFoundError("No module named 'mujoco'", name="mujoco"),
            2,
            "hilfit: this needs mujoco, which is not installed; run: pip install 'hilfit[sim]'\n",
        ),
    ],
)
def test_errors_become_one_line_and_an_exit_code(
    run: Run, monkeypatch: pytest.MonkeyPatch, error: Exception, code: int, says: str
) -> None:
    def fail(part: cli.Part) -> dict[str, object]:
        raise error

    monkeypatch.setattr(cli, "load_commands", fail)
    assert run("serve") == (code, "", says)


@pytest.fixture
def without_mujoco(monkeypatch: pytest.MonkeyPatch) -> None:
    """As installed without the extra: the module cannot be found, and nothing that needs it is loaded yet."""
    monkeypatch.setitem(sys.modules, "mujoco", None)
    for name in [name for name in sys.modules if name.partition(".")[0] == "sim_backends"]:
        monkeypatch.delitem(sys.modules, name)


@pytest.mark.usefixtures("without_mujoco")
def test_a_missing_extra_is_named_with_the_command_that_installs_it(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "machine.yaml"
    path.write_text(MACHINE)
    code, _, err = run("simulate", str(path))
    assert code == 2
    assert err == "hilfit: this needs mujoco, which is not installed; run: pip install 'hilfit[sim]'\n"


@pytest.mark.usefixtures("without_mujoco")
def test_what_needs_no_extra_works_without_it(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "machine.yaml"
    path.write_text(MACHINE)
    assert run("machine", "check", str(path))[0] == 0


def test_a_wrong_file_is_exit_code_2_and_one_line(run: Run, tmp_path: Path) -> None:
    path = tmp_path / "machine.yaml"
    path.write_text("schema: hilfit/machine/1\nnome: x\n")
    code, _, err = run("machine", "check", str(path))
    assert code == 2
    assert str(path) in err
    assert "Traceback" not in err


@pytest.mark.slow
def test_help_imports_nothing_heavy() -> None:
    heavy = ("numpy", "pyarrow", "pydantic", "scipy", "mujoco", "fastapi", "dbos", "matplotlib")
    code = (
        "import sys\nfrom server.commands.command_line import main\n"
        "try:\n    main(['--help'])\nexcept SystemExit: pass\n"
        f"print([name for name in {heavy} if name in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=60, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
def test_the_service_starts_without_what_only_its_children_need() -> None:
    heavy = ("scipy", "mujoco", "matplotlib", "asammdf", "mcap")
    code = "import sys, server.composition.serve, server.composition.declarations\n"
    code += f"print([name for name in {heavy} if name in sys.modules])"
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, timeout=250, check=True)
    assert done.stdout.splitlines()[-1] == "[]"


@pytest.mark.slow
@pytest.mark.parametrize("program", PROGRAMS)
def test_what_talks_to_a_bus_starts_without_what_reads_files(program: str) -> None:
    command = [sys.executable, "-X", "importtime", "-m", program]  # told nothing, it ends when it has loaded
    done = subprocess.run(command, capture_output=True, text=True, timeout=250, stdin=subprocess.DEVNULL)
    loaded = {line.rpartition("|")[2].strip() for line in done.stderr.splitlines() if "|" in line}
    assert "can.io.mf4" in loaded
    assert not loaded & {"asammdf.mdf", "pandas", "scipy"}
